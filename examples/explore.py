# SPDX-License-Identifier: Apache-2.0
"""A robot that maps an office it does not know, from frontier to frontier.

python examples/explore.py [-o explored.png] [--nearest]

It looks around, finds the frontiers of its map, asks what a scan from each would tell, weighs that
against the way there, and drives through cells that it knows to be free, until no frontier is left
that it can reach. `--nearest` goes to the nearest one each time instead.
"""

from __future__ import annotations

import argparse
import copy
import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import oddsmap
from oddsmap.simulate import Lidar2D, office_plan

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Cell = tuple[int, int]

START = (0.9, 7.0)
LASER = Lidar2D(beam_count=360, angle_min=-math.pi, range_max=6.0)
SENSOR = oddsmap.BeamSensor(range_max=LASER.range_max)
# What is free is asked often and of few scans: one pass is enough.
LIMITS = oddsmap.Thresholds(free=0.45)
RADIUS = 0.25  # of the robot [m]
SCAN_EVERY = 1.0  # of the way [m]
SMALLEST = 0.4  # frontiers below this are gaps between beams [m]
NEAR = 0.6  # how near to a frontier the robot has to get [m]
UNKNOWN = 0.05  # chance that a cell is occupied that nothing was seen of
PATIENCE = 2.0  # after this length of way what a look tells counts 1 / e [m]


@dataclass
class Step:
    """The map before the robot leaves for the next place.

    Attributes:
        view: the map.
        frontiers: of it.
        way: to the next place [m], shape (n, 2); empty at the end.
        driven: the whole way so far [m], shape (m, 2).
        scans: how many were taken so far.
    """

    view: Any
    frontiers: list[oddsmap.Frontier]
    way: FloatArray
    driven: FloatArray
    scans: int


def explore(resolution: float = 0.1, *, nearest: bool = False) -> Iterator[Step]:
    """Map the office, step by step."""
    plan, rng = office_plan(), np.random.default_rng(0)
    grid = oddsmap.EvidenceMap(resolution, sensor=SENSOR)
    driven, done = [np.array(START)], set[Cell]()
    grid.add(LASER.scan(plan, oddsmap.Pose2(*START, 0.0), rng))
    scans = 1
    while True:
        # Of a copy: what is added to a map later shows in its views.
        view = copy.deepcopy(grid).log_odds(thresholds=LIMITS)
        frontiers = view.frontiers(min_size=SMALLEST)
        way = next_way(view, frontiers, driven[-1], done, nearest=nearest)
        yield Step(view, frontiers, way, np.array(driven), scans)
        if len(way) == 0:
            return
        since = 0.0
        for left, place in zip(range(len(way) - 1, -1, -1), way, strict=True):
            since += float(np.linalg.norm(place - driven[-1]))
            driven.append(place)
            if since >= SCAN_EVERY or left == 0:
                grid.add(
                    LASER.scan(plan, oddsmap.Pose2(float(place[0]), float(place[1]), 0.0), rng)
                )
                scans, since = scans + 1, 0.0
        done.add(cell_of(view, way[-1]))


def next_way(
    view: Any,
    frontiers: list[oddsmap.Frontier],
    here: FloatArray,
    done: set[Cell],
    *,
    nearest: bool,
) -> FloatArray:
    """The way to the best place to look from [m], shape (n, 2); (0, 2): there is none."""
    cost, before = ways_from(view, cell_of(view, here))
    reached = np.array(list(cost))
    stands: list[Cell] = []
    for frontier in frontiers:
        far = np.linalg.norm(view.centre_of(reached) - frontier.goal, axis=1)
        stand = tuple(reached[np.argmin(far)].tolist())
        if far.min() <= NEAR and stand not in done:  # not where a scan has changed nothing
            stands.append(stand)
    if not stands:
        return np.empty((0, 2))
    lengths = np.array([cost[stand] for stand in stands]) * view.resolution
    poses = np.column_stack([view.centre_of(stands), np.zeros(len(stands))])
    gains = view.information_gain(poses, LASER.directions, LASER.range_max, unknown=UNKNOWN)
    # As in H. Gonzalez-Banos and J.-C. Latombe, Navigation strategies for exploring indoor
    # environments, 2002, whose gain is the area that comes into sight.
    value = -lengths if nearest else gains * np.exp(-lengths / PATIENCE)
    cell: Cell | None = stands[int(np.argmax(value))]
    way = []
    while cell is not None:
        way.append(cell)
        cell = before[cell]
    return np.asarray(view.centre_of(way[::-1]))


def ways_from(view: Any, start: Cell) -> tuple[dict[Cell, float], dict[Cell, Cell | None]]:
    """Dijkstra: for each cell in reach the length of the way [cells], and the cell before it.

    The robot keeps its radius from all that it does not know to be free.
    """
    lo, hi = view.bounds()
    state, radius = view.state((lo, hi)), RADIUS / view.resolution
    here = np.zeros(state.shape, np.bool_)
    here[start[1] - lo[1], start[0] - lo[0]] = True
    # A wall that has just come into sight may be too near: then the robot may leave.
    near = widened(state != oddsmap.State.FREE, radius) & ~widened(here, radius)
    allowed = ((state == oddsmap.State.FREE) & ~near) | here
    cost, before = {start: 0.0}, dict[Cell, Cell | None]({start: None})
    ahead = [(0.0, start)]
    while ahead:
        length, (x, y) = heapq.heappop(ahead)
        if length > cost[x, y]:
            continue
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            cell = x + dx, y + dy
            row, column = cell[1] - lo[1], cell[0] - lo[0]
            if not (0 <= row < len(allowed) and 0 <= column < len(allowed[0])):
                continue
            there = length + math.hypot(dx, dy)
            if allowed[row, column] and there < cost.get(cell, math.inf):
                cost[cell], before[cell] = there, (x, y)
                heapq.heappush(ahead, (there, cell))
    return cost, before


def widened(cells: BoolArray, radius: float) -> BoolArray:
    """The cells within a radius [cells] of some."""
    r = math.ceil(radius)
    ny, nx = cells.shape
    padded, wide = np.pad(cells, r), np.zeros_like(cells)
    for dy in range(-r, r + 1):
        for dx in range(-r, r + 1):
            if math.hypot(dx, dy) <= radius:
                wide |= padded[r + dy : r + dy + ny, r + dx : r + dx + nx]
    return wide


def cell_of(view: Any, place: FloatArray) -> Cell:
    """The cell that holds a place."""
    x, y = view.cell_of([place])[0].tolist()
    return x, y


def length_of(way: FloatArray) -> float:
    """The length of a way [m]."""
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def share_known(view: Any) -> float:
    """Which share of the floor that is free in truth is free in the map."""
    side = view.resolution
    size = round(20.0 / side), round(14.0 / side)
    free = ~office_plan().rasterise(side, (0, 0), size)
    return float((view.state(((0, 0), size)) == oddsmap.State.FREE)[free].mean())


def main() -> None:
    """Explore, and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", default="explored.png", help="a picture of the map")
    parser.add_argument("--nearest", action="store_true", help="go to the nearest frontier")
    given = parser.parse_args()
    for number, step in enumerate(explore(nearest=given.nearest)):
        print(
            f"{number:3}  {length_of(step.driven):6.1f} m driven, {step.scans:3} scans, "
            f"{len(step.frontiers):2} frontiers, {share_known(step.view):6.1%} of the floor known"
        )
    from oddsmap.plot.picture import save_picture

    save_picture(step.view.to_probability_map(), given.output, trajectory=step.driven, force=True)
    print(f"picture: {given.output}")


if __name__ == "__main__":
    main()
