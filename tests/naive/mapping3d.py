"""A slow and obvious mapper of space: exact rational arithmetic, one cell at a time.

Points are in cells, of any dimension; nothing here knows that there are three axes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from fractions import Fraction
from itertools import pairwise, product

Cell = tuple[int, ...]
Point = tuple[float, ...]
Beam = tuple[Point, Point, bool]
Weight = Fraction | int


def cell_of(point: Iterable[float | Fraction]) -> Cell:
    """The half-open cell [i, i + 1) x [j, j + 1) x ... that holds a point given in cells."""
    return tuple(math.floor(x) for x in point)


def crossed(start: Point, end: Point) -> dict[Cell, Fraction]:
    """Every cell in which the segment has positive length, and its share of the segment.

    Between two neighbouring border crossings the segment is inside one cell: that of the middle.
    Coordinates are whole multiples of 1 / `one` cell, and `whole` is a length of the segment in
    whose unit all crossings lie at whole numbers, so Python's integers hold everything exactly.
    """
    ratios = [x.as_integer_ratio() for x in (*start, *end)]
    one = math.lcm(*(bottom for _, bottom in ratios))
    places = [top * (one // bottom) for top, bottom in ratios]
    a, b = places[: len(start)], places[len(start) :]
    way = [there - here for here, there in zip(a, b, strict=True)]
    if not any(way):
        return {}
    whole = math.prod(abs(d) for d in way if d)
    at = {0, whole}
    for x0, d in zip(a, way, strict=True):
        if d != 0:
            low, high = min(x0, x0 + d), max(x0, x0 + d)
            borders = range(-(-low // one), high // one + 1)
            at.update((border * one - x0) * (whole // d) for border in borders)
    cells = {}
    for t0, t1 in pairwise(sorted(at)):
        # (t0 + t1) / 2 / whole of the way from the start.
        middle = (x0 * 2 * whole + (t0 + t1) * d for x0, d in zip(a, way, strict=True))
        cells[tuple(x // (2 * whole * one) for x in middle)] = Fraction(t1 - t0, whole)
    return cells


def length_inside(start: Point, end: Point, cell: Cell) -> Fraction:
    """Share of the segment inside the half-open cell, exactly.

    Along each axis the segment is inside for an interval of its parameter t; a segment that
    rests on a border along an axis is inside the cell that owns the border (half-open).
    """
    lo, hi = Fraction(0), Fraction(1)
    for i, first, last in zip(cell, start, end, strict=True):
        a, b = Fraction(first), Fraction(last)
        if a == b:
            if not i <= a < i + 1:
                return Fraction(0)
            continue
        t0, t1 = (i - a) / (b - a), (i + 1 - a) / (b - a)
        lo, hi = max(lo, min(t0, t1)), min(hi, max(t0, t1))
    return max(Fraction(0), hi - lo)


def crossed_in_box(start: Point, end: Point) -> dict[Cell, Fraction]:
    """As `crossed`, by looking at every cell of the segment's box: slower and more obvious."""
    ends = zip(cell_of(start), cell_of(end), strict=True)
    spans = [range(min(i, j) - 1, max(i, j) + 2) for i, j in ends]
    if start == end:
        return {}
    shares = {cell: length_inside(start, end, cell) for cell in product(*spans)}
    return {cell: share for cell, share in shares.items() if share > 0}


def edge_distance(start: Point, end: Point, cell: Cell) -> float:
    """Distance [cells] from the segment to the nearest edge of a cell of space.

    Next to an edge (in the plane: a corner) a segment decides between two cells, and a kernel in
    fixed point may take the other one.
    """
    nearest = math.inf
    for axis, across in ((0, (1, 2)), (1, (2, 0)), (2, (0, 1))):
        # The part of the segment that is between the ends of the four edges along this axis.
        a, d = start[axis], end[axis] - start[axis]
        t0, t1 = 0.0, 1.0
        if d != 0:
            one, other = (cell[axis] - 0.01 - a) / d, (cell[axis] + 1.01 - a) / d
            t0, t1 = max(t0, min(one, other)), min(t1, max(one, other))
        elif not cell[axis] - 0.01 <= a <= cell[axis] + 1.01:
            continue
        if t0 > t1:
            continue
        for corner in product((0, 1), repeat=2):
            px, py = (cell[k] + c - start[k] for k, c in zip(across, corner, strict=True))
            dx, dy = (end[k] - start[k] for k in across)
            t = min(t1, max(t0, (px * dx + py * dy) / (dx * dx + dy * dy or 1.0)))
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
