# SPDX-License-Identifier: Apache-2.0
"""How far projective integration of depth images differs from exact rays.

    python benchmarks/projective.py                    # both resolutions, about 20 seconds
    python benchmarks/projective.py --log 7scenes      # the pictures of a folder

The pictures are those of `lidar3d.py`: a 640 x 480 depth camera carried through a room. Each is
mapped by both methods, alone; then all of them are.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from benchmarks.lidar2d import show
from benchmarks.lidar3d import FRAMES, load_frames, room_frames
from oddsmap import EvidenceMap, build_map, open_log
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.lazy_log import DepthLog

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]


def votes(grids: Sequence[EvidenceMap]) -> tuple[IntArray, list[tuple[BoolArray, BoolArray]]]:
    """Where each map has hits, and where passes, in the box around all of them and a cell more.

    Returns:
        First cell of the box; hits and passes of each map, by (z, y, x).
    """
    bounds = [bounds for grid in grids if (bounds := grid.bounds()) is not None]
    lo = np.min([lo for lo, _ in bounds], axis=0) - 1
    hi = np.max([hi for _, hi in bounds], axis=0) + 1
    units = [grid.region_units(lo, hi) for grid in grids]
    return lo, [(hits > 0, passes > 0) for hits, passes in units]


def outside(frame: DepthScan, free: BoolArray, lo: IntArray, resolution: float) -> int:
    """How many of the cells have their centre outside of the picture."""
    centres = np.asarray(np.argwhere(free)[:, ::-1] + lo + 0.5, np.float64)
    to_camera = frame.map_from_sensor.inverse()
    x, y, z = to_camera.transform(centres * resolution).T
    camera = frame.camera
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    inside = (z > 0) & (abs(u - (camera.width - 1) / 2) < camera.width / 2)
    inside &= abs(v - (camera.height - 1) / 2) < camera.height / 2
    return int(np.count_nonzero(~inside))


def around(cells: BoolArray) -> BoolArray:
    """The cells and their 26 neighbours; none lies on the border of the box."""
    for axis in range(3):
        cells = cells | np.roll(cells, 1, axis) | np.roll(cells, -1, axis)
    return cells


def compare(frames: Sequence[DepthScan], resolution: float) -> dict[str, object]:
    """Shares of cells, over pictures mapped one by one."""
    by_rays = by_image = both = beside_hit = off = hits = 0
    for frame in frames:
        grids = [build_map([frame], resolution, method=m) for m in ("rays", "projective")]
        lo, ((hit, free), (image_hit, image_free)) = votes(grids)
        if not np.array_equal(hit, image_hit):
            raise SystemExit("hits differ")
        hits += int(hit.sum())
        by_rays, by_image = by_rays + int(free.sum()), by_image + int(image_free.sum())
        both += int((free & image_free).sum())
        missed = free & ~image_free
        beside_hit += int((missed & around(hit)).sum())
        off += outside(frame, missed, lo, resolution)
    return {
        "pictures": len(frames),
        "hits (the same by both)": hits,
        "free by rays": by_rays,
        "free by projection": by_image,
        "free by rays: also by projection": both / by_rays,
        "free by rays alone: centre outside of the picture": off / max(1, by_rays - both),
        "free by rays alone: beside a hit": beside_hit / max(1, by_rays - both),
        "free by projection: passed by no ray": (by_image - both) / by_image,
    }


def states(frames: Sequence[DepthScan], resolution: float) -> dict[str, float]:
    """Cells of the map of all pictures: known to both, and of the same state there."""
    grids = [build_map(frames, resolution, method=m) for m in ("rays", "projective")]
    bounds = [grid.bounds() for grid in grids]
    lo = np.min([b[0] for b in bounds if b], axis=0)
    hi = np.max([b[1] for b in bounds if b], axis=0)
    odds = []
    for grid in grids:
        hits, passes = grid.region_units(lo, hi)
        known = hits + passes > 0
        odds.append((known, grid.log_odds().of_votes(hits, passes) > 0))
    (known, occupied), (image_known, image_occupied) = odds
    common = known & image_known
    return {
        "known by rays: also by projection": float(common.sum() / known.sum()),
        "known by projection: not by rays": float((image_known & ~known).sum() / image_known.sum()),
        "known to both: occupied or not by both": float(
            (occupied == image_occupied)[common].mean()
        ),
        "occupied by rays": int(occupied[known].sum()),
        "occupied by projection": int(image_occupied[image_known].sum()),
    }


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    cache = ROOT / "benchmarks" / ".cache"
    parser.add_argument("--work", type=Path, default=cache, help="folder for the simulated scans")
    parser.add_argument("--frames", type=int, default=FRAMES, help="how many pictures")
    parser.add_argument("--log", type=Path, help="a folder of depth images, in place of the room")
    options = parser.parse_args()
    if options.log is None:
        frames = load_frames(room_frames(options.work), options.frames)
    else:
        log = open_log(options.log)
        if not isinstance(log, DepthLog):
            raise SystemExit(f"{options.log}: no depth images")
        frames = list(itertools.islice(log, options.frames))
    show({f"{r} m": compare(frames, r) | states(frames, r) for r in (0.05, 0.1)})


if __name__ == "__main__":
    main()
