# SPDX-License-Identifier: Apache-2.0
"""Objects of MRPT rawlogs, as their classes are written."""

from __future__ import annotations

import struct

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.poses.pose import Pose3, quaternion_xyzw

__all__ = ["odometry", "rawlog", "scan"]

_1970 = 116_444_736_000_000_000


def _object(name: str, version: int, body: bytes) -> bytes:
    full = name.encode()
    return bytes([0x80 | len(full)]) + full + bytes([version]) + body + b"\x88"


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _ticks(seconds: float) -> bytes:
    return struct.pack("<Q", _1970 + round(seconds * 1e7))


def odometry(t: float, x: float, y: float, theta: float, version: int = 2) -> bytes:
    """CObservationOdometry: of version 0 nothing of the wheels, of 1 all, of 2 what there is."""
    if version == 0:
        pose = _object("CPose2D", 0, struct.pack("<3f", x, y, theta))
        more = b""
    else:
        pose = _object("mrpt::poses::CPose2D", 1, struct.pack("<3d", x, y, theta))
        more = struct.pack("<BiiBff", 1, 2, 3, 1, 0.5, 0.1)
    if version == 2:
        more = struct.pack("<BiiB3d", 1, 2, 3, 1, 0.5, 0.0, 0.1)
    body = pose + _text("odometry") + _ticks(t) + more
    return _object("mrpt::obs::CObservationOdometry", version, body)


def scan(
    t: float,
    ranges: FloatArray,
    valid: FloatArray | None = None,
    mount: Pose3 | None = None,
    *,
    aperture: float = np.pi,
    right_to_left: bool = True,
    range_max: float = 20.0,
    version: int = 7,
    pose_version: int = 3,
    pitch: float = 0.0,
    intensity: bool = False,
) -> bytes:
    """CObservation2DRangeScan."""
    mount = mount or Pose3(np.zeros(3), np.eye(3))
    if pose_version == 3:
        place = struct.pack("<12d", *mount.translation, *mount.rotation.ravel())
    else:
        qx, qy, qz, qw = quaternion_xyzw(mount.rotation)
        place = struct.pack("<7d", *mount.translation, qw, qx, qy, qz)
    n = len(ranges)
    good = np.ones(n) if valid is None else valid
    body = struct.pack("<fBf", aperture, right_to_left, range_max)
    body += _object("mrpt::poses::CPose3D", pose_version, place)
    body += struct.pack("<I", n) + ranges.astype("<f4").tobytes() + good.astype("u1").tobytes()
    body += struct.pack("<f", 0.01) + _ticks(t) + struct.pack("<f", 0.0)
    body += _text("FLASER") + struct.pack("<d", pitch)
    if version >= 7:
        body += bytes([intensity]) + np.arange(n).astype("<i4").tobytes() * intensity
    return _object("mrpt::obs::CObservation2DRangeScan", version, body)


def rawlog(count: int = 4) -> bytes:
    """A robot that drives along x at 1 m/s, and scans between two readings of its odometry."""
    objects = [odometry(0.0, 0.0, 0.0, 0.0)]
    for i in range(count):
        objects.append(scan(0.1 * i + 0.05, np.array([1.0, 2.0, 3.0, 4.0, 5.0])))
        objects.append(odometry(0.1 * (i + 1), 0.1 * (i + 1), 0.0, 0.0))
    return b"".join(objects)
