"""A slow and obvious mapper of the plane: exact rational arithmetic, one cell at a time."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from fractions import Fraction

Cell = tuple[int, int]
Point = tuple[float, float]
Beam = tuple[Point, Point, bool]
Weight = Fraction | int


def cell_of(point: Point) -> Cell:
    """The cell [i, i + 1) x [j, j + 1) that holds a point given in cells."""
    return math.floor(point[0]), math.floor(point[1])


def length_inside(start: Point, end: Point, cell: Cell) -> Fraction:
    """Share of the segment inside the half-open cell, exactly.

    Along each axis the segment is inside for an interval of its parameter t; a segment that
    rests on a border along an axis is inside the cell that owns the border (half-open).
    """
    lo, hi = Fraction(0), Fraction(1)
    for axis in range(2):
        a, b = Fraction(start[axis]), Fraction(end[axis])
        if a == b:
            if not cell[axis] <= a < cell[axis] + 1:
                return Fraction(0)
            continue
        t0, t1 = (cell[axis] - a) / (b - a), (cell[axis] + 1 - a) / (b - a)
        lo, hi = max(lo, min(t0, t1)), min(hi, max(t0, t1))
    return max(Fraction(0), hi - lo)


def crossed(start: Point, end: Point) -> dict[Cell, Fraction]:
    """Every cell in which the segment has positive length, and its share of the segment."""
    first, last = cell_of(start), cell_of(end)
    cells = {}
    for x in range(min(first[0], last[0]) - 1, max(first[0], last[0]) + 2):
        for y in range(min(first[1], last[1]) - 1, max(first[1], last[1]) + 2):
            share = length_inside(start, end, (x, y))
            if share > 0:
                cells[x, y] = share
    return cells


def corner_distance(start: Point, end: Point, cell: Cell) -> float:
    """Distance [cells] from the segment to the nearest corner of a cell."""
    nearest = math.inf
    for cx, cy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        px, py = cell[0] + cx - start[0], cell[1] + cy - start[1]
        dx, dy = end[0] - start[0], end[1] - start[1]
        t = min(1.0, max(0.0, (px * dx + py * dy) / (dx * dx + dy * dy or 1.0)))
        nearest = min(nearest, math.hypot(px - t * dx, py - t * dy))
    return nearest


def map_scan(
    origin: Point,
    beams: Iterable[Beam],
    votes: str,
    share: bool = False,
    passed: Callable[[Point, Point], Iterable[Cell]] = crossed,
) -> dict[Cell, tuple[Weight, Weight]]:
    """One scan's votes: beams are (end of the free part, end of the occupied part, hit?)."""
    hits: dict[Cell, Weight] = defaultdict(int)
    passes: dict[Cell, Weight] = defaultdict(int)

    def put(votes_of: dict[Cell, Weight], cell: Cell, weight: Weight) -> None:
        before = votes_of[cell]
        votes_of[cell] = before + weight if votes == "beam" else max(before, weight)

    for end, tip, hit in beams:
        last = cell_of(end)
        for cell in passed(origin, end):
            if cell != last:
                put(passes, cell, 1)
        if hit:
            zone = {last: Fraction(1)} if end == tip else crossed(end, tip)
            for cell, part in zone.items():
                put(hits, cell, part if share else 1)
    result = {}
    for cell in hits.keys() | passes.keys():
        hit_weight, pass_weight = hits.get(cell, 0), passes.get(cell, 0)
        if votes == "scan" and hit_weight > 0:
            pass_weight = 0
        result[cell] = (hit_weight, pass_weight)
    return result
