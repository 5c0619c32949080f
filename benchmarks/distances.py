# SPDX-License-Identifier: Apache-2.0
"""Distances to obstacles in maps and in random arrays, beside PyPI's `edt` and SciPy.

    python benchmarks/distances.py                # about two minutes
    python benchmarks/distances.py --quick        # smaller arrays

Every answer is checked first: squared distances of `edt` (single precision) and of SciPy (double)
rounded to whole numbers. CPU time of one thread, best of some rounds in turn, per cell. All three
start from an array that says which cells are obstacles; `distance_field` starts from the map, has
the states of its cells decided, too, and is reported apart. `edt` is not needed: pip install edt.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT)]

import oddsmap
from oddsmap.query.boxes import Box
from oddsmap.query.squared_distances import squared_to
from oddsmap.simulate import (
    Lidar2D,
    Lidar3D,
    drive3d,
    office_drive,
    office_plan,
    town,
)

Mask = npt.NDArray[np.uint8]


def office_scans(count: int) -> list[Any]:
    """Scans of a drive through the simulated office."""
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    return [lidar.scan(plan, pose, rng) for pose in office_drive(count)]


def town_scans(count: int) -> list[Any]:
    """Scans of a drive through the simulated town."""
    world, lidar, rng = town(flat=True), Lidar3D(), np.random.default_rng(0)
    return [lidar.scan(world, pose, rng) for pose in drive3d(count)]


def random_mask(shape: tuple[int, ...], share: float) -> Mask:
    """Obstacles here and there."""
    return (np.random.default_rng(1).random(shape) < share).astype(np.uint8)


def box_of(mask: Mask) -> Box:
    """The cells of an array."""
    return Box(np.zeros(mask.ndim, np.int64), np.array(mask.shape[::-1], np.int64))


def contenders(mask: Mask) -> dict[str, Callable[[], Any]]:
    """What makes squared distances of an array, or distances where there are no others."""
    from scipy import ndimage

    box, free = box_of(mask), mask == 0
    jobs: dict[str, Callable[[], Any]] = {
        "oddsmap": lambda: squared_to(mask, box, box, None, np.int32, 1),
        "oddsmap, up to 20 cells": lambda: squared_to(mask, box, box, 400, np.int32, 1),
        "scipy": lambda: ndimage.distance_transform_edt(free),
    }
    if importlib.util.find_spec("edt") is not None:
        import edt

        jobs["edt"] = lambda: edt.edtsq(free, parallel=1)
    return jobs


def check(name: str, jobs: dict[str, Callable[[], Any]]) -> None:
    """All answers are one answer.

    Raises:
        RuntimeError: they are not.
    """
    squared = jobs["oddsmap"]()
    near = np.where(squared <= 400, squared, np.iinfo(np.int32).max)
    found = {"scipy": np.rint(jobs["scipy"]() ** 2), "oddsmap, up to 20 cells": None}
    if "edt" in jobs:
        found["edt"] = np.rint(jobs["edt"]())
    same = {who: np.array_equal(squared, each) for who, each in found.items() if each is not None}
    same["oddsmap, up to 20 cells"] = np.array_equal(near, jobs["oddsmap, up to 20 cells"]())
    if not all(same.values()):
        raise RuntimeError(f"{name}: answers differ: {same}")


def seconds(job: Callable[[], object]) -> float:
    """CPU time of one run."""
    start = time.process_time()
    job()
    return time.process_time() - start


def transforms(cases: dict[str, Mask], rounds: int) -> dict[str, dict[str, list[float]]]:
    """Nanoseconds per cell, by case and contender."""
    found: dict[str, dict[str, list[float]]] = {}
    for name, mask in cases.items():
        jobs = contenders(mask)
        check(name, jobs)
        times = found.setdefault(f"{name}, {' x '.join(map(str, mask.shape[::-1]))}", {})
        for _ in range(rounds):
            for who, job in jobs.items():
                times.setdefault(who, []).append(seconds(job) / mask.size * 1e9)
    return found


def fields(scans: list[Any], resolution: float, rounds: int) -> dict[str, float]:
    """Milliseconds that fields of a map take, made and updated after each of the last scans."""
    grid = oddsmap.build_map(scans[:-rounds], resolution)
    view = grid.log_odds()
    found: dict[str, list[float]] = {}
    of_all, near = view.distance_field(), view.distance_field(2.0)
    for field in (of_all, near):
        field.update(view)  # from now on it knows all tiles
    for scan in scans[-rounds:]:
        grid.add(scan)
        for name, field, reach in (("any distance", of_all, None), ("up to 2 m", near, 2.0)):
            took = seconds(partial(field.update, view))
            found.setdefault(f"update, {name}", []).append(took)
            found.setdefault(f"made, {name}", []).append(
                seconds(partial(view.distance_field, reach))
            )
            if not np.array_equal(field.squared, view.distance_field(reach).squared):
                raise RuntimeError("an updated field is not what a new one is")
    cells = {"cells": float(of_all.squared.size), "known": float(grid.cell_count())}
    return cells | {name: 1e3 * float(np.median(times)) for name, times in found.items()}


def band(scans: list[Any], resolution: float) -> dict[str, float]:
    """Megabytes and milliseconds of a band of 2 m, and of a field up to 2 m."""
    view = oddsmap.build_map(scans, resolution).log_odds()
    of: dict[str, Any] = {"band": view.distance_band(2.0), "field": view.distance_field(2.0)}
    index, distance = of["band"].cells()
    if not np.array_equal(
        np.sort(of["field"].distance[np.isfinite(of["field"].distance)]),
        np.sort(distance[~np.isnan(of["field"].at_cells(index))]),
    ):
        raise RuntimeError("a band is not what a field is")
    took = {
        "band": min(seconds(lambda: view.distance_band(2.0)) for _ in range(3)),
        "field": min(seconds(lambda: view.distance_field(2.0)) for _ in range(3)),
    }
    return {f"{name} MB": each.nbytes / 1e6 for name, each in of.items()} | {
        f"{name} ms": 1e3 * each for name, each in took.items()
    }


def one_cell(side: int, rounds: int) -> dict[str, float]:
    """Milliseconds that fields up to 2 m of a plane take, made and updated after one cell."""
    mask = random_mask((side, side), 0.003)
    grid = oddsmap.EvidenceMap(0.05)
    cells = np.argwhere(mask < 2)[:, ::-1]
    occupied = mask.ravel().astype(np.int64)
    grid.add_cells(cells, (occupied * 4) << 16, ((1 - occupied) * 4) << 16)
    view = grid.log_odds()
    field = view.distance_field(2.0)
    field.update(view)
    times, cell = [], np.ones(1, np.int64)
    for step in range(rounds):
        grid.add_cells(np.array([[side // 3 + 9 * step, side // 2]]), cell * 4 << 16, cell * 0)
        times.append(
            (seconds(lambda: view.distance_field(2.0)), seconds(lambda: field.update(view)))
        )
    made, updated = 1e3 * np.median(times, axis=0)
    return {"cells": float(side * side), "made": float(made), "update": float(updated)}


def main() -> None:
    """Check, measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="smaller arrays, fewer rounds")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = parser.parse_args()
    rounds, side, edge = (2, 500, 64) if given.quick else (5, 2000, 160)
    drive, drive3 = office_scans(60 if given.quick else 160), town_scans(4 if given.quick else 10)
    maps = {"office": (drive, 0.02), "town": (drive3, 0.2)}
    cases = {
        name: oddsmap.build_map(scans, resolution).log_odds().state() == oddsmap.State.OCCUPIED
        for name, (scans, resolution) in maps.items()
    }
    arrays = {name: mask.astype(np.uint8) for name, mask in cases.items()}
    for share in (0.001, 0.05):
        arrays[f"2D, {share:.1%} obstacles"] = random_mask((side,) * 2, share)
        arrays[f"3D, {share:.1%} obstacles"] = random_mask((edge,) * 3, share)
    found = transforms(arrays, rounds)
    there = importlib.util.find_spec("edt") is not None
    print("edt", importlib.metadata.version("edt") if there else "not there: pip install edt")
    for name, times in found.items():
        print(f"{name}: ns per cell, best (median)")
        for who, each in times.items():
            print(f"  {who:24} {min(each):7.1f} ({np.median(each):.1f})")
    of_maps = {}
    for name, (scans, resolution) in maps.items():
        of_maps[name] = fields(scans, resolution, 2 if given.quick else 5)
        print(f"{name}: " + ", ".join(f"{what} {x:.4g}" for what, x in of_maps[name].items()))
    of_maps["town, 2 m"] = band(drive3, 0.2)
    print("town, 2 m: " + ", ".join(f"{what} {x:.4g}" for what, x in of_maps["town, 2 m"].items()))
    of_maps["one cell"] = one_cell(side, rounds)
    print("one cell: " + ", ".join(f"{what} {x:.4g}" for what, x in of_maps["one cell"].items()))
    if given.json:
        given.json.write_text(json.dumps({"transforms": found, "fields": of_maps}, indent=1))


if __name__ == "__main__":
    main()
