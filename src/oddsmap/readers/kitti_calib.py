# SPDX-License-Identifier: Apache-2.0
"""KITTI's poses are those of its left camera: `calib.txt` has the place of the LIDAR in `Tr`.

Other programs write poses of the LIDAR into files of the same form. A car shows which they are: it
moves along the z axis of its camera, or along the x axis of its LIDAR.

Source: Geiger, Lenz, Urtasun, Are we ready for autonomous driving? (CVPR 2012), odometry devkit.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.options import FilePath
from oddsmap.readers.pose_file import PoseFile, read_pose_file
from oddsmap.readers.text_table import parse_numbers, read_rows
from oddsmap.scans.note import Note

__all__ = ["read_kitti_poses"]

_NAME = "calib.txt"
_KEYS = ("Tr:", "Tr_velo_to_cam:")

# Which share of the way must go along one axis, and how long the way must be [m]: where there is a
# calibration, poses of the LIDAR are the exception, and a car may be moved sideways a little.
_MIN_SHARE = 0.7
_MIN_WAY_M = {"camera": 0.05, "lidar": 20.0}


def read_kitti_poses(folder: Path, path: FilePath) -> PoseFile:
    """Read the poses of a folder of KITTI scans, as those of the LIDAR where they tell.

    Args:
        folder: the scans; `calib.txt` is looked for in it, above it, and beside the poses.
        path: the poses.

    Returns:
        Poses of the camera in the frame of the LIDAR's first place: x ahead, z up.

    Raises:
        InputError: there is a calibration, and it cannot be told whose poses they are.
    """
    file = read_pose_file(path)
    if file.trajectory.stamps_ns is not None:
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


def _find_calib(folder: Path, poses: FilePath) -> tuple[str, Pose3] | None:
    """Where a calibration is, and camera_from_lidar in it."""
    for place in dict.fromkeys((folder, folder.resolve().parent, Path(poses).resolve().parent)):
        if not (place / _NAME).is_file():
            continue
        for row in read_rows(place / _NAME):
            if row.words[0] in _KEYS:
                try:
                    return _NAME, Pose3.from_matrix(parse_numbers(row, row.words[1:]))
                except InputError as error:
                    raise InputError(f"{row.where}: Tr: {error}") from None
    return None
