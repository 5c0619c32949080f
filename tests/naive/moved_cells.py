# SPDX-License-Identifier: Apache-2.0
"""A map moved by any pose, cell by cell of the new map: each asks which old cell holds it."""

from __future__ import annotations

import math
from itertools import product

from tests.kit import Votes

__all__ = ["moved_votes"]


def moved_votes(
    votes: Votes, rotation: list[list[float]], shift: list[float]
) -> tuple[Votes, dict[tuple[int, ...], int]]:
    """The votes of the moved map, and for each old cell how many new ones took its counts.

    Args:
        votes: of the old map.
        rotation: from the old frame to the new one, row by row.
        shift: likewise, in cells.
    """
    d = len(shift)
    centres = [
        [sum(rotation[row][k] * (at[k] + 0.5) for k in range(d)) + shift[row] for row in range(d)]
        for at in votes
    ]
    # Far enough around where the centres go that no cell is missed.
    around = [
        range(
            math.floor(min(centre[axis] for centre in centres)) - 3,
            math.floor(max(centre[axis] for centre in centres)) + 4,
        )
        for axis in range(d)
    ]
    found: Votes = {}
    taken = dict.fromkeys(votes, 0)
    for cell in product(*around):
        off = [cell[k] + 0.5 - shift[k] for k in range(d)]
        place = []
        for axis in range(d):
            total = off[0] * rotation[0][axis]
            for k in range(1, d):
                total += off[k] * rotation[k][axis]
            place.append(math.floor(total))
        if tuple(place) in votes:
            found[cell] = votes[tuple(place)]
            taken[tuple(place)] += 1
    return found, taken
