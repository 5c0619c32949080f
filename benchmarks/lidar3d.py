# SPDX-License-Identifier: Apache-2.0
"""Points per second, memory and file size in space: oddsmap beside OctoMap in the same run.

    python benchmarks/lidar3d.py                       # all of it, about eight minutes
    python benchmarks/lidar3d.py --quick               # fewer scans, one round: about one minute
    python benchmarks/lidar3d.py --work DIR --json result.json

The scans are those of a seeded town, written once to `--work`. Every answer is checked before any
time is taken. Contenders take turns, so that a busy machine slows all of them; times are medians.
"""

from __future__ import annotations

import argparse
import gc
import hashlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.lidar2d import machine, show
from benchmarks.peers import octomap_python
from benchmarks.peers.octomap_python import Cloud
from oddsmap import EvidenceMap, Pose3, Scan, build_map
from oddsmap.errors import OddsmapError
from oddsmap.kernels.units import ONE
from oddsmap.odds import logit
from oddsmap.scans.depth_image import DepthScan
from oddsmap.simulate import DepthCamera, Lidar3D, drive3d, room, room_walk, town
from tests.naive import mapping3d

SEED = 20240531
SCANS = 100
FRAMES = 60
DEPTH_RESOLUTION = 0.05
# Where a segment comes nearer than this [cells] to an edge of a cell, rounding decides.
EDGE = 1e-3
# A float32 coordinate, as OctoMap keeps them, is off by this at most [m] up to 64 m.
FLOAT32 = 4e-6

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]
Cell = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Effort:
    """How many scans a resolution gets: OctoMap takes ten minutes for all of them at 0.05 m.

    Args:
        resolution: side of a cell [m].
        timed: scans inserted in each round of timing, by both.
        kept: scans in the maps whose memory and files are measured, by both.
        whole: whether OctoMap, too, inserts the whole log, once.
    """

    resolution: float
    timed: int
    kept: int
    whole: bool


EFFORTS = (Effort(0.2, 20, 100, True), Effort(0.1, 6, 20, True), Effort(0.05, 2, 4, False))
QUICK = (Effort(0.2, 5, 10, False), Effort(0.1, 2, 2, False), Effort(0.05, 1, 1, False))


# ---- scans -----------------------------------------------------------------------------------


def town_scans(work: Path) -> Path:
    """100 scans of a 64 x 1024 lidar on a drive through the town: simulated, or kept from before.

    Returns:
        The file, named after what is in it.
    """
    world, lidar = town(SEED), Lidar3D()
    poses = drive3d(SCANS, ground=world.ground)

    def make() -> dict[str, npt.NDArray[Any]]:
        rng = np.random.default_rng(SEED)
        ranges = [lidar.scan(world, pose, rng).ranges for pose in poses]
        return {"ranges": np.stack(ranges).astype(np.float32)}

    return _write_once(work, "town", (world, lidar), poses, make)


def room_frames(work: Path) -> Path:
    """60 pictures of a 640 x 480 depth camera in the room: simulated, or kept from before."""
    world, camera, poses = room(), DepthCamera(), room_walk(FRAMES)

    def make() -> dict[str, npt.NDArray[Any]]:
        rng = np.random.default_rng(SEED)
        return {"depths": np.stack([camera.scan(world, pose, rng).depth for pose in poses])}

    return _write_once(work, "room", (world, camera), poses, make)


def _write_once(
    work: Path,
    name: str,
    what: object,
    poses: Sequence[Pose3],
    make: Callable[[], dict[str, npt.NDArray[Any]]],
) -> Path:
    matrices = np.stack([_matrix(pose) for pose in poses])
    digest = hashlib.sha256(f"{SEED} {what!r}".encode() + matrices.tobytes()).hexdigest()
    path = work / f"{name}-{digest[:12]}.npz"
    if not path.exists():
        work.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=work) as folder:
            half_written = Path(folder) / path.name
            np.savez(half_written, poses=matrices, **make())  # type: ignore[arg-type]
            half_written.replace(path)
    return path


def _matrix(pose: Pose3) -> FloatArray:
    return np.concatenate([pose.rotation, pose.translation[:, None]], axis=1)


def load_scans(path: Path, count: int) -> list[Scan]:
    """The first scans of the file; +Inf is no return and, with no range_max given, ignored."""
    directions = Lidar3D().directions
    with np.load(path) as file:
        rows = zip(file["poses"][:count], file["ranges"][:count], strict=True)
        return [Scan(Pose3.from_matrix(p), directions, r.astype(np.float64)) for p, r in rows]


def load_frames(path: Path, count: int) -> list[DepthScan]:
    """The first depth images of the file."""
    camera = DepthCamera().camera
    with np.load(path) as file:
        rows = zip(file["poses"][:count], file["depths"][:count], strict=True)
        return [DepthScan(Pose3.from_matrix(p), d, camera) for p, d in rows]


def cloud(scan: Scan) -> Cloud:
    """The end points of a scan's returns in the map frame, as OctoMap wants them."""
    pose = scan.map_from_sensor
    seen = np.isfinite(scan.ranges)
    points = pose.transform(scan.directions[seen] * scan.ranges[seen, None])
    return points, pose.translation


def statistics_of(scans: Sequence[Scan], resolution: float, sampled: int) -> dict[str, object]:
    """What decides how much work a map is."""
    clouds = [cloud(scan) for scan in scans]
    count = sum(len(points) for points, _ in clouds)
    ranges = np.concatenate([np.linalg.norm(points - origin, axis=1) for points, origin in clouds])
    visits = sum(
        int(np.abs(np.floor(points / resolution) - np.floor(origin / resolution)).sum())
        for points, origin in clouds
    )
    result: dict[str, object] = {
        "scans": len(scans),
        "returns": count,
        "returns a scan": count / len(scans),
        "mean range [m]": float(ranges.mean()),
        "median range [m]": float(np.median(ranges)),
        f"cell visits at {resolution} m": visits,
        "visits a ray": visits / count,
    }
    if octomap_python.available()[0]:
        few = clouds[:: max(1, len(clouds) // sampled)]
        known = [octomap_python.known_cells(octomap_python.insert([c], resolution)) for c in few]
        result["distinct updates a scan"] = statistics.mean(known)
        result["of that many scans"] = len(few)
    return result


# ---- answers ---------------------------------------------------------------------------------


def why_not(scans: Sequence[Any], **options: Any) -> str | None:
    """None where oddsmap can map such scans; else what it says."""
    try:
        build_map(scans[:1], 0.5, **options)
    except (OddsmapError, TypeError, NotImplementedError) as error:
        return f"NOT AVAILABLE: {error}"
    return None


def thinned(scan: Scan, every: int) -> Scan:
    """A scan with some of its beams."""
    return Scan(scan.map_from_sensor, scan.directions[::every], scan.ranges[::every])


def exact_states(scan: Scan, resolution: float) -> tuple[dict[Cell, bool], int]:
    """Each cell that exact arithmetic gives a vote: hit or not; and how many passes there were."""
    points, origin = cloud(scan)
    start = tuple((origin / resolution).tolist())
    hits: dict[Cell, bool] = {}
    passes = 0
    for end in (points / resolution).tolist():
        last = mapping3d.cell_of(end)
        cells = mapping3d.crossed(start, tuple(end)).keys() - {last}
        passes += len(cells)
        hits |= dict.fromkeys(cells - hits.keys(), False)
        hits[last] = True
    return hits, passes


def near_edge(scan: Scan, cell: Cell, resolution: float, margin: float) -> bool:
    """Whether a beam comes within the margin [cells] of an edge of a cell, or ends beside it."""
    points, origin = cloud(scan)
    start, ends = origin / resolution, points / resolution
    # Beams that come near the cell at all.
    way, to = ends - start, np.array(cell) + 0.5 - start
    share = np.clip((way @ to) / np.maximum((way * way).sum(axis=1), 1e-300), 0, 1)
    near = np.flatnonzero(np.linalg.norm(to - share[:, None] * way, axis=1) < 1.0)
    for i in near:
        one, other = tuple(start.tolist()), tuple(ends[i].tolist())
        if mapping3d.edge_distance(one, other, cell) <= margin:
            return True
        # An end of the beam on a face of the cell: rounding decides on which side of it that is.
        for point in (start, ends[i]):
            outside = np.abs(point - np.array(cell) - 0.5) - 0.5
            if outside.max() <= margin and np.abs(outside).min() <= margin:
                return True
    return False


def compare(
    name: str,
    ours: dict[Cell, bool],
    exact: dict[Cell, bool],
    scan: Scan,
    resolution: float,
    margin: float,
) -> dict[str, int]:
    """Count the cells in which a map differs from exact arithmetic, and how many rounding explains.

    Args:
        name: for messages.
        ours: the map's cells: hit or not.
        exact: likewise, exactly.
        scan: the beams.
        resolution: side of a cell [m].
        margin: how near to an edge rounding may decide [cells].
    """
    differing = [c for c in ours.keys() | exact.keys() if ours.get(c) != exact.get(c)]
    explained = sum(near_edge(scan, cell, resolution, margin) for cell in differing)
    return {
        "cells": len(exact),
        "only exact": sum(cell not in ours for cell in differing),
        f"only {name}": sum(cell not in exact for cell in differing),
        "other state": sum(cell in ours and cell in exact for cell in differing),
        "explained by rounding at an edge": explained,
        "unexplained": len(differing) - explained,
    }


def hit_cells(grid: EvidenceMap) -> dict[Cell, bool]:
    """Cells of a map of one scan: hit or not."""
    index, hits, _ = grid.cells()
    return dict(zip(map(tuple, index.tolist()), (hits > 0).tolist(), strict=True))


def check_exact(scans: Sequence[Scan], resolution: float, every: int, ready: bool) -> Any:
    """Hold both against exact rational arithmetic on some beams of some scans.

    oddsmap: a pass may differ within 1/1000 of a cell of an edge, 1 in 100,000; hits never.
    OctoMap keeps points in float32, and its ray caster may take the wrong way round an edge.
    """
    result: dict[str, object] = {}
    for i, scan in enumerate(thinned(scan, every) for scan in scans):
        exact, passes = exact_states(scan, resolution)
        entry: dict[str, object] = {"beams": len(cloud(scan)[0]), "passes": passes}
        if ready:
            ours = hit_cells(build_map([scan], resolution))
            entry["oddsmap"] = found = compare("oddsmap", ours, exact, scan, resolution, EDGE)
            wrong = sum(found[k] for k in ("only exact", "only oddsmap", "other state"))
            hits_differ = {c for c in exact if exact[c]} != {c for c in ours if ours[c]}
            if hits_differ or found["unexplained"] or wrong > max(1, passes * 1e-5):
                raise SystemExit(f"scan {i} at {resolution} m: oddsmap is not exact: {found}")
        if octomap_python.available()[0]:
            index, value = octomap_python.cells(octomap_python.insert([cloud(scan)], resolution))
            theirs = dict(zip(map(tuple, index.tolist()), (value > 0).tolist(), strict=True))
            margin = EDGE + FLOAT32 / resolution
            entry["OctoMap"] = compare("OctoMap", theirs, exact, scan, resolution, margin)
        result[f"scan {i}"] = entry
    return result


def check_octomap(scans: Sequence[Scan], resolution: float) -> dict[str, object]:
    """Known cells, states and log odds of whole scans, all beams, beside OctoMap's.

    OctoMap's p_hit 0.7 and p_miss 0.4; so few scans reach none of its clamps but the upper one.
    """
    tree = octomap_python.insert([cloud(scan) for scan in scans], resolution)
    index, theirs = octomap_python.cells(tree)
    grid = build_map(scans, resolution)
    cells, hits, passes = grid.cells()
    ours = (hits * float(logit(0.7)) + passes * float(logit(0.4))) / ONE
    lo = np.minimum(index.min(axis=0), cells.min(axis=0))
    span = np.maximum(index.max(axis=0), cells.max(axis=0)) - lo + 1
    mine = np.ravel_multi_index(tuple((cells - lo).T), tuple(span))
    other = np.ravel_multi_index(tuple((index - lo).T), tuple(span))
    _, at_mine, at_other = np.intersect1d(mine, other, assume_unique=True, return_indices=True)
    clamped = np.clip(ours[at_mine], float(logit(0.1192)), float(logit(0.971)))
    return {
        "scans": len(scans),
        "known to both": len(at_mine),
        "known to oddsmap alone": len(mine) - len(at_mine),
        "known to OctoMap alone": len(other) - len(at_mine),
        "same state [share]": float(((clamped > 0) == (theirs[at_other] > 0)).mean()),
        "same log odds [share]": float((np.abs(clamped - theirs[at_other]) < 1e-4).mean()),
    }


def check_threads(scans: Sequence[Scan], resolution: float) -> None:
    """Two threads must change no bit."""
    one, two = (build_map(scans, resolution, threads=n).cells() for n in (1, 2))
    if not all(np.array_equal(a, b) for a, b in zip(one, two, strict=True)):
        raise SystemExit(f"one and two threads differ at {resolution} m")


# ---- times -----------------------------------------------------------------------------------

Contender = Callable[[], tuple[float, float]]


def in_turns(
    contenders: dict[str, Contender], points: int, scans: int, rounds: int, once: Set[str]
) -> dict[str, dict[str, float]]:
    """Rates [M points/s] by CPU and by wall time, medians over the rounds; some run but once."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in contenders}
    for turn in range(rounds):
        for name, run in contenders.items():
            if turn > 0 and name in once:
                continue
            gc.collect()
            taken[name].append(run())
    return {
        name: {
            "M points/s of CPU time": points / statistics.median(c for c, _ in times) / 1e6,
            "M points/s of wall time": points / statistics.median(w for _, w in times) / 1e6,
            "ms of CPU time a scan, least": 1e3 * min(c for c, _ in times) / scans,
        }
        for name, times in taken.items()
    }


def our_times(scans: Sequence[Any], resolution: float, **options: Any) -> Contender:
    """CPU time of all of `build_map`, and its own wall time of integration."""

    def run() -> tuple[float, float]:
        started = time.process_time()
        report = build_map(scans, resolution, **options).report
        cpu = time.process_time() - started
        assert report is not None
        return cpu, report.integrate_s

    return run


def measure(
    contenders: dict[str, Contender],
    points: int,
    scans: int,
    rounds: int,
    once: Set[str] = frozenset(),
) -> Any:
    """Time contenders; ratios are of CPU time to OctoMap, and two threads to one of wall time."""
    speed = in_turns(contenders, points, scans, rounds, once)
    result: dict[str, Any] = {"scans": scans, "points": points, **speed}
    if "OctoMap" in speed:
        theirs = speed["OctoMap"]["M points/s of CPU time"]
        ratios = {
            name: entry["M points/s of CPU time"] / theirs
            for name, entry in speed.items()
            if name != "OctoMap" and not name.endswith("threads")
        }
        result |= {"x OctoMap": ratios} if ratios else {}
    if "oddsmap, 2 threads" in speed:
        key = "M points/s of wall time"
        result["2 threads x 1"] = speed["oddsmap, 2 threads"][key] / speed["oddsmap"][key]
    return result


def measure_lidar(
    scans: Sequence[Scan], resolution: float, rounds: int, ready: bool, theirs: int
) -> Any:
    """Speed of the lidar's scans; OctoMap takes part in all rounds, in the first or in none."""
    clouds = [cloud(scan) for scan in scans] if theirs else []
    contenders: dict[str, Contender] = {}
    if ready:
        contenders["oddsmap"] = our_times(scans, resolution)
        contenders["oddsmap, 2 threads"] = our_times(scans, resolution, threads=2)
    if theirs and octomap_python.available()[0]:
        contenders["OctoMap"] = lambda: octomap_python.seconds(clouds, resolution)
    return measure(
        contenders, _returns(scans), len(scans), rounds, {"OctoMap"} if theirs == 1 else set()
    )


def measure_camera(frames: Sequence[DepthScan], rounds: int) -> Any:
    """Speed of the depth camera's frames, by projection and by rays."""
    scans = [frame.to_scan() for frame in frames]
    clouds = [cloud(scan) for scan in scans]
    contenders: dict[str, Contender] = {}
    missing = {}
    for method, readings in (("projective", frames), ("rays", scans)):
        name = f"oddsmap, {method}"
        options = {"method": method} if method == "projective" else {}
        reason = why_not(readings, **options)
        if reason is None:
            contenders[name] = our_times(readings, DEPTH_RESOLUTION, **options)
            contenders[name]()
        else:
            missing[name] = reason
    if octomap_python.available()[0]:
        contenders["OctoMap"] = lambda: octomap_python.seconds(clouds, DEPTH_RESOLUTION)
    points = sum(len(points) for points, _ in clouds)
    return measure(contenders, points, len(frames), rounds) | missing


# ---- memory and files ------------------------------------------------------------------------


def keep(who: str, path: Path, resolution: float, count: int) -> dict[str, float]:
    """Build one map in this process: its memory, cells and file. Run in a process of its own."""
    scans = load_scans(path, count)
    clouds = [cloud(scan) for scan in scans] if who == "OctoMap" else []
    if who == "oddsmap":
        build_map(scans[:1], 5.0)  # kernels loaded before memory is looked at
    gc.collect()
    before = _status()["VmRSS"]
    held: Any
    if who == "oddsmap":
        held = build_map(scans, resolution)
    else:
        held = octomap_python.insert(clouds, resolution)
    gc.collect()
    after = _status()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "map"
        if who == "oddsmap":
            api, cells = held.nbytes, held.cell_count()
            held.save(out)
            size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
        else:
            api, cells = held.memoryUsage(), octomap_python.known_cells(held)
            size = octomap_python.write(held, out)
    return {
        "scans": count,
        "cells known": cells,
        "bytes a cell, own count": api / cells,
        "bytes a cell, process (VmRSS)": (after["VmRSS"] - before) / cells,
        "bytes a cell, process at its highest (VmHWM)": (after["VmHWM"] - before) / cells,
        "saved [MB]": size / 1e6,
        "saved bytes a cell": size / cells,
    }


def _status() -> dict[str, int]:
    """What the kernel says of this process's memory [bytes]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    fields = (line.split() for line in lines if line.startswith(("VmRSS", "VmHWM")))
    return {words[0].rstrip(":"): int(words[1]) * 1024 for words in fields}


def kept(path: Path, effort: Effort, ready: bool) -> dict[str, Any]:
    """`keep` of both, each in a fresh process."""
    result: dict[str, Any] = {}
    if not Path("/proc/self/status").exists():
        return {"memory": "NOT AVAILABLE: /proc/self/status is Linux's"}
    whom = (["oddsmap"] if ready else []) + (["OctoMap"] if octomap_python.available()[0] else [])
    for who in whom:
        task = json.dumps([who, str(path), effort.resolution, effort.kept])
        command = [sys.executable, __file__, "--keep", task]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        result[who] = json.loads(done.stdout)
    if len(result) == 2:
        ours, theirs = result["oddsmap"]["saved [MB]"], result["OctoMap"]["saved [MB]"]
        result["saved, share of OctoMap's .ot"] = ours / theirs
    return result


# ---- all of it -------------------------------------------------------------------------------


def run(work: Path, quick: bool, parts: set[str]) -> dict[str, Any]:
    """Every part that was asked for."""
    path, pictures = town_scans(work), room_frames(work)
    rounds = 1 if quick else 3
    scans = load_scans(path, SCANS)
    reason = why_not(scans)
    ready = reason is None
    result: dict[str, Any] = {
        "machine": machine(),
        "oddsmap in space": reason or "available",
        "OctoMap": octomap_python.available()[1],
        "town": statistics_of(scans, 0.2, 4 if quick else 20),
    }
    if "answers" in parts:
        few = scans[:: SCANS // 2][:2]
        result["against exact arithmetic, 0.2 m"] = check_exact(few, 0.2, 127, ready)
        if ready and octomap_python.available()[0]:
            result["beside OctoMap, 0.2 m"] = check_octomap(scans[:3], 0.2)
        if ready:
            check_threads(scans[:5], 0.2)
            result["one and two threads, 0.2 m"] = "equal to the bit"
    for effort in QUICK if quick else EFFORTS:
        name = f"{effort.resolution} m"
        if "speed" in parts:
            timed = scans[: effort.timed]
            result[name] = measure_lidar(timed, effort.resolution, rounds, ready, rounds)
            whole = measure_lidar(scans, effort.resolution, rounds, ready, int(effort.whole))
            result[name][f"all {SCANS} scans"] = whole
        if "memory" in parts:
            result[f"{name}, kept"] = kept(path, effort, ready)
    if "camera" in parts:
        frames = load_frames(pictures, 2 if quick else 10)
        result[f"depth camera, {DEPTH_RESOLUTION} m"] = measure_camera(frames, rounds)
    return result


def _returns(scans: Sequence[Scan]) -> int:
    return sum(int(np.isfinite(scan.ranges).sum()) for scan in scans)


PARTS = ("answers", "speed", "memory", "camera")


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    cache = ROOT / "benchmarks" / ".cache"
    parser.add_argument("--work", type=Path, default=cache, help="folder for the simulated scans")
    parser.add_argument("--json", type=Path, help="write the results there as well")
    parser.add_argument("--quick", action="store_true", help="fewer scans, one round")
    parser.add_argument("--part", action="append", choices=PARTS, help="only this (repeatable)")
    parser.add_argument("--keep", help=argparse.SUPPRESS)
    options = parser.parse_args()

    if options.keep:
        who, path, resolution, count = json.loads(options.keep)
        print(json.dumps(keep(who, Path(path), resolution, count)))
        return
    result = run(options.work, options.quick, set(options.part or PARTS))
    show(result)
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
