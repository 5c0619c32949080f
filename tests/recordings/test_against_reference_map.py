# SPDX-License-Identifier: Apache-2.0
"""A recording without transforms, mapped by odometry, against a map that another program made."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import Pose3, build_map, load_ros, open_log
from oddsmap.odds import State

Mask = npt.NDArray[np.bool_]
Points = npt.NDArray[np.float64]


def centres(mask: Mask, corner: tuple[float, float], side: float) -> Points:
    rows, columns = np.nonzero(mask)
    return np.stack([columns + 0.5, rows + 0.5], axis=1) * side + corner


def grown(mask: Mask) -> Mask:
    """With the eight neighbours of each cell."""
    wide = np.pad(mask, 1)
    rows, columns = mask.shape
    shifted = (wide[i : i + rows, j : j + columns] for i in range(3) for j in range(3))
    return np.asarray(np.logical_or.reduce(list(shifted)))


def best_shift(near: Mask, cells: npt.NDArray[np.int64]) -> tuple[int, npt.NDArray[np.int64]]:
    """The shift of cells (x, y) that puts the most of them on a mask, and how many: all tried."""
    low = cells.min(axis=0)
    image = np.zeros(tuple((cells.max(axis=0) - low)[::-1] + 1))
    image[tuple((cells - low)[:, ::-1].T)] = 1.0
    shape = tuple(np.array(near.shape) + image.shape)
    spectrum = np.fft.rfft2(near, shape) * np.conj(np.fft.rfft2(image, shape))
    score = np.fft.irfft2(spectrum, shape)
    row, column = np.unravel_index(int(score.argmax()), shape)
    # Shifts down and to the left come around from the other end.
    y = row - shape[0] if row >= near.shape[0] else row
    x = column - shape[1] if column >= near.shape[1] else column
    return round(float(score.max())), np.array([x, y]) - low


@pytest.mark.realdata
def test_turtlebot3(data_folder: Path) -> None:
    """After alignment .999 of the walls of the reference lie within a cell of ours."""
    folder = data_folder / "ros"
    log = open_log(
        folder / "turtlebot3_gazebo.bag",
        body_from_sensor=Pose3(np.array([-0.032, 0.0, 0.0]), np.eye(3)),
    )
    side = 0.05
    ours = build_map(log, side).log_odds().to_probability_map()
    state = ours.state()
    near = grown(state == State.OCCUPIED)
    reference = load_ros(folder / "turtlebot3_world.yaml")
    walls = centres(reference.state() == State.OCCUPIED, reference.origin, side)
    found = []
    for degrees in np.arange(-10.0, 10.5, 0.5):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        turned = walls @ np.array([[c, s], [-s, c]])
        cells = np.floor((turned - ours.origin) / side).astype(np.int64)
        count, shift = best_shift(near, cells)
        found.append((count, abs(degrees), cells + shift))
    _, degrees, cells = max(found, key=lambda each: each[:2])
    inside = ((cells >= 0) & (cells < state.shape[::-1])).all(axis=1)
    x, y = cells[inside].T
    seen = state[y, x] != State.UNKNOWN
    assert degrees <= 2.0
    assert np.count_nonzero(seen) > 0.95 * len(walls)
    assert near[y, x][seen].mean() > 0.98, f"{near[y, x][seen].mean():.4f} of {seen.sum()}"
