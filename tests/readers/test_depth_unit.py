# SPDX-License-Identifier: Apache-2.0
"""Millimetres in the layout of TUM, whose unit is a fifth of that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.errors import ConfigError, InputError
from oddsmap.readers import open_log
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.log import Log
from tests.readers.test_rgbd_folder import write_png

HEIGHT, WIDTH = 24, 32


def tum(folder: Path, *images: np.ndarray) -> Path:
    lines = []
    for i, units in enumerate(images):
        write_png(folder / "depth" / f"{i}.png", units.astype(np.uint16))
        lines.append(f"{i}.0 depth/{i}.png")
    (folder / "depth.txt").write_text("\n".join(lines))
    poses = "".join(f"{i}.0 0 0 0 0 0 0 1\n" for i in range(len(images)))
    (folder / "groundtruth.txt").write_text(poses)
    (folder / "camera-intrinsics.txt").write_text("30 0 15.5\n0 30 11.5\n0 0 1\n")
    return folder


def scene(low: float, high: float, seed: int = 0) -> np.ndarray:
    """Depths [mm] of a scene from `low` to `high` [m], as a driver gives them."""
    rng = np.random.default_rng(seed)
    depth = np.rint(rng.uniform(1000 * low, 1000 * high, (HEIGHT, WIDTH)))
    depth[rng.random(depth.shape) < 0.2] = 0
    return depth


def first(log: Log) -> DepthScan:
    scan = next(iter(log))
    assert isinstance(scan, DepthScan)
    return scan


def codes(folder: Path, **options: float) -> list[str]:
    return [note.code for note in open_log(folder, **options).notes]  # type: ignore[arg-type]


def test_a_wall_at_two_metres_in_millimetres(tmp_path: Path) -> None:
    folder = tum(tmp_path, np.full((HEIGHT, WIDTH), 2000.0))
    (note,) = open_log(folder).notes
    assert (note.code, note.severity) == ("depth.unit", "warning")
    assert note.startswith("half of the depths are below 0.4 m at 5000 units a metre")
    assert "--depth-scale 1000 (depth_scale=1000)" in note
    log = open_log(folder, depth_scale=1000)
    assert log.notes == ()
    assert (first(log).depth == 2.0).all()
    bounds = oddsmap.build_map(log, 0.1).bounds()
    assert bounds is not None
    assert bounds[1][2] == 21  # the wall is in the cells from 2.0 m on


def test_what_is_doubted(tmp_path: Path) -> None:
    # A room in millimetres; the same in the right unit, from a driver and from a renderer.
    room = [scene(0.8, 4.5, seed) for seed in range(7)]
    assert codes(tum(tmp_path / "mm", *room)) == ["depth.unit"]
    assert codes(tum(tmp_path / "driver", *(5 * image for image in room))) == []
    assert codes(tum(tmp_path / "renderer", *(5 * image + 1 for image in room))) == []
    # A desk seen from near, in the right unit.
    assert codes(tum(tmp_path / "desk", 5 * scene(0.5, 1.4))) == []
    # All too near for a camera.
    assert codes(tum(tmp_path / "near", 5 * scene(0.1, 0.7))) == ["depth.unit"]
    # One image looks far: metres were meant.
    assert codes(tum(tmp_path / "one", *room[:4], 5 * room[4])) == []
    assert codes(tum(tmp_path / "nothing", np.zeros((HEIGHT, WIDTH)))) == []


def test_the_scale_is_for_depth_images(tmp_path: Path) -> None:
    folder = tum(tmp_path / "tum", scene(1, 2))
    for scale in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigError, match=r"depth_scale is how many units .*millimetres\)"):
            open_log(folder, depth_scale=scale)
    np.savez(tmp_path / "a.npz", beams=np.ones((2, 4)))
    with pytest.raises(InputError, match="holds no depth images: leave `depth_scale` out"):
        open_log(tmp_path / "a.npz", depth_scale=1000)


def test_the_scale_holds_for_the_other_layout(tmp_path: Path) -> None:
    write_png(tmp_path / "frame-000000.depth.png", np.full((HEIGHT, WIDTH), 4000, np.uint16))
    (tmp_path / "frame-000000.pose.txt").write_text("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    (tmp_path / "camera-intrinsics.txt").write_text("30 0 15.5\n0 30 11.5\n0 0 1\n")
    assert (first(open_log(tmp_path)).depth == 4.0).all()
    assert (first(open_log(tmp_path, depth_scale=5000)).depth == np.float32(0.8)).all()
