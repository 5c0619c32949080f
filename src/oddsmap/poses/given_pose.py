# SPDX-License-Identifier: Apache-2.0
"""Poses as people have them: three numbers, a matrix, a position with a quaternion, a `Pose`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError, shown
from oddsmap.poses.pose import Pose, Pose2, Pose3

__all__ = ["PoseLike", "pose_of"]

PoseLike: TypeAlias = Pose | npt.ArrayLike | Mapping[str, npt.ArrayLike]
"""A pose of the sensor in the map frame, map_from_sensor, in one of these forms:

- (x, y, yaw) [m, m, rad]: a pose in the plane.
- a matrix [R | t]: 3 x 3 in the plane, 4 x 4 (or its first three rows) in space.
- {"position": (x, y, z), "xyzw": (x, y, z, w)}, or "wxyz" for a quaternion that starts with w.
- a `Pose2` or a `Pose3`.
"""

_FORMS = (
    '(x, y, yaw), a matrix of 3 x 3 or 4 x 4, {"position": p, "xyzw": q} (or "wxyz"), a Pose2 or a '
    "Pose3"
)
# As a matrix that was written with few digits may have it.
_LAST_ROW_TOLERANCE = 1e-6


def pose_of(given: PoseLike) -> Pose:
    """The pose that is meant.

    Numbers that are not finite make a pose that is not finite: its scan is counted as skipped.

    Args:
        given: one of the forms of `PoseLike`.

    Raises:
        InputError: it is none of them, a rotation is scaled, sheared or left-handed, a matrix is
            transposed, or nothing names the order of a quaternion.
    """
    if isinstance(given, Pose2 | Pose3):
        return given
    if isinstance(given, Mapping):
        return _of_quaternion(given)
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"a pose is {_FORMS}; got {_what(given)}") from None
    if values.shape == (3,):
        x, y, yaw = values.tolist()
        return Pose2(x, y, yaw)
    if values.shape == (3, 3):
        _check_last_row(values)
        return Pose2.from_matrix(values)
    if values.shape in ((4, 4), (3, 4)):
        _check_last_row(values)
        return Pose3.from_matrix(values)
    raise InputError(f"a pose is {_FORMS}; got numbers of shape {values.shape}")


def _of_quaternion(given: Mapping[str, npt.ArrayLike]) -> Pose3:
    keys = set(given)
    if keys not in ({"position", "xyzw"}, {"position", "wxyz"}):
        raise InputError(
            'a pose by name is {"position": (x, y, z), "xyzw": q}, or "wxyz" for a quaternion that '
            f"starts with w; got the names {shown(sorted(map(str, keys)))}"
        )
    return Pose3.from_quaternion(**given)


def _check_last_row(matrix: FloatArray) -> None:
    """Refuse matrices whose last row is not that of a rotation and a translation."""
    n = matrix.shape[1]
    if len(matrix) < n or not np.isfinite(matrix).all():
        return
    if np.abs(matrix[-1] - np.eye(n)[-1]).max() <= _LAST_ROW_TOLERANCE:
        return
    hint = "transpose it" if np.abs(matrix[:-1, -1]).max() == 0.0 else "is it a pose?"
    if n == 3:
        hint = "a rotation in space needs a position: give a 4 x 4 matrix; a transposed one, turn"
    raise InputError(
        f"the last row of a {n} x {n} pose is {' '.join(['0'] * (n - 1))} 1, got "
        f"{' '.join(f'{value:g}' for value in matrix[-1])}: {hint}"
    )


def _what(given: object) -> str:
    """What was given in place of a pose, for messages."""
    if isinstance(given, tuple | list) and [np.size(part) for part in given] == [3, 4]:
        return (
            "(position, quaternion), which does not say the order of the quaternion: name it, "
            '{"position": p, "xyzw": q} or {"position": p, "wxyz": q}'
        )
    return f"{shown(given)} ({type(given).__name__})"
