# SPDX-License-Identifier: Apache-2.0
"""One landmark: the Gaussian that is reported, and what it is computed from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.landmarks.likelihood import POLAR_COLUMNS, Linear, maximum_likelihood
from oddsmap.landmarks.observations import Observations

__all__ = ["Landmark", "Track"]

FloatArray = npt.NDArray[np.float64]


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
