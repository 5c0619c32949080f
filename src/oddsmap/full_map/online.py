# SPDX-License-Identifier: Apache-2.0
"""The whole map while the robot drives: beams are looked at a few times, and then let go.

    scan -> list_rows            # forward/beam_rows.py: the cells of its beams
         -> sweep                # first messages, from the beliefs as they are
         -> sweep the window     # the last scans once more, oldest first
         -> tell neighbours      # now and then, where beliefs have changed

The first of these alone is assumed-density filtering: the exact inverse sensor model of a beam,
given what is believed about its other cells. Sweeping the last scans again mends what was believed
too early. The message of a scan that leaves the window stays in the beliefs for good.

Sources: Minka, Expectation propagation for approximate Bayesian inference (2001), section 3.1, for
assumed-density filtering; Kaufman et al., exact inverse sensor model (2016).
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map.collector import ranging_sensor
from oddsmap.full_map.full_map import FullMap
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.scans.scan import Scan
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import settings_of
from oddsmap.sensors.usable_beams import usable_beams
from oddsmap.short_repr import counted, described, in_bytes
from oddsmap.warm_up import warm_up

if TYPE_CHECKING:
    from oddsmap.forward.beams import Beams
    from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = ["OnlineFullMap"]


@dataclass(frozen=True, slots=True, eq=False)
class _Recent:
    """A scan whose messages may still be renewed."""

    rows: BeamRows
    order: npt.NDArray[np.int64]
    messages: npt.NDArray[np.int32]
    blocks: npt.NDArray[np.int32]
    """Numbers of the blocks that its cells are in."""


class OnlineFullMap:
    """A full map that takes one scan after the other, in a time that does not grow with the map.

    Beams are kept for the last `window` scans only. The order of scans matters, as it does to
    any estimator that forgets them: the same scans in the same order give the same bits, in one
    call of `add_scans` or in many.

    Args:
        config: resolution, sensor, and of `full_map` the prior and the coupling; what it says of
            sweeps and schedules is for the batch estimator.

    Other Args:
        window: how many scans, the new one among them, are swept once more when one is added.
            0: each beam is looked at once.
        prior_every: messages go to neighbours each time this many usable scans were added. At
            half the window the sonar benchmark gives the log loss of 1, at a third less time.

    Attributes:
        report: what was used and what was skipped so far, and the times.

    Raises:
        ConfigError: the sensor has no forward model, a parameter is outside its range, or a
            setting of the filter is set.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield f"cells of {self.config.map.resolution:g} m, sensor {self.config.sensor.kind}"
        yield f"{counted(self.report.scans, 'scan')}, {counted(self.report.beams, 'beam')}"
        yield f"window of {counted(self._window, 'scan')}"
        yield in_bytes(self.nbytes)

    def __init__(self, config: Config, *, window: int = 10, prior_every: int = 5) -> None:
        sensor = ranging_sensor(config)
        for name, value, min_value in (("window", window, 0), ("prior_every", prior_every, 1)):
            if value < min_value:
                raise ConfigError(f"{name}: at least {min_value} is needed, got {value}")
        if config.full_map.method != "sum-product":
            raise ConfigError(
                f"full_map.method {config.full_map.method} needs all beams at once: online there "
                "is sum-product alone; use build_full_map"
            )
        self.config = config
        self.report = Report()
        self._sensor = sensor
        self._model = sensor.forward_model()
        self._window, self._prior_every = window, prior_every
        self._noise = self._model.noise(config.map.resolution)
        self._detection = np.array([self._model.detection])
        self._field: CellField | None = None
        self._recent: deque[_Recent] = deque()
        self._changed: list[npt.NDArray[np.int32]] = []
        self._since_prior = 0
        self._residual = math.inf

    @property
    def window_nbytes(self) -> int:
        """Bytes that the beams of the last scans take."""
        return sum(
            array.nbytes
            for scan in self._recent
            for array in (*scan.rows, scan.order, scan.messages, scan.blocks)
        )

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use: beliefs, and beams of the last scans."""
        return (0 if self._field is None else self._field.nbytes) + self.window_nbytes

    def add_scans(self, scans: Iterable[Measurement]) -> Report:
        """Add scans, one after the other.

        Returns:
            What became of them; no usable scan is no error.

        Raises:
            InputError: 2D and 3D scans together, or a scan that is not of ranges.
            MapTooLargeError: it would not fit in memory.
        """
        report = Report(compile_s=warm_up(_estimate_toys))
        source = iter(scans)
        while True:
            started = time.perf_counter()
            scan = next(source, None)
            report.read_s += time.perf_counter() - started
            if scan is None:
                break
            started = time.perf_counter()
            report.add(*self._add(scan))
            report.integrate_s += time.perf_counter() - started
        self.report.add(report.scans, report.beams, report.skipped)
        self.report.integrate_s += report.integrate_s
        self.report.compile_s += report.compile_s
        self.report.read_s += report.read_s
        return report

    def view(self) -> FullMap:
        """The map as it is believed now: a copy, which later scans leave alone.

        In the copy messages go to neighbours as if it were their turn. Its `sweeps` says how often
        the beams of a scan were looked at, and its `residual` is that of the last sweep of the
        window [nats]. So `converged` says that the messages of the newest scans rest; those of
        older ones are not looked at again, wherever they would go.

        Raises:
            InputError: no usable scan was added yet.
        """
        from oddsmap.kernels.infer.beam_factor import NAT

        field = self._field
        if field is None:
            reasons = ", ".join(f"{n} x {why}" for why, n in self.report.skipped.most_common())
            raise InputError(
                f"the scans: no usable scan ({reasons or 'there are none'}); nothing to map"
            )
        field = field.copy()
        if self._since_prior > 0:
            self._tell_neighbours(field)
        for scan in self._recent:
            self._note_observed(field, scan)
        full_map = FullMap(
            self.config,
            field.coords,
            (field.belief / NAT).astype(np.float32).reshape(-1, field.block_cells),
            field.observed.reshape(-1, field.block_cells),
            sweeps=1 if self._window == 0 else self._window + 1,
            residual=self._residual,
        )
        full_map.report = dataclasses.replace(self.report, skipped=Counter(self.report.skipped))
        full_map.provenance = [
            {
                "source": None,
                "scans": self.report.scans,
                "sensor": settings_of(self._sensor),
                "estimator": "full-map-online",
                "window": self._window,
                "prior_every": self._prior_every,
                **self.config.full_map.values_in(field.ndim),
            }
        ]
        return full_map

    def _add(self, scan: Measurement) -> tuple[int, int, Counter[str]]:
        from oddsmap.forward.beam_rows import list_rows

        beams, used, skipped = usable_beams([scan], self._sensor, self.config.map.resolution)
        if used == 0:
            return 0, 0, skipped
        field = self._field_for(beams)
        rows = list_rows(field, beams, self._model, self.config.map.resolution)
        there = np.zeros(len(field.coords), np.bool_)
        there[rows.cells // field.block_cells] = True
        newest = _Recent(
            rows,
            np.arange(len(beams)),
            np.zeros(len(rows.cells), np.int32),
            np.flatnonzero(there).astype(np.int32),
        )
        self._residual = self._sweep(field, [newest])
        self._recent.append(newest)
        if self._window > 0:
            self._residual = self._sweep(field, self._recent)
        while len(self._recent) > self._window:
            leaving = self._recent.popleft()
            self._note_observed(field, leaving)
            self._changed.append(leaving.blocks)
        self._since_prior += 1
        if self._since_prior >= self._prior_every:
            self._tell_neighbours(field)
            self._changed.clear()
            self._since_prior = 0
        return used, len(beams), skipped

    def _field_for(self, beams: Beams) -> CellField:
        from oddsmap.kernels.infer.beam_factor import NAT

        if self._field is None:
            prior = self.config.full_map.prior_in(beams.ndim)
            self._field = CellField(beams.ndim, round(math.log(prior / (1.0 - prior)) * NAT))
        elif self._field.ndim != beams.ndim:
            raise InputError("2D and 3D scans cannot go into one map")
        return self._field

    def _sweep(self, field: CellField, scans: Iterable[_Recent]) -> float:
        """Renew all messages of some scans once; returns their mean change [nats]."""
        from oddsmap.kernels.infer.beam_factor import NAT, sweep_in_turn

        moved, count = 0, 0
        for scan in scans:
            moved += sweep_in_turn(
                scan.rows,
                scan.order,
                self._noise,
                self._detection,
                field.belief,
                scan.messages,
                0.0,
            )
            count += len(scan.messages)
        return moved / NAT / max(1, count)

    def _note_observed(self, field: CellField, scan: _Recent) -> None:
        from oddsmap.forward.beam_rows import note_observed

        resolution = self.config.map.resolution
        note_observed(field, scan.rows, self._model, resolution, self._detection)

    def _tell_neighbours(self, field: CellField) -> None:
        """The Ising prior, from the blocks in which a scan was swept since and their neighbours."""
        from oddsmap.kernels.infer.ising import pass_from_blocks

        coupling = self.config.full_map.coupling_in(field.ndim)
        if coupling == 0.0:
            return
        block_neighbours = field.block_neighbours()
        swept = np.unique(np.concatenate([*self._changed, *(s.blocks for s in self._recent)]))
        around = np.unique(np.concatenate([swept, block_neighbours[swept].ravel()]))
        pass_from_blocks(
            around[around >= 0],
            block_neighbours,
            field.side,
            field.ndim,
            coupling,
            field.belief,
            field.received,
        )


def _estimate_toys() -> None:
    toy = Config(
        map=MapConfig(resolution=1.0),
        sensor=ConeSensor(cone_deg=30.0, range_max=3.0),
        full_map=FullMapConfig(),
    )
    for pose in (Pose2(0.5, 0.5, 0.0), Pose3(np.full(3, 0.5), np.eye(3))):
        d = len(pose.translation)
        OnlineFullMap(toy, window=1, prior_every=1)._add(Scan(pose, np.eye(d)[:1], np.array([2.0])))
