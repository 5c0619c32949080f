# SPDX-License-Identifier: Apache-2.0
"""What an export loses of cells between the thresholds, and what would change that."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

from oddsmap.odds import State, Thresholds, logit, sigmoid

if TYPE_CHECKING:
    from oddsmap.array_types import FloatArray
    from oddsmap.cli.export_sources import Source
    from oddsmap.map_files.fields import Plane
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.posterior.belief import Belief

__all__ = ["knows_undecided", "undecided_in_plane", "undecided_in_points"]

# A share that is worth a line. Of five long logs of offices 5 to 22 % of the cells are undecided.
_NOTABLE = 0.3


def knows_undecided(notes: Iterable[str]) -> bool:
    """Whether a projection has said what is undecided, and why."""
    return any(getattr(note, "code", None) == "projection.undecided" for note in notes)


def undecided_in_plane(plane: Plane, thresholds: Thresholds | None, view: Source) -> str | None:
    """What to say of a ROS map that knows free, occupied and unknown alone.

    Args:
        plane: what is written.
        thresholds: what is free and what is occupied in it.
        view: what it was made of.
    """
    import numpy as np

    from oddsmap.map_files.plane import windows

    limits = thresholds or Thresholds()
    seen, undecided = 0, []
    for rows, columns in windows(plane.shape):
        part = plane.part(rows, columns)
        if not part.observed.any():
            continue
        state = limits.state(part.probability, part.observed)
        undecided.append(part.probability[state == State.UNDECIDED])
        seen += int(np.count_nonzero(part.observed))
    count = sum(map(len, undecided))
    if count < _NOTABLE * seen or count == 0:
        return None
    remedy = _fewer_passes(np.concatenate(undecided), limits, view) or (
        "More scans would decide them, or other limits (--free, --occupied)."
    )
    return (
        f"{count / seen:.0%} of the {seen:,} seen cells are undecided, with p between "
        f"{limits.free:g} (free) and {limits.occupied:g} (occupied), and are written as unknown. "
        f"{remedy} --mode scale keeps their probabilities."
    )


def undecided_in_points(view: Belief | VoxelMap, limits: Thresholds) -> str | None:
    """What to say of points of occupied cells, where many are nearly that."""
    import numpy as np

    likely = written = 0
    for part in view.points(0.5):
        likely += len(part.probability)
        written += int(np.count_nonzero(part.probability >= limits.occupied))
    left = likely - written
    if left < _NOTABLE * likely or left <= 0:
        return None
    return (
        f"{left / likely:.0%} of the {likely:,} cells with p of 0.5 or more are left out, because "
        f"a cell is occupied from {limits.occupied:g} on. A lower --occupied brings them in, or a "
        "larger --p-hit or --prior."
    )


def _fewer_passes(p: FloatArray, limits: Thresholds, view: Source) -> str | None:
    """How few passes are the cause, and the --p-miss that mends it, where that is so."""
    import numpy as np

    from oddsmap.posterior.log_odds import LogOdds

    if not isinstance(view, LogOdds) or view.prior_map is not None or limits.free <= 0.0:
        return None
    start, step, goal = (float(logit(x)) for x in (view.prior, view.p_miss, limits.free))
    passed = p[p < view.prior]
    if 2 * len(passed) < len(p) or goal >= start:
        return None  # most are undecided for another reason than few passes
    passes = max(1, round((float(np.median(logit(passed))) - start) / step))
    wanted = math.floor(100 * float(sigmoid((goal - start) / passes))) / 100
    if not 0.0 < wanted < view.p_miss:
        return None
    needed = math.ceil((goal - start) / step - 1e-9)
    return (
        f"It takes {needed} passes to make a cell free, and most of these have {passes}: with "
        f"--p-miss {wanted:g} they are free."
    )
