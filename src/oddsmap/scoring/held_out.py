# SPDX-License-Identifier: Apache-2.0
"""Scores of a map without ground truth: how well it predicts readings that it has not seen."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import Window
from oddsmap.forward.model import ForwardModel
from oddsmap.posterior.belief import Belief
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.scoring.marginals import Marginals
from oddsmap.scoring.reliability import BINS, Reliability
from oddsmap.sensors.base import RangingSensor
from oddsmap.sensors.registry import Sensor
from oddsmap.sensors.usable_beams import usable_beams
from oddsmap.short_repr import short_repr

__all__ = ["LogScores", "score_map"]


# Beams looked at together: as many scans as that takes.
_BATCH = 1 << 14
# Probabilities of first echoes held at a time, one per beam and range bin: 8 MB.
_BATCH_BINS = 1 << 20
# A likelihood of 0 (a no-return where p_dropout is 0 and an echo is certain) counts as this.
_LEAST = 1e-12
# Maps of one occupancy everywhere, the best of which is what a map must beat.
_CONSTANTS = np.geomspace(1e-4, 0.5, 16)


@dataclass(frozen=True, slots=True, eq=False)
class LogScores:
    """How well a map predicts the readings of a log.

    Log likelihoods are means over beams [nats]: of the density [1/m] of a reading that is finite,
    of the probability of a no-return. Only differences mean something, in nats per beam.

    Args:
        scans: how many were scored.
        beams: how many readings.
        no_returns: how many of them were no-returns.
        skipped: scans and beams that carry no information, by reason.
        log_likelihood: under the map.
        prior_log_likelihood: under the map's prior in every cell: no map at all. With wide beams
            a prior near one half is a poor start: hundreds of cells share a cone.
        constant_log_likelihood: under the best map of one occupancy in all cells, chosen among 16
            from 0.0001 to 0.5 by these very readings.
        constant: that occupancy.
        reliability: of the predicted hazards: in steps of one cell along each beam, the chance
            that the reading ends in this step, having come that far.
    """

    scans: int
    beams: int
    no_returns: int
    skipped: Counter[str]
    log_likelihood: float
    prior_log_likelihood: float
    constant_log_likelihood: float
    constant: float
    reliability: Reliability

    __repr__ = short_repr

    @property
    def ece(self) -> float:
        """Expected calibration error of beam ends, see `Reliability.ece`."""
        return self.reliability.ece

    @property
    def ece_of_bins(self) -> float:
        """The same with all bins weighing alike, see `Reliability.ece_of_bins`."""
        return self.reliability.ece_of_bins


def score_map(
    belief: Belief,
    log: Log | Iterable[Measurement],
    sensor: Sensor,
    *,
    progress: Callable[[int], None] | None = None,
) -> LogScores:
    """Score a map by readings, ideally scans that it was not made from.

    The reading of each beam is predicted from the map's marginals under the forward sensor model,
    cells that were never observed having the prior. Beams of one scan are scored one by one.

    Args:
        belief: a `FullMap`, a `LogOdds` view, or another map of probabilities.
        log: the scans to predict; memory is bounded by a few thousand of their beams.
        sensor: of the log, with range_max.
        progress: called with the number of scans done so far.

    Returns:
        The scores.

    Raises:
        InputError: no usable scan, or scans of another dimension than the map's.
        ConfigError: the sensor has no forward model or no range_max.
        MapTooLargeError: one beam would not fit in memory.
    """
    if not isinstance(sensor, RangingSensor):
        raise ConfigError(
            f"a map is scored by ranges, and a sensor of kind {sensor.kind} has no forward model "
            "of them: give the sensor of the log (sensor.kind beam or cone)"
        )
    tally = _Tally(belief, sensor.forward_model())
    skipped: Counter[str] = Counter()
    done = scan_count = 0
    for batch in _batches(log):
        beams, scans, reasons = usable_beams(batch, sensor, belief.resolution)
        skipped += reasons
        if len(beams):
            tally.add(beams)
        scan_count += scans
        done += len(batch)
        if progress is not None:
            progress(done)
    skipped += Counter(getattr(log, "skipped", {}))
    if scan_count == 0:
        reasons_of = ", ".join(f"{n} x {why}" for why, n in skipped.most_common())
        raise InputError(
            f"{getattr(log, 'path', None) or 'the scans'}: no usable scan "
            f"({reasons_of or 'there are none'}); nothing to score"
        )
    best = int(np.argmax(tally.constants))
    return LogScores(
        scans=scan_count,
        beams=tally.beams,
        no_returns=tally.no_returns,
        skipped=skipped,
        log_likelihood=tally.map / tally.beams,
        prior_log_likelihood=tally.prior / tally.beams,
        constant_log_likelihood=float(tally.constants[best]) / tally.beams,
        constant=float(_CONSTANTS[best]),
        reliability=Reliability(tally.count, tally.predicted, tally.happened),
    )


def _batches(log: Iterable[Measurement]) -> Iterator[list[Measurement]]:
    batch: list[Measurement] = []
    beams = 0
    for scan in log:
        batch.append(scan)
        beams += sum(beam.size for beam in ranges_of([scan]))
        if beams >= _BATCH:
            yield batch
            batch, beams = [], 0
    if batch:
        yield batch


@dataclass(slots=True, eq=False)
class _Tally:
    """Sums over beams."""

    belief: Belief
    model: ForwardModel
    beams: int = 0
    no_returns: int = 0
    map: float = 0.0
    prior: float = 0.0
    constants: FloatArray = field(default_factory=lambda: np.zeros(len(_CONSTANTS)))
    count: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS, np.int64))
    predicted: FloatArray = field(default_factory=lambda: np.zeros(BINS))
    happened: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS, np.int64))
    marginals: Marginals = field(init=False)

    def __post_init__(self) -> None:
        self.marginals = Marginals(self.belief)

    def add(self, beams: Beams) -> None:
        if beams.ndim != self.belief.ndim:
            raise InputError(f"the scans are {beams.ndim}D, the map is {self.belief.ndim}D")
        side = self.belief.resolution
        # The last step that is predicted ends up to a step behind the reading, and noise may
        # bring the reading there from six sigma further off.
        ahead = beams.ranges + side + self.model.sigma
        far = float(np.max(self.model.reach(ahead))) / side + 2.0
        for run, window in self.marginals.windows(beams.origins / side, far):
            some = Beams(beams.origins[run], beams.directions[run], ahead[run])
            self._add(window, some, beams.ranges[run])

    def _add(self, window: Window, ahead: Beams, ranges: FloatArray) -> None:
        """Sum up beams in a window: listed as far as `ahead` says, with other readings."""
        from oddsmap.kernels.infer.first_echo import first_echoes
        from oddsmap.kernels.infer.range_hazards import tally_hazards

        model, side = self.model, self.belief.resolution
        noise, detection = model.noise(side), np.array([model.detection])
        shape = tuple(int(n) for n in window.shape[::-1])
        for part, listed in model.cells(ahead, side, window.lo, shape):
            cells = self.marginals.number(window, listed)
            z = ranges[part]
            rows = (listed.offsets, cells, listed.bins, listed.fractions)
            self.map += self._logs(z, *rows, self.marginals.probability)
            self.prior += self._logs(z, *rows, self.marginals.prior)
            for i, p in enumerate(_CONSTANTS):
                same = (listed.offsets, np.zeros_like(cells), listed.bins, listed.fractions)
                self.constants[i] += self._logs(z, *same, np.array([p]))
            bins = model.bin_count(side)
            batch = max(1, _BATCH_BINS // bins)
            for begin in range(0, len(z), batch):
                some = slice(begin, begin + batch)
                offsets = listed.offsets[begin : begin + batch + 1]
                echo = np.zeros((len(z[some]), bins))
                first_echoes(offsets, *rows[1:], self.marginals.probability, detection, echo,
                             np.empty(len(echo)))  # fmt: skip
                tally_hazards(z[some], noise, echo, side, self.count, self.predicted,
                              self.happened)  # fmt: skip
            self.beams += len(z)
            self.no_returns += int(np.count_nonzero(z >= model.range_max))

    def _logs(
        self,
        z: FloatArray,
        offsets: npt.NDArray[np.int64],
        cells: npt.NDArray[np.int32],
        bins: npt.NDArray[np.int32],
        fractions: npt.NDArray[np.float32],
        probability: FloatArray,
    ) -> float:
        from oddsmap.kernels.infer.first_echo import likelihoods

        side = self.belief.resolution
        out = np.empty(len(z))
        detection = np.array([self.model.detection])
        likelihoods(
            z, self.model.noise(side), offsets, cells, bins, fractions, probability, detection, out
        )
        out[z < self.model.range_max] /= self.model.bin_width_at(side)
        return float(np.log(np.maximum(out, _LEAST)).sum())
