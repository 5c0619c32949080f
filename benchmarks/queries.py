# SPDX-License-Identifier: Apache-2.0
"""Rates of questions about maps: octomap-python's `search` and `castRay` in 3D, grid rays in 2D.

    python benchmarks/queries.py                  # about a minute
    python benchmarks/queries.py --quick          # a tenth of the questions

The town of `oddsmap.simulate` is mapped, and written as an OctoMap `.bt`. Answers are compared on
that file as both read it, before any time is taken, and rays are timed on it; points are timed on
the map of evidence, where `at` works out probabilities. CPU time of one thread, best of some rounds
in turn. octomap-python is asked one point or ray at a time, as it offers nothing else: its rate has
the call from Python in it, and what an empty call takes is reported alone, too.

In 2D the peers are Bresenham's line and ray marching over a dense grid (`peers/grid_rays.py`), as
range_libc has them, from random free places of the office at 0.05 m, up to 30 m.

`exploring.py` has frontiers, information gain, expected ranges and states, on both maps.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT)]

import oddsmap
from benchmarks.exploring import explore
from benchmarks.peers import grid_rays, octomap_python
from oddsmap.simulate import (
    Lidar2D,
    Lidar3D,
    drive3d,
    office_drive,
    office_plan,
    town,
)
from tests.naive.rays import cells_along

FloatArray = npt.NDArray[np.float64]
RESOLUTION, MAX_RANGE = 0.2, 50.0
FINE, ACROSS = 0.05, 30.0


def town_view(scans: int) -> Any:
    """A map of the town, and where its sensor stood."""
    world, lidar, rng = town(flat=True), Lidar3D(), np.random.default_rng(0)
    poses = list(drive3d(scans))
    grid = oddsmap.build_map((lidar.scan(world, pose, rng) for pose in poses), RESOLUTION)
    return grid.log_odds(), np.stack([pose.translation for pose in poses])


def questions(view: Any, stands: FloatArray, count: int) -> tuple[FloatArray, ...]:
    """Points around what is known, and rays from where the sensor stood."""
    rng = np.random.default_rng(1)
    index, _ = view.cells()
    points = view.evidence.centre_of(index[rng.integers(len(index), size=count)])
    points += rng.uniform(-0.45, 0.45, points.shape) * RESOLUTION
    points[::4] += rng.uniform(-3.0, 3.0, points[::4].shape)
    ways = rng.normal(size=(count, 3)) * (1.0, 1.0, 0.3)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return points, stands[rng.integers(len(stands), size=count)], ways


def octree(path: Path) -> Any:
    """A map as OctoMap reads it."""
    import octomap

    tree = octomap.OcTree(RESOLUTION)
    if not tree.readBinary(str(path).encode()):
        raise RuntimeError("OctoMap does not read the map")
    return tree


def ask_octree(tree: Any, points: FloatArray) -> npt.NDArray[np.int8]:
    """-1 unknown, 0 free, 1 occupied."""
    import octomap

    answers = np.full(len(points), -1, np.int8)
    for i, point in enumerate(points):
        node = tree.search(point)
        with suppress(octomap.NullPointerException):  # unknown
            answers[i] = tree.isNodeOccupied(node)
    return answers


def cast_octree(tree: Any, origins: FloatArray, ways: FloatArray) -> FloatArray:
    """Where rays end [m], shape (n, 3), NaN where nothing ends them."""
    ends = np.full(origins.shape, np.nan)
    end = np.empty(3)
    for i in range(len(ways)):
        if tree.castRay(origins[i], ways[i], end, True, MAX_RANGE):
            ends[i] = end
    return ends


def compare(tree: Any, voxels: oddsmap.VoxelMap, asked: tuple[FloatArray, ...]) -> dict[str, float]:
    """Shares of equal answers."""
    points, origins, ways = asked
    state = voxels.states_at(points).state
    known = ask_octree(tree, points)
    want = np.select([state == oddsmap.State.UNKNOWN, state == oddsmap.State.FREE], [-1, 0], 1)
    ends, hits = cast_octree(tree, origins, ways), voxels.cast_rays(origins, ways, MAX_RANGE)
    met = ~np.isnan(ends[:, 0])
    cell = np.where(met[:, None], voxels.cell_of(np.nan_to_num(ends)), oddsmap.RayHits.NO_CELL)
    different = np.flatnonzero((cell != hits.cell).any(axis=1))
    right = sum(
        tuple(hits.cell[i].tolist()) == exact_end(voxels, origins[i], ways[i]) for i in different
    )
    share = right / len(different) if len(different) else 1.0
    return {
        "points": float((known == want).mean()),
        "rays": 1.0 - len(different) / len(ways),
        "of the others, oddsmap's by exact arithmetic": share,
    }


def exact_end(voxels: oddsmap.VoxelMap, origin: FloatArray, way: FloatArray) -> tuple[int, ...]:
    """The cell that ends a ray, in rational arithmetic."""
    start, reach = (origin / RESOLUTION).tolist(), MAX_RANGE / RESOLUTION
    along = [cell for _, cell in cells_along(start, way.tolist(), reach)]
    stops = np.flatnonzero(voxels.state_at(along) == oddsmap.State.OCCUPIED)
    return along[stops[0]] if len(stops) else (oddsmap.RayHits.NO_CELL,) * 3


def in_the_plane(
    count: int,
) -> tuple[dict[str, tuple[Callable[[], object], int]], dict[str, float]]:
    """What is timed in 2D, and how far answers are from those they are compared with."""
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    view = oddsmap.build_map(
        [lidar.scan(plan, pose, rng) for pose in office_drive()], FINE
    ).log_odds()
    lo, hi = view.bounds() or ((0, 0), (0, 0))
    state = view.state((lo, hi))
    free = np.argwhere(state == oddsmap.State.FREE)[:, ::-1]
    starts = free[rng.integers(len(free), size=count)] + rng.random((count, 2))
    angle = rng.uniform(-np.pi, np.pi, count)
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    origins, caster, reach = (starts + np.asarray(lo)) * FINE, view.ray_caster(), ACROSS / FINE
    occupied = state == oddsmap.State.OCCUPIED
    field = grid_rays.distances(occupied)
    exact = caster.cast(origins, ways, ACROSS).distance / FINE
    places, scan = localised(plan, lidar, rng, count // 60)
    by_field, by_beams = view.likelihood_field(ACROSS), view.beam_likelihood(ACROSS)
    apart = {}
    for name, found in (
        ("Bresenham", grid_rays.bresenham(occupied, starts, ways, reach)),
        ("marching", grid_rays.march(field, starts, ways, reach)),
    ):
        with np.errstate(invalid="ignore"):
            same = (np.abs(found - exact) <= 2.0) | (found == exact)
        apart[f"{name}, within 2 cells of the exact range"] = float(same.mean())
    jobs, compared = explore("2D", view, origins, origins, ways, ACROSS)
    apart |= compared
    return jobs | {
        "2D cast_rays, occupied": (lambda: caster.cast(origins, ways, ACROSS), count),
        "2D Bresenham, dense": (
            lambda: grid_rays.bresenham(occupied, starts, ways, reach), count
        ),
        "2D ray marching, dense": (lambda: grid_rays.march(field, starts, ways, reach), count),
        "likelihood_field, beams": (
            lambda: by_field.log_likelihood(places, scan, max_beams=60), 60 * len(places)
        ),
        "beam_likelihood, beams": (
            lambda: by_beams.log_likelihood(places, scan, max_beams=60), 60 * len(places)
        ),
    }, apart  # fmt: skip


def localised(plan: Any, lidar: Any, rng: np.random.Generator, count: int) -> tuple[Any, Any]:
    """Poses about that of a scan."""
    pose = office_drive()[100]
    places = rng.normal(size=(count, 3)) * (0.5, 0.5, 0.2) + (*pose.translation, pose.theta)
    return places, lidar.scan(plan, pose, rng)


def rate(job: Callable[[], object], count: int) -> float:
    """Questions per second of CPU time."""
    start = time.process_time()
    job()
    return count / (time.process_time() - start)


def main() -> None:
    """Compare answers, then rates."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a tenth of the questions")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = parser.parse_args()
    count = 20_000 if given.quick else 200_000
    view, stands = town_view(6)
    asked = questions(view, stands, count)
    points, origins, ways = asked
    few = tuple(part[: count // 10] for part in asked)
    there, version = octomap_python.available()
    found: dict[str, Any] = {"cells": view.evidence.cell_count(), "rates": {}, "octomap": version}
    with tempfile.TemporaryDirectory() as folder:
        view.save_octomap(Path(folder) / "town.bt")
        voxels = oddsmap.load_octomap(Path(folder) / "town.bt")
        caster = voxels.ray_caster()
        jobs: dict[str, tuple[Callable[[], object], int]] = {
            "at": (lambda: view.at(points), count),
            "cast_rays, occupied": (lambda: caster.cast(origins, ways, MAX_RANGE), count),
            "cast_rays, unknown": (
                lambda: caster.cast(origins, ways, MAX_RANGE, until="unknown"), count
            ),
        }  # fmt: skip
        plane, apart = in_the_plane(count)
        space, compared = explore("3D", view, points, origins, ways, MAX_RANGE)
        jobs |= plane | space
        apart |= compared
        if there:
            tree = octree(Path(folder) / "town.bt")
            found["equal answers"] = compare(tree, voxels, few)
            part = count // 10
            jobs["octomap search"] = (lambda: ask_octree(tree, few[0]), part)
            jobs["octomap castRay"] = (lambda: cast_octree(tree, *few[1:]), part)
            jobs["octomap, an empty call"] = (lambda: [tree.size() for _ in range(part)], part)
        for job, _ in jobs.values():  # compiled, and in memory
            job()
        for _ in range(3 if given.quick else 7):
            for name, (job, number) in jobs.items():
                found["rates"].setdefault(name, []).append(rate(job, number))
    for name, make in (
        ("ray_caster", view.ray_caster),
        ("likelihood_field", lambda: view.likelihood_field(MAX_RANGE)),
    ):
        found[f"{name}_s"] = 1.0 / max(rate(make, 1) for _ in range(3))
    print(f"{found['cells']} cells of {RESOLUTION} m; {version}")
    if there:
        print("equal answers:", {name: f"{x:.4%}" for name, x in found["equal answers"].items()})
    for name, x in apart.items():
        print(f"{name}: {x:.4g}")
    found["compared"] = apart
    for name, rates in found["rates"].items():
        best, middle = max(rates) / 1e6, float(np.median(rates)) / 1e6
        print(f"{name:28} {best:9.4f} M/s, median {middle:.4f}")
    for name in ("ray_caster", "likelihood_field"):
        print(f"making a {name}: {found[name + '_s']:.3f} s")
    if given.json:
        given.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
