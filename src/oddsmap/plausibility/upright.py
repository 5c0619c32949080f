# SPDX-License-Identifier: Apache-2.0
"""Whether a sensor that is upside down all the time stands on its feet by another reading."""

from __future__ import annotations

from collections.abc import Sequence

from oddsmap.plausibility.pose_readings import W_FIRST
from oddsmap.plausibility.sample import Glance
from oddsmap.poses.pose import Pose3
from oddsmap.scans.note import Note

__all__ = ["doubts_of_upright"]

# The cosine of how far from the vertical a z axis is that points up, or down: 37 degrees.
_UP = 0.8


def doubts_of_upright(glances: Sequence[Glance]) -> list[Note]:
    """Doubt quaternions that turn every scan over, where those with w first would turn none.

    A sensor that never turns gives no pair of scans that fits badly: only this shows it.
    """
    poses = [g.pose for g in glances if isinstance(g.pose, Pose3) and not g.from_image]
    if not poses or any(pose.rotation[2, 2] > -_UP for pose in poses):
        return []
    if any(W_FIRST.read(pose).rotation[2, 2] < _UP for pose in poses):
        return []
    text = (
        f"are these {W_FIRST.suspicion}? The sensor is upside down in each of {len(poses)} scans "
        f"that were looked at, and would be upright in all: if so, {W_FIRST.remedy}"
    )
    return [Note(text, code=W_FIRST.code, severity="warning")]
