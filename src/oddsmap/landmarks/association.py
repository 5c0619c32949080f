# SPDX-License-Identifier: Apache-2.0
"""Which observation is of which landmark: chi-square gate and mutual nearest neighbour.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
ch. 1.4 and 5.4 (innovation, its covariance, chi-square gate); Dissanayake et al. 2001, A solution
to the SLAM problem (two gates: one to associate, a wider one to start a new landmark).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.landmarks.likelihood import wrap
from oddsmap.landmarks.observations import Observations

__all__ = ["chi_square_quantile", "mutual_nearest", "squared_mahalanobis"]


def chi_square_quantile(probability: float, degrees: int) -> float:
    """The value that a chi-square variable stays below with a probability in (0, 1)."""
    from scipy.special import gammaincinv  # a tenth of the time that scipy.stats takes to load

    return float(2.0 * gammaincinv(0.5 * degrees, probability))


def squared_mahalanobis(
    observations: Observations, means: FloatArray, covariances: FloatArray
) -> FloatArray:
    """How far each observation is from what each landmark would give, in the measurement space.

    Args:
        observations: n observations.
        means: positions of the landmarks [m], shape (m, d).
        covariances: of the positions [m^2], shape (m, d, d).

    Returns:
        v^T S^-1 v, shape (n, m), of the innovation v = z - h(mean) and its covariance
        S = R + H P H^T.
    """
    if observations.kind == "position":
        points, noise = observations.in_map()
        off, spread = points[:, None] - means[None], covariances
    else:
        noise = observations.covariance
        off, jacobian = _polar_innovations(observations, means)
        spread = jacobian @ covariances @ jacobian.transpose(0, 2, 1)
    innovation = noise[:, None] + spread[None]
    return np.asarray((off * np.linalg.solve(innovation, off[..., None])[..., 0]).sum(axis=2))


def mutual_nearest(distance: FloatArray, limit: float) -> npt.NDArray[np.int64]:
    """Pair rows and columns that are each other's nearest.

    Args:
        distance: shape (n, m).
        limit: pairs farther apart are none.

    Returns:
        The column of each row, or -1, shape (n,).
    """
    n, m = distance.shape
    pairs = np.full(n, -1, dtype=np.int64)
    if n == 0 or m == 0:
        return pairs
    column, row = distance.argmin(axis=1), distance.argmin(axis=0)
    rows = np.arange(n)
    paired = (row[column] == rows) & (distance[rows, column] <= limit)
    pairs[paired] = column[paired]
    return pairs


def _polar_innovations(
    observations: Observations, means: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Innovations, shape (n, m, k), and the Jacobians of the predictions, shape (m, k, d)."""
    pose = observations.map_from_sensor
    away = (means - pose.translation) @ pose.rotation  # in the sensor frame
    distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), np.finfo(np.float64).tiny)
    ahead = (means - pose.translation) / distance[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / distance[:, None]
    bearings = observations.values[:, -1:]
    off = wrap(bearings - np.arctan2(away[:, 1], away[:, 0]))[..., None]
    if observations.kind == "bearing":
        return off, left[:, None]
    off = np.concatenate([(observations.values[:, :1] - distance)[..., None], off], axis=2)
    return off, np.stack([ahead, left], axis=1)
