# SPDX-License-Identifier: Apache-2.0
"""Times of the points of a cloud, in whichever unit they were written."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["TIME_NAMES", "after_stamp"]

TIME_NAMES = ("t", "time", "timestamp", "offset_time", "time_offset", "time_stamp")
"""What drivers call the field, the first that is there counts."""


def after_stamp(times: npt.NDArray[Any], stamp_ns: int) -> npt.NDArray[np.int64] | None:
    """Times of points after the stamp of their cloud [ns]; None where they are no times.

    Programs write them in seconds, milliseconds, microseconds or nanoseconds, from the stamp on or
    since 1970. A cloud takes between 10 ms and 1 s: one unit fits, or none.
    """
    values = times.astype(np.float64)
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return None
    first, span = float(known.min()), float(known.max() - known.min())
    for unit in (10**9, 10**6, 10**3, 1):
        if not 1e7 <= span * unit <= 1e9:
            continue
        if abs(first * unit) < 3600e9:
            after = values * unit
        elif abs(first * unit - stamp_ns) > 10e9:
            return None
        elif times.dtype.kind in "iu":
            after = (times.astype(np.int64) * unit - stamp_ns).astype(np.float64)
        else:
            # Seconds first, which doubles of some 1e9 hold to 0.2 us; nanoseconds they do not.
            after = (values - stamp_ns / unit) * unit
        return np.rint(np.where(np.isfinite(after), after, 0.0)).astype(np.int64)
    return None
