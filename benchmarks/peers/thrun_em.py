# SPDX-License-Identifier: Apache-2.0
"""Occupancy grid maps by EM with a forward sensor model: a baseline, after Thrun (2003).

Source: Thrun, Learning occupancy grid maps with forward sensor models (Autonomous Robots 15, 2003);
the notation is the paper's. A map m is a set of occupied cells. The K_t of them in the cone of
reading z_t stand at distances d_{t,1} <= ... <= d_{t,K_t}. One of the correspondences c_t caused
the reading:

    c_{t,*}, at random:            p = p_rand                                 p(z) = 1 / z_max
    c_{t,k}, the k-th obstacle:    p = (1 - p_rand) (1 - p_hit)^(k-1) p_hit   p(z) = N(z; d_{t,k}, sigma)
    c_{t,0}, none (max range):     p = (1 - p_rand) (1 - p_hit)^K_t           p(z) = N(z; z_max, sigma)

E-step: e_t = p(c_t | z_t, m), the expectations of the correspondences.
M-step: cells are flipped one by one where this raises the expected log-likelihood

    sum_t sum_c e_{t,c} log [p(c | m) p(z_t | c, m)]  +  l_0 * (occupied cells),

until no flip does; the first map is empty. A flip changes which obstacles there are, so that the
expectations of the beams that see the cell are renewed for the map with the flip: held where they
were they would forbid every new obstacle. With `entropy` those expectations' entropy is added,
which makes the criterion log p(z_t | m) itself (Neal and Hinton, A view of the EM algorithm that
justifies incremental, sparse, and other variants, 1998).
Residual uncertainty: p(m_i = 1 | z, the rest of the map at the maximum), each cell by itself.
"""  # noqa: E501 - a table

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = ["EmMap", "thrun_em"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class EmMap:
    """What EM found.

    Args:
        occupied: the map, shape (cells,).
        probability: of each cell given the others, shape (cells,).
        sweeps: how often the cells were gone through.
        converged: whether no flip was left.
    """

    occupied: npt.NDArray[np.bool_]
    probability: FloatArray
    sweeps: int
    converged: bool


def thrun_em(
    rows: BeamRows,
    cell_count: int,
    *,
    bin_width: float,
    range_max: float,
    p_rand: float,
    p_hit: float = 0.9,
    sigma: float = 0.05,
    prior: float = 0.1,
    entropy: bool = False,
    max_sweeps: int = 50,
) -> EmMap:
    """Find a map by EM.

    Args:
        rows: beams and the cells of their cones, near to far; a cell is in a cone where at least
            half of it is.
        cell_count: how many cells there are.

    Other Args:
        bin_width: of a range bin [m]; obstacles stand in the middle of theirs.
        range_max: z_max [m]; readings at or above it are max-range ones.
        p_rand: probability of a random reading.
        p_hit: probability that an obstacle in the cone is detected.
        sigma: range noise, standard deviation [m].
        prior: p(occupied) of a cell; l_0 is its log odds.
        entropy: True: flip by the likelihood, see above.
        max_sweeps: when to stop at the latest.
    """
    inside = rows.fractions >= 0.5
    beam = np.repeat(np.arange(len(rows.readings)), np.diff(rows.offsets))[inside]
    offsets = np.searchsorted(beam, np.arange(len(rows.readings) + 1)).astype(np.int64)
    cells = rows.cells[inside].astype(np.int64)
    distances = (rows.bins[inside].astype(np.float64) + 0.5) * bin_width
    by_cell = np.argsort(cells, kind="stable")
    seen_from = np.searchsorted(cells[by_cell], np.arange(cell_count + 1)).astype(np.int64)
    readings: FloatArray = np.minimum(rows.readings, range_max)
    beams = (readings, offsets, cells, distances)
    model = (float(range_max), float(p_rand), float(p_hit), float(sigma))
    occupied = np.zeros(cell_count, np.bool_)
    log_prior = math.log(prior / (1.0 - prior))
    flips, sweeps = 1, 0
    while flips and sweeps < max_sweeps:
        flips = _sweep(*beams, seen_from, beam[by_cell], model, log_prior, entropy, occupied)
        sweeps += 1
    log_odds = np.empty(cell_count)
    _residual(*beams, seen_from, beam[by_cell], model, log_prior, occupied, log_odds)
    probability = 1.0 / (1.0 + np.exp(-np.clip(log_odds, -700.0, 700.0)))
    return EmMap(occupied, probability, sweeps, flips == 0)


@njit(cache=True)
def _score(
    z: float,
    begin: int,
    end: int,
    cells: IntArray,
    distances: FloatArray,
    model: tuple[float, float, float, float],
    occupied: npt.NDArray[np.bool_],
    entropy: bool,
) -> float:
    # Of one beam: sum_c e_c log p(z, c | m), or log p(z | m) with the entropy of e.
    z_max, p_rand, p_hit, sigma = model
    peak = 1.0 / (sigma * math.sqrt(2.0 * math.pi))
    term = p_rand / z_max
    total, weighted = term, term * math.log(term)
    missed = 1.0 - p_rand
    for i in range(begin, end):
        if occupied[cells[i]]:
            off = (z - distances[i]) / sigma
            term = missed * p_hit * peak * math.exp(-0.5 * off * off)
            missed *= 1.0 - p_hit
            if term > 1e-300:
                total += term
                weighted += term * math.log(term)
    off = (z - z_max) / sigma
    term = missed * peak * math.exp(-0.5 * off * off)
    if term > 1e-300:
        total += term
        weighted += term * math.log(term)
    return math.log(total) if entropy else weighted / total


@njit(cache=True)
def _gain(
    cell: int,
    readings: FloatArray,
    offsets: IntArray,
    cells: IntArray,
    distances: FloatArray,
    seen_from: IntArray,
    seen_by: IntArray,
    model: tuple[float, float, float, float],
    occupied: npt.NDArray[np.bool_],
    entropy: bool,
) -> float:
    # What the beams of a cell win where it is occupied; the map is left as it was.
    before = occupied[cell]
    gain = 0.0
    for n in range(seen_from[cell], seen_from[cell + 1]):
        beam = seen_by[n]
        z, begin, end = readings[beam], offsets[beam], offsets[beam + 1]
        occupied[cell] = True
        gain += _score(z, begin, end, cells, distances, model, occupied, entropy)
        occupied[cell] = False
        gain -= _score(z, begin, end, cells, distances, model, occupied, entropy)
    occupied[cell] = before
    return gain


@njit(cache=True)
def _sweep(
    readings: FloatArray,
    offsets: IntArray,
    cells: IntArray,
    distances: FloatArray,
    seen_from: IntArray,
    seen_by: IntArray,
    model: tuple[float, float, float, float],
    log_prior: float,
    entropy: bool,
    occupied: npt.NDArray[np.bool_],
) -> int:
    # Flips each cell where that raises the criterion; returns how many were.
    flips = 0
    for cell in range(occupied.shape[0]):
        if seen_from[cell] == seen_from[cell + 1]:
            continue
        gain = log_prior + _gain(
            cell, readings, offsets, cells, distances, seen_from, seen_by, model, occupied, entropy
        )
        # A draw is no reason: rounding must not flip a cell for ever.
        if abs(gain) > 1e-9 and (gain > 0.0) != occupied[cell]:
            occupied[cell] = not occupied[cell]
            flips += 1
    return flips


@njit(cache=True)
def _residual(
    readings: FloatArray,
    offsets: IntArray,
    cells: IntArray,
    distances: FloatArray,
    seen_from: IntArray,
    seen_by: IntArray,
    model: tuple[float, float, float, float],
    log_prior: float,
    occupied: npt.NDArray[np.bool_],
    out: FloatArray,
) -> None:
    # Log odds of each cell given the others.
    for cell in range(occupied.shape[0]):
        out[cell] = log_prior + _gain(
            cell, readings, offsets, cells, distances, seen_from, seen_by, model, occupied, True
        )
