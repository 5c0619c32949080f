# SPDX-License-Identifier: Apache-2.0
"""Messages of single wide beams: sonars, infrared and time-of-flight rangers.

Sources: https://docs.ros.org/en/noetic/api/sensor_msgs/html/msg/Range.html;
https://www.ros.org/reps/rep-0117.html
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from oddsmap.errors import InputError
from oddsmap.recordings.beams import Beams, shortest
from oddsmap.recordings.recording import stamp_of
from oddsmap.scans.note import Note

__all__ = ["range_beams"]

# Up to this angle a beam is as good as a ray, as in beam logs [deg].
_NARROW_DEG = 1.0
_AHEAD = np.array([[1.0, 0.0, 0.0]])
_AHEAD.flags.writeable = False


def range_beams(data: Any) -> Beams:
    """The beam of a `sensor_msgs/Range`: a cone around the x axis of its frame.

    A reading outside its limits says nothing of where something is: +Inf and what is at or above
    max_range are no returns, -Inf and what is below min_range is nearer than it can tell.

    Raises:
        InputError: a ranger that tells only whether something is near, or an angle that is none.
    """
    low, high = shortest(data.min_range), shortest(data.max_range)
    angle = float(data.field_of_view)
    if low == high and math.isfinite(low):
        raise InputError(
            f"min_range and max_range are both {low:g} m: such a ranger tells whether something is "
            "near, not how far: leave its topic out"
        )
    if not 0.0 <= angle <= math.pi + 1e-6:
        raise InputError(
            f"a field of view of {angle:g} rad: it lies between 0 and pi; is it in degrees?"
        )
    settings, notes = {}, []
    if 0.0 < low < math.inf:
        settings["range_min"] = low
    if 0.0 < high < math.inf:
        settings["range_max"] = high
    if settings.get("range_min", 0.0) >= settings.get("range_max", math.inf):
        raise InputError(f"min_range {low:g} m lies above max_range {high:g} m")
    # Degrees as people wrote them: an angle of 4 bytes is known to seven digits.
    degrees = min(float(f"{math.degrees(angle):.6g}"), 180.0)
    if degrees > _NARROW_DEG:
        settings["cone_deg"] = degrees
    elif angle == 0.0:
        text = "a field of view of 0 is taken as a narrow beam: if it is wider, say --sensor sonar "
        text += "--set sensor.cone_deg=DEGREES"
        notes.append(Note(text, code="cone.missing", severity="warning"))
    frame = data.header.frame_id.lstrip("/")
    return Beams(
        frame=frame,
        stamp_ns=stamp_of(data.header),
        directions=_AHEAD,
        ranges=np.array([data.range], np.float64),
        settings=settings,
        part=frame,
        notes=tuple(notes),
    )
