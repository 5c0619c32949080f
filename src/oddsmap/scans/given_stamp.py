# SPDX-License-Identifier: Apache-2.0
"""Times as people have them, as nanoseconds: the unit is said, never guessed."""

from __future__ import annotations

import math
import operator
from datetime import UTC, datetime, timedelta
from decimal import Decimal
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np

from oddsmap.errors import InputError, shown

__all__ = ["Seconds", "stamp_of"]

Seconds: TypeAlias = float | Decimal | Fraction

_INT64 = 2**63
_SECOND_NAMES = (("sec", "nanosec"), ("secs", "nsecs"))
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def stamp_of(stamp: object, stamp_s: Seconds | None, stamp_ns: int | None) -> int | None:
    """The time of a scan [ns], or None where none is given.

    Args:
        stamp: a time that knows its unit: a `datetime` with its time zone, a `numpy.datetime64`
            (UTC), or a stamp of a ROS message (`sec` and `nanosec`, `secs` and `nsecs`).
        stamp_s: a time [s]. A float counts exactly: since 1970 it holds some 0.2 us.
        stamp_ns: a time [ns], a whole number.

    Raises:
        InputError: more than one is given, or one is no such time, or beyond int64 nanoseconds.
    """
    given = {"stamp": stamp, "stamp_s": stamp_s, "stamp_ns": stamp_ns}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise InputError(f"a scan has one stamp, got {' and '.join(named)}: give one of them")
    if not named:
        return None
    if stamp_ns is not None:
        found = _whole(stamp_ns)
    elif stamp_s is not None:
        found = _of_seconds(stamp_s)
    else:
        found = _of_time(stamp)
    if not -_INT64 <= found < _INT64:
        hint = ": is it in nanoseconds? Then write stamp_ns=" if stamp_s is not None else ""
        raise InputError(f"{named[0]} is beyond int64 nanoseconds, got {given[named[0]]}{hint}")
    return found


def _whole(value: Any) -> int:
    try:
        if not isinstance(value, bool | np.bool_):
            return operator.index(value)
    except TypeError:
        pass
    raise InputError(
        f"stamp_ns is a whole number of nanoseconds, got {shown(value)}: seconds are stamp_s="
    )


def _of_seconds(value: Any) -> int:
    value = int(value) if isinstance(value, np.integer) else value
    number = isinstance(value, int | float | np.floating | Decimal | Fraction)
    if not number or isinstance(value, bool) or not math.isfinite(value):
        raise InputError(f"stamp_s is a finite number of seconds, got {shown(value)}")
    exact = Fraction(*(int(part) for part in value.as_integer_ratio()))
    return round(exact * 10**9)


def _of_time(stamp: Any) -> int:
    if isinstance(stamp, np.datetime64) and not np.isnat(stamp):
        return _of_datetime64(stamp)
    if isinstance(stamp, datetime) and stamp.tzinfo is not None:
        return (stamp - _EPOCH) // timedelta(microseconds=1) * 1000
    for seconds, rest in _SECOND_NAMES:
        if hasattr(stamp, seconds) and hasattr(stamp, rest):
            return int(getattr(stamp, seconds)) * 10**9 + int(getattr(stamp, rest))
    if isinstance(stamp, datetime):
        hint = "it has no time zone: datetime(..., tzinfo=UTC)"
    else:
        hint = "say the unit: stamp_s= for seconds, stamp_ns= for nanoseconds"
    raise InputError(f"stamp={shown(stamp)} is no time that knows its unit; {hint}")


def _of_datetime64(stamp: np.datetime64) -> int:
    unit, count = np.datetime_data(stamp.dtype)
    if unit in ("Y", "M"):  # of no fixed length: by the calendar
        stamp, unit, count = stamp.astype("datetime64[D]"), "D", 1
    lengths = {"W": 604800, "D": 86400, "h": 3600, "m": 60, "s": 1}
    lengths_ns = {name: seconds * 10**9 for name, seconds in lengths.items()}
    lengths_ns |= {"ms": 10**6, "us": 10**3, "ns": 1}
    if unit not in lengths_ns:
        raise InputError(f"stamp={stamp!r} is finer than nanoseconds: give stamp_ns=")
    return int(stamp.astype(np.int64)) * count * lengths_ns[unit]
