# SPDX-License-Identifier: Apache-2.0
"""What `calibrate` says of walls that look like mirrors, and what its fit does to such a map.

    python benchmarks/mirrors.py --bench ../shared/data/sonar_bench
    python benchmarks/mirrors.py udacity.npz A0.npz R0.npz
    python benchmarks/mirrors.py --bench ../shared/data/sonar_bench --maps

Prints a line of the table for each log, noise only unless --all is given: of --bench, seed 0 of
each case, of which E6 alone has walls that mirror. The fit starts from default rates and from the
cone width and the range that a log states. With --maps E6 is mapped with three sensors, and the
maps are compared with the truth: log loss on the scored cells, and on those that a map calls
observed. (examples/udacity.py and tof8x8.py make the logs; A0 and R0 are in 3D.)
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.sonar_accuracy import CASES, RESOLUTION, load_cases
from oddsmap import ConeSensor, Scan, build_full_map, calibrate, evaluate, open_log
from oddsmap.scoring.calibration import Calibration
from oddsmap.sensors.registry import stated_of_sensor

_STATED = ("cone_deg", "range_max")
_FITTED = ("cone_deg", "detection", "p_dropout", "p_random", "sigma")


def tell(name: str, scans: Iterable[Scan], sensor: ConeSensor, everything: bool) -> Calibration:
    """Calibrate, and print the line of a log."""
    started = time.process_time()
    found = calibrate(scans, RESOLUTION, sensor=sensor, noise_only=not everything)
    taken = time.process_time() - started
    mirrors = found.mirrors
    assert mirrors is not None
    which = "all parameters" if everything else "noise only"
    print(
        f"| {name}, {which} | {mirrors.correlation:.2f} | {mirrors.dropouts:.3f} | "
        f"{mirrors.head_on:.2f} | {mirrors.aslant:.2f} | {'yes' if mirrors.warning else 'no'} | "
        f"{taken:.0f} s |",
        flush=True,
    )
    return found


def compare_maps(folder: Path, everything: bool) -> None:
    """Map E6 with default, calibrated and the benchmarks' rates."""
    case = load_cases(folder, "E6")[0]
    default = ConeSensor(**{name: case.sensor[name] for name in _STATED})
    found = tell("E6", case.scans, default, everything).sensor
    assert isinstance(found, ConeSensor)
    sensors = {"default": default, "calibrated": found, "benchmarks'": ConeSensor(**case.sensor)}
    print(f"\n| E6, seed 0: rates | {' | '.join(_FITTED)} | scored | observed |\n{'|---' * 8}|")
    for name, sensor in sensors.items():
        full_map = build_full_map(case.scans, RESOLUTION, sensor=sensor)
        p, observed = case.of(full_map)
        losses = [evaluate(p, case.truth, mask).log_loss for mask in (case.scored, observed)]
        rates = " | ".join(f"{getattr(sensor.forward_model(), rate):.3g}" for rate in _FITTED)
        print(f"| {name} | {rates} | {losses[0]:.4f} | {losses[1]:.4f} |", flush=True)


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("logs", type=Path, nargs="*")
    parser.add_argument("--bench", type=Path, help="the sonar_bench folder")
    parser.add_argument("--maps", action="store_true", help="of --bench, compare maps of E6 alone")
    parser.add_argument("--all", action="store_true", help="fit cone width and detection as well")
    given = parser.parse_args()
    print(f"| log | correlation | dropouts | head on | aslant | warns | CPU |\n{'|---' * 7}|")
    if given.bench is not None and given.maps:
        compare_maps(given.bench, given.all)
    elif given.bench is not None:
        for name in CASES:
            case = load_cases(given.bench, name)[0]
            sensor = ConeSensor(**{key: case.sensor[key] for key in _STATED})
            tell(name, case.scans, sensor, given.all)
    for path in given.logs:
        log = open_log(path)
        said = stated_of_sensor(log)
        sensor = ConeSensor(**{key: said[key] for key in _STATED})
        tell(path.stem, list(log), sensor, given.all)


if __name__ == "__main__":
    main()
