# SPDX-License-Identifier: Apache-2.0
"""From where message passing ends to the joint posterior: Gibbs marginals, samples, the best map.

Both go on with the factors that messages were passed along, and from the map of the cells whose
belief is above 1/2: `gibbs.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import MapTooLargeError
from oddsmap.full_map.belief_propagation import Propagation
from oddsmap.full_map.factor_graph import FactorGraph
from oddsmap.full_map.gibbs import GibbsSamples, conditional_log_odds, gibbs, hill_climb
from oddsmap.full_map.window_prior import windows_of
from oddsmap.kernels.infer.beam_factor import NAT
from oddsmap.kernels.infer.cell_status import REACHED
from oddsmap.kernels.infer.incremental_likelihood import count_bins
from oddsmap.limits import memory_limit
from oddsmap.short_repr import short_repr

__all__ = [
    "JointSamples",
    "draw_maps",
    "factor_graph",
    "log_odds_by_climbing",
    "log_odds_by_gibbs",
]


# A finite chain has no more to say than this, and a probability of 1 no finite log odds.
_LEAST = 1e-12
_DRAW = 1e-6
# Bytes of a row sorted by cell, and of a beam's bin.
_ROW, _BIN = 8, 44
# And of a cell under the window prior, with the rim.
_WINDOW = 80
# How sure a cell can be where the prior has been learnt from some worlds: others exist.
_LEARNT = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class JointSamples:
    """Maps drawn from the joint posterior: what marginals cannot say, such as which cells go along.

    Args:
        index: the observed cells, shape (n, d), x first, in the order of `FullMap.cells`.
        occupied: the maps, shape (samples, n).
        flip_rate: cells turned over in a sweep, as a share of all; near 0 a chain hardly moves,
            and its maps are much the same.
    """

    index: npt.NDArray[np.int64]
    occupied: BoolArray
    flip_rate: float

    __repr__ = short_repr


def factor_graph(work: Propagation) -> FactorGraph:
    """All cells and beams of a propagation and its prior as one posterior over maps.

    Under the window prior there are more cells than the field has, behind its own.

    Raises:
        MapTooLargeError: its tables would not fit in memory.
    """
    field, rows, config = work.field, work.rows, work.config
    needed = field.nbytes + work.nbytes + _ROW * len(rows.cells) + _BIN * count_bins(rows)
    if config.prior_model == "windows":
        needed += _WINDOW * len(field.belief)
    limit = memory_limit()
    if needed > limit:
        raise MapTooLargeError(
            f"Gibbs sampling and hill climbing over {len(rows.readings)} beams would take "
            f"{needed / 1e9:.3g} GB of memory (there are {limit / 1e9:.3g} GB): use "
            "full_map.method sum-product, a coarser resolution, or map a part of the log"
        )
    if config.prior_model == "windows":
        windows, beside = windows_of(field, rows)
        return FactorGraph(rows, work.noise, work.detection, beside, windows=windows)
    return FactorGraph(
        rows,
        work.noise,
        work.detection,
        field.neighbours(),
        np.array([field.start / NAT]),
        config.coupling_in(field.ndim),
    )


def log_odds_by_gibbs(work: Propagation) -> tuple[FloatArray, float]:
    """Log odds of the Gibbs marginals of each cell, and how far halves of the chain differ.

    Returns:
        Log odds, shape (cells,); the mean difference of p between the first and the second half
        of the counted sweeps, over the observed cells; 1 where there is no
        such thing.
    """
    config, cells = work.config, len(work.field.belief)
    found = _drawn(work, config.samples)
    if config.prior_model == "windows":
        p = np.clip(found.probability[:cells], _LEARNT, 1.0 - _LEARNT)
        p[np.bincount(work.rows.cells, minlength=cells) == 0] = config.prior_in(2)
    else:
        p = np.clip(found.probability, _LEAST, 1.0 - _LEAST)
    seen = work.field.observed == REACHED
    apart = np.abs(found.halves[0] - found.halves[1])[:cells][seen]
    drift = float(apart.mean()) if config.samples > 1 and len(apart) else 1.0
    return np.log(p) - np.log1p(-p), drift


def log_odds_by_climbing(work: Propagation) -> tuple[FloatArray, int, float]:
    """Climb to a map that no single cell improves; what each cell says there, given all others.

    Returns:
        Log odds of each cell given all others as they are in that map, shape (cells,): above 0
        exactly where it is occupied, and by how much log p(m | z) falls if the cell alone is
        turned over; sweeps; the share of cells that the last sweep turned over.
    """
    graph = factor_graph(work)
    climb = hill_climb(graph, start=work.field.belief > 0)
    odds = np.abs(conditional_log_odds(graph, climb.occupied))
    # Where both states are as good the map decides.
    odds = np.where(climb.occupied, 1.0, -1.0) * np.maximum(odds, _DRAW)
    return odds, climb.sweeps, climb.flip_rate


def draw_maps(work: Propagation, count: int, every: int) -> JointSamples:
    """Draw whole maps, `every` sweeps apart, of the cells that are noted as observed."""
    field = work.field
    found = _drawn(work, count * every, every)
    cells = np.flatnonzero(field.observed == REACHED)
    index = field.index(cells)
    order = np.lexsort(index.T)
    return JointSamples(index[order], found.samples[:, cells[order]], found.flip_rate)


def _drawn(work: Propagation, sweeps: int, every: int | None = None) -> GibbsSamples:
    graph, config = factor_graph(work), work.config
    start = np.zeros(graph.cell_count, np.bool_)
    start[: len(work.field.belief)] = work.field.belief > 0
    return gibbs(
        graph,
        sweeps=sweeps,
        burn_in=config.burn_in,
        seed=config.seed,
        start=start,
        sample_every=every,
    )
