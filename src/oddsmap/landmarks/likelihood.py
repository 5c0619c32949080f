# SPDX-License-Identifier: Apache-2.0
"""The position of one landmark that explains all its observations best, and how sure it is.

Positions are linear in the landmark: their information matrices and vectors add up, and the sums
are all that is kept. Ranges and bearings are not: they are kept, and linearised about the estimate
until it stays where it is (Gauss-Newton). The covariance is the inverse of the information there.

Source: Thrun, Burgard, Fox, Probabilistic Robotics, ch. 3.5 (information filter); Nocedal, Wright,
Numerical Optimization, ch. 10.3 (Gauss-Newton).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import FloatArray

__all__ = ["POLAR_COLUMNS", "Linear", "maximum_likelihood", "wrap"]


# Columns of an array of ranges and bearings: position of the sensor [m], direction in the map
# frame [rad], range [m], and the information about (range, direction). A bearing alone has no
# information about the range.
POLAR_COLUMNS = ("x", "y", "azimuth", "range", "w_rr", "w_ra", "w_aa")

_MAX_STEPS = 50
_MAX_HALVINGS = 20
_SMALL = 1e-9  # a step of so many standard deviations is the last
_SURE = 1e-4  # and a step of so many is within what the cost can tell
_SINGULAR = 1e-12  # ratio of eigenvalues below which a direction is not observed
_NEAREST = 1e-9  # [m]; the direction to a landmark at the sensor itself is not defined


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Sums of the observations that are linear in the position p of the landmark.

    Args:
        information: sum of the inverse covariances W [1/m^2], shape (d, d).
        vector: sum of W p [1/m], shape (d,).
    """

    information: FloatArray
    vector: FloatArray

    @classmethod
    def nothing(cls, d: int) -> Linear:
        """No observation yet."""
        return cls(np.zeros((d, d)), np.zeros(d))

    def plus(self, points: FloatArray, covariances: FloatArray) -> Linear:
        """Add points [m], shape (n, d), with covariances [m^2], shape (n, d, d)."""
        weights = np.linalg.inv(covariances)
        return Linear(
            self.information + weights.sum(axis=0),
            self.vector + np.einsum("nij,nj->i", weights, points),
        )


def maximum_likelihood(
    linear: Linear,
    polar: FloatArray,
    start: FloatArray | None = None,
    *,
    depth_ratio_max: float = 0.2,
) -> tuple[FloatArray, FloatArray] | None:
    """Estimate a landmark from all its observations.

    Args:
        linear: positions, summed up.
        polar: ranges and bearings, shape (n, 7), see `POLAR_COLUMNS`, in the frame of `linear`.
        start: where to start from [m], shape (d,); None: from a linear estimate.
        depth_ratio_max: with bearings alone, the largest standard deviation may be at most this
            part of the distance to the nearest sensor; above, the bearings are nearly parallel and
            no Gaussian describes what is known of the distance.

    Returns:
        The position [m], shape (d,), and its information [1/m^2], shape (d, d); None where the
        observations do not determine it.
    """
    ranged = bool((polar[:, 4] > 0.0).any())
    fixed = linear.information.any()
    if not len(polar):
        point = _solve(linear.information, linear.vector) if fixed else None
        return None if point is None else (point, linear.information)
    if start is None:
        start = _cartesian(linear, polar) if ranged or fixed else _crossing(polar)
    if start is None:
        return None
    found = _gauss_newton(linear, polar, start)
    if found is not None and not ranged and not fixed:
        point, information = found
        if not _is_crossing(polar, point, information, depth_ratio_max):
            return None
    return found


def wrap(angle: FloatArray) -> FloatArray:
    """Angles [rad] in [-pi, pi)."""
    return np.asarray(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)


def _gauss_newton(
    linear: Linear, polar: FloatArray, point: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    cost, gradient, information = _linearise(linear, polar, point)
    for _ in range(_MAX_STEPS):
        step = _solve(information, gradient)
        if step is None:
            return None
        length = float(np.sqrt(step @ information @ step))  # in standard deviations
        for _ in range(_MAX_HALVINGS):
            there = _linearise(linear, polar, point + step)
            if there[0] <= cost or length <= _SURE:
                break
            step = 0.5 * step
        else:
            return None
        point = point + step
        cost, gradient, information = there
        if length <= _SMALL:
            return (point, information) if _solve(information, gradient) is not None else None
    return None


def _linearise(
    linear: Linear, polar: FloatArray, point: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Twice the negative log likelihood (but for a constant), half its descent, the information."""
    away = point - polar[:, :2]
    distance = np.maximum(np.hypot(away[:, 0], away[:, 1]), _NEAREST)
    ahead = away / distance[:, None]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / distance[:, None]
    jacobian = np.stack([ahead, left], axis=1)
    off = np.stack(
        [polar[:, 3] - distance, wrap(polar[:, 2] - np.arctan2(away[:, 1], away[:, 0]))], axis=1
    )
    weights = polar[:, [4, 5, 5, 6]].reshape(-1, 2, 2)
    weighted = np.einsum("nij,nj->ni", weights, off)
    # The linear part is a parabola: its cost is counted from its value at the origin.
    cost = float((weighted * off).sum())
    cost += float(point @ linear.information @ point - 2.0 * point @ linear.vector)
    gradient = np.einsum("nij,ni->j", jacobian, weighted)
    gradient = gradient + linear.vector - linear.information @ point
    information = np.einsum("nki,nkl,nlj->ij", jacobian, weights, jacobian)
    return cost, gradient, information + linear.information


def _cartesian(linear: Linear, polar: FloatArray) -> FloatArray | None:
    """Start from ranges with bearings as positions, to first order, and from positions."""
    ranged = polar[polar[:, 4] > 0.0]
    cos, sin = np.cos(ranged[:, 2]), np.sin(ranged[:, 2])
    ranges = ranged[:, 3]
    points = ranged[:, :2] + ranges[:, None] * np.stack([cos, sin], axis=1)
    jacobian = np.moveaxis(np.array([[cos, -ranges * sin], [sin, ranges * cos]]), 2, 0)
    noise = np.linalg.inv(ranged[:, [4, 5, 5, 6]].reshape(-1, 2, 2))
    total = linear.plus(points, jacobian @ noise @ jacobian.transpose(0, 2, 1))
    return _solve(total.information, total.vector)


def _crossing(polar: FloatArray) -> FloatArray | None:
    """Start from the point nearest to all lines of sight, in the sense of least squares."""
    normals = np.stack([-np.sin(polar[:, 2]), np.cos(polar[:, 2])], axis=1)
    offsets = (normals * polar[:, :2]).sum(axis=1)
    return _solve(normals.T @ normals, normals.T @ offsets)


def _is_crossing(
    polar: FloatArray, point: FloatArray, information: FloatArray, ratio: float
) -> bool:
    """Whether bearings alone say where the landmark is: ahead of all, and not along one line."""
    away = point - polar[:, :2]
    off = wrap(polar[:, 2] - np.arctan2(away[:, 1], away[:, 0]))
    nearest = np.hypot(away[:, 0], away[:, 1]).min()
    spread = 1.0 / np.sqrt(np.linalg.eigvalsh(information)[0])
    return bool((np.abs(off) < 0.5 * np.pi).all() and spread <= ratio * nearest)


def _solve(matrix: FloatArray, vector: FloatArray) -> FloatArray | None:
    """Solve a symmetric system; None where it is singular, or has passed all numbers."""
    if not np.isfinite(matrix).all():
        return None
    eigenvalues = np.linalg.eigvalsh(matrix)
    if not eigenvalues[0] > _SINGULAR * eigenvalues[-1]:
        return None
    return np.asarray(np.linalg.solve(matrix, vector))
