# SPDX-License-Identifier: Apache-2.0
"""PCD's VIEWPOINT as the pose of a scan, and in whose frame the points then are.

By its description VIEWPOINT takes points from the frame of the sensor to that of the map. Programs
that have moved the points into the map already keep it, for where the sensor was. Nothing in a file
says which, and the two readings give different maps: the person has to.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.compression import HEAD_SIZE, Source, open_source
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pcd import read_pcd, read_viewpoint, viewpoint_pose
from oddsmap.scans.note import Note

__all__ = ["any_viewpoint", "frame_note", "in_sensor_frame"]

# Which frame is likelier is seen from so many clouds, at places at least so far apart [m], in cells
# of this side [m].
_COMPARED, _APART_M, _CELL_M = 5, 0.4, 0.2
# It is said where the clouds have this share in common, and many times as much as in the other.
_MIN_COMMON, _TIMES_BETTER = 0.3, 3.0
_FARTHEST_M = 1e5


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


def frame_note(path: str, options: ReadOptions, files: Sequence[Path] = ()) -> Note:
    """What VIEWPOINT is taken for.

    Args:
        path: a file or folder whose VIEWPOINT is not the identity.
        options: they say in which frame its points are.
        files: the clouds of the folder, to say which frame is the likelier.

    Raises:
        InputError: they do not.
    """
    if options.points_in is None:
        raise InputError(
            f"{path}: VIEWPOINT is not the identity, and nothing says whether the points are in "
            "the frame of the sensor, from which it takes them to the map, or in that of the map "
            "already: say --points-in sensor or --points-in map (points_in=)" + _likelier(files)
        )
    if options.points_in == "sensor":
        text = "VIEWPOINT is taken for the pose of the sensor, in whose frame the points are"
    else:
        text = "VIEWPOINT is taken for the place of the sensor; the points are in the map frame"
    return Note(text, code="pose.viewpoint")


def _likelier(files: Sequence[Path]) -> str:
    """In which frame the clouds show one world, in words; empty where that is not clear.

    Clouds from places apart, in the cells of 0.2 m that two have in common: in the wrong frame a
    wall of one is beside that of the other.
    """
    if len(files) < 2:
        return ""
    picked = [files[i] for i in np.unique(np.linspace(0, len(files) - 1, _COMPARED).astype(int))]
    shares: dict[str, list[float]] = {"sensor": [], "map": []}
    clouds = [cloud for cloud in map(_placed_cloud, picked) if cloud is not None]
    for (points, pose), (others, other) in pairwise(clouds):
        if np.linalg.norm(pose.translation - other.translation) < _APART_M:
            continue
        shares["map"].append(_common(points, others))
        shares["sensor"].append(_common(pose.transform(points), other.transform(others)))
    if not shares["map"]:
        return ""
    sensor, in_map = (float(np.mean(shares[frame])) for frame in ("sensor", "map"))
    better, worse = max(sensor, in_map), min(sensor, in_map)
    if better < _MIN_COMMON or better < _TIMES_BETTER * worse:
        return ""
    return (
        f"; {'map' if in_map > sensor else 'sensor'} is likelier: of the cells of two clouds "
        f"{better:.0%} are then in common, {worse:.0%} otherwise"
    )


def _placed_cloud(path: Path) -> tuple[FloatArray, Pose3] | None:
    try:
        cloud = read_pcd(open_source(path))
        pose = viewpoint_pose(str(path), cloud.viewpoint)
    except InputError:
        return None  # said when the scan itself is read
    points = cloud.points[np.isfinite(cloud.points).all(axis=1)]
    points = points[(np.abs(points) < _FARTHEST_M).all(axis=1) & points.any(axis=1)]
    return points, pose or Pose3(np.zeros(3), np.eye(3))


def _common(points: FloatArray, others: FloatArray) -> float:
    """Which share of the cells of the cloud with fewer is in the other, too."""
    one, other = (
        {tuple(cell) for cell in np.unique(np.floor(p / _CELL_M).astype(np.int64), axis=0).tolist()}
        for p in (points, others)
    )
    return len(one & other) / max(1, min(len(one), len(other)))


def in_sensor_frame(points: FloatArray, map_from_sensor: Pose3, options: ReadOptions) -> FloatArray:
    """Points as beams need them: from the sensor, turned back where they are in the map frame.

    Args:
        points: as they stand in the file [m], shape (n, 3).
        map_from_sensor: pose of the sensor.
        options: they say in which frame the points are; by default in the sensor's.
    """
    if not options.points_in_map:
        return points
    moved = (points - map_from_sensor.translation) @ map_from_sensor.rotation
    # Nothing returned: the point of the sensor itself, which has been moved and rounded.
    place = map_from_sensor.translation.astype(np.float32)
    with np.errstate(over="ignore"):
        moved[(points.astype(np.float32) == place).all(axis=1)] = 0.0
    return np.asarray(moved, np.float64)
