# SPDX-License-Identifier: Apache-2.0
"""Which readings make a scan too large for memory, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from oddsmap.errors import MapTooLargeError
from oddsmap.limits import in_metres
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.scan import Scan
from oddsmap.sensors.registry import Sensor

__all__ = ["with_readings"]

# No lidar, sonar or camera of a robot sees half of its surroundings farther away [m].
_NOT_METRES = 300.0


def with_readings(
    error: MapTooLargeError, batch: Sequence[Measurement], sensor: Sensor
) -> MapTooLargeError:
    """The same error, with what the readings of its scans are like.

    Args:
        error: why a batch was refused.
        batch: its measurements; one of them is too large, or one more than the map can hold.
        sensor: the sensor model, whose range_max ends what counts as a reading.
    """
    beams = [scan.to_scan() if isinstance(scan, DepthScan) else scan for scan in batch]
    ranges = [scan.ranges for scan in beams if isinstance(scan, Scan)]
    if "coarser resolution" not in str(error) or not ranges:  # it has other reasons
        return error
    z = np.concatenate(ranges)
    limit = getattr(sensor, "range_max", None) or math.inf
    z = z[np.isfinite(z) & (z > 0.0) & (z < limit)]
    if len(z) == 0:
        return error
    longest, median = float(z.max()), float(np.median(z))
    many = int(np.count_nonzero(z > longest / 2))
    doubt = "; ranges are metres, are these millimetres?" if median > _NOT_METRES else ""
    return MapTooLargeError(
        f"{error} (here half of the readings are above {in_metres(median)} m, "
        f"{many:,} of {len(z):,} above {in_metres(longest / 2)} m, "
        f"and the longest is {in_metres(longest)} m{doubt})"
    )
