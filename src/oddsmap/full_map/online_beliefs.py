# SPDX-License-Identifier: Apache-2.0
"""The beliefs of an online estimator, and how a scan changes them.

    beams -> list_rows            # forward/beam_rows.py: their cells
          -> settle_new_blocks    # online_prior.py: what is believed where nothing was seen
          -> sweep                # first messages, from the beliefs as they are
          -> sweep the window     # the last scans once more, oldest first
          -> sweep old scans      # replay.py: some of a reservoir, drawn at random
          -> tell_neighbours      # online_prior.py: now and then, where beliefs have changed

The first sweep alone is assumed-density filtering: the exact inverse sensor model of a beam, given
what is believed about its other cells. Sweeping scans again mends what was believed too early; the
messages of a scan that is let go stay in the beliefs for good.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import MapTooLargeError
from oddsmap.forward.beam_rows import list_rows, note_observed
from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel
from oddsmap.full_map.online_prior import settle_new_blocks, tell_neighbours
from oddsmap.full_map.replay import KeptScan, Reservoir, Schedule
from oddsmap.kernels.infer.beam_factor import NAT, sweep_in_turn
from oddsmap.limits import memory_limit

__all__ = ["OnlineBeliefs"]


class OnlineBeliefs:
    """Cells, and the scans whose messages to them may still be renewed.

    Args:
        ndim: 2 or 3.
        model: of the sensor.
        resolution: side of a cell [m].
        settings: prior, coupling, tolerance and seed.
        schedule: which scans are swept when.

    Attributes:
        residual: by how much messages changed when scans were last swept [nats].
        window: the last scans, oldest first.
        reservoir: older ones.
    """

    def __init__(
        self,
        ndim: int,
        model: ForwardModel,
        resolution: float,
        settings: FullMapConfig,
        schedule: Schedule,
    ) -> None:
        prior = settings.prior_in(ndim)
        self.residual = math.inf
        self.window: deque[KeptScan] = deque()
        self.reservoir = Reservoir(schedule.reservoir, settings.seed)
        self._field = CellField(ndim, round(math.log(prior / (1.0 - prior)) * NAT))
        self._model, self._resolution, self._schedule = model, resolution, schedule
        self._coupling, self._tolerance = settings.coupling_in(ndim), settings.tolerance
        self._noise, self._detection = model.noise(resolution), np.array([model.detection])
        # Blocks where beliefs have changed since neighbours were told.
        self._changed: list[npt.NDArray[np.int32]] = []
        self._since_prior = 0

    @property
    def ndim(self) -> int:
        """2 or 3."""
        return self._field.ndim

    @property
    def window_nbytes(self) -> int:
        """Bytes that the beams of the last scans take."""
        return sum(scan.nbytes for scan in self.window)

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use: beliefs, and beams of the scans that are kept."""
        return self._field.nbytes + self.window_nbytes + self.reservoir.nbytes

    def add(self, beams: Beams) -> None:
        """Take in the beams of one scan.

        Raises:
            MapTooLargeError: memory would not hold them, or a beam is too long.
        """
        newest = self._list(beams)
        self.residual = self._sweep([newest])
        self.window.append(newest)
        while len(self.window) > self._schedule.window:
            leaving = self.window.popleft()
            self._note_observed(self._field, leaving)
            if self._schedule.replay > 0:
                self.reservoir.offer(leaving)
        again = [*self.window, *self.reservoir.draw(self._schedule.replay)]
        if again:
            self.residual = self._sweep(again)
        self._since_prior += 1
        if self._since_prior >= self._schedule.prior_every:
            self._tell_neighbours(self._field)
            self._changed.clear()
            self._since_prior = 0

    def as_of_now(self) -> CellField:
        """A copy in which neighbours were told, and the cells of the last scans count as seen."""
        field = self._field.copy()
        self._tell_neighbours(field)
        for scan in self.window:
            self._note_observed(field, scan)
        return field

    def _list(self, beams: Beams) -> KeptScan:
        """The cells of a scan's beams; where the map grows, its new cells get their prior."""
        field = self._field
        known = len(field.coords)
        rows = list_rows(field, beams, self._model, self._resolution)
        settle_new_blocks(field, known, self._coupling, self._tolerance)
        there = np.zeros(len(field.coords), np.bool_)
        there[rows.cells // field.block_cells] = True
        blocks = np.flatnonzero(there).astype(np.int32)
        scan = KeptScan(rows, np.zeros(len(rows.cells), np.int32), blocks)
        needed, limit = self.nbytes + scan.nbytes, memory_limit()
        if needed > limit:
            raise MapTooLargeError(
                f"the online map and {len(self.reservoir.scans):,} old scans would take "
                f"{needed / 1e9:.3g} GB of memory (there are {limit / 1e9:.3g} GB): keep fewer of "
                "them (reservoir), or use a coarser resolution"
            )
        return scan

    def _sweep(self, scans: Sequence[KeptScan]) -> float:
        """Renew all messages of some scans once; returns their mean change [nats]."""
        moved, count = 0, 0
        for scan in scans:
            change = sweep_in_turn(
                scan.rows, np.arange(len(scan.rows.readings)), self._noise, self._detection,
                self._field.belief, scan.messages, 0.0,
            )  # fmt: skip
            # Where an old scan rests its neighbours do: telling them costs more than it.
            if change > self._tolerance * NAT * len(scan.messages):
                self._changed.append(scan.blocks)
            moved += change
            count += len(scan.messages)
        return moved / NAT / max(1, count)

    def _note_observed(self, field: CellField, scan: KeptScan) -> None:
        note_observed(field, scan.rows, self._model, self._resolution, self._detection)

    def _tell_neighbours(self, field: CellField) -> None:
        if self._changed:
            tell_neighbours(field, np.unique(np.concatenate(self._changed)), self._coupling)
