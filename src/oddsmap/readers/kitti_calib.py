# SPDX-License-Identifier: Apache-2.0
"""KITTI's poses are those of its left camera: `calib.txt` has the place of the LIDAR in `Tr`.

Other programs write poses of the LIDAR into files of the same form. A car shows which they are: it
moves along the z axis of its camera, or along the x axis of its LIDAR.

Source: Geiger, Lenz, Urtasun, Are we ready for autonomous driving? (CVPR 2012), odometry devkit.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.options import FilePath
from oddsmap.readers.pose_file import PoseFile, read_pose_file, read_pose_matrix
from oddsmap.readers.text_table import Row, parse_numbers, read_rows
from oddsmap.scans.note import Note

__all__ = ["read_extrinsics_file", "read_kitti_poses"]

_NAME = "calib.txt"
_RAW_NAME, _CAMERAS_NAME = "calib_velo_to_cam.txt", "calib_cam_to_cam.txt"
# Where the numbers of a 3 x 4 matrix are in nine of a rotation and three of a place behind them.
_ROWS_AND_COLUMN = (0, 1, 2, 9, 3, 4, 5, 10, 6, 7, 8, 11)
_KEYS = ("Tr:", "Tr_velo_to_cam:")

# Which share of the way must go along one axis, and how long the way must be [m]: where there is a
# calibration, poses of the LIDAR are the exception, and a car may be moved sideways a little.
_MIN_SHARE = 0.7
_MIN_WAY_M = {"camera": 0.05, "lidar": 20.0}


def read_kitti_poses(folder: Path, path: FilePath, *, positions_do: bool = False) -> PoseFile:
    """Read the poses of a folder of KITTI scans, as those of the LIDAR where they tell.

    Args:
        folder: the scans; `calib.txt` is looked for in it, above it, and beside the poses.
        path: the poses.
        positions_do: see `read_pose_file`.

    Returns:
        Poses of the camera in the frame of the LIDAR's first place: x ahead, z up.

    Raises:
        InputError: there is a calibration, and it cannot be told whose poses they are.
    """
    file = read_pose_file(path, positions_do=positions_do)
    if file.trajectory.stamps_ns is not None or not file.oriented:
        return file
    moves = _moves_as(file.trajectory)
    calib = _find_calib(folder, path)
    if calib is None:
        return _warned(file, "camera.poses", _NO_CALIB) if moves == "camera" else file
    where, camera_from_lidar = calib
    if moves == "camera":
        lidar = [camera_from_lidar.inverse() @ pose @ camera_from_lidar for pose in file.trajectory]
        moved = replace(
            file.trajectory,
            positions=np.array([pose.translation for pose in lidar]),
            rotations=np.array([pose.rotation for pose in lidar]),
        )
        text = (
            "the poses move along their z axis, as the camera's do: the LIDAR's follow by Tr of "
            f"{where}, in the frame of the LIDAR at pose 0"
        )
        return _warned(replace(file, trajectory=moved), "camera.poses", text)
    if moves == "lidar":
        text = f"the poses move along their x axis, as the LIDAR's do: Tr of {where} is not used"
        return _warned(file, "camera.poses", text)
    raise InputError(
        f"{os.fspath(path)}: the poses may be those of the camera, with Tr of {where} to the "
        "LIDAR's, or of the LIDAR itself: say --body-from-sensor '0 0 0 0 0 0 1' if they are the "
        "LIDAR's, else the place of the LIDAR in the frame of the camera"
    )


_NO_CALIB = (
    "the poses move along their z axis, as a camera's do: if they are, say where the LIDAR is with "
    "calib.txt beside the scans, or with --body-from-sensor"
)


def _warned(file: PoseFile, code: str, text: str) -> PoseFile:
    return replace(file, notes=(*file.notes, Note(text, code=code, severity="warning")))


def _moves_as(trajectory: Trajectory) -> Literal["camera", "lidar"] | None:
    """Along which of its own axes the body moves: z of a camera, x of a LIDAR."""
    steps = np.diff(trajectory.positions, axis=0)
    own = np.einsum("nji,nj->ni", trajectory.rotations[:-1], steps)
    way = float(np.linalg.norm(steps, axis=1).sum())
    x, _, z = own.sum(axis=0)
    if z > _MIN_SHARE * way and way >= _MIN_WAY_M["camera"]:
        return "camera"
    return "lidar" if x > _MIN_SHARE * way and way >= _MIN_WAY_M["lidar"] else None


def read_extrinsics_file(path: FilePath) -> Pose3:
    """A file with the place of a sensor: a 3 x 4 or 4 x 4 matrix, or a calibration of KITTI.

    Raises:
        InputError: it holds neither.
    """
    rows = read_rows(path)
    if any(row.words[0].endswith(":") for row in rows):
        found = _calibration(Path(path))
        if found is None:
            raise InputError(
                f"{os.fspath(path)}: no line {' or '.join(_KEYS)}, nor R: and T:, that would say "
                "where the LIDAR is"
            )
        return found
    return read_pose_matrix(path)


def _find_calib(folder: Path, poses: FilePath) -> tuple[str, Pose3] | None:
    """Where a calibration is, and camera_from_lidar in it."""
    for place in dict.fromkeys((folder, folder.resolve().parent, Path(poses).resolve().parent)):
        for name in (_NAME, _RAW_NAME):
            if not (place / name).is_file():
                continue
            found = _calibration(place / name)
            if found is not None:
                return name, found
    return None


def _calibration(path: Path) -> Pose3 | None:
    """camera_from_lidar of a file: `Tr`, or R and T of KITTI's raw data; None where it has none.

    Poses are those of the rectified camera, which `R_rect_00` turns the raw one into.
    """
    rows = {row.words[0]: row for row in read_rows(path)}
    for key in _KEYS:
        if key in rows:
            return _named_matrix(rows[key], parse_numbers(rows[key], rows[key].words[1:]))
    if not {"R:", "T:"} <= rows.keys():
        return None
    turn, place = (parse_numbers(rows[key], rows[key].words[1:]) for key in ("R:", "T:"))
    if (len(turn), len(place)) != (9, 3):
        raise InputError(
            f"{path}: R: and T: have {len(turn)} and {len(place)} numbers, not 9 and 3"
        )
    camera_from_lidar = _named_matrix(rows["R:"], [*turn, *place], order=_ROWS_AND_COLUMN)
    rectify = path.with_name(_CAMERAS_NAME)
    if not rectify.is_file():
        return camera_from_lidar
    for row in read_rows(rectify):
        if row.words[0] == "R_rect_00:":
            numbers = [*parse_numbers(row, row.words[1:]), 0.0, 0.0, 0.0]
            if len(numbers) == 12:
                return _named_matrix(row, numbers, order=_ROWS_AND_COLUMN) @ camera_from_lidar
    return camera_from_lidar


def _named_matrix(row: Row, numbers: list[float], order: Sequence[int] = range(12)) -> Pose3:
    """The motion after a key."""
    try:
        if len(numbers) == 12:
            numbers = [numbers[i] for i in order]
        return Pose3.from_matrix(numbers)
    except InputError as error:
        raise InputError(f"{row.where}: {row.words[0].rstrip(':')}: {error}") from None
