# SPDX-License-Identifier: Apache-2.0
"""Readings predicted from a map's counts without those of their own scan: exact, nothing held out.

Counts are sums over scans. So a map without one scan is the map less what the scan has added, which
mapping it by itself tells to the bit, and a scan's readings are predicted from what all others saw.
Only the fit of the view has seen the scan, one of hundreds. This does for narrow beams what
`leave_one_out` does for the messages of full maps.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence_map import build_map
from oddsmap.forward.beam_rows import list_rows
from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import NAT
from oddsmap.kernels.infer.responsibilities import LIKELIHOOD, causes
from oddsmap.kernels.units import ONE
from oddsmap.posterior.count_view import CountView
from oddsmap.scans.measurement import Measurement
from oddsmap.scoring.leave_one_out import is_listed_for
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.usable_beams import usable_beams

__all__ = ["CountsWithout", "spread_over"]

# The most beams that are predicted, spread evenly: those of about as many scans as this.
_BEAMS, _SCANS = 20_000, 100
# Log odds beyond this are the same in 32 bits of 1 / NAT each.
_MOST = 100.0


def spread_over(scans: Iterable[Measurement], count: int = _SCANS) -> list[Measurement]:
    """Between `count` and twice as many scans at equal steps, or all; read once, few in memory."""
    kept: list[Measurement] = []
    step = 1
    for number, scan in enumerate(scans):
        if number % step == 0:
            kept.append(scan)
        if len(kept) > 2 * count:
            kept, step = kept[::2], 2 * step
    return kept


class CountsWithout:
    """A map of counts, and the readings of some of its scans predicted from the others.

    Args:
        view: of a map whose evidence does not fade.
        scans: some of those that it was made of.
        sensor: that they were mapped with.
        method: likewise, "rays" or "projective".

    Raises:
        InputError: scans of 2D and 3D; or, from `settle`, a scan has added more to a cell than the
            map has there.

    Attributes:
        beams: those that carry information, at most 20,000.
        scans: how many scans have any.
        no_returns: True where a beam saw nothing, shape (beams,).
        skipped: scans and beams of these that carry no information, by reason.
    """

    def __init__(
        self,
        view: CountView,
        scans: Sequence[Measurement],
        sensor: BeamSensor,
        method: str = "rays",
    ) -> None:
        self._view = view
        self._own: list[Evidence] = []
        self._ends: list[int] = []
        self.skipped: Counter[str] = Counter()
        self.scans = total = 0
        parts = []
        most = max(1, _BEAMS // max(len(scans), 1))
        for scan in scans:
            beams, used, skipped = usable_beams([scan], sensor, view.resolution)
            self.skipped += skipped
            if not used:
                continue
            some = slice(None, None, max(1, -(-len(beams) // most)))
            parts.append(Beams(beams.origins[some], beams.directions[some], beams.ranges[some]))
            self._own.append(
                build_map(
                    [scan], view.resolution, sensor=sensor, votes=view.evidence.votes, method=method
                )
            )
            self.scans, total = self.scans + 1, total + len(parts[-1])
            self._ends.append(total)
        d = view.ndim
        self.beams = Beams(
            np.concatenate([part.origins for part in parts] or [np.empty((0, d))]),
            np.concatenate([part.directions for part in parts] or [np.empty((0, d))]),
            np.concatenate([part.ranges for part in parts] or [np.empty(0)]),
        )
        self._listed = (math.nan, math.nan)
        self.no_returns = ~np.isfinite(self.beams.ranges)

    def settle(self, model: ForwardModel, edge: float, sweeps: int) -> None:
        """Nothing has to settle: cells are listed anew where the range noise asks for it.

        Args:
            model: the sensor.
            edge: of narrow beams there is none.
            sweeps: likewise.
        """
        if is_listed_for(model, *self._listed):
            return
        field = CellField(self._view.ndim, 0)
        self._rows = list_rows(field, self.beams, model, self._view.resolution)
        self._belief = np.zeros(len(field.belief), np.int64)
        self._messages = np.empty(len(self._rows.cells), np.int32)
        for own, rows in self._scans():
            index = field.index(self._rows.cells[rows])
            log_odds = self._without(own, index)
            # The kernel takes a message out of its cell's belief, which is 0 here.
            self._messages[rows] = np.rint(-NAT * np.clip(log_odds, -_MOST, _MOST))
        self._listed = (model.cone_deg, model.sigma)

    def go_on(self, model: ForwardModel, sweeps: int) -> None:
        """As `settle`."""
        self.settle(model, 1.0, sweeps)

    def causes(self, model: ForwardModel) -> FloatArray:
        """Likelihood and causes of each beam's reading, see `kernels.infer.responsibilities`."""
        out = np.empty((len(self.beams), 4))
        causes(
            self._rows, model.noise(self._view.resolution), np.array([model.detection]),
            self._belief, self._messages, out,
        )  # fmt: skip
        return out

    def log_likelihood(self, model: ForwardModel) -> float:
        """Sum over beams of the log density [1/m] of a reading, or probability of a no-return."""
        likelihood = self.causes(model)[:, LIKELIHOOD]
        returns = np.count_nonzero(self.beams.ranges < model.range_max)
        width = model.bin_width_at(self._view.resolution)
        return float(np.log(likelihood).sum() - returns * math.log(width))

    def _scans(self) -> Iterator[tuple[Evidence, slice]]:
        """What each scan has added, and the rows of its beams."""
        offsets = self._rows.offsets
        for own, begin, end in zip(self._own, [0, *self._ends], self._ends, strict=False):
            yield own, slice(int(offsets[begin]), int(offsets[end]))

    def _without(self, own: Evidence, index: npt.NDArray[np.int64]) -> FloatArray:
        """Log odds of cells, shape (n, d), of the map without what one scan has added."""
        hits, passes = self._view.evidence.tiles.at(index)
        own_hits, own_passes = own.tiles.at(index)
        other_hits, other_passes = hits - own_hits, passes - own_passes
        if len(index) and min(int(other_hits.min()), int(other_passes.min())) < 0:
            raise InputError(
                "a scan has more votes in a cell than the map: the map was made of other scans, or "
                "with another sensor, frame or method; give the scans and the sensor that made it"
            )
        return self._view.of_votes(other_hits / ONE, other_passes / ONE, self._view.prior_at(index))
