# SPDX-License-Identifier: Apache-2.0
"""The beams of a scan that may speak of a place; all others cannot.

What a cell gets from a scan depends on the beams that speak of it alone, so a scan of these gives
it the same votes, to the bit. Which of them do is for the mapping itself to say: here a beam is
left out only where it passes by at a distance, or ends well before.
"""

from __future__ import annotations

import math

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.scans.scan import Scan
from oddsmap.sensors.registry import Sensor

__all__ = ["beams_near", "rays_of"]

# Half the diagonal of a cell is 0.71 (2D) or 0.87 sides (3D); what directions in single precision
# are off by at 100 m is a fraction of a millimetre.
_NEAR = 1.5


def beams_near(scan: Scan, centre: FloatArray, resolution: float, sensor: Sensor) -> IntArray:
    """Numbers of the beams that may speak of a cell.

    Args:
        scan: of narrow beams or of cones, its pose finite.
        centre: of the cell [m], shape (d,).
        resolution: its side [m].
        sensor: the sensor model: how wide beams are, and how far they say something.
    """
    pose = scan.map_from_sensor
    near = _NEAR * resolution
    to = (centre - pose.translation) @ pose.rotation  # rows from the right: by the inverse
    if scan.beam_origins is not None:
        to = to - scan.beam_origins
    along = scan.directions @ to if to.ndim == 1 else (scan.directions * to).sum(axis=1)
    cone_deg = getattr(sensor, "cone_deg", None)
    if cone_deg is None:
        aside = along[:, None] * scan.directions - to
        may = (along >= -near) & (np.square(aside).sum(axis=1) <= near * near)
    else:
        distance = np.sqrt(np.square(to).sum(axis=-1))
        with np.errstate(divide="ignore", invalid="ignore"):
            width = math.radians(cone_deg / 2) + np.arcsin(np.minimum(1.0, near / distance))
        may = (along >= distance * np.cos(np.minimum(width + 1e-3, math.pi))) | (distance <= near)
        along = np.broadcast_to(distance, along.shape)
    # Where nothing was seen a beam clears as far as settings say, not as its reading.
    no_return = getattr(sensor, "range_max", None)
    far = math.inf if no_return is None else no_return
    width = max(float(getattr(sensor, "half_width", 0.0)), float(getattr(sensor, "hit_width", 0.0)))
    with np.errstate(invalid="ignore"):
        may &= (scan.ranges + width + near >= along) | (scan.ranges >= far)
    return np.flatnonzero(may)


def rays_of(scan: Scan, beams: IntArray) -> tuple[FloatArray, FloatArray]:
    """Where some beams of a scan lie in the map frame.

    Args:
        scan: of beams.
        beams: their numbers, shape (k,).

    Returns:
        Where each starts [m], and unit vectors along each, both of shape (k, d).
    """
    pose = scan.map_from_sensor
    directions = scan.directions[beams] @ pose.rotation.T
    if scan.beam_origins is None:
        return np.broadcast_to(pose.translation, directions.shape), directions
    return pose.transform(scan.beam_origins[beams]), directions
