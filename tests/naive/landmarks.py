# SPDX-License-Identifier: Apache-2.0
"""One landmark by batch weighted least squares: SciPy, residual by residual, numeric Jacobian."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from oddsmap.landmarks import Observations

FloatArray = npt.NDArray[np.float64]


def predict(observations: Observations, point: FloatArray) -> FloatArray:
    """What the sensor would read of a landmark there."""
    relative = np.array(observations.map_from_sensor.inverse().transform(point[None])[0])
    if observations.kind == "position":
        return relative
    x, y = relative
    bearing = math.atan2(y, x)
    if observations.kind == "bearing":
        return np.array([bearing])
    return np.array([math.hypot(x, y), bearing])


def innovation(observations: Observations, row: int, point: FloatArray) -> FloatArray:
    """Reading minus prediction, the angle in [-pi, pi]."""
    off = np.array(observations.values[row] - predict(observations, point))
    if observations.kind != "position":
        off[-1] = math.remainder(off[-1], 2.0 * math.pi)
    return off


def least_squares_landmark(
    scans: Sequence[Observations], start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position and covariance of the landmark of which all the observations are."""

    def residuals(point: FloatArray) -> FloatArray:
        whitened = []
        for scan in scans:
            for row in range(len(scan)):
                root = np.linalg.cholesky(np.linalg.inv(scan.covariance[row]))
                whitened.append(root.T @ innovation(scan, row, point))
        return np.concatenate(whitened)

    found = least_squares(residuals, start, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return found.x, np.linalg.inv(found.jac.T @ found.jac)


def squared_mahalanobis_of(
    observations: Observations, row: int, mean: FloatArray, covariance: FloatArray
) -> float:
    """The distance of one observation from one landmark, with a numeric Jacobian."""
    step = 1e-6
    jacobian = np.stack(
        [
            (predict(observations, mean + step * axis) - predict(observations, mean - step * axis))
            / (2.0 * step)
            for axis in np.eye(len(mean))
        ],
        axis=1,
    )
    spread = observations.covariance[row] + jacobian @ covariance @ jacobian.T
    off = innovation(observations, row, mean)
    return float(off @ np.linalg.inv(spread) @ off)
