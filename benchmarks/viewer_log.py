# SPDX-License-Identifier: Apache-2.0
"""A log in the page of `oddsmap view`: what reading it, a scan of it and a question cost.

    python benchmarks/viewer_log.py --data ../shared/data

Printed for each log: its scans and beams; CPU seconds to read it through for the page, and the peak
of memory that this adds; CPU seconds for the beams of a scan (a mean of 20) and for "why is this
cell so?" (the median of six cells); kilobytes that a file with the log has more. The third log is
the second 20 times over.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import EvidenceMap, build_map, open_log
from oddsmap.scans.log import Log
from oddsmap.viewer.journey import kept_beams, read_journey
from oddsmap.viewer.journey_payload import journey_payload
from oddsmap.viewer.questions import LogQuestions
from oddsmap.viewer.text import text_of
from oddsmap.witnesses.why import sensor_models

TIMES = 20


def repeated(folder: Path, to: Path) -> Path:
    """The scans of a folder with their poses, again and again."""
    scans = sorted(folder.glob("*.pcd"))
    for i in range(TIMES * len(scans)):
        (to / f"{i:06d}.pcd").symlink_to(scans[i % len(scans)].resolve())
    (to / "poses_kitti.txt").write_text(TIMES * (folder / "poses_kitti.txt").read_text())
    return to


def measure(name: str, log: Log, grid: EvidenceMap) -> None:
    """Print a line."""
    models = sensor_models(grid, log)
    questions = LogQuestions(grid, log, len(log))
    questions.scan("number=0")  # compiles
    memory = peak_mb()
    begun = time.process_time()
    journey = read_journey(log, models)
    read, memory = time.process_time() - begun, peak_mb() - memory
    begun = time.process_time()
    for i in range(20):
        questions.scan(f"number={i * len(log) // 20}")
    scan = (time.process_time() - begun) / 20
    index = grid.cells()[0]
    points = grid.centre_of(index[[i * len(index) // 7 for i in range(7)]]).tolist()
    times = []
    for point in points:
        begun = time.process_time()
        questions.why("at=" + ",".join(f"{x:.6f}" for x in point))
        times.append(time.process_time() - begun)
    beams = sum(scan.size for scan in log)
    kept = read_journey(log, models, beams=kept_beams(len(log)))
    size = len(text_of(journey_payload(kept, {}))) / 1000
    # The first question also compiles.
    print(
        f"{name:20} {journey.scan_count:4} scans {beams:11,} beams  read {read:6.3f} s, "
        f"{memory:4.1f} MB  scan {scan:.4f} s  why {statistics.median(times[1:]):.2f} s  "
        f"file {size:.0f} kB"
    )


def peak_mb() -> float:
    """The most memory so far [MB], on Linux."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Measure three logs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    data = parser.parse_args().data
    hall = data / "lidar3d" / "hall_os0"
    for path, resolution in ((data / "laser2d" / "intel-corrected.log.gz", 0.05), (hall, 0.1)):
        log = open_log(path)
        measure(path.name, log, build_map(log, resolution))
    with tempfile.TemporaryDirectory() as folder:
        log = open_log(repeated(hall, Path(folder)))
        measure(f"{hall.name}, {TIMES} times", log, build_map(log, 0.1))


if __name__ == "__main__":
    main()
