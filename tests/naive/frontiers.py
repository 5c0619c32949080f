# SPDX-License-Identifier: Apache-2.0
"""Frontiers by their definition: sets of cells."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

__all__ = ["frontiers_of", "neighbours"]

Cell = tuple[int, ...]
FREE, UNKNOWN = 0, -1


def neighbours(cell: Cell, connectivity: str) -> list[Cell]:
    """The cells that share a side with a cell, or also those that share a corner."""
    most = 1 if connectivity == "sides" else len(cell)
    return [
        tuple(x + s for x, s in zip(cell, step, strict=True))
        for step in product((-1, 0, 1), repeat=len(cell))
        if 0 < sum(map(abs, step)) <= most
    ]


def frontiers_of(states: Mapping[Cell, int], next_to: str, joined: str) -> set[frozenset[Cell]]:
    """Clusters of the free cells that have an unknown neighbour."""
    edge = {
        cell
        for cell, state in states.items()
        if state == FREE
        and any(states.get(other, UNKNOWN) == UNKNOWN for other in neighbours(cell, next_to))
    }
    found = set()
    while edge:
        ahead, group = [edge.pop()], set()
        while ahead:
            cell = ahead.pop()
            group.add(cell)
            near = edge.intersection(neighbours(cell, joined))
            edge -= near
            ahead += near
        found.add(frozenset(group))
    return found
