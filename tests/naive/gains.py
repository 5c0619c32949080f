# SPDX-License-Identifier: Apache-2.0
"""What a beam is expected to tell, by its definition: over all maps, and over all returns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product

__all__ = ["by_cells", "by_maps", "by_returns", "entropy_drop", "information"]

Measure = Callable[[float, float], float]


def updated(p: float, vote: float) -> float:
    """The filter: odds times the odds of the inverse model at prior 1/2."""
    odds = p / (1.0 - p) * vote / (1.0 - vote)
    return odds / (1.0 + odds)


def information(p: float, vote: float) -> float:
    """Divergence of Kullback and Leibler of the belief after a vote from the one before."""
    q = updated(p, vote)
    return q * math.log(q / p) + (1.0 - q) * math.log((1.0 - q) / (1.0 - p))


def entropy_drop(p: float, vote: float) -> float:
    """How much the entropy of a cell falls by a vote."""
    return _entropy(p) - _entropy(updated(p, vote))


def _entropy(p: float) -> float:
    return -p * math.log(p) - (1.0 - p) * math.log(1.0 - p)


def told(cells: Sequence[float], hit: int | None, cleared: int, votes: tuple[float, float],
         of: Measure) -> float:  # fmt: skip
    """What a reading tells: of the cell it ends in, and of those before; None: of no return."""
    p_hit, p_miss = votes
    if hit is None:
        return sum(of(p, p_miss) for p in cells[:cleared])
    return sum(of(p, p_miss) for p in cells[:hit]) + of(cells[hit], p_hit)


def by_maps(cells: Sequence[float], cleared: int, votes: tuple[float, float], of: Measure) -> float:
    """The mean over all maps of the cells along a beam.

    Args:
        cells: p(occupied) of the cells along it.
        cleared: how many of them it clears where none is occupied.
        votes: p_hit and p_miss.
        of: what a vote tells of a cell.
    """
    mean = 0.0
    for world in product((False, True), repeat=len(cells)):
        chance = math.prod(p if full else 1.0 - p for p, full in zip(cells, world, strict=True))
        hit = world.index(True) if True in world else None
        mean += chance * told(cells, hit, cleared, votes, of)
    return mean


def by_returns(
    cells: Sequence[float], cleared: int, votes: tuple[float, float], of: Measure
) -> float:
    """The same as a sum over the cells that a beam may end in; arguments as in `by_maps`."""
    mean = math.prod(1.0 - p for p in cells) * told(cells, None, cleared, votes, of)
    for j, p in enumerate(cells):
        chance = p * math.prod(1.0 - q for q in cells[:j])
        mean += chance * told(cells, j, cleared, votes, of)
    return mean


def by_cells(
    cells: Sequence[float], cleared: int, votes: tuple[float, float], of: Measure
) -> list[tuple[float, float]]:
    """For each cell the probability that the beam gets there, and what it is expected to tell.

    Arguments as in `by_maps`.
    """
    p_hit, p_miss = votes
    nothing = math.prod(1.0 - p for p in cells)
    found = []
    for k, p in enumerate(cells):
        arrives = math.prod(1.0 - q for q in cells[:k])
        passes = arrives * (1.0 - p) - (0.0 if k < cleared else nothing)
        found.append((arrives, arrives * p * of(p, p_hit) + passes * of(p, p_miss)))
    return found
