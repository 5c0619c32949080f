# SPDX-License-Identifier: Apache-2.0
"""Poses at many times at once: those of the beams of a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.short_repr import short_repr

__all__ = ["PoseArray", "PoseTrack"]


@dataclass(frozen=True, slots=True, eq=False)
class PoseArray:
    """Poses at some times, composed and inverted as `Pose3` is, bit by bit.

    Args:
        rotations: shape (n, 3, 3).
        positions: [m], shape (n, 3).
        known: False where there is no pose, whose numbers then mean nothing, shape (n,).
    """

    rotations: FloatArray
    positions: FloatArray
    known: BoolArray

    __repr__ = short_repr

    @classmethod
    def fixed(cls, pose: Pose3, count: int) -> PoseArray:
        """One pose at all times."""
        return cls(
            np.broadcast_to(pose.rotation, (count, 3, 3)),
            np.broadcast_to(pose.translation, (count, 3)),
            np.ones(count, np.bool_),
        )

    def __len__(self) -> int:
        return len(self.known)

    def __matmul__(self, other: PoseArray) -> PoseArray:
        """Compose: `map_from_body @ body_from_sensor` is `map_from_sensor`."""
        ours, theirs = self.rotations, other.rotations
        with np.errstate(invalid="ignore", over="ignore"):
            turned = ours[:, :, :1] * theirs[:, :1]
            moved = other.positions[:, 0, None] * ours[:, :, 0]
            for k in (1, 2):
                turned = turned + ours[:, :, k : k + 1] * theirs[:, k : k + 1]
                moved = moved + other.positions[:, k, None] * ours[:, :, k]
            return PoseArray(turned, moved + self.positions, self.known & other.known)

    def inverse(self) -> PoseArray:
        """The transforms in the other direction."""
        with np.errstate(invalid="ignore", over="ignore"):
            back = -self.positions
            moved = back[:, 0, None] * self.rotations[:, 0]
            for k in (1, 2):
                moved = moved + back[:, k, None] * self.rotations[:, k]
        return PoseArray(self.rotations.transpose(0, 2, 1), moved, self.known)


class PoseTrack:
    """A trajectory that is asked for many times at once.

    Args:
        trajectory: poses with stamps.

    Raises:
        InputError: it has no stamps.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        if trajectory.stamps_ns is None:
            raise InputError(f"{trajectory.path}: the poses have no stamps to look them up by")
        order = np.argsort(trajectory.stamps_ns, kind="stable")
        self._stamps = trajectory.stamps_ns[order]
        self._positions = np.ascontiguousarray(trajectory.positions[order], np.float64)
        self._rotations = np.ascontiguousarray(trajectory.rotations[order], np.float64)

    @property
    def spacing_ns(self) -> float:
        """The time from a pose to the next, in the middle of all [ns]; infinite for one pose."""
        gaps = np.diff(self._stamps.astype(np.float64))
        gaps = gaps[gaps > 0]
        return float(np.median(gaps)) if len(gaps) else np.inf

    def at(self, times_ns: IntArray, tolerance_ns: int) -> PoseArray:
        """The pose at each time, as `Trajectory.at` has it between two poses.

        Before the first pose, after the last and where the nearest is farther off than the
        tolerance it is not known: nothing is extrapolated.

        Args:
            times_ns: [ns], shape (n,), in any order.
            tolerance_ns: how far the nearest pose may be from a time [ns].
        """
        from oddsmap.kernels.beam_poses import interpolate_poses

        count = len(times_ns)
        found = PoseArray(np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count, np.bool_))
        interpolate_poses(
            self._stamps, self._positions, self._rotations,
            np.ascontiguousarray(times_ns, np.int64), tolerance_ns,
            found.positions, found.rotations, found.known,
        )  # fmt: skip
        return found
