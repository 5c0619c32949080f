# SPDX-License-Identifier: Apache-2.0
"""PCD's VIEWPOINT as the pose of a scan, and in whose frame the points then are.

By its description VIEWPOINT takes points from the frame of the sensor to that of the map. Programs
that have moved the points into the map already keep it, for where the sensor was. Nothing in a file
says which, and the two readings give different maps: the person has to.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.compression import HEAD_SIZE, Source, open_source
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pcd import read_viewpoint, viewpoint_pose
from oddsmap.scans.note import Note

__all__ = ["any_viewpoint", "frame_note", "in_sensor_frame"]


def any_viewpoint(files: list[Path]) -> bool:
    """Whether one PCD has another VIEWPOINT than the identity; only the headers are read."""
    for path in files:
        try:
            with path.open("rb") as file:
                head = file.read(HEAD_SIZE)
            if head.startswith((b"\x1f\x8b", b"BZh")):
                head = open_source(path).content
            if viewpoint_pose(str(path), read_viewpoint(Source(str(path), head))) is not None:
                return True
        except (InputError, OSError):
            continue  # said when the scan itself is read
    return False


def frame_note(path: str, options: ReadOptions) -> Note:
    """What VIEWPOINT is taken for.

    Args:
        path: a file or folder whose VIEWPOINT is not the identity.
        options: they say in which frame its points are.

    Raises:
        InputError: they do not.
    """
    if options.points_in is None:
        raise InputError(
            f"{path}: VIEWPOINT is not the identity, and nothing says whether the points are in "
            "the frame of the sensor, from which it takes them to the map, or in that of the map "
            "already: say --points-in sensor or --points-in map (points_in=)"
        )
    if options.points_in == "sensor":
        text = "VIEWPOINT is taken for the pose of the sensor, in whose frame the points are"
    else:
        text = "VIEWPOINT is taken for the place of the sensor; the points are in the map frame"
    return Note(text, code="pose.viewpoint")


def in_sensor_frame(points: FloatArray, map_from_sensor: Pose3, options: ReadOptions) -> FloatArray:
    """Points as beams need them: from the sensor, turned back where they are in the map frame.

    Args:
        points: as they stand in the file [m], shape (n, 3).
        map_from_sensor: pose of the sensor.
        options: they say in which frame the points are; by default in the sensor's.
    """
    if options.points_in != "map":
        return points
    moved = (points - map_from_sensor.translation) @ map_from_sensor.rotation
    # Nothing returned: the point of the sensor itself, which has been moved and rounded.
    place = map_from_sensor.translation.astype(np.float32)
    with np.errstate(over="ignore"):
        moved[(points.astype(np.float32) == place).all(axis=1)] = 0.0
    return np.asarray(moved, np.float64)
