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

from oddsmap.kernels.beam_factor import (
    NAT,
    BeamRows,
    apply_messages,
    new_messages,
    sweep_in_turn,
)
from oddsmap.kernels.first_echo import Noise
from oddsmap.kernels.ising import pass_to_neighbours
from oddsmap.posterior.full_map.field import CellField
from oddsmap.posterior.full_map.settings import FullMapConfig

__all__ = ["Propagation"]

IntArray = npt.NDArray[np.int64]

# Of the old message, where all beams move at once.
_DAMPED = 0.5


class Propagation:
    """The messages of some beams, and how to renew them.

    Args:
        field: the cells' beliefs, changed in place.
        rows: the beams and their cells.
        noise: what the sensor adds.
        detection: of each cell, or one for all, shape (1,).
        config: how.
        threads: how many share a chunk.
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
        self._field, self._rows, self._noise = field, rows, noise
        self._detection, self._config = detection, config
        self._threads = threads
        self._rng = np.random.default_rng(config.seed)

    def run(self, progress: Callable[[int, float], None] | None = None) -> tuple[int, float]:
        """Sweep until messages rest, or as often as the configuration allows.

        Args:
            progress: called after each sweep with its number, from 1, and the residual.

        Returns:
            How many sweeps there were, and the residual: by how much a beam's message changed in
            the last one, on average [nats].
        """
        residual = 0.0
        for sweep in range(1, self._config.sweeps + 1):
            residual = self.sweep()
            if progress is not None:
                progress(sweep, residual)
            if residual < self._config.tolerance:
                break
        return sweep, residual

    def sweep(self) -> float:
        """Renew every message once; returns the residual."""
        order = self._rng.permutation(len(self._rows.readings))
        if self._config.schedule == "sequential":
            moved = sweep_in_turn(
                self._rows, order, self._noise, self._detection, self._field.belief, self.messages
            )
        else:
            moved = self._in_chunks(order)
        coupling = self._config.coupling_in(self._field.ndim)
        if coupling > 0.0:
            pass_to_neighbours(
                self._field.beside(), self._field.side, self._field.ndim, coupling,
                self._field.belief, self._field.told,
            )  # fmt: skip
        return moved / NAT / max(1, len(self.messages))

    def _in_chunks(self, order: IntArray) -> int:
        parallel = self._config.schedule == "parallel"
        size = max(1, len(order)) if parallel else self._config.chunk
        moved = 0
        with ThreadPoolExecutor(self._threads) as pool:
            for start in range(0, len(order), size):
                parts = np.array_split(order[start : start + size], self._threads)
                fresh = list(pool.map(self._renewed, parts))
                for part, messages in zip(parts, fresh, strict=True):
                    moved += apply_messages(
                        self._rows, part, self._field.belief, self.messages, messages,
                        _DAMPED if parallel else 0.0,
                    )  # fmt: skip
        return moved

    def _renewed(self, beams: IntArray) -> npt.NDArray[np.int32]:
        lengths = self._rows.offsets[beams + 1] - self._rows.offsets[beams]
        fresh = np.empty(int(lengths.sum()), np.int32)
        new_messages(
            self._rows, beams, self._noise, self._detection, self._field.belief, self.messages,
            fresh,
        )  # fmt: skip
        return fresh
