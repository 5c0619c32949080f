# SPDX-License-Identifier: Apache-2.0
"""What full-map estimation gives: a probability for every cell, and which have been observed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.config.config import Config
from oddsmap.full_map.blocks import cells_at, dense_box, listed_cells
from oddsmap.full_map.store import FullMapFields, read_full_map, save_full_map
from oddsmap.kernels.infer.cell_status import LISTED, REACHED
from oddsmap.limits import TILE_SIDE
from oddsmap.odds import sigmoid
from oddsmap.posterior.belief import Belief
from oddsmap.scans.report import Report
from oddsmap.short_repr import FEW_CELLS, counted, grid_facts, in_bytes

__all__ = ["FullMap", "load_full_map"]


# A chain is at rest where the marginals of its halves are as near to each other [probability].
_DRIFT = 0.005


class FullMap(Belief):
    """The marginals of p(m | z_1:t), all cells estimated together.

    Unknown comes from what was observed, never from the belief: the Ising prior gives cells that
    no beam has seen the opinion of their neighbours.

    Args:
        config: what it was made with.
        blocks: coordinates of blocks of cells, shape (n, d), x first, in blocks.
        values: log odds of their cells, shape (n, cells of a block), x fastest, float32.
        marks: of each cell, same shape: 2 where a beam has reached it, 1 where it lies in the cone
            of a beam before its reading but behind what is believed to stand there, else 0.
        sweeps: how many there were.
        residual: what the last one changed. "sum-product": a message, on average [nats]. "gibbs":
            by how much the marginals of both halves of the chain differ, on average [probability].
            "map": the share of cells turned over.

    Attributes:
        converged: False where the last allowed sweep still changed messages by more than the
            configured tolerance, or a cell, or where halves of a Gibbs chain differ by 0.005 or
            more. The map is usable, and less certain than it says.
        report: what was used and what was skipped, where it was estimated in this process.
        provenance: what the readings came from.
    """

    def _facts(self) -> Iterator[str]:
        bounds = self.bounds() if self.marks.size <= FEW_CELLS else None
        yield from grid_facts(self.ndim, self.resolution, self.cell_count, bounds)
        yield f"{self.method}, {counted(self.sweeps, 'sweep')}"
        if not self.converged:
            yield "not converged"
        yield f"prior {self.prior:.4g}"
        yield f"sensor {self.config.sensor.kind}"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        config: Config,
        blocks: IntArray,
        values: npt.NDArray[np.float32],
        marks: npt.NDArray[np.uint8],
        *,
        sweeps: int,
        residual: float,
    ) -> None:
        self.config = config
        self.thresholds = config.posterior.thresholds
        self.prior = config.full_map.prior_in(blocks.shape[1])
        self.blocks, self.values, self.marks = blocks, values, marks
        self.sweeps, self.residual = sweeps, residual
        self.provenance: list[dict[str, Any]] = []
        self.report: Report | None = None

    @property
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""
        return int(self.blocks.shape[1])

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.config.map.resolution

    @property
    def method(self) -> str:
        """What the values are: see `FullMapConfig.method`.

        Those of "map" are no marginals: they say by how much log p(m | z) falls if that cell alone
        is turned over.
        """
        return self.config.full_map.method

    @property
    def converged(self) -> bool:
        """Whether messages, or whatever the method moves, came to rest."""
        if self.method == "map":
            return self.residual == 0.0
        gibbs = self.method == "gibbs"
        return self.residual < (_DRIFT if gibbs else self.config.full_map.tolerance)

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self.blocks.nbytes + self.values.nbytes + self.marks.nbytes

    @property
    def prior_log_odds(self) -> float:
        """Log odds of a cell that no beam lists, as they are stored: in float32."""
        return self.config.full_map.log_odds_in(self.ndim)

    @property
    def cell_count(self) -> int:
        """How many cells have been observed."""
        return int(np.count_nonzero(self.marks == REACHED))

    @property
    def side(self) -> int:
        """Cells along a block's side."""
        return TILE_SIDE[self.ndim]

    def known_log_odds(self) -> tuple[IntArray, FloatArray]:
        """The observed cells: index, shape (n, d), x first, and log odds, shape (n,)."""
        return self._cells_from(REACHED)[:2]

    def _cells_from(self, mark: int) -> tuple[IntArray, FloatArray, npt.NDArray[np.bool_]]:
        """The cells with at least a mark: index, log odds, and whether they were reached."""
        index, block, place = listed_cells(self.blocks, self.side, self.marks >= mark)
        values = self.values[block, place].astype(np.float64)
        return index, values, self.marks[block, place] == REACHED

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of observed cells: first index and past the last, shape (d,), x first."""
        index, _ = self.known_log_odds()
        return None if len(index) == 0 else (index.min(axis=0), index.max(axis=0) + 1)

    def log_odds(self, region: Region | None = None) -> FloatArray:
        """Log odds of a region's cells; the prior's where no beam reached."""
        return self._dense(self.values, self.prior_log_odds, region)

    def log_odds_at(self, index: npt.ArrayLike) -> FloatArray:
        """Log odds of single cells, shape (n,); the prior's where no beam reached."""
        block, place = cells_at(self.blocks, self.side, index)
        if len(self.blocks) == 0:
            return np.full(len(block), self.prior_log_odds)
        return np.where(block < 0, self.prior_log_odds, self.values[block, place])

    def observed_at(self, index: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """True for single cells that a beam has seen, shape (n,)."""
        block, place = cells_at(self.blocks, self.side, index)
        if len(self.blocks) == 0:
            return np.zeros(len(block), np.bool_)
        return np.asarray((block >= 0) & (self.marks[block, place] == REACHED))

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True for the cells of a region that a beam has seen."""
        return np.asarray(self.marks_of(region) == REACHED)

    def marks_of(self, region: Region | None = None) -> npt.NDArray[np.uint8]:
        """The marks of a region's cells, as they are stored."""
        return self._dense(self.marks, 0, region).astype(np.uint8)

    def _dense(
        self, values: npt.NDArray[np.generic], fill: float, region: Region | None
    ) -> FloatArray:
        return dense_box(self.blocks, self.side, values, fill, *self._region(region))

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the map as a Zarr folder: see `oddsmap.full_map.store`."""
        fields = FullMapFields(
            self.config,
            self.blocks,
            self.values,
            self.marks,
            self.sweeps,
            self.residual,
            self.provenance,
        )
        save_full_map(fields, path, converged=self.converged, force=force)

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the cells inside cones: see `oddsmap.map_files.npz.save_npz`; there are no counts.

        Those that no beam has reached are listed with their belief, and `observed` False.
        """
        from oddsmap.map_files.npz import save_npz

        index, log_odds, observed = self._cells_from(LISTED)
        nothing = np.zeros(len(index))
        save_npz(
            Path(path),
            index=index,
            hits=nothing,
            passes=nothing,
            probability=sigmoid(log_odds).astype(np.float32),
            observed=observed,
            resolution=self.resolution,
            force=force,
        )

    def _notes(self) -> dict[str, object]:
        return {"prior": self.prior, "estimator": "full-map"}


def load_full_map(path: str | os.PathLike[str]) -> FullMap:
    """Read a map that `FullMap.save` wrote.

    Raises:
        InputError: not a full map, damaged, or of a newer format.
    """
    config, blocks, values, marks, sweeps, residual, provenance = read_full_map(path)
    full_map = FullMap(config, blocks, values, marks, sweeps=sweeps, residual=residual)
    full_map.provenance = provenance
    return full_map
