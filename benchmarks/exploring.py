"""Questions of explorers and planners about a map, for `queries.py`: each is checked, then timed.

Frontiers have a peer: a dense array of states with `scipy.ndimage` (dilation, labels, the cells of
each label), which is given that array. So have states at points: a look into the same array. What
scans are expected to tell and to read is compared with its definition, in rational arithmetic, on
some rays: there is no other library to ask.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap import BeamSensor, ForwardModel, State
from oddsmap.kernels.trace.cone3d import RADIUS
from tests.naive.forward import nearest
from tests.naive.gains import by_returns, information
from tests.naive.rays import Cell, cells_along

FloatArray = npt.NDArray[np.float64]
States = npt.NDArray[np.int8]
Jobs = dict[str, tuple[Callable[[], object], int]]
BEAMS, FEW, LEAST, SAME = 360, 20, 1e-12, 1e-6


def dense_states(view: Any) -> tuple[States, npt.NDArray[np.int64]]:
    """States of the box of known cells and of a ring around it, and its first cell."""
    index, p = view.cells()
    lo = index.min(axis=0) - 1
    states = np.full((index.max(axis=0) + 2 - lo)[::-1], State.UNKNOWN, np.int8)
    states[tuple((index - lo).T[::-1])] = view.thresholds.state(p, np.ones(len(p), np.bool_))
    return states, lo


def frontiers_by_ndimage(states: States) -> list[npt.NDArray[np.int64]]:
    """The cells of each cluster, x first."""
    from scipy import ndimage

    edge = (states == State.FREE) & ndimage.binary_dilation(states == State.UNKNOWN)
    label, _ = ndimage.label(edge, np.ones((3,) * states.ndim))
    number = label[edge]
    order = np.argsort(number, kind="stable")
    return np.split(np.argwhere(edge)[order, ::-1], np.flatnonzero(np.diff(number[order])) + 1)


def states_by_numpy(
    states: States, lo: npt.NDArray[np.int64], points: FloatArray, side: float
) -> States:
    """States at points, unknown outside the array."""
    cell = np.floor(points / side).astype(np.int64) - lo
    inside = ((cell >= 0) & (cell < states.shape[::-1])).all(axis=1)
    found = np.full(len(points), State.UNKNOWN, np.int8)
    found[inside] = states[tuple(cell[inside].T[::-1])]
    return found


def along(view: Any, start: FloatArray, way: FloatArray, reach: float) -> list[tuple[Cell, float]]:
    """The cells that a ray meets, and their probabilities."""
    side = view.resolution
    met = [cell for _, cell in cells_along((start / side).tolist(), way.tolist(), reach / side)]
    return list(zip(met, view.at(view.evidence.centre_of(met)).tolist(), strict=True))


def until_ended(chances: list[float]) -> list[float]:
    """Those of the cells until a beam is as good as ended."""
    left = np.cumprod(1.0 - np.array([0.0, *chances]))
    return chances[: np.count_nonzero(left[:-1] >= LEAST)]


def expected_range(
    model: ForwardModel, view: Any, start: FloatArray, way: FloatArray, cells: list[Cell]
) -> float:
    """The mean of where the first echo is from [m], by steps of the model's bins.

    That of a cell is from its nearest point; the cell that a ray starts in is free. In 3D a ray
    meets cells as balls, as the forward model has them: also of cells beside those on its way.
    """
    side = view.resolution
    at = (start / side).tolist()
    own = tuple(map(math.floor, at))  # also where a ray leaves a border downward
    if view.ndim == 3:
        near = np.unique([np.add(c, s) for c in cells for s in np.ndindex(3, 3, 3)], axis=0) - 1
        to = near + 0.5 - start / side
        distance, ahead = np.linalg.norm(to, axis=1), to @ way
        beside = np.linalg.norm(to - ahead[:, None] * way, axis=1)
        seen = np.arctan2(beside, ahead) <= np.minimum(RADIUS / distance, math.pi / 2)
        cells = list(map(tuple, near[seen].tolist()))
    cells = [c for c in cells if c != own]
    away = np.array([nearest(at, c) * side + model.range_bias for c in cells])
    mean, left, width = 0.0, 1.0, model.bin_width_at(side)
    p = view.at(view.evidence.centre_of(cells))
    for i in np.argsort(away):
        chance = left * model.detection * p[i]
        mean += chance * min((math.floor(away[i] / width) + 0.5) * width, model.range_max)
        left -= chance
    return mean + left * model.range_max


def explore(
    name: str, view: Any, points: FloatArray, places: FloatArray, ways: FloatArray, reach: float
) -> tuple[Jobs, dict[str, float]]:
    """What is timed, and how far answers are from those they are compared with.

    Raises:
        RuntimeError: they are not the same.

    Args:
        name: of the map.
        view: its log odds, in the map frame.
        points: to ask for states [m], shape (k, d).
        places: where rays start [m], shape (n, d).
        ways: unit vectors, shape (n, d).
        reach: how far beams see [m].
    """
    states, lo = dense_states(view)
    count, sensor = view.evidence.cell_count(), BeamSensor(range_max=reach)
    poses = np.zeros((max(1, len(places) // 1000), 3))
    if view.ndim == 2:
        poses[:, :2] = places[: len(poses)]
        given: Any = poses
    else:
        given = np.tile(np.eye(4), (len(poses), 1, 1))
        given[:, :3, 3] = places[: len(poses)]
    beams = ways[:BEAMS]
    asked = len(places) // 500
    ours = {found.cells.tobytes() for found in view.frontiers()}
    theirs = {(cells + lo).tobytes() for cells in frontiers_by_ndimage(states)}
    of_points = view.states_at(points).state
    looked_up = states_by_numpy(states, lo, points, view.resolution)
    met = [along(view, places[0], way, reach) for way in beams[:FEW]]
    told = view.information_gain(given[:1], beams[:FEW], reach, votes="beam")[0]
    chances = [until_ended([p for _, p in cells]) for cells in met]
    votes = view.p_hit, view.p_miss
    want = sum(by_returns(cells, len(cells), votes, information) for cells in chances)
    near = view.expected_ranges(places[0], beams[:FEW], sensor)
    model = sensor.forward_model()
    means = np.array(
        [
            expected_range(model, view, places[0], way, [cell for cell, _ in cells])
            for way, cells in zip(beams[:FEW], met, strict=True)
        ]
    )
    some = [
        along(view, place, way, reach)
        for place, way in zip(places[: 5 * FEW], ways[: 5 * FEW], strict=True)
    ]
    cells_of_a_beam = sum(len(until_ended([p for _, p in cells])) for cells in some) / len(some)
    apart = {
        f"{name}: frontiers": float(len(ours)),
        f"{name}: cells of a beam": cells_of_a_beam,
        f"{name}: frontiers that differ": float(len(ours ^ theirs)),
        f"{name}: states that differ": float(np.count_nonzero(of_points != looked_up)),
        f"{name}: gain, relative": abs(told - want) / want,
        f"{name}: expected range [m]": float(np.abs(near - means).max()),
    }
    if max(list(apart.values())[2:]) > SAME:
        raise RuntimeError(f"answers differ: {apart}")
    return {
        f"{name} frontiers, cells": (view.frontiers, count),
        f"{name} ndimage, cells": (lambda: frontiers_by_ndimage(states), count),
        f"{name} states_at": (lambda: view.states_at(points), len(points)),
        f"{name} NumPy, dense": (
            lambda: states_by_numpy(states, lo, points, view.resolution), len(points)
        ),
        f"{name} gain, beams x cells": (
            lambda: view.information_gain(given, beams, reach, votes="beam"),
            round(len(poses) * len(beams) * cells_of_a_beam),
        ),
        f"{name} expected_ranges": (
            lambda: view.expected_ranges(places[:asked], ways[:asked], sensor), asked
        ),
    }, apart  # fmt: skip
