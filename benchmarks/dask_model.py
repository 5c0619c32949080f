# SPDX-License-Identifier: Apache-2.0
"""What limits a build on many workers: costs measured in this process, and a prediction of them.

    python benchmarks/dask_model.py                       # half a minute of CPU, and the tables
    python benchmarks/dask_model.py --json costs.json     # keeps the costs
    python benchmarks/dask_model.py --costs costs.json    # the tables alone

The tasks that workers run (`map_chunk`, `add_group`, `write_group`) are run here, on 400 m of the
street of `street_log.py` at 0.1 m, and their CPU time is taken, which other programs on the machine
change little. The model adds up: work shared among workers, against what one scheduler and one
store let through; each phase takes as long as the slowest of these.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.street_log import street_log
from oddsmap import BeamSensor
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import ONE
from oddsmap.scale.answers import Refusal
from oddsmap.scale.chunk_task import Chunk, PartRef, map_chunk
from oddsmap.scale.group_tasks import GroupSum, Stored, add_group, write_group
from oddsmap.scale.log_source import LogSource
from oddsmap.scale.map_places import LocalPlace
from oddsmap.scale.marked_place import mark
from oddsmap.scale.worker_versions import versions_here

SCANS = 400
CHUNKS = (50, 200)


@dataclass(frozen=True)
class Costs:
    """What was measured; lengths are those of the drive.

    Args:
        map_s: CPU of reading, mapping and packing a scan [s].
        mb_read: of a scan's file.
        mb_parts: of parts, of a kilometre in chunks of one piece.
        mb_parts_end: of parts more, for each end of a chunk: what two chunks see.
        mb_map: of a kilometre in the map.
        files: of a kilometre in the map.
        groups: of a kilometre.
        add_s: CPU of adding up a MB of parts [s].
        write_s: CPU of writing a MB of map [s].
        task_s: of the scheduler, for each task [s].
    """

    map_s: float
    mb_read: float
    mb_parts: float
    mb_parts_end: float
    mb_map: float
    files: float
    groups: float
    add_s: float
    write_s: float
    task_s: float


@dataclass(frozen=True)
class Cluster:
    """What is assumed of a cluster.

    Args:
        workers: threads that map.
        worker_mb_s: between a worker and the store.
        store_mb_s: of the store, to all workers together.
        store_requests_s: writes of the store in a second.
        chunk_scans: scans in a chunk, one a metre.
    """

    workers: int
    worker_mb_s: float = 100.0
    store_mb_s: float = 5000.0
    store_requests_s: float = 3500.0
    chunk_scans: int = 2000


def measure(log: Path, task_s: float) -> Costs:
    """Run the tasks of a build one after the other."""
    versions = versions_here()
    empty = Evidence(0.1, ndim=3)
    km = SCANS / 1000
    parts_mb = {}
    with tempfile.TemporaryDirectory() as folder:
        place = LocalPlace(folder, "writing")
        mark(place, "parts")

        def mapped(number: int, first: int, past: int) -> dict[tuple[int, ...], PartRef]:
            source = LogSource("street", str(log), {})
            chunk = Chunk(number, source, SCANS, first, past, BeamSensor(), "rays", None)
            done = map_chunk(versions, chunk, empty, place, "parts")
            assert not isinstance(done, Refusal)
            return done.parts

        mapped(0, 0, 4)  # compiles, and opens the log
        for size in CHUNKS:
            groups: dict[tuple[int, ...], list[PartRef]] = {}
            started = time.process_time()
            for number, first in enumerate(range(0, SCANS, size)):
                for group, part in mapped(number, first, first + size).items():
                    groups.setdefault(group, []).append(part)
            map_s = (time.process_time() - started) / SCANS
            parts_mb[size] = sum(p.length for parts in groups.values() for p in parts) / 1e6
        started, sums = time.process_time(), []
        for parts in groups.values():
            found = add_group(versions, place, parts, (), 3)
            assert isinstance(found, GroupSum)
            sums.append(found)
        add_s = (time.process_time() - started) / parts_mb[size]
        stored = {name: Stored("uint16", ONE) for name in ("hits", "passes")}
        started = time.process_time()
        for each in sums:
            write_group(versions, each, stored, (0, 0, 0), place, "map", "parts")
        write_s = time.process_time() - started
        files = [path for path in Path(folder, "map").rglob("*") if path.is_file()]
        mb_map = sum(path.stat().st_size for path in files) / 1e6
    small, large = (parts_mb[size] for size in CHUNKS)
    ends = [2 * SCANS // size for size in CHUNKS]
    end = (small - large) / (ends[0] - ends[1])
    read = sum(path.stat().st_size for path in log.glob("*.pcd")) / SCANS / 1e6
    return Costs(
        map_s=map_s,
        mb_read=read,
        mb_parts=(large - ends[1] * end) / km,
        mb_parts_end=end,
        mb_map=mb_map / km,
        files=len(files) / km,
        groups=len(groups) / km,
        add_s=add_s,
        write_s=write_s / mb_map,
        task_s=task_s,
    )


def predict(costs: Costs, km: float, cluster: Cluster) -> dict[str, dict[str, float]]:
    """How long each phase takes [s], by what could limit it."""
    scans = 1000 * km
    chunks = max(scans / cluster.chunk_scans, 1.0)
    parts = costs.mb_parts * km + 2 * chunks * costs.mb_parts_end
    mb_map, groups, files = (costs.mb_map * km, costs.groups * km, costs.files * km)
    workers = cluster.workers
    wire = min(workers * cluster.worker_mb_s, cluster.store_mb_s)
    # The last round of chunks keeps some workers waiting: half a chunk each, on average.
    idle = 0.5 * min(cluster.chunk_scans, scans / workers) * costs.map_s
    return {
        "mapping": {
            "work": scans * costs.map_s / min(workers, chunks) + idle,
            "store": (scans * costs.mb_read + parts) / wire,
            "scheduler": chunks * costs.task_s,
        },
        "adding": {
            "work": parts * costs.add_s / min(workers, groups),
            "store": parts / wire,
            "scheduler": 2 * groups * costs.task_s,
        },
        "writing": {
            "work": mb_map * costs.write_s / min(workers, groups),
            "store": max(mb_map / wire, files / cluster.store_requests_s),
            "scheduler": groups * costs.task_s,
        },
    }


def show(costs: Costs, km: float) -> None:
    """Tables: what there is to do, and how long it takes."""
    parts = costs.mb_parts * km + 2 * (1000 * km / 2000) * costs.mb_parts_end
    print(f"\n{km:g} km: {1000 * km:,.0f} scans, {1e-6 * 1000 * km * costs.mb_read:,.1f} TB read, ")
    print(f"{parts / 1e3:,.1f} GB of parts, a map of {costs.mb_map * km / 1e3:,.1f} GB in ")
    print(f"{costs.files * km:,.0f} files, {costs.groups * km:,.0f} groups\n")
    print("| workers | mapping | adding | writing | together | limited by |")
    print("|---|---|---|---|---|---|")
    for workers in (1, 10, 100, 1000):
        phases = predict(costs, km, Cluster(workers))
        longest = {name: max(of.values()) for name, of in phases.items()}
        phase = max(longest, key=lambda name: longest[name])
        why = max(phases[phase], key=lambda name: phases[phase][name])
        cells = " | ".join(_time(seconds) for seconds in longest.values())
        total = _time(sum(longest.values()))
        print(f"| {workers:,} | {cells} | {total} | {phase}: {why} |")


def _time(seconds: float) -> str:
    for unit, size in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"


def main() -> None:
    """Measure, and predict."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=ROOT / "benchmarks" / ".cache")
    parser.add_argument("--costs", type=Path)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--task-ms", type=float, default=1.0, help="of the scheduler, for a task")
    options = parser.parse_args()
    if options.costs:
        costs = Costs(**json.loads(options.costs.read_text()))
    else:
        log = street_log(options.work / f"street-{SCANS}", SCANS, options.work)
        costs = measure(log, options.task_ms / 1e3)
    if options.json:
        options.json.write_text(json.dumps(asdict(costs), indent=1))
    print(json.dumps({name: float(f"{value:.4g}") for name, value in asdict(costs).items()}))
    for workers in (1, 2):
        small = replace(Cluster(workers), chunk_scans=75 * 2 // workers)
        phases = predict(costs, 0.6, small)
        total = sum(max(of.values()) for of in phases.values())
        print(f"600 scans, {workers} workers: {total:.1f} s ({total * workers:.1f} s of CPU)")
    show(costs, 10_000)


if __name__ == "__main__":
    main()
