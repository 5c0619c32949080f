# SPDX-License-Identifier: Apache-2.0
"""Whether ranges can be metres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oddsmap.plausibility.sample import Glance
from oddsmap.scans.note import Note

__all__ = ["doubts_of_ranges"]

# Half of the readings of a sensor on a robot, in a car or on a tripod are nearer than this [m]; in
# millimetres it would be an arm's length.
_FAR = 400.0


def doubts_of_ranges(glances: Sequence[Glance]) -> list[Note]:
    """Doubt ranges that are too long for anything but a sensor in the air."""
    typical = [glance.typical_range for glance in glances if not np.isnan(glance.typical_range)]
    if not typical or (middle := float(np.median(typical))) < _FAR:
        return []
    text = (
        f"are these ranges in millimetres? Half of the returns are farther than {middle:.4g} m: if "
        "so, divide ranges by 1000 (range_max and positions too, where they are in millimetres)"
    )
    return [Note(text, code="range.unit", severity="warning")]
