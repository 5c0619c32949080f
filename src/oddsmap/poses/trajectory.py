# SPDX-License-Identifier: Apache-2.0
"""Poses over time: looked up by number or by stamp, never by guess."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3, quaternion_xyzw
from oddsmap.poses.product import product
from oddsmap.short_repr import short_repr

__all__ = ["NoPoseError", "Trajectory"]

StampArray = npt.NDArray[np.int64]


class NoPoseError(InputError):
    """There is no pose close enough to a stamp."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Poses in the order of their file, with or without stamps.

    Args:
        positions: positions [m], shape (n, 3).
        rotations: rotation matrices, shape (n, 3, 3).
        stamps_ns: time of each pose [ns], shape (n,), in any order; None where there are none.
        path: where the poses come from: what messages start with.

    Raises:
        InputError: the shapes do not fit each other, or there is no pose.
    """

    positions: FloatArray
    rotations: FloatArray
    stamps_ns: StampArray | None = None
    path: str = "the trajectory"
    _order: npt.NDArray[np.intp] | None = field(init=False, repr=False, default=None)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name, kind in (("positions", np.float64), ("rotations", np.float64)):
            if not isinstance(getattr(self, name), np.ndarray):
                object.__setattr__(self, name, np.asarray(getattr(self, name), kind))
        if self.stamps_ns is not None and not isinstance(self.stamps_ns, np.ndarray):
            object.__setattr__(self, "stamps_ns", np.asarray(self.stamps_ns))
        n = len(self.positions)
        if n == 0:
            raise InputError(f"{self.path}: no poses: check how the file was written")
        if self.positions.shape != (n, 3) or self.rotations.shape != (n, 3, 3):
            raise InputError(
                f"{self.path}: a trajectory needs positions (n, 3) and rotations (n, 3, 3), "
                f"got {self.positions.shape} and {self.rotations.shape}"
            )
        if self.stamps_ns is None:
            return
        if self.stamps_ns.shape != (n,) or self.stamps_ns.dtype != np.int64:
            raise InputError(
                f"{self.path}: {n} poses need {n} stamps in int64 nanoseconds, "
                f"got {self.stamps_ns.dtype} of shape {self.stamps_ns.shape}"
            )
        object.__setattr__(self, "_order", np.argsort(self.stamps_ns, kind="stable"))

    def __len__(self) -> int:
        """How many poses there are."""
        return len(self.positions)

    def __getitem__(self, i: int) -> Pose3:
        """The pose of number `i`, in the order of the file."""
        return Pose3(self.positions[i], self.rotations[i])

    def __iter__(self) -> Iterator[Pose3]:
        """The poses in the order of the file."""
        return (self[i] for i in range(len(self)))

    def with_stamps(self, stamps_ns: StampArray) -> Trajectory:
        """The same poses with these stamps [ns], shape (n,)."""
        return replace(self, stamps_ns=stamps_ns)

    def at(self, stamp_ns: int, tolerance_ns: int, *, interpolate: bool = True) -> Pose3:
        """The pose at a time.

        A pose of exactly this stamp is given as it is. Otherwise the nearest pose must be within
        the tolerance. Between two poses, position is interpolated linearly and rotation at
        constant angular velocity (slerp); before the first pose and after the last, where nothing
        can be interpolated, and without `interpolate`, it is the nearest pose (of two equally
        near ones the earlier).

        Args:
            stamp_ns: the time [ns].
            tolerance_ns: how far the nearest pose may be from it [ns].
            interpolate: interpolate between neighbours.

        Raises:
            NoPoseError: no pose within the tolerance.
            InputError: the trajectory has no stamps, or two different poses have this stamp.
        """
        if self.stamps_ns is None or self._order is None:
            raise InputError(f"{self.path}: the poses have no stamps to look them up by")
        # Python integers from here on: differences of int64 could wrap.
        stamp = int(stamp_ns)
        low = int(np.searchsorted(self.stamps_ns, stamp, "left", sorter=self._order))
        high = int(np.searchsorted(self.stamps_ns, stamp, "right", sorter=self._order))
        if low < high:
            return self._only_pose(self._order[low:high], stamp)
        before = int(self._order[low - 1]) if low > 0 else None
        after = int(self._order[low]) if low < len(self) else None
        gaps = [(abs(int(self.stamps_ns[i]) - stamp), i) for i in (before, after) if i is not None]
        gap, nearest = min(gaps, key=lambda pair: pair[0])
        if gap > tolerance_ns:
            raise NoPoseError(
                f"{self.path}: no pose within {tolerance_ns / 1e9:g} s of stamp "
                f"{format_seconds(stamp)}, the nearest is {gap / 1e9:g} s away: check that scans "
                "and poses use one clock, or allow more with tolerance_s"
            )
        if before is None or after is None or not interpolate:
            return self[nearest]
        start, end = int(self.stamps_ns[before]), int(self.stamps_ns[after])
        return _interpolate(self[before], self[after], (stamp - start) / (end - start))

    def _only_pose(self, rows: npt.NDArray[np.intp], stamp: int) -> Pose3:
        first, *others = (int(row) for row in rows)
        for row in others:
            if not (
                np.array_equal(self.positions[row], self.positions[first])
                and np.array_equal(self.rotations[row], self.rotations[first])
            ):
                raise InputError(
                    f"{self.path}: poses {first + 1} and {row + 1} differ and both have the stamp "
                    f"{format_seconds(stamp)}: take one of them out"
                )
        return self[first]


def format_seconds(stamp_ns: int) -> str:
    """A stamp in seconds with all its digits, for people."""
    sign = "-" if stamp_ns < 0 else ""
    whole, part = divmod(abs(stamp_ns), 10**9)
    return f"{sign}{whole}" + f".{part:09d}".rstrip("0").rstrip(".")


def _interpolate(start: Pose3, end: Pose3, fraction: float) -> Pose3:
    """Between two poses; the rotation takes the short way around one axis.

    Where both are the same bits, so is what lies between them.
    """
    position = start.translation + fraction * (end.translation - start.translation)
    if np.array_equal(start.rotation, end.rotation):
        return Pose3(position, start.rotation)
    x, y, z, w = quaternion_xyzw(product(start.rotation.T, end.rotation))
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return Pose3(position, start.rotation)
    # q and -q are one rotation: with w >= 0 the angle is at most pi.
    angle = 2.0 * math.atan2(sine, abs(w)) * math.copysign(fraction, w)
    half = math.sin(angle / 2) / sine
    turn = Pose3.from_quaternion_xyzw(
        np.zeros(3), [x * half, y * half, z * half, math.cos(angle / 2)]
    )
    return Pose3(position, product(start.rotation, turn.rotation))
