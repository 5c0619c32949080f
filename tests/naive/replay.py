# SPDX-License-Identifier: Apache-2.0
"""Online estimation with every scan and every choice in plain lists: which is swept when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from oddsmap.forward.beam_rows import list_rows
from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel
from oddsmap.full_map.replay import Schedule
from oddsmap.kernels.infer.beam_factor import NAT, sweep_in_turn
from oddsmap.kernels.infer.ising import pass_from_blocks


@dataclass
class Plan:
    """What to sweep, in turn, when scan k has been added: numbers of scans."""

    schedule: Schedule
    seed: int
    held: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    def after(self, k: int) -> list[int]:
        """Scan k alone; the last ones; some of those held, which the one that leaves joins."""
        window = [i for i in range(k + 1) if i > k - self.schedule.window]
        leaving = k - self.schedule.window
        if leaving >= 0 and self.schedule.replay > 0:
            size = self.schedule.reservoir
            if size is None or len(self.held) < size:
                self.held.append(leaving)
            else:
                # Scan number n takes one of n + 1 places, of which `size` are in the reservoir.
                place = self.rng.integers(leaving + 1)
                if place < size:
                    self.held[place] = leaving
        old: list[int] = []
        count = min(self.schedule.replay, len(self.held))
        if count > 0:
            old = [self.held[i] for i in self.rng.choice(len(self.held), count, replace=False)]
        return [k, *window, *old]


def beliefs(
    scans: Sequence[Beams],
    model: ForwardModel,
    resolution: float,
    schedule: Schedule,
    *,
    seed: int,
    start: int,
    coupling: float,
    tolerance: float,
) -> CellField:
    """The beliefs after all scans [1 / NAT], before neighbours are told in a view."""
    cells = CellField(scans[0].ndim, start)
    plan = Plan(schedule, seed)
    noise, detection = model.noise(resolution), np.array([model.detection])
    rows, messages, changed = [], [], set[int]()

    def tell(blocks: list[int]) -> float:
        if not blocks or coupling == 0.0:
            return 0.0
        moved = pass_from_blocks(
            np.array(blocks, np.int32), cells.block_neighbours(), cells.side, cells.ndim,
            coupling, cells.belief, cells.received,
        )  # fmt: skip
        return float(moved / NAT / (len(blocks) * cells.side**cells.ndim * 2 * cells.ndim))

    for k, beams in enumerate(scans):
        known = len(cells.coords)
        rows.append(list_rows(cells, beams, model, resolution))
        messages.append(np.zeros(len(rows[k].cells), np.int32))
        new = list(range(known, len(cells.coords)))
        for _ in range(40):
            if tell(new) < tolerance:
                break
        for i in plan.after(k):
            before = messages[i].astype(np.int64)
            for beam in range(len(rows[i].readings)):
                sweep_in_turn(
                    rows[i], np.array([beam]), noise, detection, cells.belief, messages[i], 0.0
                )
            if np.abs(messages[i] - before).mean() > tolerance * NAT:
                changed |= {int(cell) // cells.side**cells.ndim for cell in rows[i].cells}
        if (k + 1) % schedule.prior_every == 0:
            tell(sorted(changed))
            changed.clear()
    return cells
