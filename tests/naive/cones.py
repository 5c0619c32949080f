# SPDX-License-Identifier: Apache-2.0
"""The votes of one wide beam by the rule in words: every cell of a box is asked.

Lengths and positions are in cells. Floats are combined as `kernels/vote/cone_votes.py` combines
them, so that results are equal to the last bit; which cells the axis passes is found in exact
arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

from oddsmap.sensors.cone import ConeSensor
from tests.naive.mapping3d import Cell, cell_of, crossed

ONE = 65536


def cone_votes(
    sensor: ConeSensor,
    resolution: float,
    origin: Sequence[float],
    axis: Sequence[float],
    reach: float,
    end: Sequence[float],
    hit: bool,
    *,
    seen: bool | None = None,
) -> dict[Cell, tuple[int, int]]:
    """Cell -> (hits, passes) [1/65536 vote] of one beam, cells of weight 0 included.

    A beam that is `seen` and no `hit` is a return that may not mark; by default every return may.
    """
    d = len(origin)
    home = cell_of(origin)
    at = [x - i for x, i in zip(origin, home, strict=True)]
    end = [x - i for x, i in zip(end, home, strict=True)]
    half_angle = math.radians(sensor.cone_deg) / 2
    cosine = 0.0 if sensor.cone_deg == 180 else math.cos(half_angle)
    returned = hit if seen is None else seen
    half = max(sensor.hit_width / resolution, 1.0) / 2 if returned else 0.5
    near, far = reach - half, reach + half
    decline = sensor.range_falloff * (resolution / (sensor.range_max or math.inf))

    def place(cell: Cell) -> tuple[float, float]:
        """Component of a cell's centre along the axis, and its range."""
        x, y, z = (*((i + 0.5) - f for i, f in zip(cell, at, strict=True)), 0.0)[:3]
        ax, ay, az = (*axis, 0.0)[:3]
        return ax * x + (ay * y + az * z), math.sqrt(x * x + (y * y + z * z))

    def angular(along: float, r: float) -> float:
        if sensor.angular_falloff == 0 or r == 0:
            return 1.0
        off = math.acos(min(1.0, along / r)) / half_angle
        return max(0.0, 1.0 - sensor.angular_falloff * off * off)

    box = range(math.floor(-far) - 2, math.ceil(far) + 3)
    centred: list[tuple[Cell, float, float]] = []  # cell, range, weight; z before y before x
    for reverse in product(box, repeat=d):
        along, r = place(reverse[::-1])
        if along >= cosine * r:
            weight = angular(along, r) * max(0.0, 1.0 - decline * r)
            centred.append((reverse[::-1], r, weight))
    inside = {cell for cell, _, _ in centred}
    tip = cell_of(end)
    on_axis = []
    shares = crossed(tuple(at), tuple(end))
    for cell in sorted(shares, key=lambda c: _order(c, at, end)):
        if cell not in inside and shares[cell] > 1e-9:
            _, r = place(cell)
            on_axis.append((cell, r, max(0.0, 1.0 - decline * r)))
    cells = [entry for entry in centred + on_axis if entry[0] != tip]

    votes: dict[Cell, tuple[int, int]] = {}
    for cell, r, weight in cells:
        if r < near:
            faded = 1.0 - sensor.pass_falloff * ((r / reach) * (r / reach))
            votes[cell] = (0, round(ONE * (weight * faded)))
    if hit:
        arc = [(cell, weight) for cell, r, weight in cells if near <= r <= far]
        arc.append((tip, max(0.0, 1.0 - decline * place(tip)[1])))
        for (cell, _), share in zip(arc, _hits(sensor, [w for _, w in arc]), strict=True):
            votes[cell] = (share, 0)
    return {
        tuple(i + j for i, j in zip(cell, home, strict=True)): vote for cell, vote in votes.items()
    }


def _hits(sensor: ConeSensor, weights: list[float]) -> list[int]:
    if not sensor.share_hit:
        return [round(ONE * weight) for weight in weights]
    total = 0.0
    for weight in weights:
        total += weight
    if total == 0:
        return [0] * (len(weights) - 1) + [ONE]
    shares, running, given = [], 0.0, 0
    for weight in weights:
        running += weight
        upto = round(ONE * (running / total))
        shares.append(upto - given)
        given = upto
    return shares


def _order(cell: Cell, start: Sequence[float], end: Sequence[float]) -> int:
    """Cells along a segment, in order: each step goes to a neighbour, farther in the same way."""
    ways = (1 if b >= a else -1 for a, b in zip(start, end, strict=True))
    return sum(i * way for i, way in zip(cell, ways, strict=True))
