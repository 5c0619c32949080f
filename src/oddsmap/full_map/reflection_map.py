# SPDX-License-Identifier: Apache-2.0
"""What reflection estimation gives: a Beta distribution for every cell that beams have reached."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.config.config import Config
from oddsmap.full_map.blocks import cells_at, dense_box, listed_cells
from oddsmap.posterior.reflectivity import BetaView, IntervalKind
from oddsmap.scans.report import Report
from oddsmap.short_repr import FEW_CELLS, grid_facts

__all__ = ["REST", "ReflectionMap"]

REST = 1e-4
"""Sweeps end once the mean of a cell changes by less than this, on average."""


class ReflectionMap(BetaView):
    """p(reflectivity | z_1:t) of each cell that beams have reached, from the forward model.

    Values are those of `BetaView`: mean, mode, standard deviation, credible interval and more.

    Args:
        config: what it was made with: resolution and sensor.
        blocks: coordinates of blocks of cells, shape (n, d), x first, in blocks.
        alpha: of their cells, shape (n, cells of a block), x fastest.
        beta: likewise.
        reached: True where a beam has reached the cell, same shape.

    Other Args:
        a: the prior's weight of hits [votes].
        b: its weight of passes [votes].
        threshold: and the others as in `BetaView`; they may be set later, too.
        level: see there.
        kind: see there. "highest-density" by default: reflectivities are often near 0 or 1, where
            an equal-tailed interval leaves out the most probable end.
        sweeps: how many there were.
        residual: by how much the mean of a cell changed in the last one, on average; 0 for "adf",
            which makes one alone.

    Attributes:
        report: what was used and what was skipped.
        provenance: what the readings came from.
    """

    def _facts(self) -> Iterator[str]:
        bounds = self.bounds() if self.reached.size <= FEW_CELLS else None
        reached = int(np.count_nonzero(self.reached))
        yield from grid_facts(self.ndim, self.resolution, reached, bounds)
        yield from self._settings_facts()
        if not self.converged:
            yield "not converged"

    def __init__(
        self,
        config: Config,
        blocks: IntArray,
        alpha: FloatArray,
        beta: FloatArray,
        reached: npt.NDArray[np.bool_],
        *,
        a: float,
        b: float,
        threshold: float = 0.5,
        level: float = 0.95,
        kind: IntervalKind = "highest-density",
        sweeps: int = 1,
        residual: float = 0.0,
    ) -> None:
        super().__init__(a=a, b=b, threshold=threshold, level=level, kind=kind)
        self.config, self.blocks, self.reached = config, blocks, reached
        self.alpha, self.beta = alpha, beta
        self.sweeps, self.residual = sweeps, residual
        self.report = Report()
        self.provenance: list[dict[str, Any]] = []

    @property
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""
        return int(self.blocks.shape[1])

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.config.map.resolution

    @property
    def side(self) -> int:
        """Cells along a block's side."""
        return 32 if self.ndim == 2 else 8

    @property
    def converged(self) -> bool:
        """Whether means came to rest; if not, the map is usable, but less certain than it says."""
        return self.residual < REST

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of cells that were reached: first index and past the last, shape (d,)."""
        index, _, _ = listed_cells(self.blocks, self.side, self.reached)
        return None if len(index) == 0 else (index.min(axis=0), index.max(axis=0) + 1)

    def parameters(self, region: Region | None = None) -> tuple[FloatArray, FloatArray]:
        """Alpha and beta of a region's cells; a and b where no beam came."""
        box = self._region(region)
        return (
            dense_box(self.blocks, self.side, self.alpha, self.a, *box),
            dense_box(self.blocks, self.side, self.beta, self.b, *box),
        )

    def parameters_at(
        self, index: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Alpha and beta of single cells, and whether a beam has reached them."""
        block, place = cells_at(self.blocks, self.side, index)
        nowhere = block < 0
        if len(self.blocks) == 0:
            return np.full(len(block), self.a), np.full(len(block), self.b), ~nowhere
        return (
            np.where(nowhere, self.a, self.alpha[block, place]),
            np.where(nowhere, self.b, self.beta[block, place]),
            ~nowhere & self.reached[block, place],
        )

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True where a beam has reached a region's cells, as far as is known of those before."""
        box = self._region(region)
        return dense_box(self.blocks, self.side, self.reached, 0.0, *box) > 0.0

    def cells(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The cells that were reached: index, shape (n, d), x first, alpha and beta, shape (n,)."""
        index, block, place = listed_cells(self.blocks, self.side, self.reached)
        return index, self.alpha[block, place], self.beta[block, place]

    def _counts(self) -> tuple[FloatArray, FloatArray]:
        # A surprise may leave a cell with less weight than the prior's: that is no count.
        _, alpha, beta = self.cells()
        return np.maximum(alpha - self.a, 0.0), np.maximum(beta - self.b, 0.0)
