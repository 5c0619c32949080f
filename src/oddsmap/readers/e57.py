# SPDX-License-Identifier: Apache-2.0
"""E57 of terrestrial scanners: one scan a setup, each with its pose, read when it is asked for.

Points are in the frame of their scanner, cartesian or spherical. A scan without a pose has points
in some map, and nothing says where they were seen from. Points marked as invalid are no returns.

Source: ASTM E2807-11; decoded by pye57 (libE57Format).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.decoding import decoding
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.readers.extras import needs_extra
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pose_association import PoseMatch, match_poses
from oddsmap.readers.sensor_track import pose_at
from oddsmap.readers.viewpoints import in_sensor_frame
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_e57"]

_FAULT, _ADVICE = "the E57 file cannot be read", "copy or write it again"
_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_INVALID = {_CARTESIAN: "cartesianInvalidState", _SPHERICAL: "sphericalInvalidState"}
# Points that are decoded at once: a header may promise any number.
_BLOCK = 200_000


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is an E57 file."""
    return head.startswith(b"ASTM-E57")


def open_e57(path: str, options: ReadOptions) -> LazyLog:
    """Open an E57 file.

    Raises:
        InputError: it cannot be read, it holds no scan, or its scans have no poses and none are
            given.
    """
    options.refuse(path, "an E57 file", "camera", "columns", "depth_scale", "scans", "frame")
    options.refuse(path, "an E57 file", "clock_offset_s", "deskew")
    with _opened(path) as file, decoding(path, _FAULT, _ADVICE):
        count = len(file.data3d)
        posed = [bool(file.data3d[i].isDefined("pose")) for i in range(count)]
    if not count:
        raise InputError(f"{path}: it holds no scans (data3D is empty)")
    match, notes = _match(path, posed, options)

    def read_scan(i: int) -> Scan:
        with _opened(path) as file:
            pose = _pose_of(path, file, i, posed[i], match, options)
            points = _read_points(path, file, i)
        missing = ~points.any(axis=1)
        moved = in_sensor_frame(points, pose, options)
        moved[missing] = 0.0
        return Scan.from_points(pose, moved, None if match is None else match.stamp_ns(i))

    return LazyLog(
        path=path,
        format="E57 scans",
        scan_count=count,
        read_scan=read_scan,
        skip_bad=options.skip_bad,
        opening_notes=notes,
    )


def _match(
    path: str, posed: list[bool], options: ReadOptions
) -> tuple[PoseMatch | None, tuple[Note, ...]]:
    """Poses that the caller gives; None where they are those of the file, or one place."""
    if any(posed):
        options.refuse(path, "an E57 file whose scans have poses", "poses", "times", "origin")
        options.refuse(path, "an E57 file whose scans have poses", "points_in", "body_from_sensor")
        return None, ()
    if options.origin is not None:
        options.refuse(path, "an E57 file seen from one place", "times", "body_from_sensor")
        if len(posed) > 1:
            text = f"{len(posed)} scans without poses: all are taken to be seen from one place"
            return None, (Note(text, code="pose.assumed", severity="warning"),)
        return None, ()
    if options.poses is None:
        raise InputError(
            f"{path}: its scans have no poses: without the place of the scanner no free "
            "space can be told: say it with --origin X Y Z (origin=), in the coordinates of "
            "the points, or give one pose for each scan with --poses FILE (poses=)"
        )
    names = [f"{i:06d}.e57" for i in range(len(posed))]
    match = match_poses(path, names, options.poses, options.times, options)
    return match, match.notes


def _pose_of(
    path: str, file: Any, i: int, posed: bool, match: PoseMatch | None, options: ReadOptions
) -> Pose3:
    """The pose of a scan; of one place, with the axes of the map."""
    if options.origin is not None:
        return pose_at(np.array(options.origin))
    if match is not None:
        return match.map_from_sensor(i)
    if not posed:
        raise NoPoseError(
            f"{path}: scan {i + 1} has no pose, others have: leave it out, or use --skip-bad "
            "(skip_bad=True)"
        )
    with decoding(path, f"the pose of scan {i + 1} cannot be read", _ADVICE):
        pose = file.data3d[i]["pose"]
        turn = _values(pose, "rotation", "wxyz") or [1.0, 0.0, 0.0, 0.0]
        place = _values(pose, "translation", "xyz") or [0.0, 0.0, 0.0]
    try:
        return Pose3.from_quaternion_xyzw(place, [*turn[1:], turn[0]])
    except InputError as error:
        raise InputError(f"{path}: scan {i + 1}: {error}") from None


def _values(pose: Any, name: str, fields: str) -> list[float]:
    """Fields of a part of a pose; empty where the part is not there, which means none of it."""
    if not pose.isDefined(name):
        return []
    return [float(pose[name][field].value()) for field in fields]


def _read_points(path: str, file: Any, i: int) -> FloatArray:
    """The points of a scan [m], shape (n, 3); invalid ones are 0 0 0."""
    with decoding(path, f"scan {i + 1} cannot be read", _ADVICE):
        header = file.get_header(i)
        there = set(header.point_fields)
    axes = next((axes for axes in _INVALID if set(axes) <= there), None)
    if axes is None:
        raise InputError(f"{path}: scan {i + 1} has neither cartesian nor spherical points")
    fields = [*axes, *([_INVALID[axes]] if _INVALID[axes] in there else [])]
    with decoding(path, f"scan {i + 1} cannot be read", _ADVICE):
        arrays, buffers = file.make_buffers(fields, _BLOCK)
        reader = header.points.reader(buffers)
        parts = []
        while (found := reader.read()) > 0:
            parts.append(np.stack([arrays[name][:found].astype(np.float64) for name in fields]))
        reader.close()
    values = np.concatenate(parts, axis=1) if parts else np.empty((len(fields), 0))
    points = _as_cartesian(values[:3].T) if axes == _SPHERICAL else values[:3].T.copy()
    if len(fields) > 3:
        points[values[3] != 0] = 0.0
    return points


def _as_cartesian(spherical: FloatArray) -> FloatArray:
    """Range [m], azimuth and elevation [rad] as x, y, z."""
    reach, azimuth, elevation = spherical.T
    flat = reach * np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), reach * np.sin(elevation)], axis=1
    )


@contextmanager
def _opened(path: str) -> Iterator[Any]:
    """A file as pye57 reads it."""
    with needs_extra(path, "survey"):
        import pye57
    with decoding(path, _FAULT, _ADVICE):
        file = pye57.E57(path)
    try:
        yield file
    finally:
        file.close()
