# SPDX-License-Identifier: Apache-2.0
"""A scan without its pose, and the many poses that it may have been taken from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose, Pose2, Pose3
from oddsmap.query.places import CellGrid, check_places
from oddsmap.scans.scan import Scan

__all__ = ["Frame", "Poses", "PosesLike", "ScanBeams"]

PosesLike: TypeAlias = npt.ArrayLike | Sequence[Pose]
"""Poses of the sensor in the map frame: in 2D x, y, yaw [m, m, rad], shape (n, 3), in 3D matrices
[R | t], shape (n, 4, 4); or `Pose` objects."""

Frame: TypeAlias = tuple[FloatArray, FloatArray]
"""map_from_grid: rotation, shape (d, d), and translation [m], shape (d,)."""

# As far as a matrix of few digits may be from a rotation.
_ROTATION = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class ScanBeams:
    """The beams of a scan that say something, in the sensor frame.

    Attributes:
        origins: where beams start [m], shape (m, d).
        directions: unit vectors, shape (m, d).
        ranges: readings [m], 0 or more, +Inf for a no-return, shape (m,).
    """

    origins: FloatArray
    directions: FloatArray
    ranges: FloatArray

    @classmethod
    def of(cls, scan: Scan, ndim: int, max_beams: int | None) -> ScanBeams:
        """Those of a scan.

        Args:
            scan: its pose is not looked at.
            ndim: of the map.
            max_beams: at most so many, evenly spaced among all; None: all.

        Raises:
            InputError: it is no scan, or not of the map's dimension.
            ConfigError: max_beams below 1.
        """
        if not isinstance(scan, Scan):
            raise InputError(
                f"a likelihood needs a Scan, got {type(scan).__name__}: make one with "
                "Scan.from_angles or Scan.from_points"
            )
        if scan.directions.shape[1] != ndim:
            raise InputError(f"the scan is {scan.directions.shape[1]}D, the map {ndim}D")
        if max_beams is not None and not isinstance(max_beams, Integral):
            raise ConfigError(f"max_beams is a whole number, got {max_beams!r}")
        if max_beams is not None and not max_beams >= 1:
            raise ConfigError(f"max_beams is at least 1, got {max_beams}")
        chosen = np.arange(scan.size)
        if max_beams is not None and max_beams < scan.size:
            chosen = np.rint(np.linspace(0, scan.size - 1, max_beams)).astype(np.int64)
        chosen = chosen[scan.ranges[chosen] >= 0.0]
        ways = np.ascontiguousarray(scan.directions[chosen], np.float64)
        starts = (
            np.zeros_like(ways)
            if scan.beam_origins is None
            else np.ascontiguousarray(scan.beam_origins[chosen], np.float64)
        )
        return cls(starts, ways, np.ascontiguousarray(scan.ranges[chosen], np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Where the sensor may have been, in the frame that cells count from.

    Attributes:
        rotations: shape (n, d, d).
        positions: [m], shape (n, d).
    """

    rotations: FloatArray
    positions: FloatArray

    @classmethod
    def of(cls, given: PosesLike, grid: CellGrid, frame: Frame | None) -> Poses:
        """Those of an array or a list.

        Args:
            given: see `PosesLike`.
            grid: the map.
            frame: map_from_grid; None: the map frame.

        Raises:
            InputError: another shape, numbers that are not finite, positions farther than 2^46
                cells from the map's origin, or no rotations.
        """
        values = _numbers(given, grid.ndim)
        if grid.ndim == 2:
            cos, sin = np.cos(values[:, 2]), np.sin(values[:, 2])
            turns = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], axis=1)
            places = values[:, :2]
        else:
            turns, places = values[:, :3, :3], values[:, :3, 3]
            off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
            wrong = ~((off < _ROTATION) & (np.linalg.det(turns) > 0.0))
            if wrong.any():
                raise InputError(
                    f"{np.count_nonzero(wrong)} of {len(turns)} poses are no rotation and "
                    f"translation, the first is pose {int(np.argmax(wrong))}"
                )
        if frame is not None:
            turn, corner = frame
            places, turns = (places - corner) @ turn, turn.T @ turns
        check_places(places / grid.resolution)
        return cls(np.ascontiguousarray(turns), np.ascontiguousarray(places))

    def __len__(self) -> int:
        return len(self.positions)


def _numbers(given: PosesLike, ndim: int) -> FloatArray:
    """Poses as numbers: shape (n, 3) in 2D, (n, 4, 4) in 3D."""
    form, shape = ("(x, y, yaw)", (3,)) if ndim == 2 else ("a matrix of 4 x 4", (4, 4))
    if isinstance(given, Sequence):
        objects = [pose for pose in given if isinstance(pose, Pose2 | Pose3)]
        if objects:
            kind = Pose2 if ndim == 2 else Pose3
            if len(objects) < len(given) or not all(isinstance(pose, kind) for pose in objects):
                raise InputError(
                    f"poses in a {ndim}D map are all {kind.__name__}, or an array of them"
                )
            given = np.array([_row(pose) for pose in objects])
    try:
        values = np.asarray(given)
    except ValueError:  # rows of different lengths
        values = np.asarray(None)
    if values.dtype.kind not in "iuf":
        raise InputError(f"poses are numbers, {form} each, got {type(given).__name__}")
    if values.size == 0:
        return np.empty((0, *shape))
    if values.shape[1:] != shape:
        one = " (one alone is [pose])" if values.shape == shape else ""
        raise InputError(
            f"poses in a {ndim}D map are {form} each, shape (n, {', '.join(map(str, shape))}), "
            f"got {values.shape}{one}"
        )
    wrong = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
    if wrong.any():
        raise InputError(
            f"{np.count_nonzero(wrong)} of {len(values)} poses are not finite, the first is pose "
            f"{int(np.argmax(wrong))}: leave them out"
        )
    return values.astype(np.float64)


def _row(pose: Pose) -> FloatArray:
    if isinstance(pose, Pose2):
        return np.array([pose.x, pose.y, pose.theta])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix
