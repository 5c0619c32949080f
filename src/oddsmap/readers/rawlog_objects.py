# SPDX-License-Identifier: Apache-2.0
"""Objects of MRPT's rawlogs: laser scans and odometry, one after the other.

An object is the length of its class's name, that name, a version, its fields, and 0x88. Nothing
says how long one is, so that what is not known cannot be passed over: it is an error.

Source: MRPT 2, `serializeTo` of the classes named here; https://github.com/MRPT/mrpt (BSD)
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError, as_line
from oddsmap.poses.pose import Pose3

__all__ = ["LaserScan2D", "Odometry", "TruncatedObjectError", "matches", "read_objects"]

_NEW, _END = 0x80, 0x88
_LONGEST_NAME = 100
_SCAN, _ODOMETRY = "CObservation2DRangeScan", "CObservationOdometry"
# 100 ns since 1601, and how many of them there were in 1970.
_TICK_NS, _TICKS_1970 = 100, 116_444_736_000_000_000


class TruncatedObjectError(InputError):
    """The file ends within an object."""


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan2D:
    """A scan of a laser.

    Args:
        stamp_ns: its time since 1970 [ns], or None where it has none.
        label: the name of the sensor.
        angles: of the beams in the plane of the laser [rad], shape (n,).
        ranges: readings [m], shape (n,); NaN where the log calls one invalid.
        range_max: from here on a reading is no return [m].
        body_from_sensor: where the laser sits on the robot.
    """

    stamp_ns: int | None
    label: str
    angles: FloatArray
    ranges: FloatArray
    range_max: float
    body_from_sensor: Pose3


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """Where the robot took itself to be: x, y [m] and heading [rad]."""

    stamp_ns: int | None
    x: float
    y: float
    theta: float


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a rawlog."""
    size = head[0] & ~_NEW if head and head[0] & _NEW else 0
    name = head[1 : 1 + size]
    if not len(name) == size > 1:
        return False
    return name.startswith(b"mrpt::") or (name[:1] == b"C" and name.isalnum())


def read_objects(path: str, content: bytes) -> Iterator[LaserScan2D | Odometry]:
    """The objects of a file in their order.

    Raises:
        TruncatedObjectError: the file ends within one.
        InputError: one is of another class, or of a version that is not known.
    """
    reader = _Reader(path, content)
    while reader.at < len(content):
        yield reader.observation()


class _Reader:
    """A place in a file that moves on."""

    def __init__(self, path: str, content: bytes) -> None:
        self.path, self.content, self.at = path, content, 0
        self.start = 0

    def observation(self) -> LaserScan2D | Odometry:
        """The next object, a scan or odometry."""
        self.start = self.at
        name, version = self._begin()
        if name == _SCAN and version in (6, 7):
            found: LaserScan2D | Odometry = self._scan(version)
        elif name == _ODOMETRY and version in (0, 1, 2):
            found = self._odometry(version)
        else:
            raise self._unknown(name, version)
        self._finish(name)
        return found

    def _scan(self, version: int) -> LaserScan2D:
        aperture, right_to_left, range_max = self._take("<fBf")
        place = self._pose3()
        (count,) = self._take("<I")
        ranges = self._array("<f4", count).astype(np.float64)
        valid = self._array("u1", count) != 0
        _, ticks, _ = self._take("<fQf")
        label = self._text()
        (pitch,) = self._take("<d")
        if version >= 7 and self._take("<B")[0]:
            self._array("<i4", count)
        if pitch:
            raise self._error(f"a laser that turned by {pitch:g} rad about its y axis in a scan")
        if not 0.0 <= aperture < 7.0 or not 0.0 < range_max < 1e5:
            raise self._error(f"a laser of {aperture:g} rad and {range_max:g} m")
        # A reading that reached the end of the range is no return, whatever it is called.
        ranges[~valid & ~(ranges >= range_max)] = np.nan
        half = 0.5 * float(aperture) if right_to_left else -0.5 * float(aperture)
        angles = np.linspace(-half, half, count) if count > 1 else np.zeros(count)
        return LaserScan2D(_stamp(ticks), label, angles, ranges, float(range_max), place)

    def _odometry(self, version: int) -> Odometry:
        name, inner = self._begin()
        if name != "CPose2D" or inner not in (0, 1):
            raise self._unknown(name, inner)
        x, y, theta = self._take("<3d" if inner else "<3f")
        self._finish(name)
        self._text()
        (ticks,) = self._take("<Q")
        if version == 1:
            self._take("<BiiBff")
        elif version == 2:
            if self._take("<B")[0]:
                self._take("<ii")
            if self._take("<B")[0]:
                self._take("<3d")
        if not np.isfinite([x, y, theta]).all():
            raise self._error("a pose that is not finite")
        return Odometry(_stamp(ticks), x, y, theta)

    def _pose3(self) -> Pose3:
        name, version = self._begin()
        if name != "CPose3D" or version not in (2, 3):
            raise self._unknown(name, version)
        place = self._take("<3d")
        turn = self._take("<4d" if version == 2 else "<9d")
        self._finish(name)
        if not np.isfinite([*place, *turn]).all():
            raise self._error("a place of its sensor that is not finite")
        try:
            if version == 2:
                return Pose3.from_quaternion_xyzw(place, [*turn[1:], turn[0]])
            rotation = np.array(turn).reshape(3, 3)
            return Pose3.from_matrix(np.hstack([rotation, np.array(place)[:, None]]))
        except InputError as error:
            raise self._error(str(error)) from None

    def _begin(self) -> tuple[str, int]:
        """The class of an object without its namespace, and its version."""
        (size,) = self._take("<B")
        if not size & _NEW or not 1 < size & ~_NEW <= _LONGEST_NAME:
            raise self._error("no object of MRPT starts here")
        name = self._bytes(size & ~_NEW).decode("ascii", "replace")
        return name.rpartition("::")[2], int(self._take("<B")[0])

    def _finish(self, name: str) -> None:
        if self._take("<B")[0] != _END:
            raise self._error(f"{as_line(name, 40)} does not end where it should")

    def _text(self) -> str:
        (size,) = self._take("<I")
        return self._bytes(size).decode("utf-8", "replace")[:100]

    def _take(self, form: str) -> tuple[Any, ...]:
        return struct.unpack(form, self._bytes(struct.calcsize(form)))

    def _array(self, kind: str, count: int) -> npt.NDArray[Any]:
        return np.frombuffer(self._bytes(count * np.dtype(kind).itemsize), kind)

    def _bytes(self, size: int) -> bytes:
        if size > len(self.content) - self.at:
            raise TruncatedObjectError(
                f"{self.path}: it ends within the object at byte {self.start}: copy the file "
                "again, or use the objects before it with --skip-bad (skip_bad=True)"
            )
        self.at += size
        return self.content[self.at - size : self.at]

    def _error(self, what: str) -> InputError:
        return InputError(f"{self.path}: byte {self.start}: {what}: copy the file again")

    def _unknown(self, name: str, version: int) -> InputError:
        return InputError(
            f"{self.path}: byte {self.start}: an object {as_line(name, 40)} of version {version}, "
            f"which is not read ({_SCAN} 6 and 7, {_ODOMETRY} 0 to 2 are): export these alone"
        )


def _stamp(ticks: int) -> int | None:
    """Ticks as nanoseconds since 1970; 0 is none."""
    return (ticks - _TICKS_1970) * _TICK_NS if 0 < ticks < 2 * _TICKS_1970 else None
