# SPDX-License-Identifier: Apache-2.0
"""The forms of a map's arrays, from what its parts say of themselves.

Arrays have the narrowest type that holds their largest weight, and count votes where all weights
are whole ones. The largest weight of parts is a lower bound of that, and the sum of each group's
largest an upper one: mostly both give the same type, so that groups can be added up and written in
one go. Only those that could pass it have to be added up before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from oddsmap.evidence.stored_tiles import Form
from oddsmap.evidence.tiles import NOTHING
from oddsmap.scale.chunk_task import Weights
from oddsmap.scale.shard_records import Index

__all__ = ["form_of", "undecided"]


def undecided(groups: Mapping[Index, Sequence[Weights]]) -> set[Index]:
    """The groups that have to be added up before the type of an array is known.

    Args:
        groups: weights of the parts of each.
    """
    shared = {group for group, parts in groups.items() if len(parts) > 1}
    fraction = {
        group for group, parts in groups.items() if not all(part.whole_votes for part in parts)
    }
    if fraction and fraction <= shared:  # parts of votes may add up to whole ones
        return shared
    known = form_of(part for parts in groups.values() for part in parts)
    most = int(np.iinfo(known.dtype).max) * known.unit
    return {group for group in shared if sum(part.largest for part in groups[group]) > most}


def form_of(weights: Iterable[Weights]) -> Form:
    """The form of an array of all of them."""
    largest, whole_votes = 0, True
    for each in weights:
        largest, whole_votes = max(largest, each.largest), whole_votes and each.whole_votes
    return Form.narrowest(NOTHING._replace(largest=largest, whole_votes=whole_votes))
