# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from matplotlib import colormaps
from PIL import Image

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.plot import frame
from oddsmap.plot.quantity import block_largest, save_quantity

UNKNOWN = (199, 213, 227)


def pixels(path: Path) -> npt.NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def colour(share: float) -> npt.NDArray[np.uint8]:
    return np.array(colormaps["viridis"](share, bytes=True)[:3], np.uint8)


def middle_of_cells(path: Path, ny: int, nx: int) -> npt.NDArray[np.uint8]:
    """The colours of the cells of a map without unknown ones, row = y ascending."""
    picture = pixels(path)
    unknown = (picture == np.array(UNKNOWN, np.uint8)).all(axis=2)
    rows = np.flatnonzero(unknown.mean(axis=1) > 0.5)
    columns = np.flatnonzero(unknown.mean(axis=0) > 0.5)
    top, bottom = (rows[k + d] for k in np.flatnonzero(np.diff(rows) > 1)[:1] for d in (0, 1))
    left, right = (columns[k + d] for k in np.flatnonzero(np.diff(columns) > 1)[:1] for d in (0, 1))
    part = picture[top + 1 : bottom, left + 1 : right]
    scale = part.shape[0] // ny
    assert part.shape == (ny * scale, nx * scale, 3)
    return part[scale // 2 :: scale, scale // 2 :: scale][::-1]


def test_every_cell_has_the_colour_of_its_value(tmp_path: Path) -> None:
    value = np.arange(12.0).reshape(3, 4) / 40
    grid = ProbabilityMap(value, np.ones((3, 4), np.bool_), 0.1, (-2.0, 7.0))
    for limits, top in (((0.0, 1.0), 1.0), (None, 11 / 40)):
        path = save_quantity(grid, tmp_path / f"{top}.png", label="width", limits=limits)
        seen = middle_of_cells(path, 3, 4)
        for cell in np.ndindex(3, 4):
            assert np.array_equal(seen[cell], colour(float(value[cell]) / top)), cell


def test_unknown_and_undefined_are_no_value(tmp_path: Path) -> None:
    value, observed = np.full((9, 9), 0.5), np.ones((9, 9), np.bool_)
    value[4, 4], observed[2, 6] = np.nan, False
    grid = ProbabilityMap(value, observed, 0.1)
    whole = ProbabilityMap(np.full((9, 9), 0.5), np.ones((9, 9), np.bool_), 0.1)
    shown = [
        (pixels(save_quantity(g, tmp_path / f"{n}.png", label="x")) == np.array(UNKNOWN, np.uint8))
        .all(axis=2)
        .sum()
        for n, g in enumerate((grid, whole))
    ]
    cell = round(1200 / 9)
    assert shown[0] - shown[1] == pytest.approx(2 * cell**2, rel=0.05)


def test_blocks_show_the_largest() -> None:
    value = np.array([[1.0, 2.0, np.nan], [0.0, -3.0, np.nan], [np.nan, 5.0, 7.0]])
    assert np.array_equal(block_largest(value, 2), [[2.0, np.nan], [5.0, 7.0]], equal_nan=True)
    assert np.array_equal(block_largest(value, 1), value, equal_nan=True)


def test_nothing_but_zeros(tmp_path: Path) -> None:
    grid = ProbabilityMap(np.zeros((2, 2)), np.ones((2, 2), np.bool_), 0.1)
    seen = middle_of_cells(save_quantity(grid, tmp_path / "m.png", label="std"), 2, 2)
    assert np.array_equal(seen[0, 0], colour(0.0))


def test_wrong_requests(tmp_path: Path) -> None:
    grid = ProbabilityMap(np.zeros((2, 2)), np.ones((2, 2), np.bool_), 0.1)
    with pytest.raises(ConfigError, match=r"ends in \.png"):
        save_quantity(grid, tmp_path / "m.jpg", label="x")
    save_quantity(grid, tmp_path / "m.png", label="x")
    with pytest.raises(OutputError, match="exists already"):
        save_quantity(grid, tmp_path / "m.png", label="x")
    save_quantity(grid, tmp_path / "m.png", label="x", force=True)
    empty = ProbabilityMap(np.zeros((2, 2)), np.zeros((2, 2), np.bool_), 0.1)
    with pytest.raises(InputError, match="nothing to draw"):
        save_quantity(empty, tmp_path / "e.png", label="x")


@pytest.mark.parametrize("shape", [(30, 40), (700, 31), (1300, 900), (4100, 1000)])
def test_pictures_drawn_in_bands_are_the_same(
    shape: tuple[int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(shape[0])
    value, observed = rng.random(shape), rng.random(shape) < 0.7
    value[: shape[0] // 2] = np.where(value[: shape[0] // 2] < 0.1, np.nan, 0.5)
    grid = ProbabilityMap(value, observed, 0.05, (-123.4, 5_000_000.3))
    for name, size in (("whole", 1 << 40), ("bands", 1 << 14)):
        monkeypatch.setattr(frame, "BAND", size)
        save_quantity(grid, tmp_path / f"{name}.png", label="a share")
    assert (tmp_path / "bands.png").read_bytes() == (tmp_path / "whole.png").read_bytes()
