# SPDX-License-Identifier: Apache-2.0
"""One landmark: the Gaussian that is reported, and what it is computed from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.landmarks.likelihood import POLAR_COLUMNS, Linear, maximum_likelihood
from oddsmap.landmarks.observations import Observations
from oddsmap.short_repr import short_repr

__all__ = ["Landmark", "Track"]


@dataclass(frozen=True, slots=True, eq=False)
class Landmark:
    """A landmark as a Gaussian in the map frame.

    Args:
        id: its name: the one given with its observations, or a number of the map's own.
        mean: position [m], shape (d,).
        covariance: [m^2], shape (d, d).
        count: how many observations it was estimated from.
    """

    id: int
    mean: FloatArray
    covariance: FloatArray
    count: int

    __repr__ = short_repr


class Track:
    """All that was observed of one landmark, and the estimate from it.

    Args:
        anchor: a point near the landmark [m], shape (d,): sums and estimates are relative to it,
            so that coordinates as large as UTM's cost no digits.
    """

    def __init__(self, anchor: FloatArray) -> None:
        self.anchor = anchor
        self.count = 0
        self.linear = Linear.nothing(len(anchor))
        self.polar = np.empty((0, len(POLAR_COLUMNS)))
        # Relative mean and covariance; None: not determined. Valid while not `stale`.
        self.gaussian: tuple[FloatArray, FloatArray] | None = None
        self.stale = False

    def to_dict(self) -> dict[str, Any]:
        """All of it but the count, as plain values for JSON."""
        gaussian = self.gaussian
        return {
            "anchor": self.anchor.tolist(),
            "information": self.linear.information.tolist(),
            "vector": self.linear.vector.tolist(),
            "polar": self.polar.tolist(),
            "estimate": None if gaussian is None else [part.tolist() for part in gaussian],
        }

    @classmethod
    def from_dict(cls, written: Mapping[str, Any], count: int, d: int) -> Track:
        """The inverse of `to_dict`, in d dimensions.

        Raises:
            KeyError, TypeError, ValueError: something is missing, or no number, or of another
                shape.
        """
        track = cls(_array(written["anchor"], d))
        track.count = count
        track.linear = Linear(_array(written["information"], d, d), _array(written["vector"], d))
        columns = len(POLAR_COLUMNS)
        track.polar = _array(written["polar"] or np.empty((0, columns)), -1, columns)
        if written["estimate"] is not None:
            mean, covariance = written["estimate"]
            track.gaussian = _array(mean, d), _array(covariance, d, d)
        return track

    def add(self, observations: Observations) -> None:
        """Add observations of this landmark."""
        self.count += len(observations)
        self.stale = True
        if observations.kind == "position":
            points, covariances = observations.in_map()
            self.linear = self.linear.plus(points - self.anchor, covariances)
        else:
            self.polar = np.concatenate([self.polar, self._polar_rows(observations)])

    def estimate(self, depth_ratio_max: float) -> tuple[FloatArray, FloatArray] | None:
        """Mean [m] and covariance [m^2] in the map frame, or None where not determined yet."""
        if self.stale:
            start = None if self.gaussian is None else self.gaussian[0]
            found = maximum_likelihood(
                self.linear, self.polar, start, depth_ratio_max=depth_ratio_max
            )
            self.gaussian = None
            if found is not None:
                self.gaussian = found[0], np.asarray(np.linalg.inv(found[1]), dtype=np.float64)
            self.stale = False
        if self.gaussian is None:
            return None
        return self.anchor + self.gaussian[0], self.gaussian[1]

    def _polar_rows(self, observations: Observations) -> FloatArray:
        pose = observations.map_from_sensor
        rows = np.zeros((len(observations), len(POLAR_COLUMNS)))
        rows[:, :2] = pose.translation - self.anchor
        heading = np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0])
        rows[:, 2] = heading + observations.values[:, -1]
        weights = np.linalg.inv(observations.covariance)
        rows[:, 6] = weights[:, -1, -1]
        if observations.kind == "range-bearing":
            rows[:, 3] = observations.values[:, 0]
            rows[:, 4], rows[:, 5] = weights[:, 0, 0], weights[:, 0, 1]
        return rows


def _array(numbers: Any, *shape: int) -> FloatArray:
    """Numbers as an array of that shape, -1 standing for any.

    Raises:
        ValueError: another shape, or a number that is not finite.
    """
    array = np.array(numbers, dtype=np.float64)
    if array.ndim != len(shape) or any(
        side not in (-1, n) for side, n in zip(shape, array.shape, strict=True)
    ):
        raise ValueError(f"shape {array.shape} where {shape} is needed")
    if not np.isfinite(array).all():
        raise ValueError("a number that is not finite")
    return array
