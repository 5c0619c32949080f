# SPDX-License-Identifier: Apache-2.0
"""The way of a log's sensors as the page takes it: whole numbers, beside the map's own data.

Positions are to a tenth of a millimetre, angles to 0.006 degrees, times to a tenth of a
millisecond, where their span fits in 32 bits. Beams that a file holds are the way from the sensor
to their end: as azimuths from its heading those of a scanner are the same in each scan, and take
next to nothing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.viewer.journey import Journey
from oddsmap.viewer.payload import BytePlanes, payload_of

__all__ = ["journey_payload"]

_FINEST_M, _FINEST_S = 1e-4, 1e-4
_LARGEST = (1 << 32) - 1
_TURN = 1 << 16


def journey_payload(journey: Journey, facts: dict[str, Any]) -> bytes:
    """The payload of a log.

    Args:
        journey: see `oddsmap.viewer.journey`.
        facts: what else the page is told of the log, plain values for JSON.
    """
    known: BoolArray = np.asarray(np.isfinite(journey.positions).all(axis=1))
    lo, unit, places = _positions(journey.positions, known)
    time_unit, times = _times(journey)
    stamped = journey.stamped.astype(np.bool_)
    first = int(journey.stamps_ns[stamped].min()) if stamped.any() else None
    arrays = [
        _packed(axis, _steps(places[:, i]), np.uint32)
        for i, axis in enumerate("xyz"[: places.shape[1]])
    ]
    arrays += [
        _packed("yaw", _turns(journey.yaw), np.uint16),
        _packed("pitch", _turns(journey.pitch), np.uint16),
        _packed("known", known, np.uint8),
        _packed("stamped", stamped, np.uint8),
        _packed("time", _steps(times), np.uint32),
        _packed("whose", journey.whose, np.uint32),
    ]
    longest = 0.0
    if journey.beams:
        longest, more = _beams(journey)
        arrays += more
    return payload_of(
        {
            "scans": journey.scan_count,
            "axes": places.shape[1],
            "sensors": list(journey.sensors),
            "lo": lo,
            "unit": unit,
            "time_unit": time_unit,
            "first_stamp": None if first is None else f"{first / 1e9:.6f}",
            "kept": bool(journey.beams),
            "reach_unit": longest / (_TURN - 1),
            **facts,
        },
        arrays,
    )


def _packed(name: str, values: npt.ArrayLike, dtype: npt.DTypeLike) -> BytePlanes:
    planes = BytePlanes(name, dtype)
    planes.append(np.asarray(values))
    return planes


def _positions(positions: FloatArray, known: BoolArray) -> tuple[list[float], float, IntArray]:
    """The lowest position [m], the unit [m], and positions in units from there; 0 where unknown."""
    if not known.any():
        return [0.0] * positions.shape[1], _FINEST_M, np.zeros(positions.shape, np.int64)
    lo = positions[known].min(axis=0)
    above = np.where(known[:, None], positions - lo, 0.0)
    unit = _unit(_FINEST_M, float(above.max()))
    return lo.tolist(), unit, np.rint(above / unit).astype(np.int64)


def _times(journey: Journey) -> tuple[float, IntArray]:
    """The unit [s], and times in units from the first one; 0 where there is none."""
    stamped = journey.stamped.astype(np.bool_)
    if not stamped.any():
        return _FINEST_S, np.zeros(journey.scan_count, np.int64)
    first = journey.stamps_ns[stamped].min()
    after = np.where(stamped, journey.stamps_ns - first, 0) / 1e9
    unit = _unit(_FINEST_S, float(after.max()))
    return unit, np.rint(after / unit).astype(np.int64)


def _unit(finest: float, span: float) -> float:
    """The finest unit, or so many times 2 of it that a span fits."""
    return finest * 2.0 ** max(0, math.ceil(math.log2(max(span / finest / _LARGEST, 1e-300))))


def _steps(values: IntArray) -> IntArray:
    """Differences from the number before, modulo 2^32; the first one's is from 0."""
    return np.asarray(np.diff(values, prepend=0) % (1 << 32), np.int64)


def _turns(angles: FloatArray) -> IntArray:
    """Angles [rad] as 65536ths of a turn; 0 for what is none."""
    shares = np.where(np.isfinite(angles), angles, 0.0) / (2.0 * math.pi)
    return np.asarray(np.rint(shares * _TURN).astype(np.int64) % _TURN)


def _beams(journey: Journey) -> tuple[float, list[BytePlanes]]:
    """The longest beam [m], and the beams of all scans one after the other."""
    counts = np.array([beams.size for beams in journey.beams])
    whose = np.repeat(np.arange(len(counts)), counts)
    ways = np.concatenate([beams.ends for beams in journey.beams]) - journey.positions[whose]
    reach = np.sqrt(np.square(ways).sum(axis=1))
    longest = float(reach.max(initial=0.0)) or 1.0
    azimuth = np.arctan2(ways[:, 1], ways[:, 0]) - journey.yaw[whose]
    arrays = [
        _packed("count", counts, np.uint16),
        _packed("readings", [beams.readings for beams in journey.beams], np.uint32),
        _packed("silent", [beams.silent for beams in journey.beams], np.uint32),
        _packed("azimuth", _turns(azimuth), np.uint16),
        _packed("reach", np.rint(reach / longest * (_TURN - 1)).astype(np.int64), np.uint16),
        _packed("returned", np.concatenate([beams.returned for beams in journey.beams]), np.uint8),
    ]
    if ways.shape[1] == 3:
        flat = np.hypot(ways[:, 0], ways[:, 1])
        arrays.append(_packed("elevation", _turns(np.arctan2(ways[:, 2], flat)), np.uint16))
    return longest, arrays
