# SPDX-License-Identifier: Apache-2.0
"""Beta distributions, arrays of them: modes and credible intervals."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError

__all__ = ["IntervalKind", "beta_interval", "beta_mode"]

IntervalKind = Literal["equal-tailed", "highest-density"]

# Each step halves the bracket at least: 60 leave 1e-18 of mass. Newton's steps need about 8.
_MAX_STEPS = 60


def beta_mode(alpha: FloatArray, beta: FloatArray) -> FloatArray:
    """Where the density of Beta(alpha, beta) is largest; NaN where that is no single place.

    (alpha - 1) / (alpha + beta - 2) where both are above 1. A density that falls from 0 on
    (alpha <= 1 <= beta) has its mode at 0, one that rises to 1 (beta <= 1 <= alpha) at 1. A flat
    one (both 1) and one with two peaks (both below 1) have none.
    """
    none = ((alpha == 1.0) & (beta == 1.0)) | ((alpha < 1.0) & (beta < 1.0))
    up, down = np.maximum(alpha - 1.0, 0.0), np.maximum(beta - 1.0, 0.0)
    # At alpha = 1 > beta no weight is left on either side: the density rises to 1.
    rises = (alpha == 1.0) & (beta < 1.0)
    with np.errstate(invalid="ignore"):
        mode = np.where(rises, 1.0, np.where((up + down) > 0.0, up / (up + down), 0.0))
    return np.where(none, np.nan, mode)


def beta_interval(
    alpha: FloatArray, beta: FloatArray, level: float, kind: IntervalKind = "equal-tailed"
) -> tuple[FloatArray, FloatArray]:
    """Credible intervals of Beta(alpha, beta).

    "equal-tailed" leaves (1 - level) / 2 on each side. "highest-density" is the shortest interval
    of that mass: both ends have the same density, or one end is 0 or 1 where the density falls
    from there. Where no single interval is densest (flat, or two peaks: no parameter above 1) it
    is the equal-tailed one.

    Args:
        alpha: above 0, shape (n,).
        beta: above 0, same shape.
        level: mass inside, between 0 and 1.
        kind: which interval of that mass.

    Returns:
        lower and upper ends, shape (n,).

    Raises:
        ConfigError: the level is not between 0 and 1, or an unknown kind.
    """
    from scipy.special import betaincinv

    if not 0.0 < level < 1.0:
        raise ConfigError(f"a credible interval's level lies between 0 and 1, got {level}")
    if kind not in get_args(IntervalKind):
        raise ConfigError(f"interval must be {' or '.join(get_args(IntervalKind))}, got {kind!r}")
    lower_mass = np.full(alpha.shape, (1.0 - level) / 2.0)
    if kind == "highest-density":
        falls = (alpha <= 1.0) & (beta >= 1.0) & ~((alpha == 1.0) & (beta == 1.0))
        rises = (alpha >= 1.0) & (beta <= 1.0) & ~((alpha == 1.0) & (beta == 1.0))
        lower_mass[falls], lower_mass[rises] = 0.0, 1.0 - level
        inner = (alpha > 1.0) & (beta > 1.0)
        lower_mass[inner] = _lower_mass(alpha[inner], beta[inner], level)
    lower = np.asarray(betaincinv(alpha, beta, lower_mass))
    # From the other side: 1 - mass would round the little that is left above.
    upper_mass = np.maximum(1.0 - level - lower_mass, 0.0)
    upper = 1.0 - np.asarray(betaincinv(beta, alpha, upper_mass))
    return lower, upper


def _lower_mass(alpha: FloatArray, beta: FloatArray, level: float) -> FloatArray:
    """Mass below the shortest interval, for densities with one peak inside.

    With t below and 1 - level - t above, log density(lower) - log density(upper) rises with t:
    its zero is found by Newton's method, kept in a bracket that halves wherever a step leaves it.
    """
    # Mirrored so that the mass lies towards 0, where numbers are finest.
    swap = alpha > beta
    a, b = np.where(swap, beta, alpha), np.where(swap, alpha, beta)
    remainder = 1.0 - level
    low, high = np.zeros(a.shape), np.full(a.shape, remainder)
    t = 0.5 * (low + high)
    active = np.arange(len(a))
    for _ in range(_MAX_STEPS):
        gap, slope = _density_gap(a[active], b[active], t[active], remainder)
        below = gap < 0.0
        low[active] = np.where(below, t[active], low[active])
        high[active] = np.where(below, high[active], t[active])
        with np.errstate(invalid="ignore", divide="ignore"):
            step = t[active] - gap / slope
        inside = (step > low[active]) & (step < high[active])
        middle = 0.5 * (low[active] + high[active])
        moved = np.where(inside, step, middle)
        change = np.abs(moved - t[active])
        t[active] = moved
        active = active[change > 1e-12 * remainder]
        if len(active) == 0:
            break
    mass: FloatArray = np.where(swap, remainder - t, t)
    return mass


def _density_gap(
    a: FloatArray, b: FloatArray, t: FloatArray, remainder: float
) -> tuple[FloatArray, FloatArray]:
    """Give log density(lower) - log density(upper) at lower mass t, and its slope in t."""
    from scipy.special import betaincinv, betaln, xlog1py, xlogy

    lower, upper = betaincinv(a, b, t), 1.0 - betaincinv(b, a, remainder - t)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        log_lower = xlogy(a - 1.0, lower) + xlog1py(b - 1.0, -lower)
        log_upper = xlogy(a - 1.0, upper) + xlog1py(b - 1.0, -upper)
        # d log f / dt = (log f)' / f, as dx / dt = 1 / f below and also above.
        norm = betaln(a, b)
        slope = ((a - 1.0) / lower - (b - 1.0) / (1.0 - lower)) * np.exp(norm - log_lower)
        slope -= ((a - 1.0) / upper - (b - 1.0) / (1.0 - upper)) * np.exp(norm - log_upper)
        gap = log_lower - log_upper
    return gap, slope
