# SPDX-License-Identifier: Apache-2.0
"""Models of counts, fitted to a map's own hits and passes.

Evidence is maximised: the parameters are those under which the counts of all known cells are most
probable. Nothing is held out, and no truth is needed. Weak priors, worth as much as a few cells,
keep parameters that the counts say nothing of where they are for most maps.

Source: Minka, Estimating a Dirichlet distribution (2000), for the likelihood of beta-binomial
counts. The optimiser is L-BFGS-B (Byrd, Lu, Nocedal, Zhu 1995) on exact gradients: iterating
Minka's fixed points takes ten times as long, and Newton's steps can leave the domain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.posterior.cell_classes import CellClasses
from oddsmap.posterior.count_pairs import CountPairs

__all__ = ["CONCENTRATIONS", "fit_beta", "fit_classes"]

CONCENTRATIONS = (3.0, 4.0, 5.0)
"""a + b of free cells, free cells beside something, and occupied ones. They are not fitted: counts
hardly tell them, and free ones made worse maps on simulated worlds whose truth is known."""

# Where parameters start, and what counts that say nothing leave them at.
_MEANS, _SHARES = (0.002, 0.1, 0.6), (0.9, 0.05, 0.05)
_MEAN_LIMITS = ((1e-6, 0.2), (1e-6, 0.4), (0.3, 0.99))
_LOG_SHARE_LIMITS = (-12.0, 4.0)  # relative to that of free cells
_BETA = (0.02, 1.0)
_BETA_LIMITS = (1e-4, 1e3)
# Standard deviation of the priors of logits and logarithms.
_PRIOR_SD = 1.5


def fit_beta(pairs: CountPairs) -> tuple[float, float]:
    """The Beta prior of reflectivity under which counts are most probable.

    Args:
        pairs: the counts of a map.

    Returns:
        Weights of hits and of passes [votes].
    """
    table = _Tables(pairs)
    start = np.log(_BETA)

    def cost(logs: FloatArray) -> tuple[float, FloatArray]:
        alpha, beta = np.exp(logs)
        log_p, by_alpha, by_beta = table.log_beta_binomial(alpha, beta)
        value = float(table.cells @ log_p)
        slope = np.array([table.cells @ by_alpha * alpha, table.cells @ by_beta * beta])
        return _with_prior(value, slope, logs, start, table.total)

    low, high = np.log(_BETA_LIMITS)
    alpha, beta = np.exp(_minimum(cost, start, [(low, high)] * 2))
    return float(alpha), float(beta)


def fit_classes(pairs: CountPairs) -> CellClasses:
    """The kinds of cells under which counts are most probable.

    Args:
        pairs: the counts of a map.
    """
    table = _Tables(pairs)
    means, shares = np.array(_MEANS), np.array(_SHARES)
    start = np.concatenate([_logit(means), np.log(shares[1:] / shares[0])])
    limits = [tuple(_logit(np.array(limit))) for limit in _MEAN_LIMITS]

    def cost(parameters: FloatArray) -> tuple[float, FloatArray]:
        mean, log_share = _mean(parameters[:3]), _log_shares(parameters[3:])
        log_p, slopes = [], []
        for m, total in zip(mean, CONCENTRATIONS, strict=True):
            each, by_alpha, by_beta = table.log_beta_binomial(m * total, (1.0 - m) * total)
            log_p.append(each)
            slopes.append((by_alpha - by_beta) * (total * m * (1.0 - m)))
        joint = log_share[:, None] + np.stack(log_p)
        whole = np.logaddexp.reduce(joint, axis=0)
        kind = np.exp(joint - whole) * table.cells  # whose cells they are
        of_shares = kind.sum(axis=1) - np.exp(log_share) * table.total
        slope = np.concatenate([(kind * np.stack(slopes)).sum(axis=1), of_shares[1:]])
        return _with_prior(float(table.cells @ whole), slope, parameters, start, table.total)

    found = _minimum(cost, start, [*limits, _LOG_SHARE_LIMITS, _LOG_SHARE_LIMITS])
    mean, share = _mean(found[:3]).tolist(), np.exp(_log_shares(found[3:])).tolist()
    return CellClasses(tuple(mean), CONCENTRATIONS, tuple(share))


_OfArray = Callable[[FloatArray], FloatArray]


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


def _mean(logits: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(-logits)))


def _logit(p: FloatArray) -> FloatArray:
    return np.asarray(np.log(p) - np.log1p(-p))


def _log_shares(relative: FloatArray) -> FloatArray:
    logs = np.concatenate([[0.0], relative])
    return np.asarray(logs - np.logaddexp.reduce(logs))
