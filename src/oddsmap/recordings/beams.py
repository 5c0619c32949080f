# SPDX-License-Identifier: Apache-2.0
"""What one message of a range sensor says, in the frame of the sensor; lasers and clouds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.recordings.recording import stamp_of
from oddsmap.scans.beam_times import TIME_NAMES, after_stamp
from oddsmap.scans.note import Note

__all__ = ["LASERS_AND_CLOUDS", "Beams", "shortest"]

# A laser of more beams than a turn has seconds of arc is a damaged message.
_MAX_BEAMS = 360 * 3600


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """One scan, in the frame of its sensor: ranges along directions, points, or an image.

    Args:
        frame: the name of that frame, without a leading slash.
        stamp_ns: the time of the scan, by its header [ns].
        directions: unit vectors, shape (n, 3).
        ranges: readings [m], shape (n,).
        points: in place of these, the ends of the beams [m], shape (n, 3).
        depth: in place of these, an image of the depth along z [m], shape (h, w).
        after_ns: time of each beam after the stamp [ns], shape (n,); None where it is not known.
        settings: what the message states about its sensor, by the names of the configuration.
        frame_from_sensor: where the sensor is in the frame, where the message has a pose of its
            own: beams start there, and directions and points are in its axes.
        part: which of several sensors on one topic it is.
        notes: what to know about such messages.
    """

    frame: str
    stamp_ns: int
    directions: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    ranges: FloatArray = field(default_factory=lambda: np.empty(0))
    points: FloatArray | None = None
    depth: npt.NDArray[np.float32] | None = None
    after_ns: npt.NDArray[np.int64] | None = None
    settings: Mapping[str, float] = field(default_factory=dict)
    frame_from_sensor: Pose3 | None = None
    part: str = ""
    notes: tuple[Note, ...] = ()


def _laser_scan(data: Any) -> Beams:
    return _laser(data, np.asarray(data.ranges, np.float64))


def _multi_echo(data: Any) -> Beams:
    # The first echo: nothing is known to be free behind it.
    firsts = [echo.echoes[0] if len(echo.echoes) else np.nan for echo in data.ranges]
    return _laser(data, np.array(firsts, np.float64))


def _laser(data: Any, ranges: FloatArray) -> Beams:
    start, step = float(data.angle_min), float(data.angle_increment)
    if len(ranges) > _MAX_BEAMS or not (np.isfinite(start) and np.isfinite(step)):
        raise InputError(f"a laser of {len(ranges)} beams from {start:g} in steps of {step:g} rad")
    notes = []
    # One beam more or less is how drivers count.
    said = (float(data.angle_max) - start) / step + 1.0 if step else math.nan
    if len(ranges) and not abs(said - len(ranges)) <= 2.5:
        text = f"a scan has {len(ranges)} beams, and {said:.6g} by its angles: they are taken in "
        text += f"steps of {step:.4g} rad from {start:.4g}"
        notes.append(Note(text, code="laser.angles", severity="warning"))
    every = float(data.time_increment)
    after = None
    if 0.0 < every * len(ranges) < 10.0:
        after = np.rint(np.arange(len(ranges)) * (every * 1e9)).astype(np.int64)
    settings = {}
    for name in ("range_min", "range_max"):
        value = float(getattr(data, name))
        if np.isfinite(value) and value > 0.0:
            settings[name] = shortest(value)
    return Beams(
        frame=data.header.frame_id.lstrip("/"),
        stamp_ns=stamp_of(data.header),
        directions=_fan(start, step, len(ranges)),
        ranges=ranges,
        after_ns=after,
        settings=settings,
        notes=tuple(notes),
    )


def shortest(value: float) -> float:
    """A float of 4 bytes as people wrote it: 5.6, not 5.599999904632568."""
    return float(str(np.float32(value)))


@lru_cache(maxsize=32)
def _fan(start: float, step: float, count: int) -> FloatArray:
    angles = start + step * np.arange(count)
    return np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)


# Types of PointField by number.
_KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def _point_cloud(data: Any) -> Beams:
    table = _records(data)
    points = np.empty((len(table), 3))
    with np.errstate(invalid="ignore"):  # a signalling NaN, which some bytes are
        for axis, name in enumerate("xyz"):
            points[:, axis] = table[name]
    stamp = stamp_of(data.header)
    times = next((table[name] for name in TIME_NAMES if name in (table.dtype.names or ())), None)
    after = None if times is None else after_stamp(times, stamp)
    frame = data.header.frame_id.lstrip("/")
    return Beams(frame=frame, stamp_ns=stamp, points=points, after_ns=after)


def _records(data: Any) -> npt.NDArray[np.void]:
    """The points of a cloud as records."""
    order = ">" if data.is_bigendian else "<"
    fields = {f.name: f for f in data.fields if f.name and f.datatype in _KINDS and f.count == 1}
    if missing := [axis for axis in "xyz" if axis not in fields]:
        names = ", ".join(f.name for f in data.fields)[:80]
        raise InputError(f"a cloud without {', '.join(missing)}: its fields are {names}")
    width, height, stride = int(data.width), int(data.height), int(data.point_step)
    row = int(data.row_step) or width * stride
    content = np.asarray(data.data, np.uint8)
    sizes = {name: np.dtype(_KINDS[f.datatype]).itemsize for name, f in fields.items()}
    if any(int(f.offset) + sizes[name] > stride for name, f in fields.items()):
        raise InputError(f"a cloud with fields beyond its {stride} bytes per point")
    if width * stride > row or row * height > len(content):
        raise InputError(
            f"a cloud of {width} x {height} points of {stride} bytes in {len(content)} bytes"
        )
    dtype = np.dtype(
        {
            "names": list(fields),
            "formats": [order + _KINDS[f.datatype] for f in fields.values()],
            "offsets": [int(f.offset) for f in fields.values()],
            "itemsize": stride,
        }
    )
    rows = content[: row * height].reshape(height, row)[:, : width * stride]
    return np.ascontiguousarray(rows).reshape(-1).view(dtype)


LASERS_AND_CLOUDS = {
    "sensor_msgs/LaserScan": _laser_scan,
    "sensor_msgs/MultiEchoLaserScan": _multi_echo,
    "sensor_msgs/PointCloud2": _point_cloud,
}
"""Their types, and what reads each."""
