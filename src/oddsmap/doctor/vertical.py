# SPDX-License-Identifier: Apache-2.0
"""Whether z of the map points up: a robot's way lies in the plane across the vertical."""

from __future__ import annotations

import numpy as np

from oddsmap.doctor.examined import Examined
from oddsmap.scans.note import Note

__all__ = ["doubts_of_vertical"]

# The way is plane where it rises by less than this share of its narrower extent, which is so many
# typical ranges, and metres.
_PLANE, _WIDE, _WIDE_M = 0.15, 0.3, 1.0
# The cosine of how far from an axis its normal is, 20 degrees.
_ALONG = 0.94


def doubts_of_vertical(seen: Examined) -> list[Note]:
    """Doubt a map in space whose way is plane across x or y."""
    if seen.ndim == 2 or not seen.unit > 0.0:
        return []
    way = np.array([pose.translation for pose in seen.poses if pose.is_finite])
    if len(way) < 10:
        return []
    _, sizes, axes = np.linalg.svd(way - way.mean(axis=0), full_matrices=False)
    sizes = sizes / np.sqrt(len(way))
    if sizes[1] < max(_WIDE * seen.unit, _WIDE_M) or sizes[2] > _PLANE * sizes[1]:
        return []
    across = np.abs(axes[2])
    axis = int(np.argmax(across))
    if axis == 2 or across[axis] < _ALONG:
        return []
    text = (
        f"is {'xy'[axis]} the vertical of this map? The sensor's way is plane across it, with "
        f"{sizes[2]:.2g} m up and down on {sizes[0]:.2g} x {sizes[1]:.2g} m: poses of cameras are "
        "often so (x right, y down, z forward); turn the poses so that z points up, or heights are "
        "not heights"
    )
    return [Note(text, code="pose.vertical", severity="warning")]
