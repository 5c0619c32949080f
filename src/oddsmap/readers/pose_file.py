# SPDX-License-Identifier: Apache-2.0
"""Pose files: KITTI (12 numbers per row: 3 x 4, row-major) and TUM (`t x y z qx qy qz qw`).

The two are told apart by the count of numbers in the first row. Empty lines and `#` comments are
ignored. A pose that cannot be used is an error with its line: a file of poses with one row
left out would match the wrong scans.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.text_table import Row, parse_numbers, parse_stamp_ns, read_rows

__all__ = ["read_pose_matrix", "read_times", "read_trajectory"]

_KITTI_COLUMNS = 12
_TUM_COLUMNS = 8


def read_trajectory(
    path: str | os.PathLike[str], *, times: str | os.PathLike[str] | None = None
) -> Trajectory:
    """Read a pose file.

    Args:
        path: KITTI or TUM poses.
        times: stamps of KITTI poses, one number of seconds per row; None: they have no stamps.

    Raises:
        InputError: a row with another count of numbers, NaN, a quaternion that is not of unit
            length, a scaled or left-handed rotation, or another count of times than of poses.
    """
    name = os.fspath(path)
    rows = read_rows(path)
    if not rows:
        raise InputError(f"{name}: no poses: check how the file was written")
    columns = len(rows[0].words)
    if columns not in (_KITTI_COLUMNS, _TUM_COLUMNS):
        raise InputError(
            f"{rows[0].where}: {columns} numbers: a pose has {_KITTI_COLUMNS} (KITTI: 3 x 4, "
            f"row-major) or {_TUM_COLUMNS} (TUM: t x y z qx qy qz qw)"
        )
    read_one = _kitti_pose if columns == _KITTI_COLUMNS else _tum_pose
    poses = [_read_pose(row, columns, read_one) for row in rows]
    trajectory = Trajectory(
        positions=np.array([pose.translation for pose in poses]),
        rotations=np.array([pose.rotation for pose in poses]),
        path=name,
    )
    if columns == _TUM_COLUMNS:
        if times is not None:
            raise InputError(f"{name}: has stamps of its own (TUM): leave {os.fspath(times)} out")
        stamps = np.array([parse_stamp_ns(row, row.words[0]) for row in rows], np.int64)
        return trajectory.with_stamps(stamps)
    if times is None:
        return trajectory
    stamps = read_times(times)
    if len(stamps) != len(poses):
        raise InputError(
            f"{os.fspath(times)}: {len(stamps)} times for the {len(poses)} poses of {name}: "
            "give the times of these poses"
        )
    return trajectory.with_stamps(stamps)


def read_times(path: str | os.PathLike[str]) -> npt.NDArray[np.int64]:
    """Read a file of one time in seconds per row; returns nanoseconds, shape (n,).

    Raises:
        InputError: a row that is not one number, or no row at all.
    """
    rows = read_rows(path)
    if not rows:
        raise InputError(f"{os.fspath(path)}: no times: check how the file was written")
    for row in rows:
        if len(row.words) != 1:
            raise InputError(
                f"{row.where}: {len(row.words)} values: a row of times is one number of seconds"
            )
    return np.array([parse_stamp_ns(row, row.words[0]) for row in rows], np.int64)


def read_pose_matrix(path: str | os.PathLike[str]) -> Pose3:
    """Read a file that holds one pose as a 4 x 4 or 3 x 4 matrix.

    Raises:
        InputError: another count of numbers, NaN, or a scaled or left-handed rotation.
    """
    rows = read_rows(path)
    numbers = [number for row in rows for number in parse_numbers(row, row.words)]
    try:
        return Pose3.from_matrix(numbers)
    except InputError as error:
        raise InputError(f"{os.fspath(path)}: {error}") from None


def _kitti_pose(numbers: list[float]) -> Pose3:
    return Pose3.from_matrix(numbers)


def _tum_pose(numbers: list[float]) -> Pose3:
    return Pose3.from_quaternion_xyzw(numbers[1:4], numbers[4:8])


def _read_pose(row: Row, columns: int, read_one: Callable[[list[float]], Pose3]) -> Pose3:
    if len(row.words) != columns:
        raise InputError(
            f"{row.where}: {len(row.words)} numbers where the first pose has {columns}: "
            "check how the file was written"
        )
    numbers = parse_numbers(row, row.words)
    try:
        return read_one(numbers)
    except InputError as error:
        raise InputError(f"{row.where}: {error}") from None
