# SPDX-License-Identifier: Apache-2.0
"""Cells, beams and a prior as one posterior over maps: what Gibbs and hill climbing work on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import InputError
from oddsmap.full_map.window_prior import Windows

if TYPE_CHECKING:
    from oddsmap.kernels.infer.beam_factor import BeamRows
    from oddsmap.kernels.infer.first_echo import Noise
    from oddsmap.kernels.infer.incremental_likelihood import BeamBins, CellRows

__all__ = ["FactorGraph", "begin", "log_joint", "log_joint_in"]

State = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class FactorGraph:
    """Cells, the beams that meet them, and the prior: all that the posterior of a map is made of.

    Args:
        rows: the beams and their cells; their readings carry information.
        noise: what the sensor adds.
        detection: chance that an occupied cell wholly in the cone returns the beam, for each cell
            or one for all, shape (1,).
        neighbours: numbers of each cell's neighbours, -1 where there is none, shape (cells, 2 d); a
            pair of neighbours is listed from both sides.
        prior: log odds of a cell before its neighbours and beams are looked at, for each cell or
            one for all, shape (1,).
        coupling: J of the Ising prior exp(J [m_i = m_j]).
        windows: a prior on windows in place of `prior` and `coupling`, which then say nothing; for
            Gibbs sampling alone.

    Raises:
        InputError: shapes do not fit, or a beam meets a cell that does not exist.
    """

    rows: BeamRows
    noise: Noise
    detection: FloatArray
    neighbours: npt.NDArray[np.int32]
    prior: FloatArray = field(default_factory=lambda: np.zeros(1))
    coupling: float = 0.0
    windows: Windows | None = None

    def __post_init__(self) -> None:
        for name in ("detection", "prior"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if value.shape not in ((1,), (self.cell_count,)):
                raise InputError(
                    f"{name} is one number or one for each of {self.cell_count} cells, got shape "
                    f"{value.shape}"
                )
            object.__setattr__(self, name, value)
        met = self.rows.cells
        if len(met) and not (met.min() >= 0 and met.max() < self.cell_count):
            raise InputError(
                f"beams meet cells {met.min()} to {met.max()}, but there are {self.cell_count}"
            )

    @property
    def cell_count(self) -> int:
        """How many cells there are."""
        return len(self.neighbours)


def log_joint(graph: FactorGraph, occupied: BoolArray) -> float:
    """Log p(z, m) of a map, up to the constant of the prior: minus its energy.

    sum over beams of log p(z | m), plus the prior's log odds of the occupied cells, plus the
    coupling for each pair of equal neighbours; or what `Windows.log_prior` says.

    Raises:
        InputError: a map of another shape.
    """
    bins, _, state = begin(graph, occupied)
    return log_joint_in(graph, bins, state)


def begin(graph: FactorGraph, start: BoolArray | None) -> tuple[BeamBins, CellRows, State]:
    """What is kept of a graph's beams in a map, and the map, 1 where occupied, shape (cells,).

    Args:
        graph: the posterior.
        start: the map, shape (cells,); None: all free.

    Raises:
        InputError: a start of another shape.
    """
    from oddsmap.kernels.infer.incremental_likelihood import (
        BeamBins,
        CellRows,
        count_bins,
        list_bins,
        renew_all,
        turn_rows,
    )

    rows, cells = graph.rows, graph.cell_count
    if start is None:
        state = np.zeros(cells, np.uint8)
    elif start.shape != (cells,):
        raise InputError(f"a map of {cells} cells has shape ({cells},), got {start.shape}")
    else:
        state = start.astype(np.uint8)
    beams, count = len(rows.readings), count_bins(rows)
    bins = BeamBins(
        np.empty(beams + 1, np.int64), np.empty(count + 1, np.int64), np.empty(count, np.int32),
        np.empty(count), np.empty(beams), np.empty(count), np.empty(count), np.empty(count),
        np.empty(beams),
    )  # fmt: skip
    list_bins(rows, graph.noise, bins)
    of_cells = CellRows(
        np.empty(cells + 1, np.int64),
        np.empty(len(rows.cells), np.int32),
        np.empty(len(rows.cells), np.float32),
    )
    turn_rows(rows, bins, of_cells)
    renew_all(rows, bins, graph.detection, state)
    return bins, of_cells, state


def log_joint_in(graph: FactorGraph, bins: BeamBins, state: State) -> float:
    """`log_joint` of a map that `begin` was given, from what is kept of its beams."""
    with np.errstate(divide="ignore"):
        beams = float(np.sum(np.log(bins.likelihood)))
    if graph.windows is not None:
        return beams + graph.windows.log_prior(state)
    # Each pair of neighbours is listed twice.
    there = graph.neighbours >= 0
    equal = np.count_nonzero(there & (state[graph.neighbours] == state[:, None])) / 2
    return beams + float(np.sum(graph.prior * state)) + float(graph.coupling) * equal
