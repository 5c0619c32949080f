# SPDX-License-Identifier: Apache-2.0
"""Gibbs sampling and hill climbing over maps: the reference, and the most probable map.

Both work on the same factors as message passing: the beams' forward model and a prior on pairs of
neighbours. Gibbs sampling, which also knows a prior on windows, is exact in the limit of many
sweeps and gives whole maps drawn from the joint posterior. Hill climbing ends in a map that no
single cell can improve.

Source: Geman and Geman, Stochastic relaxation, Gibbs distributions, and the Bayesian restoration of
images (1984); Besag, On the statistical analysis of dirty pictures (1986); Thrun, Burgard, Fox:
Probabilistic Robotics (2005), section 9.4 and table 9.3 (hill climbing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import ConfigError
from oddsmap.full_map.factor_graph import FactorGraph, begin, log_joint_in
from oddsmap.full_map.gibbs_chains import chain_of

__all__ = [
    "Climb",
    "GibbsSamples",
    "conditional_log_odds",
    "gibbs",
    "hill_climb",
]


@dataclass(frozen=True, slots=True, eq=False)
class GibbsSamples:
    """What Gibbs sampling found.

    Args:
        probability: marginal p(occupied | z_1:t), the mean of each cell's probabilities given the
            others (Rao-Blackwellised), shape (cells,).
        samples: maps drawn from the joint posterior, shape (samples, cells).
        flip_rate: cells turned over in a sweep, as a share of all; near 0 a chain hardly moves.
        halves: the same mean over the first and over the second half of the sweeps, shape
            (2, cells): half their difference is about the error that is due to chance. Of one
            sweep there is no first half, and it is NaN.
    """

    probability: FloatArray
    samples: BoolArray
    flip_rate: float
    halves: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Climb:
    """Where hill climbing ended.

    Args:
        occupied: the map, shape (cells,).
        log_joint: log p(z, m) up to the prior's constant, see `log_joint`; minus the energy.
        sweeps: how many were made.
        flip_rate: cells that the last sweep turned over, as a share of all.
    """

    occupied: BoolArray
    log_joint: float
    sweeps: int
    flip_rate: float

    @property
    def converged(self) -> bool:
        """True where no single cell could raise it further."""
        return self.flip_rate == 0.0


def gibbs(
    graph: FactorGraph,
    *,
    sweeps: int = 100,
    burn_in: int = 20,
    seed: int = 0,
    start: BoolArray | None = None,
    sample_every: int | None = None,
) -> GibbsSamples:
    """Draw maps from the posterior, one cell at a time; the same seed gives the same maps.

    Args:
        graph: the posterior.

    Other Args:
        sweeps: how often each cell is drawn and counted.
        burn_in: sweeps before that, which are forgotten.
        seed: of the random numbers.
        start: the map to start from, shape (cells,); None: all free. From a good one (where the
            belief of message passing is above 1/2) a short burn-in is enough.
        sample_every: keep every n-th map of the counted sweeps; None: keep none.

    Raises:
        ConfigError: no sweep, or a negative number of them.
        InputError: a start of another shape.
    """
    if sweeps < 1 or burn_in < 0 or (sample_every is not None and sample_every < 1):
        raise ConfigError(
            "Gibbs sampling takes sweeps >= 1, burn_in >= 0 and sample_every >= 1, got "
            f"{sweeps}, {burn_in} and {sample_every}"
        )
    chain = chain_of(graph, start, seed)
    total, before = np.zeros((2, graph.cell_count))
    half = np.float64(sweeps // 2)
    kept: list[BoolArray] = []
    flips = 0
    for sweep in range(-burn_in, sweeps):
        if sweep == 0:
            if burn_in > 0:
                chain.settle(total / burn_in)
            total[:] = 0.0
            flips = 0
        if sweep == half:
            before[:] = total
        flips += chain.sweep(total)
        if sample_every is not None and sweep >= 0 and (sweep + 1) % sample_every == 0:
            kept.append(chain.state == 1)
    samples = np.stack(kept) if kept else np.empty((0, graph.cell_count), np.bool_)
    with np.errstate(invalid="ignore"):
        halves = np.stack([before / half, (total - before) / (sweeps - half)])
    flip_rate = flips / sweeps / max(1, graph.cell_count)
    return GibbsSamples(total / sweeps, samples, flip_rate, halves)


def hill_climb(
    graph: FactorGraph, *, start: BoolArray | None = None, max_sweeps: int = 100
) -> Climb:
    """Climb to a local maximum of the posterior over maps, one cell at a time.

    Args:
        graph: the posterior.

    Other Args:
        start: the map to start from, shape (cells,); None: all free, as in table 9.3. Where the
            climb ends depends on it: from a belief above 1/2 it ends higher.
        max_sweeps: when to stop at the latest.

    Raises:
        ConfigError: no sweep, or a prior on windows.
        InputError: a start of another shape.
    """
    from oddsmap.kernels.infer.cell_flips import climb_sweep

    _refuse_windows(graph, "the steps of hill climbing")
    if max_sweeps < 1:
        raise ConfigError(f"hill climbing takes max_sweeps >= 1, got {max_sweeps}")
    bins, of_cells, state = begin(graph, start)
    done, flips = 0, 1
    while flips and done < max_sweeps:
        flips = climb_sweep(
            graph.rows, bins, of_cells, graph.detection, graph.neighbours, graph.prior,
            float(graph.coupling), state,
        )  # fmt: skip
        done += 1
    flip_rate = flips / max(1, graph.cell_count)
    return Climb(state == 1, log_joint_in(graph, bins, state), done, flip_rate)


def conditional_log_odds(graph: FactorGraph, occupied: BoolArray) -> FloatArray:
    """Log odds of each cell given all others as they are in a map, shape (cells,).

    Raises:
        ConfigError: a prior on windows.
        InputError: a map of another shape.
    """
    from oddsmap.kernels.infer.cell_flips import conditional

    _refuse_windows(graph, "conditional log odds")
    bins, of_cells, state = begin(graph, occupied)
    odds = np.empty(graph.cell_count)
    conditional(
        bins, of_cells, graph.detection, graph.neighbours, graph.prior, float(graph.coupling),
        state, odds,
    )  # fmt: skip
    return odds


def _refuse_windows(graph: FactorGraph, what: str) -> None:
    if graph.windows is not None:
        raise ConfigError(
            f"{what} know the prior on pairs of neighbours alone, and this graph has one on "
            "windows: draw from it by `gibbs`"
        )
