"""Spread hits, fading passes and lengths, the obvious way: exact crossings, then the formulas."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence

from tests.naive.mapping3d import Cell, Point, cell_of, crossed

# End of the free part, tip of the occupied one, did it hit?
Beam = tuple[Point, Point, bool]


def intervals(start: Point, stop: Point) -> Iterator[tuple[Cell, float, float]]:
    """Cells in the order in which a segment meets them: way from the start in and out [cells]."""
    way, t = math.dist(start, stop), 0.0
    for cell, share in crossed(start, stop).items():
        yield cell, t * way, min(1.0, t + float(share)) * way
        t += float(share)


def hit_shares(
    end: Point, tip: Point, half_width: float, sigma: float, share: bool
) -> dict[Cell, float]:
    """What each cell of an occupied region gets of the hit."""
    if end == tip:
        return {cell_of(end): 1.0}
    way = math.dist(end, tip)
    if sigma == 0.0:
        return {
            cell: (stop - start) / way if share else 1.0
            for cell, start, stop in intervals(end, tip)
        }

    def normal(at: float) -> float:
        """Cumulated from the return, which is half_width before the tip."""
        return 0.5 * math.erf((at - (way - half_width)) / sigma / math.sqrt(2.0))

    total = normal(way) - normal(0.0)
    return {
        cell: (normal(stop) - normal(start)) / total for cell, start, stop in intervals(end, tip)
    }


def pass_weights(origin: Point, end: Point, fade: float) -> dict[Cell, float]:
    """The mean of the weight along a beam's free part inside each cell but the last."""

    way = math.dist(origin, end)
    weights = {}
    for cell, start, stop in intervals(origin, end):
        if cell == cell_of(end) or stop <= start:
            continue
        # On either side of where passes begin to fade the weight is a straight line.
        turn = min(max(way - fade, start), stop)
        middle = way - (turn + stop) / 2
        fading = min(1.0, middle / fade) * (stop - turn) if stop > turn else 0.0
        weights[cell] = ((turn - start) + fading) / (stop - start)
    return weights


def map_scan(
    origin: Point,
    beams: Sequence[Beam],
    votes: str,
    *,
    half_width: float,
    sigma: float,
    share: bool,
    fade: float,
) -> dict[Cell, tuple[float, float]]:
    """One scan's hits and passes."""
    hits: dict[Cell, list[float]] = defaultdict(list)
    passes: dict[Cell, list[float]] = defaultdict(list)
    for end, tip, hit in beams:
        for cell, weight in pass_weights(origin, end, fade).items():
            passes[cell].append(weight)
        if hit:
            for cell, weight in hit_shares(end, tip, half_width, sigma, share).items():
                hits[cell].append(weight)
    combine = sum if votes == "beam" else max
    result = {}
    for cell in hits.keys() | passes.keys():
        hit_weight = float(combine(hits.get(cell, [0.0])))
        pass_weight = float(combine(passes.get(cell, [0.0])))
        if votes == "scan" and hit_weight > 0.0:
            pass_weight = 0.0
        result[cell] = (hit_weight, pass_weight)
    return result


def lengths(origin: Point, ends: Sequence[Point]) -> dict[Cell, float]:
    """How long beams are inside each cell [cells]."""
    total: dict[Cell, float] = defaultdict(float)
    for end in ends:
        for cell, start, stop in intervals(origin, end):
            total[cell] += stop - start
    return total
