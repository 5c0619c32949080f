# SPDX-License-Identifier: Apache-2.0
"""What limits a build on many workers: costs measured in this process, and a prediction of them.

    python benchmarks/dask_model.py                       # half a minute of CPU, and the tables
    python benchmarks/dask_model.py --json costs.json     # keeps the costs
    python benchmarks/dask_model.py --costs costs.json    # the tables alone
    python benchmarks/dask_model.py --runs result.json    # beside what dask_build.py has measured

The tasks that workers run (`map_chunk`, `write_group`) are run here, on 400 m of the street of
`street_log.py` at 0.1 m, and their CPU time is taken, which other programs on the machine change
little. The model adds up what a worker does, one after the other: computing, and waiting for the
store. One scheduler and one store let only so much through; each phase takes as long as the slowest
of these.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.slow_store import AT_ONCE
from benchmarks.street_log import street_log
from oddsmap import BeamSensor
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.stored_tiles import Form
from oddsmap.kernels.units import ONE
from oddsmap.scale.answers import Refusal
from oddsmap.scale.chunk_task import Chunk, PartRef, map_chunk
from oddsmap.scale.group_tasks import Given, write_group
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
        parts: their number, of a kilometre.
        parts_end: likewise, for each end of a chunk.
        mb_map: of a kilometre in the map.
        files: of a kilometre in the map.
        groups: of a kilometre.
        write_s: CPU of adding up and writing a MB of parts, whose type has to be changed [s].
        write_as_is_s: the same where it stays.
        task_s: of the scheduler, for each task [s].
    """

    map_s: float
    mb_read: float
    mb_parts: float
    mb_parts_end: float
    parts: float
    parts_end: float
    mb_map: float
    files: float
    groups: float
    write_s: float
    write_as_is_s: float
    task_s: float


@dataclass(frozen=True)
class Cluster:
    """What is assumed of a cluster.

    Args:
        workers: threads that map.
        worker_mb_s: between a worker and the store.
        request_s: that a worker waits for the store, beside that, each time it asks [s].
        scan_mb_s: between a worker and the logs.
        scan_s: that a worker waits for a scan's file, beside that [s].
        store_mb_s: of the store, to all workers together.
        store_requests_s: writes of the store in a second.
        chunk_scans: scans in a chunk, one a metre.
    """

    workers: int
    worker_mb_s: float = 100.0
    request_s: float = 0.02
    scan_mb_s: float = 100.0
    scan_s: float = 0.02
    store_mb_s: float = 5000.0
    store_requests_s: float = 3500.0
    chunk_scans: float = 2000.0


def measure(log: Path, task_s: float) -> Costs:
    """Run the tasks of a build one after the other."""
    versions = versions_here()
    empty = Evidence(0.1, ndim=3)
    km = SCANS / 1000
    counts, sizes = [], []
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
            counts.append(sum(len(parts) for parts in groups.values()))
            sizes.append(sum(p.length for parts in groups.values() for p in parts) / 1e6)
        write_s = []
        # Parts are of bytes; long maps need two.
        for dtype in (np.uint8, np.uint16):
            forms = {name: Form(ONE, np.dtype(dtype)) for name in ("hits", "passes")}
            started = time.process_time()
            for parts in groups.values():
                at = (0, 0, 0)
                write_group(versions, place, Given(parts, 3), (), forms, at, "map", "parts")
            write_s.append((time.process_time() - started) / sizes[-1])
        files = [path for path in Path(folder, "map").rglob("*") if path.is_file()]
        mb_map = sum(path.stat().st_size for path in files) / 1e6
    ends = [2 * SCANS / size for size in CHUNKS]
    mb_end, parts_end = ((of[0] - of[1]) / (ends[0] - ends[1]) for of in (sizes, counts))
    return Costs(
        map_s=map_s,
        mb_read=sum(path.stat().st_size for path in log.glob("*.pcd")) / SCANS / 1e6,
        mb_parts=(sizes[1] - ends[1] * mb_end) / km,
        mb_parts_end=mb_end,
        parts=(counts[1] - ends[1] * parts_end) / km,
        parts_end=parts_end,
        mb_map=mb_map / km,
        files=len(files) / km,
        groups=len(groups) / km,
        write_s=write_s[1],
        write_as_is_s=write_s[0],
        task_s=task_s,
    )


def predict(costs: Costs, km: float, cluster: Cluster) -> dict[str, dict[str, float]]:
    """How long each phase takes [s], by what could limit it."""
    scans, workers = 1000 * km, cluster.workers
    chunks = max(scans / cluster.chunk_scans, 1.0)
    mb_parts = costs.mb_parts * km + 2 * chunks * costs.mb_parts_end
    parts = costs.parts * km + 2 * chunks * costs.parts_end
    mb_map, groups, files = (costs.mb_map * km, costs.groups * km, costs.files * km)
    a_scan = costs.map_s + costs.mb_read / cluster.scan_mb_s + cluster.scan_s
    mapping = scans * a_scan + mb_parts / cluster.worker_mb_s + chunks * cluster.request_s
    # The last round of chunks keeps some workers waiting: half a chunk each, on average.
    idle = 0.5 * min(cluster.chunk_scans, scans / workers) * a_scan if workers > 1 else 0.0
    writing = mb_parts * costs.write_s + (mb_parts + mb_map) / cluster.worker_mb_s
    # Each group looks at the mark, then for its parts, and writes its files, some at a time.
    waits = 2 * groups + max(groups, (parts + files) / AT_ONCE)
    writing += waits * cluster.request_s
    return {
        "mapping": {
            "workers": mapping / min(workers, chunks) + idle,
            "store": (scans * costs.mb_read + mb_parts) / cluster.store_mb_s,
            "scheduler": chunks * costs.task_s,
        },
        "writing": {
            "workers": writing / min(workers, groups),
            "store": max(
                (mb_parts + mb_map) / cluster.store_mb_s, files / cluster.store_requests_s
            ),
            "scheduler": groups * costs.task_s,
        },
    }


def show(costs: Costs, km: float) -> None:
    """Tables: what there is to do, and how long it takes."""
    parts = costs.mb_parts * km + 2 * (1000 * km / 2000) * costs.mb_parts_end
    print(f"\n{km:g} km: {1000 * km:,.0f} scans, {1e-6 * 1000 * km * costs.mb_read:,.1f} TB read, ")
    print(f"{parts / 1e3:,.1f} GB of parts, a map of {costs.mb_map * km / 1e3:,.1f} GB in ")
    print(f"{costs.files * km:,.0f} files, {costs.groups * km:,.0f} groups\n")
    print("| workers | mapping | writing | together | limited by |")
    print("|---|---|---|---|---|")
    for workers in (1, 10, 100, 1000):
        phases = predict(costs, km, Cluster(workers))
        longest = {name: max(of.values()) for name, of in phases.items()}
        phase = max(longest, key=lambda name: longest[name])
        why = max(phases[phase], key=lambda name: phases[phase][name])
        cells = " | ".join(_time(seconds) for seconds in longest.values())
        total = _time(sum(longest.values()))
        print(f"| {workers:,} | {cells} | {total} | {phase}: {why} |")


def beside(costs: Costs, runs: Path) -> None:
    """What was measured on clusters here, and what the model says of them."""
    result = json.loads(runs.read_text())
    print("\n| | mapping [s], measured | model | writing [s], measured | model |")
    print("|---|---|---|---|---|")
    for name, row in result["medians"].items():
        if "chunks" not in row:
            continue
        cluster = Cluster(
            workers=int(row["workers"]),
            worker_mb_s=row["store_mb_s"] or float("inf"),
            request_s=row["store_request_s"],
            scan_mb_s=float("inf"),
            scan_s=0.0,
            chunk_scans=result["scans"] / row["chunks"],
        )
        short = replace(costs, write_s=costs.write_as_is_s)
        phases = predict(short, result["scans"] / 1000, cluster)
        cells = [
            f"{row[f'{phase}_wall_s']:.1f} | {max(phases[phase].values()):.1f}" for phase in phases
        ]
        print(f"| {name} | {' | '.join(cells)} |")


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
    parser.add_argument("--runs", type=Path, help="what dask_build.py --json has written")
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
    if options.runs:
        beside(costs, options.runs)
    show(costs, 10_000)


if __name__ == "__main__":
    main()
