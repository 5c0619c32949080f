# SPDX-License-Identifier: Apache-2.0
"""The page of `oddsmap view`: how large, how long to write, to open and to retune.

    python benchmarks/viewer.py --data ../shared/data      # needs Chromium and the dev extra
    python benchmarks/viewer.py --data ../shared/data --only hall sheets

Printed for each map: bytes of the file's data over those of the saved map, CPU seconds to make the
file; then what the browser takes, in software if there is no graphics card: seconds until the map
can be used, seconds from a slider to the new picture (the median of five), milliseconds of the
page's own program in a frame; of a 3D map also milliseconds to find what is pointed at, the mean of
400 pixels, and what 19 in 20 stay below. "noise" is 4000 x 4000 cells, which hardly compress, once
as counts and once as a full map; "sheets" is 3 million voxels with hits, under as many of air, once
more as an OctoMap. Of maps without counts a threshold is moved instead of p_hit.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

from oddsmap import EvidenceMap, FullMap, VoxelMap, build_full_map, build_map, open_log
from oddsmap.config.config import Config, MapConfig
from oddsmap.kernels.units import ONE
from oddsmap.limits import TILE_SIDE
from oddsmap.viewer.document import page_part, single_page
from oddsmap.viewer.given import given_of
from oddsmap.viewer.given_sheets import given_payload
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload
from oddsmap.viewer.text import text_of
from tests.viewer.browser_kit import chromium, file_url, opened

LOGS = ("intel-corrected", "freiburg-079-corrected")
SIDE = 4000


def noise() -> EvidenceMap:
    """Walls every 10 m, and Poisson counts."""
    grid, rng = EvidenceMap(0.05), np.random.default_rng(0)
    for first in range(0, SIDE, 500):
        y, x = np.mgrid[first : first + 500, 0:SIDE].reshape(2, -1)
        wall = (x % 200 < 2) | (y % 300 < 2)
        hits = np.where(wall, rng.poisson(30, x.shape), rng.poisson(0.01, x.shape))
        passes = rng.poisson((20 + 15 * np.sin(x / 90) * np.cos(y / 70)) / np.where(wall, 5, 1))
        grid.add_cells(np.stack([x, y], axis=1), hits * ONE, passes * ONE)
    return grid


def sheets() -> EvidenceMap:
    """Two rough floors of 1500 x 1000 voxels, one above the other, each below one voxel of air."""
    grid, rng = EvidenceMap(0.1, ndim=3), np.random.default_rng(0)
    for first in range(0, 1000, 250):
        y, x = np.mgrid[first : first + 250, 0:1500].reshape(2, -1)
        rough = (8 * np.sin(x / 60) * np.cos(y / 45)).astype(np.int64) + rng.integers(0, 2, x.shape)
        for height in (0, 40):
            for above, hits in ((0, 1 + rng.poisson(4, x.shape)), (2, np.zeros(x.shape))):
                index = np.stack([x, y, rough + height + above], axis=1)
                passes = rng.poisson(3, x.shape) + (above > 0)
                grid.add_cells(index, hits.astype(np.int64) * ONE, passes * ONE)
    return grid


def full_noise() -> FullMap:
    """No two cells with one probability."""
    rng, side = np.random.default_rng(0), TILE_SIDE[2]
    first = np.arange(SIDE // side)
    blocks = np.stack(np.meshgrid(first, first), axis=-1).reshape(-1, 2).astype(np.int64)
    values = rng.normal(-2, 3, (len(blocks), side * side)).astype(np.float32)
    marks = np.full(values.shape, 2, np.uint8)
    config = Config(map=MapConfig(resolution=0.05))
    return FullMap(config, blocks, values, marks, sweeps=1, residual=0.0)


Shown = EvidenceMap | FullMap | VoxelMap


def save(grid: Shown, folder: Path, name: str) -> Path:
    """A map as it is kept, and where."""
    if isinstance(grid, VoxelMap):
        grid.save_octomap(folder / f"{name}.ot")
        return folder / f"{name}.ot"
    grid.save(folder / f"{name}.zarr")
    return folder / f"{name}.zarr"


def payload_of(grid: Shown, name: str) -> bytes:
    """What the page gets."""
    if isinstance(grid, EvidenceMap):
        return (plane_payload if grid.ndim == 2 else space_payload)(grid, name)
    return given_payload([given_of(grid, name)])


def maps(data: Path) -> dict[str, Callable[[], Shown]]:
    """Real logs, 2D at 0.05 m, and made-up maps."""
    logs = {name: (data / "laser2d" / f"{name}.log.gz", 0.05) for name in LOGS}
    logs["hall"] = (data / "lidar3d" / "hall_os0", 0.1)
    built: dict[str, Callable[[], Shown]] = {
        name: partial(lambda a, b: build_map(open_log(a), b), *log) for name, log in logs.items()
    }
    intel = logs[LOGS[0]][0]
    return {
        **built,
        f"{LOGS[0]}-full": lambda: build_full_map(open_log(intel), 0.1),
        "noise": noise,
        "noise-full": full_noise,
        "sheets": sheets,
        "sheets-octomap": lambda: sheets().log_odds().to_voxels(),
    }


POINT = """(() => {
  const { width, height } = oddsmap.camera;
  const spent = Array.from({ length: 400 }, (_, i) => {
    const begun = performance.now();
    oddsmap.pick((width * (i % 20 + 0.5)) / 20, (height * (Math.floor(i / 20) + 0.5)) / 20);
    return performance.now() - begun;
  }).sort((a, b) => a - b);
  return [spent.reduce((sum, x) => sum + x) / 400, spent[380]];
})()"""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="the folder of real logs")
    parser.add_argument("--only", nargs="+", metavar="MAP", help="some of the maps, by name")
    given = parser.parse_args()
    made = maps(given.data)
    code = sum(len(page_part(f"viewer.{kind}")) for kind in ("js", "css"))
    print(f"code {code / 1e3:.0f} kB")
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        for name in given.only or made:
            grid = made[name]()
            saved, page = save(grid, Path(folder), name), Path(folder) / f"{name}.html"
            files = [file for file in (saved, *saved.rglob("*")) if file.is_file()]
            size = sum(file.stat().st_size for file in files)
            begun = time.process_time()
            payload = payload_of(grid, saved.name)
            page.write_text(single_page(saved.name, payload), encoding="utf-8")
            spent, share = time.process_time() - begun, len(text_of(payload)) / size
            print(f"{name}: {share:.2f} of the saved map, {spent:.2f} s of CPU to write")
            begun = time.perf_counter()
            with opened(browser, file_url(page), viewport={"width": 1280, "height": 800}) as found:
                found.page.screenshot()
                there = time.perf_counter() - begun
                moved, frames = [], []
                for p_hit in (0.75, 0.8, 0.85, 0.9, 0.95):
                    begun = time.perf_counter()
                    found.set(pHit=p_hit, colours="states", occupied=p_hit)
                    found.words()
                    frames.append(found.get("oddsmap.frameTime"))
                    found.page.screenshot()
                    moved.append(time.perf_counter() - begun)
                slow, own = statistics.median(moved), statistics.median(frames)
                print(f"  open {there:.1f} s, slider {slow:.2f} s, own program {own:.1f} ms")
                if found.get("oddsmap.facts.kind") == "space":
                    print("  to point {:.2f} ms, 19 of 20 within {:.1f}".format(*found.get(POINT)))


if __name__ == "__main__":
    main()
