# SPDX-License-Identifier: Apache-2.0
"""Models of counts, fitted to a map's own hits and passes.

Evidence is maximised: the parameters are those under which the counts of all known cells are most
probable. Nothing is held out, and no truth is needed. Weak priors, worth as much as a few cells,
keep parameters that the counts say nothing of where they are for most maps. Sums go over arrays in
one order and without BLAS, whose threads may change the last digit.

Source: Minka, Estimating a Dirichlet distribution (2000), for the likelihood of beta-binomial
counts. Its optimiser is L-BFGS-B (Byrd, Lu, Nocedal, Zhu 1995) on exact gradients: iterating
Minka's fixed points takes ten times as long, and Newton's steps can leave the domain.
"""

from __future__ import annotations

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


def fit_beta(pairs: CountPairs, expected: tuple[float, float] = BETA) -> tuple[float, float]:
    """The Beta prior of reflectivity under which counts are most probable.

    Args:
        pairs: the counts of a map.
        expected: where parameters start, and stay if there are no counts.

    Returns:
        Weights of hits and of passes [votes].
    """
    table = _Tables(pairs)
    start = np.log(expected)

    def cost(logs: FloatArray) -> tuple[float, FloatArray]:
        alpha, beta = np.exp(logs)
        log_p, by_alpha, by_beta = table.log_beta_binomial(alpha, beta)
        value = float((table.cells * log_p).sum())
        slope = np.array(
            [(table.cells * by_alpha).sum() * alpha, (table.cells * by_beta).sum() * beta]
        )
        return _with_prior(value, slope, logs, start, table.total)

    low, high = np.log(_BETA_LIMITS)
    alpha, beta = np.exp(_minimum(cost, start, [(low, high)] * 2))
    return float(alpha), float(beta)


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

    def log_beta_binomial(
        self, alpha: float, beta: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log probability of each pair, and its derivatives by alpha and beta."""
        from scipy.special import digamma, gammaln

        def rise(
            function: Callable[[FloatArray], FloatArray], first: float, n: FloatArray
        ) -> FloatArray:
            return np.asarray(function(first + n) - function(np.array(first)))

        total = alpha + beta
        of_sum = rise(gammaln, total, self._sums)[self._sum]
        log_p = rise(gammaln, alpha, self._hits)[self._hit] - of_sum
        log_p += rise(gammaln, beta, self._passes)[self._pass]
        common = rise(digamma, total, self._sums)[self._sum]
        by_alpha = rise(digamma, alpha, self._hits)[self._hit] - common
        by_beta = rise(digamma, beta, self._passes)[self._pass] - common
        return log_p, by_alpha, by_beta


def _with_prior(
    value: float, slope: FloatArray, at: FloatArray, start: FloatArray, total: float
) -> tuple[float, FloatArray]:
    """Cost per cell and its gradient, with the Gaussian priors around where parameters start."""
    off = (at - start) / _PRIOR_SD
    scale = 1.0 / max(total, 1.0)
    return (0.5 * float(off @ off) - value) * scale, (off / _PRIOR_SD - slope) * scale


def _minimum(
    cost: Callable[[FloatArray], tuple[float, FloatArray]],
    start: FloatArray,
    limits: list[tuple[float, float]],
) -> FloatArray:
    from scipy.optimize import minimize

    options = {"ftol": 1e-12, "gtol": 1e-9, "maxiter": 1000}
    found = minimize(cost, start, jac=True, bounds=limits, method="L-BFGS-B", options=options)
    return np.asarray(found.x, np.float64)


def _logit(p: float) -> float:
    return float(np.log(p) - np.log1p(-p))
