# SPDX-License-Identifier: Apache-2.0
"""Which messages are scans, and what reads each."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from oddsmap.recordings.beams import LASERS_AND_CLOUDS, Beams
from oddsmap.recordings.depth_messages import depth_beams
from oddsmap.recordings.livox_messages import livox_beams
from oddsmap.recordings.range_messages import range_beams
from oddsmap.recordings.recording import shape_of

__all__ = ["IMAGE", "RANGE", "SCAN_TYPES", "beams_of"]

IMAGE, RANGE = "sensor_msgs/Image", "sensor_msgs/Range"

SCAN_TYPES = {
    **LASERS_AND_CLOUDS,
    "livox_ros_driver/CustomMsg": livox_beams,
    "livox_ros_driver2/CustomMsg": livox_beams,
    RANGE: range_beams,
    IMAGE: depth_beams,
}
"""Messages that are scans, images only where they are of depth; and what reads each."""


def beams_of(kind: str, data: Any, units_per_metre: float | None = None) -> Beams:
    """The beams of a message.

    Args:
        kind: its type, one of `SCAN_TYPES`.
        data: the message.
        units_per_metre: of images of whole numbers; by default they are millimetres.

    Raises:
        InputError: it makes no sense.
    """
    with (
        shape_of(kind),
        np.errstate(invalid="ignore", over="ignore"),  # signalling NaNs, which some bytes are
    ):
        beams = depth_beams(data, units_per_metre) if kind == IMAGE else SCAN_TYPES[kind](data)
    own = getattr(data, "frame_from_sensor", None)
    return beams if own is None else replace(beams, frame_from_sensor=own)
