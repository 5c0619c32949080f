# SPDX-License-Identifier: Apache-2.0
"""Messages of Livox's own drivers: points with the time of each.

Source: https://github.com/Livox-SDK/livox_ros_driver2, CustomMsg.msg and CustomPoint.msg
"""

from __future__ import annotations

from typing import Any

import numpy as np

from oddsmap.errors import InputError
from oddsmap.recordings.beams import Beams
from oddsmap.recordings.recording import stamp_of

__all__ = ["livox_beams"]

# A timebase farther from the stamp than this is that of another clock [ns].
_ONE_CLOCK_NS = 10 * 10**9


def livox_beams(data: Any) -> Beams:
    """The points of a `CustomMsg`, each `offset_time` nanoseconds after `timebase`.

    Where the timebase is of another clock than the stamp (the sensor's own, since it was switched
    on), the times count from the stamp. A point at the origin is one without a return.

    Args:
        data: the message, its points as objects or as records (`livox_bytes`).

    Raises:
        InputError: it says that it has another number of points than it has.
    """
    if int(data.point_num) != len(data.points):
        raise InputError(
            f"a Livox message of {int(data.point_num)} points that holds {len(data.points)}"
        )
    if isinstance(data.points, np.ndarray):
        columns = [data.points[name] for name in ("x", "y", "z", "offset_time")]
        table = np.stack(columns, axis=1).astype(np.float64)
    else:
        rows = [(point.x, point.y, point.z, point.offset_time) for point in data.points]
        table = np.array(rows, np.float64).reshape(-1, 4)
    stamp = stamp_of(data.header)
    late = int(data.timebase) - stamp
    after = table[:, 3].astype(np.int64) + (late if abs(late) <= _ONE_CLOCK_NS else 0)
    frame = data.header.frame_id.lstrip("/")
    return Beams(frame=frame, stamp_ns=stamp, points=table[:, :3].copy(), after_ns=after)
