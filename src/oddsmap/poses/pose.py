# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms in 2D and 3D, in float64.

A transform is named `target_from_source`: `map_from_sensor.transform(points)` takes points in
the sensor frame [m] to the map frame [m]. Frames are right-handed, x forward, z up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError, shown
from oddsmap.poses.product import product
from oddsmap.short_repr import described

__all__ = ["Pose", "Pose2", "Pose3", "quaternion_xyzw"]


# Files write rotations with 6 or 7 digits; beyond this a matrix is scaled or sheared, not rounded.
_ROTATION_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Pose2:
    """A pose of SE(2): position `x`, `y` [m] and heading `theta` [rad] from the x axis."""

    x: float
    y: float
    theta: float

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Pose2:
        """Read a 2 x 3 or 3 x 3 matrix [R | t]; t in metres.

        Raises:
            InputError: another shape, or R is scaled, sheared or left-handed.
        """
        rows = np.asarray(matrix, dtype=np.float64)
        if rows.shape not in ((2, 3), (3, 3)):
            raise InputError(
                f"a pose in the plane needs a matrix of 2 x 3 or 3 x 3, got shape {rows.shape}"
            )
        turn, (x, y) = rows[:2, :2], rows[:2, 2].tolist()
        if not np.isfinite(turn).all():
            return cls(x, y, math.nan)
        _check_rotation(turn)
        return cls(x, y, math.atan2(turn[1, 0], turn[0, 0]))

    @property
    def translation(self) -> FloatArray:
        """Position [m], shape (2,)."""
        return np.array([self.x, self.y])

    @property
    def rotation(self) -> FloatArray:
        """Rotation matrix, shape (2, 2)."""
        if not math.isfinite(self.theta):  # math.cos(inf) is an error, math.cos(nan) is not
            return np.full((2, 2), np.nan)
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s], [s, c]])

    @property
    def is_finite(self) -> bool:
        """True when no component is NaN or infinite."""
        return math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.theta)

    def transform(self, points: FloatArray) -> FloatArray:
        """Take points [m], shape (n, 2), from the source frame to the target frame."""
        return product(points, self.rotation.T) + self.translation

    def inverse(self) -> Pose2:
        """The transform in the other direction."""
        x, y = product(-self.translation[None, :], self.rotation)[0]
        return Pose2(float(x), float(y), -self.theta)

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose: `map_from_body @ body_from_sensor` is `map_from_sensor`."""
        x, y = self.transform(other.translation[None, :])[0]
        return Pose2(float(x), float(y), self.theta + other.theta)


@dataclass(frozen=True, slots=True, eq=False)
class Pose3:
    """A pose of SE(3): `translation` [m], shape (3,), and `rotation`, shape (3, 3).

    The other order, of earlier versions, is still taken: the shapes tell the two apart.
    """

    translation: FloatArray
    rotation: FloatArray

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        x, y, z = (f"{float(value):.10g}" for value in self.translation)
        yield f"x {x}, y {y}, z {z} m"
        r = self.rotation
        roll, yaw = math.atan2(r[2, 1], r[2, 2]), math.atan2(r[1, 0], r[0, 0])
        pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
        angles = zip(("roll", "pitch", "yaw"), (roll, pitch, yaw), strict=True)
        yield (
            ", ".join(f"{name} {math.degrees(angle) + 0.0:.4g}" for name, angle in angles) + " deg"
        )

    def __post_init__(self) -> None:
        shapes = np.shape(self.translation), np.shape(self.rotation)
        if shapes == ((3, 3), (3,)):
            turn, place = self.translation, self.rotation
            object.__setattr__(self, "translation", place)
            object.__setattr__(self, "rotation", turn)
        elif shapes != ((3,), (3, 3)):
            raise InputError(
                "a Pose3 is made of a translation (3,) and a rotation (3, 3), in this order, got "
                f"shapes {shapes[0]} and {shapes[1]}"
            )

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Pose3:
        """Read a 3 x 4 or 4 x 4 matrix [R | t], row-major.

        Args:
            matrix: shape (3, 4) or (4, 4), or 12 or 16 numbers in that order; t in metres.

        Raises:
            InputError: another count of numbers, or R is scaled, sheared or left-handed.
        """
        flat = np.asarray(matrix, dtype=np.float64).ravel()
        if flat.size not in (12, 16):
            raise InputError(f"a pose needs 12 or 16 numbers (3 x 4 or 4 x 4), got {flat.size}")
        upper = flat.reshape(-1, 4)[:3]
        rotation, translation = upper[:, :3].copy(), upper[:, 3].copy()
        if np.isfinite(rotation).all():
            _check_rotation(rotation)
        return cls(translation, rotation)

    @classmethod
    def from_quaternion(
        cls,
        position: npt.ArrayLike,
        *,
        xyzw: npt.ArrayLike | None = None,
        wxyz: npt.ArrayLike | None = None,
    ) -> Pose3:
        """Build a pose from a position and a unit quaternion, whose order is named.

        Args:
            position: position [m], shape (3,).
            xyzw: the quaternion as (x, y, z, w): ROS, scipy, TUM files.
            wxyz: the quaternion as (w, x, y, z): Eigen's constructor, nuScenes, MuJoCo.

        Raises:
            InputError: neither or both are given, a shape is another, or the quaternion's norm
                differs from 1 by more than 1e-3.
        """
        if (xyzw is None) == (wxyz is None):
            raise InputError("a rotation needs one quaternion, xyzw= or wxyz=")
        name, given = ("xyzw", xyzw) if wxyz is None else ("wxyz", wxyz)
        found = [_numbers(position, 3, "position"), _numbers(given, 4, name)]
        return cls.from_quaternion_xyzw(found[0], np.roll(found[1], 0 if wxyz is None else -1))

    @classmethod
    def from_quaternion_xyzw(cls, translation: npt.ArrayLike, xyzw: npt.ArrayLike) -> Pose3:
        """Build a pose from a position [m], shape (3,), and a unit quaternion (x, y, z, w).

        Raises:
            InputError: the quaternion's norm differs from 1 by more than 1e-3.
        """
        t = np.asarray(translation, dtype=np.float64)
        q = np.asarray(xyzw, dtype=np.float64)
        norm = math.hypot(*q.tolist())
        if math.isfinite(norm) and abs(norm - 1.0) > _ROTATION_TOLERANCE:
            raise InputError(
                f"a rotation needs a unit quaternion, got norm {norm:.6g}: "
                "check the order of the columns (x y z w)"
            )
        with np.errstate(invalid="ignore"):  # infinite: a pose that is not finite, skipped later
            x, y, z, w = q / norm
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        return cls(t, rotation)

    @property
    def is_finite(self) -> bool:
        """True when no component is NaN or infinite."""
        return bool(np.isfinite(self.rotation).all() and np.isfinite(self.translation).all())

    def transform(self, points: FloatArray) -> FloatArray:
        """Take points [m], shape (n, 3), from the source frame to the target frame."""
        return product(points, self.rotation.T) + self.translation

    def inverse(self) -> Pose3:
        """The transform in the other direction."""
        position = product(-self.translation[None, :], self.rotation)[0]
        return Pose3(position, self.rotation.T.copy())

    def __matmul__(self, other: Pose3) -> Pose3:
        """Compose: `map_from_body @ body_from_sensor` is `map_from_sensor`."""
        return Pose3(
            self.transform(other.translation[None, :])[0], product(self.rotation, other.rotation)
        )


Pose = Pose2 | Pose3


def quaternion_xyzw(rotation: FloatArray) -> tuple[float, float, float, float]:
    """The unit quaternion of a rotation matrix, by its largest component.

    Source: Shepperd, Quaternion from rotation matrix, J. Guidance and Control 1 (1978).
    """
    m = rotation.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    q = [0.0, 0.0, 0.0, 0.0]
    diagonal = (m[0][0], m[1][1], m[2][2], trace)
    largest = diagonal.index(max(diagonal))
    if largest == 3:
        q = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1], 1.0 + trace]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = 1.0 + m[i][i] - m[j][j] - m[k][k]
        q[j] = m[j][i] + m[i][j]
        q[k] = m[k][i] + m[i][k]
        q[3] = m[k][j] - m[j][k]
    norm = math.sqrt(sum(value * value for value in q))
    return q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm


def _numbers(given: object, n: int, name: str) -> FloatArray:
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {n} numbers, got {shown(given)}") from None
    if values.shape != (n,):
        raise InputError(f"{name} is {n} numbers, got shape {values.shape}")
    return values


def _check_rotation(rotation: FloatArray) -> None:
    scale = float(np.abs(rotation @ rotation.T - np.eye(len(rotation))).max())
    if scale > _ROTATION_TOLERANCE:
        raise InputError(
            f"a rotation matrix is not orthonormal (off by {scale:.3g}): scaled or sheared poses "
            "cannot be used"
        )
    if np.linalg.det(rotation) < 0:
        raise InputError("a rotation matrix is left-handed (determinant -1): flip one axis back")
