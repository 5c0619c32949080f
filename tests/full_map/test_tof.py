# SPDX-License-Identifier: Apache-2.0
"""Full maps of real wide beams in space: the panel that motion capture knows is where it stands."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import oddsmap
from examples import tof8x8
from oddsmap.full_map.full_map import FullMap

FloatArray = npt.NDArray[np.float64]

RESOLUTION = 0.1
# The point that motion capture gives is level with the panel's upper edge: no return from the panel
# comes from more than centimetres above it. Half of a width that it has for sure, how far below the
# edge it reaches for sure, and up to where above it there is nothing.
HALF_WIDTH, BELOW, ABOVE = 0.25, 0.35, 0.2


def panel(folder: Path) -> FloatArray:
    """Where motion capture sees the panel: the median of its positions [m]."""
    with (folder / "state_Vicon.csv").open(newline="", encoding="utf-8") as table:
        rows = [row[2:5] for row in csv.reader(table) if row[0] == "Surface"]
    return np.asarray(np.median(np.array(rows, float), axis=0))


def full_map_of(folder: Path, scratch: Path) -> FullMap:
    tof8x8.main(str(folder), str(scratch / "tof.npz"))
    return oddsmap.build_full_map(oddsmap.open_log(scratch / "tof.npz"), RESOLUTION, threads=2)


@pytest.mark.realdata
@pytest.mark.parametrize("name", ["R0", "A0"])
def test_the_panel_is_found_at_its_place(name: str, data_folder: Path, tmp_path: Path) -> None:
    folder = data_folder / "tof8x8" / name
    x, y, top = panel(folder)
    assert (x, top) == (pytest.approx(1.41, abs=0.01), pytest.approx(0.45, abs=0.01))
    full_map = full_map_of(folder, tmp_path)
    assert full_map.converged
    index, probability = full_map.cells()
    centre = (index + 0.5) * RESOLUTION
    height = centre[:, 2] - top
    across = np.abs(centre[:, 1] - y) < HALF_WIDTH
    # Along x the first occupied cell is the one that motion capture puts the panel in.
    inside = across & (height > -BELOW) & (height < -RESOLUTION / 2)
    first = first_occupied(index[inside], probability[inside])
    assert len(first) == 15
    assert set(first.values()) == {int(np.floor(x / RESOLUTION))}, first
    # Nor does it reach higher than it is.
    over = across & (np.abs(centre[:, 0] - x) < 0.2) & (height > RESOLUTION) & (height < ABOVE)
    assert over.sum() >= 10
    assert (probability[over] < 0.5).all()


def first_occupied(
    index: npt.NDArray[np.int64], probability: FloatArray
) -> dict[tuple[int, int], int | None]:
    """For each line of cells along x, by its y and z: the least x of an occupied one."""
    first: dict[tuple[int, int], int | None] = {}
    for (x, y, z), p in zip(index.tolist(), probability, strict=True):
        before = first.setdefault((y, z), None)
        if p > 0.5 and (before is None or x < before):
            first[y, z] = x
    return first
