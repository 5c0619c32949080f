# SPDX-License-Identifier: Apache-2.0
"""Loopy belief propagation between beams and cells: sweeps until the messages rest.

One sweep renews the message of every beam to each of its cells, and then those between
neighbouring cells once. Whoever renews a message takes the old one out of the belief first: a
reading counts once, however many sweeps there are. Thread count changes no bit: messages of a chunk
of beams are computed from the same beliefs, wherever, and put in place in order.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.cell_grid import CellField
from oddsmap.kernels.infer.beam_factor import (
    NAT,
    BeamRows,
    apply_messages,
    new_messages,
    sweep_in_turn,
)
from oddsmap.kernels.infer.first_echo import Noise
from oddsmap.kernels.infer.ising import pass_to_neighbours

__all__ = ["Propagation"]


# Of the old message, where all beams move at once or messages are to settle.
_DAMPED = 0.5
# Where readings contradict each other (things that moved, poses that are off) a few messages would
# swing forever; from the sweep after this on they keep half of what they were, and settle.
_FREE_SWEEPS = 10
# Beams of a chunk do not know about each other. In a short log 512 are many that share their cells,
# and they would overshoot together forever: no more than this share of the beams.
_LARGEST_SHARE = 1 / 64
# Fewer beams of a chunk are not worth sharing among threads.
_MIN_SHARED = 64


class Propagation:
    """The messages of some beams, and how to renew them.

    Args:
        field: the cells' beliefs, changed in place.
        rows: the beams and their cells.
        noise: what the sensor adds.
        detection: of each cell, or one for all, shape (1,).
        config: how.
        threads: how many share a chunk.

    Attributes:
        messages: of each row [1 / NAT], shape (rows,).
    """

    def __init__(
        self,
        field: CellField,
        rows: BeamRows,
        noise: Noise,
        detection: npt.NDArray[np.float64],
        config: FullMapConfig,
        threads: int = 1,
    ) -> None:
        self.messages = np.zeros(len(rows.cells), np.int32)
        self.field, self.rows, self.noise = field, rows, noise
        self.detection, self.config = detection, config
        self._threads = threads
        self._rng = np.random.default_rng(config.seed)

    @property
    def nbytes(self) -> int:
        """Bytes of the beams and their messages."""
        return self.messages.nbytes + sum(array.nbytes for array in self.rows)

    def run(self, progress: Callable[[int, float], None] | None = None) -> tuple[int, float]:
        """Sweep until messages rest, or as often as the configuration allows.

        Args:
            progress: called after each sweep with its number, from 1, and the residual.

        Returns:
            How many sweeps there were, and the residual: by how much a message changed in the
            last one, on average [nats]. Beams' messages and those between neighbours are averaged
            apart, and the larger of the two counts: before neighbours have agreed that unseen
            cells are free, long cones of cells of a half say next to nothing, and seem at rest.
        """
        residual = 0.0
        for sweep in range(1, self.config.sweeps + 1):
            residual = self.sweep(settling=sweep > _FREE_SWEEPS)
            if progress is not None:
                progress(sweep, residual)
            if residual < self.config.tolerance:
                break
        return sweep, residual

    def sweep(self, *, settling: bool = False) -> float:
        """Renew every message once; returns the residual.

        Args:
            settling: keep half of each old message.
        """
        keep = _DAMPED if settling or self.config.schedule == "parallel" else 0.0
        order = self._rng.permutation(len(self.rows.readings))
        if self.config.schedule == "sequential":
            moved = sweep_in_turn(
                self.rows, order, self.noise, self.detection, self.field.belief, self.messages, keep
            )
        else:
            moved = self._in_chunks(order, keep)
        sent = 0
        coupling = self.config.coupling_in(self.field.ndim)
        if coupling > 0.0:
            sent = pass_to_neighbours(
                self.field.block_neighbours(), self.field.side, self.field.ndim, coupling,
                self.field.belief, self.field.received,
            )  # fmt: skip
        # A damped step is half as long as the message is off.
        off = moved / (1.0 - keep)
        return max(
            off / NAT / max(1, len(self.messages)),
            sent / NAT / max(1, self.field.received.size),
        )

    def _in_chunks(self, order: IntArray, keep: float) -> int:
        size = max(1, len(order))
        if self.config.schedule == "chunks":
            size = max(1, min(self.config.chunk, int(len(order) * _LARGEST_SHARE)))
        moved = 0
        with ThreadPoolExecutor(self._threads) as pool:
            for start in range(0, len(order), size):
                chunk = order[start : start + size]
                # Chunks of a short log are done in less time than it takes to wake a thread.
                alone = self._threads == 1 or len(chunk) < _MIN_SHARED
                parts = [chunk] if alone else np.array_split(chunk, self._threads)
                new = list(map(self._renewed, parts) if alone else pool.map(self._renewed, parts))
                for part, messages in zip(parts, new, strict=True):
                    moved += apply_messages(
                        self.rows, part, self.field.belief, self.messages, messages, keep
                    )
        return moved

    def _renewed(self, beams: IntArray) -> npt.NDArray[np.int32]:
        lengths = self.rows.offsets[beams + 1] - self.rows.offsets[beams]
        new = np.empty(int(lengths.sum()), np.int32)
        new_messages(
            self.rows, beams, self.noise, self.detection, self.field.belief, self.messages,
            new,
        )  # fmt: skip
        return new
