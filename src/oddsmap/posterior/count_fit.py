# SPDX-License-Identifier: Apache-2.0
"""Models of counts, fitted to a map's own hits and passes.

Evidence is maximised: the parameters are those under which the counts of all known cells are most
probable. Nothing is held out, and no truth is needed. Weak priors, worth as much as a few cells,
keep parameters that the counts say nothing of where they are for most maps. Sums go over arrays in
one order and without BLAS, whose threads may change the last digit.

Source: Minka, Estimating a Dirichlet distribution (2000), for the likelihood of beta-binomial
counts and its derivatives. Its optimiser is Newton's method on logarithms, damped as by Levenberg
and Marquardt, for plain steps can leave the domain; iterating Minka's fixed points takes long.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.posterior.count_model import KNOTS, LOG_MISS, LOG_REFLECT, CountModel, knots_of
from oddsmap.posterior.count_pairs import FEW_PAIRS, CountPairs, few_pairs

__all__ = ["BETA", "fit_beta", "fit_model"]

# Mean, deviation of the logit, and share: what is expected of reflectivities. It is worth as many
# cells, and the distribution among all cells as many of each number of beams.
_START = ((0.003, 2.0, 0.9), (0.55, 1.2, 0.1))
_CELLS_OF_START, _CELLS_OF_WHOLE = 10.0, 50.0
_STEPS = 60
# Of the Beta distribution: where parameters start, and what counts that say nothing leave them at.
BETA = (0.02, 1.0)
_BETA_LIMITS = (1e-4, 1e3)
# Standard deviation of the priors of logits and logarithms.
_PRIOR_SD = 1.5
# Steps of their fit, and from how small a one on it ends.
_MOST_TRIES, _LEAST_STEP = 200, 1e-9

_Pair = tuple[float, float]
_Quadratic = tuple[float, _Pair, tuple[float, float, float]]
"""A value, its slopes along both axes, and its bends: along the first, the second, and mixed."""


def fit_beta(pairs: CountPairs, expected: tuple[float, float] = BETA) -> tuple[float, float]:
    """The Beta prior of reflectivity under which counts are most probable.

    Args:
        pairs: the counts of a map.
        expected: where parameters start, and stay if there are no counts.

    Returns:
        Weights of hits and of passes [votes].
    """
    table = _Tables(pairs)
    start = (math.log(expected[0]), math.log(expected[1]))

    def cost(logs: _Pair) -> _Quadratic:
        return _with_prior(table.log_beta_binomial(*logs), logs, start, table.total)

    low, high = map(math.log, _BETA_LIMITS)
    log_a, log_b = _minimum(cost, start, low, high)
    return math.exp(log_a), math.exp(log_b)


def fit_model(
    pairs: CountPairs, expected: CountModel | None = None, most: int = FEW_PAIRS
) -> CountModel:
    """How reflectivities are distributed among cells, so that their counts are most probable.

    First among all cells, then among those of each number of beams, of which the former is what
    is expected. The problem has one optimum, which expectation maximisation approaches from
    anywhere; it stops after a fixed number of steps.

    Args:
        pairs: the counts of a map.
        expected: what is expected of the distribution among all; None: of any map.
        most: more pairs than this are rounded to fewer.
    """
    pairs = few_pairs(pairs, most)
    below, share = knots_of(pairs.hits + pairs.passes)
    order = np.argsort(below, kind="stable")  # so that sums of each knot go over neighbours
    h, p, cells = pairs.hits[order], pairs.passes[order], pairs.cells[order]
    log_p = h[:, None] * LOG_REFLECT + p[:, None] * LOG_MISS
    likelihood = np.exp(log_p - log_p.max(axis=1, keepdims=True))
    start = _start() if expected is None else np.array(expected.distributions[0])
    whole = _of_all(likelihood, cells, start)
    each = _of_knots(likelihood, cells, below[order], share[order], whole)
    return CountModel(tuple(tuple(row) for row in (whole, *each[1:])))


def _of_all(likelihood: FloatArray, cells: FloatArray, start: FloatArray) -> list[float]:
    """One distribution for all pairs, whose likelihoods have shape (pairs, reflectivities)."""
    whole = start
    for _ in range(_STEPS):
        found = likelihood * whole
        found *= (cells / found.sum(axis=1))[:, None]
        whole = found.sum(axis=0) + _CELLS_OF_START * start
        whole /= whole.sum()
    return list(map(float, whole))


def _of_knots(
    likelihood: FloatArray, cells: FloatArray, below: IntArray, share: FloatArray,
    whole: list[float],
) -> list[list[float]]:  # fmt: skip
    """A distribution for each knot; pairs are mixed of two, and sorted by the first of them."""
    edges = np.searchsorted(below, np.arange(KNOTS))
    of_both = (likelihood * (1.0 - share)[:, None], likelihood * share[:, None])
    expected = np.tile(_CELLS_OF_WHOLE * np.array(whole), (KNOTS, 1))
    each = expected / _CELLS_OF_WHOLE
    for _ in range(_STEPS):
        first, second = of_both[0] * each[below], of_both[1] * each[below + 1]
        weight = (cells / (first.sum(axis=1) + second.sum(axis=1)))[:, None]
        each = expected.copy()
        for k in range(KNOTS - 1):
            rows = slice(edges[k], edges[k + 1])
            each[k] += (first[rows] * weight[rows]).sum(axis=0)
            each[k + 1] += (second[rows] * weight[rows]).sum(axis=0)
        each /= each.sum(axis=1, keepdims=True)
    return [list(map(float, row)) for row in each]


def _start() -> FloatArray:
    """What is expected of a map: mostly free cells, of which some are beside something."""
    logit = LOG_REFLECT - LOG_MISS
    total = np.zeros(len(logit))
    for mean, deviation, share in _START:
        bell = np.exp(-0.5 * ((logit - _logit(mean)) / deviation) ** 2)
        total += share * bell / bell.sum()
    return total


class _Tables:
    """Pairs of counts, and the few different hits, passes and sums among them.

    Gamma functions take most of the time, and there are a hundred times fewer counts than pairs.
    """

    def __init__(self, pairs: CountPairs) -> None:
        self.cells = pairs.cells
        self.total = float(pairs.cells.sum())
        self._hits, self._hit = np.unique(pairs.hits, return_inverse=True)
        self._passes, self._pass = np.unique(pairs.passes, return_inverse=True)
        self._sums, self._sum = np.unique(pairs.hits + pairs.passes, return_inverse=True)

    def log_beta_binomial(self, log_alpha: float, log_beta: float) -> _Quadratic:
        """Log probability of all counts, and its derivatives by log alpha and log beta."""
        from scipy.special import digamma, gammaln, zeta

        def trigamma(x: FloatArray) -> FloatArray:
            return np.asarray(zeta(2.0, x))

        alpha, beta = math.exp(log_alpha), math.exp(log_beta)
        of = []
        for function in (gammaln, digamma, trigamma):
            parts = (
                (alpha, self._hits, self._hit),
                (beta, self._passes, self._pass),
                (alpha + beta, self._sums, self._sum),
            )
            of.append(
                [
                    float((self.cells * (function(x + n) - function(np.array(x)))[which]).sum())
                    for x, n, which in parts
                ]
            )
        (hit, passed, both), (by_hit, by_pass, by_both), (bend_hit, bend_pass, bend_both) = of
        slope = (alpha * (by_hit - by_both), beta * (by_pass - by_both))
        bend = (
            slope[0] + alpha**2 * (bend_hit - bend_both),
            slope[1] + beta**2 * (bend_pass - bend_both),
            -alpha * beta * bend_both,
        )
        return hit + passed - both, slope, bend


def _with_prior(likely: _Quadratic, at: _Pair, start: _Pair, total: float) -> _Quadratic:
    """Cost per cell and its derivatives, with Gaussian priors around where parameters start."""
    value, slope, bend = likely
    off = (at[0] - start[0], at[1] - start[1])
    scale, weight = 1.0 / max(total, 1.0), 1.0 / _PRIOR_SD**2
    return (
        (0.5 * weight * (off[0] ** 2 + off[1] ** 2) - value) * scale,
        ((weight * off[0] - slope[0]) * scale, (weight * off[1] - slope[1]) * scale),
        ((weight - bend[0]) * scale, (weight - bend[1]) * scale, -bend[2] * scale),
    )


def _minimum(cost: Callable[[_Pair], _Quadratic], start: _Pair, low: float, high: float) -> _Pair:
    """Where a cost of two parameters is least, both between the same limits.

    Without an optimiser of SciPy: for two parameters its threads take far more CPU than its steps.
    """
    at, damping = start, 1e-3
    value, slope, bend = cost(at)
    for _ in range(_MOST_TRIES):
        step = _newton(slope, bend, damping, _held(at, slope, low, high))
        new = tuple(min(max(x + d, low), high) for x, d in zip(at, step, strict=True))
        moved = max(abs(new[0] - at[0]), abs(new[1] - at[1]))
        found = cost((new[0], new[1]))
        if found[0] <= value:
            at, (value, slope, bend) = (new[0], new[1]), found
            damping = max(damping / 10.0, 1e-12)
        else:
            damping *= 10.0
        if moved < _LEAST_STEP:
            break
    return at


def _held(at: _Pair, slope: _Pair, low: float, high: float) -> tuple[bool, bool]:
    """Which parameters lie at a limit and would leave it."""
    first, second = (
        (x <= low and by > 0.0) or (x >= high and by < 0.0) for x, by in zip(at, slope, strict=True)
    )
    return first, second


def _newton(
    slope: _Pair, bend: tuple[float, float, float], damping: float, held: tuple[bool, bool]
) -> _Pair:
    """A step downhill, of at most 1 along each axis."""
    (g0, g1), (a, b, c) = slope, bend
    if held[0] or held[1]:
        c = 0.0
    # As much more curvature as makes it positive whichever way one goes.
    least = 0.5 * (a + b - math.hypot(a - b, 2.0 * c))
    more = damping * max(abs(a), abs(b)) + max(0.0, -2.0 * least) + 1e-300
    a, b = a + more, b + more
    det = a * b - c * c
    steps = ((c * g1 * (not held[1]) - b * g0) / det, (c * g0 * (not held[0]) - a * g1) / det)
    longest = max(1.0, abs(steps[0]) * (not held[0]), abs(steps[1]) * (not held[1]))
    return (
        0.0 if held[0] else steps[0] / longest,
        0.0 if held[1] else steps[1] / longest,
    )


def _logit(p: float) -> float:
    return float(np.log(p) - np.log1p(-p))
