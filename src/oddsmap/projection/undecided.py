# SPDX-License-Identifier: Apache-2.0
"""How many columns of a projection are neither free nor occupied, why, and what changes that."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.odds import State, Thresholds
from oddsmap.projection.rules import Judged
from oddsmap.scans.note import Note

__all__ = ["note_of_undecided"]


def note_of_undecided(
    probability: FloatArray, judged: Judged, limits: Thresholds, slab: float
) -> Iterator[Note]:
    """What to say of undecided columns; nothing where there are none, or the rule keeps no causes.

    Args:
        probability: of each column, shape (n,).
        judged: what the rule found.
        limits: which columns are free, and which occupied.
        slab: height of a slab [m].
    """
    if judged.doubted is None or judged.gaps is None:
        return
    open_ = limits.state(probability, judged.known) == State.UNDECIDED
    known, undecided = np.count_nonzero(judged.known), np.count_nonzero(open_)
    if not undecided:
        return
    gaps = judged.gaps & open_ & ~judged.doubted
    gap = gaps.any(axis=0)
    causes = {
        _where_unseen(gaps, slab): np.count_nonzero(gap),
        "too few beams passed": np.count_nonzero(open_ & ~gap & ~judged.doubted),
        "hits and passes of a cell disagree": np.count_nonzero(open_ & judged.doubted),
    }
    said = ", ".join(
        f"{cause} ({_share(count, undecided)})"
        for cause, count in sorted(causes.items(), key=lambda item: -item[1])
        if count
    )
    yield Note(
        f"{_share(undecided, known)} of the {known:,} columns seen in the band are undecided, "
        f"neither free (p up to {limits.free:g}) nor occupied (from {limits.occupied:g}): {said}. "
        f"{_remedy(gaps, undecided)}",
        code="projection.undecided",
    )


def _where_unseen(gaps: BoolArray, slab: float) -> str:
    bottom, between, top = (np.count_nonzero(each) for each in gaps)
    most = max((bottom, "bottom"), (between, "middle"), (top, "top"))[1]
    height = f"{slab:g} m" if 0.0 < slab < np.inf else "the band" if slab else "a cell"
    return f"no beam crossed {height} or more of it, most often at its {most}"


def _remedy(gaps: BoolArray, undecided: int | np.integer) -> str:
    ways = ["More scans decide them"]
    if 4 * np.count_nonzero(gaps[2]) > undecided:
        ways.append("a lower top of the band (--z-max), if the robot is no higher")
    ways.append("or a higher slab (--slab), which may miss what is lower")
    return ", ".join(ways)


def _share(count: int | np.integer, total: int | np.integer) -> str:
    return f"{count / total:.0%}" if 200 * count >= total else "under 1%"
