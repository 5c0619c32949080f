# SPDX-License-Identifier: Apache-2.0
"""What one scan says of landmarks: readings z, their noise, the pose, perhaps the names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose, Pose2
from oddsmap.short_repr import short_repr

__all__ = ["Kind", "Observations"]

Kind = Literal["range-bearing", "bearing", "position"]


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """The observations of one scan, all of one kind; built by the method named for the kind.

    Args:
        map_from_sensor: the known pose of the sensor; `Pose3` for positions only.
        kind: what the columns of `values` are: "range-bearing" (range [m], bearing [rad]),
            "bearing" (bearing [rad]) or "position" (coordinates in the sensor frame [m]).
        values: one row per observation, shape (n, k). A row that is not finite is counted and
            skipped when it is added to a map.
        covariance: noise of each row, shape (n, k, k), symmetric and positive definite.
        ids: which landmark each row is of, shape (n,), or None where that is not known.

    Raises:
        InputError: shapes that do not fit each other, a pose that is not finite, or a covariance
            that is not symmetric and positive definite.
    """

    map_from_sensor: Pose
    kind: Kind
    values: FloatArray
    covariance: FloatArray
    ids: npt.NDArray[np.int64] | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        d = 2 if isinstance(self.map_from_sensor, Pose2) else 3
        if d == 3 and self.kind != "position":
            raise InputError(f"{self.kind} observations need a 2D pose (Pose2)")
        if not self.map_from_sensor.is_finite:
            raise InputError("the pose of a scan of landmarks is not finite: leave the scan out")
        n, k = len(self.values), {"range-bearing": 2, "bearing": 1, "position": d}[self.kind]
        if self.values.shape != (n, k) or self.covariance.shape != (n, k, k):
            raise InputError(
                f"{self.kind} observations need values (n, {k}) and covariances (n, {k}, {k}), "
                f"got {self.values.shape} and {self.covariance.shape}"
            )
        if self.ids is not None and self.ids.shape != (n,):
            raise InputError(f"{n} observations need ids of shape ({n},), got {self.ids.shape}")
        _check_covariance(self.covariance)

    def __len__(self) -> int:
        """How many observations there are."""
        return len(self.values)

    @classmethod
    def range_bearing(
        cls,
        map_from_sensor: Pose2,
        ranges: npt.ArrayLike,
        bearings: npt.ArrayLike,
        *,
        sigma_range: float,
        sigma_bearing: float,
        ids: npt.ArrayLike | None = None,
    ) -> Observations:
        """Distances and directions.

        Args:
            map_from_sensor: the known pose of the sensor.
            ranges: distances from the sensor [m], shape (n,).
            bearings: angles from the sensor's x axis, counter-clockwise [rad], shape (n,).
            sigma_range: standard deviation of the ranges [m].
            sigma_bearing: standard deviation of the bearings [rad].
            ids: integers from 0 that name the landmarks, shape (n,); None: not known.

        Raises:
            ConfigError: a standard deviation is not positive.
            InputError: see `Observations`.
        """
        values = _columns("ranges and bearings", ranges, bearings)
        noise = _diagonal(sigma_range=sigma_range, sigma_bearing=sigma_bearing)
        return cls(map_from_sensor, "range-bearing", values, _each(values, noise), _ids(ids))

    @classmethod
    def bearing(
        cls,
        map_from_sensor: Pose2,
        bearings: npt.ArrayLike,
        *,
        sigma_bearing: float,
        ids: npt.ArrayLike | None = None,
    ) -> Observations:
        """Directions alone; the arguments are those of `range_bearing`."""
        values = _columns("bearings", bearings)
        noise = _diagonal(sigma_bearing=sigma_bearing)
        return cls(map_from_sensor, "bearing", values, _each(values, noise), _ids(ids))

    @classmethod
    def position(
        cls,
        map_from_sensor: Pose,
        points: npt.ArrayLike,
        *,
        sigma_xy: float | None = None,
        covariance: npt.ArrayLike | None = None,
        ids: npt.ArrayLike | None = None,
    ) -> Observations:
        """Positions in the sensor frame.

        Args:
            map_from_sensor: the known pose of the sensor, 2D or 3D.
            points: positions in the sensor frame [m], shape (n, d), d that of the pose.
            sigma_xy: standard deviation of each coordinate [m]; or
            covariance: in the sensor frame [m^2], shape (d, d), or (n, d, d): one per row.
            ids: integers from 0 that name the landmarks, shape (n,); None: not known.

        Raises:
            ConfigError: not exactly one of `sigma_xy` and `covariance`, or a standard deviation
                that is not positive.
            InputError: see `Observations`.
        """
        values = np.asarray(points, dtype=np.float64)
        if values.ndim != 2:
            raise InputError(f"positions of landmarks have shape (n, d), got {values.shape}")
        if (sigma_xy is None) == (covariance is None):
            raise ConfigError("positions of landmarks need one of sigma_xy [m] and covariance")
        if sigma_xy is not None:
            noise = _diagonal(**{f"sigma_xy {i}": sigma_xy for i in range(values.shape[1])})
        else:
            noise = np.asarray(covariance, dtype=np.float64)
        return cls(map_from_sensor, "position", values, _each(values, noise), _ids(ids))

    def rows(self, keep: npt.NDArray[np.bool_]) -> Observations:
        """Some of the observations: those where `keep`, shape (n,), is True."""
        ids = None if self.ids is None else self.ids[keep]
        return Observations(
            self.map_from_sensor, self.kind, self.values[keep], self.covariance[keep], ids
        )

    def in_map(self) -> tuple[FloatArray, FloatArray]:
        """Positions in the map frame [m], shape (n, d), and their covariances, (n, d, d).

        Exact for positions; to first order for ranges with bearings.

        Raises:
            InputError: bearings alone are no positions.
        """
        pose = self.map_from_sensor
        if self.kind == "bearing":
            raise InputError("one bearing gives no position: two from different places are needed")
        points, jacobian = self.values, np.broadcast_to(pose.rotation, self.covariance.shape)
        if self.kind == "range-bearing":
            ranges, bearings = self.values.T
            cos, sin = np.cos(bearings), np.sin(bearings)
            points = np.stack([ranges * cos, ranges * sin], axis=1)
            polar = np.array([[cos, -ranges * sin], [sin, ranges * cos]])
            jacobian = pose.rotation @ np.moveaxis(polar, 2, 0)
        return pose.transform(points), jacobian @ self.covariance @ jacobian.transpose(0, 2, 1)


def _columns(names: str, *columns: npt.ArrayLike) -> FloatArray:
    arrays = [np.asarray(column, dtype=np.float64) for column in columns]
    if any(array.ndim != 1 or array.shape != arrays[0].shape for array in arrays):
        shapes = " and ".join(str(array.shape) for array in arrays)
        raise InputError(f"{names} of landmarks have shape (n,), got {shapes}")
    return np.stack(arrays, axis=1)


def _diagonal(**sigmas: float) -> FloatArray:
    for name, sigma in sigmas.items():
        if not 0.0 < sigma < np.inf:
            raise ConfigError(f"{name.split()[0]} must be positive and finite, got {sigma}")
    return np.diag(np.square(list(sigmas.values())))


def _each(values: FloatArray, noise: FloatArray) -> FloatArray:
    """One covariance for all rows, or one per row: as one per row."""
    if noise.ndim == 2:
        return np.broadcast_to(noise, (len(values), *noise.shape))
    return noise


def _ids(ids: npt.ArrayLike | None) -> npt.NDArray[np.int64] | None:
    if ids is None:
        return None
    named = np.asarray(ids)
    if named.size and named.dtype.kind not in "iu":
        raise InputError(f"the ids of landmarks are integers, got {named.dtype}")
    if named.size and (named.min() < 0 or named.max() >= 2**63):
        raise InputError(f"the ids of landmarks lie from 0 to 2^63 - 1, got {named.min()}")
    return named.astype(np.int64)


def _check_covariance(covariance: FloatArray) -> None:
    if covariance.strides[0] == 0:  # one for all rows
        covariance = covariance[:1]
    if not len(covariance):
        return
    fine = np.isfinite(covariance).all() and np.allclose(covariance, covariance.swapaxes(1, 2))
    if not fine or np.linalg.eigvalsh(covariance).min() <= 0.0:
        raise InputError(
            "the noise of landmark observations needs covariances that are finite, symmetric and "
            "positive definite"
        )
