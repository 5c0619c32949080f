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
        "too few passes": np.count_nonzero(open_ & ~gap & ~judged.doubted),
        "hits and passes that disagree": np.count_nonzero(open_ & judged.doubted),
    }
    said = ", ".join(
        f"{cause} ({_share(count, undecided)})"
        for cause, count in sorted(causes.items(), key=lambda item: -item[1])
        if count
    )
    yield Note(
        f"{_share(undecided, known)} of the {known:,} columns seen in the band are undecided, with "
        f"p between {limits.free:g} (free) and {limits.occupied:g} (occupied). The reasons: "
        f"{said}. What helps: {_remedy(gaps, undecided)}.",
        code="projection.undecided",
    )


def _where_unseen(gaps: BoolArray, slab: float) -> str:
    bottom, between, top = (np.count_nonzero(each) for each in gaps)
    most = max((bottom, "bottom"), (between, "middle"), (top, "top"))[1]
    if slab == np.inf:
        return "no beam in the whole band"
    height = f"{slab:g} m" if slab else "a cell"
    return f"{height} or more without a beam, mostly at the {most} of the band"


def _remedy(gaps: BoolArray, undecided: int | np.integer) -> str:
    ways = ["more scans"]
    if 4 * np.count_nonzero(gaps[2]) > undecided:
        ways.append("a lower --z-max (z_max=), if the robot is no taller")
    ways.append("a larger --slab (slab=), which may miss lower things")
    return "; ".join(ways)


def _share(count: int | np.integer, total: int | np.integer) -> str:
    return f"{count / total:.0%}" if 200 * count >= total else "under 1%"
