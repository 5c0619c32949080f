# SPDX-License-Identifier: Apache-2.0
"""The whole map while the robot drives: scans are looked at a few times, and now and then again.

`OnlineFullMap` is what people hold; `online_beliefs.py` says what becomes of a scan.

Sources: Minka, Expectation propagation for approximate Bayesian inference (2001), section 3.1, for
assumed-density filtering; Kaufman et al., exact inverse sensor model (2016); Vitter, Random
sampling with a reservoir (1985), for which old scans are kept.
"""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.full_map.collector import ranging_sensor
from oddsmap.full_map.full_map import FullMap
from oddsmap.full_map.replay import Schedule
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
    from oddsmap.full_map.online_beliefs import OnlineBeliefs

__all__ = ["OnlineFullMap"]


class OnlineFullMap:
    """A full map that takes one scan after the other, in a time that does not grow with the map.

    Beams are kept for the last `window` scans, and for a sample of the older ones. The order of
    scans matters, as it does to any estimator that forgets them: the same scans in the same order
    give the same bits, in one call of `add_scans` or in many, and after pickling in between.

    Args:
        config: resolution, sensor, and of `full_map` the prior, the coupling, the seed of the
            replay and the tolerance below which messages rest; what it says of sweeps and
            schedules is for the batch estimator.

    Other Args:
        window: how many scans, the new one among them, are swept once more when one is added.
        replay: how many older scans are swept once more with them, drawn at random from the
            reservoir. 0: none, and none are kept; with window = 0 each beam is looked at once.
        reservoir: how many older scans are kept, a uniform sample of all; None: all of them.
            A scan of 24 sonars of 25 degrees and 4 m takes about 70 kB at 0.1 m.
        prior_every: messages go to neighbours each time this many usable scans were added.

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
        yield f"window of {counted(self._schedule.window, 'scan')}"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        config: Config,
        *,
        window: int = 2,
        replay: int = 10,
        reservoir: int | None = 1000,
        prior_every: int = 5,
    ) -> None:
        sensor = ranging_sensor(config)
        self._schedule = Schedule(
            window=window, replay=replay, reservoir=reservoir, prior_every=prior_every
        )
        if config.full_map.method != "sum-product":
            raise ConfigError(
                f"full_map.method {config.full_map.method} needs all beams at once: online there "
                "is sum-product alone; use build_full_map"
            )
        self.config = config
        self.report = Report()
        self._sensor = sensor
        self._beliefs: OnlineBeliefs | None = None

    @property
    def window_nbytes(self) -> int:
        """Bytes that the beams of the last scans take."""
        return 0 if self._beliefs is None else self._beliefs.window_nbytes

    @property
    def reservoir_nbytes(self) -> int:
        """Bytes that the beams of older scans take."""
        return 0 if self._beliefs is None else self._beliefs.reservoir.nbytes

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use: beliefs, and beams of the scans that are kept."""
        return 0 if self._beliefs is None else self._beliefs.nbytes

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
        the beams of a scan are looked at before it is old, and its `residual` is by how much
        messages changed when scans were last swept again [nats]. So `converged` says that the
        messages of the newest scans rest, and those of the older ones that were drawn with them.

        Raises:
            InputError: no usable scan was added yet.
        """
        from oddsmap.kernels.infer.beam_factor import NAT

        if self._beliefs is None:
            reasons = ", ".join(f"{n} x {why}" for why, n in self.report.skipped.most_common())
            raise InputError(
                f"the scans: no usable scan ({reasons or 'there are none'}); nothing to map"
            )
        field = self._beliefs.as_of_now()
        full_map = FullMap(
            self.config,
            field.coords,
            (field.belief / NAT).astype(np.float32).reshape(-1, field.block_cells),
            field.observed.reshape(-1, field.block_cells),
            sweeps=self._schedule.window + 1,
            residual=self._beliefs.residual,
        )
        full_map.report = dataclasses.replace(self.report, skipped=Counter(self.report.skipped))
        full_map.provenance = [
            {
                "source": None,
                "scans": self.report.scans,
                "sensor": settings_of(self._sensor),
                "estimator": "full-map-online",
                **dataclasses.asdict(self._schedule),
                **self.config.full_map.values_in(field.ndim),
            }
        ]
        return full_map

    def _add(self, scan: Measurement) -> tuple[int, int, Counter[str]]:
        beams, used, skipped = usable_beams([scan], self._sensor, self.config.map.resolution)
        if used > 0:
            self._beliefs_for(beams.ndim).add(beams)
        return used, len(beams), skipped

    def _beliefs_for(self, ndim: int) -> OnlineBeliefs:
        from oddsmap.full_map.online_beliefs import OnlineBeliefs

        if self._beliefs is None:
            self._beliefs = OnlineBeliefs(
                ndim, self._sensor.forward_model(), self.config.map.resolution,
                self.config.full_map, self._schedule,
            )  # fmt: skip
        elif self._beliefs.ndim != ndim:
            raise InputError("2D and 3D scans cannot go into one map")
        return self._beliefs


def _estimate_toys() -> None:
    toy = Config(
        map=MapConfig(resolution=1.0),
        sensor=ConeSensor(cone_deg=30.0, range_max=3.0),
        full_map=FullMapConfig(),
    )
    for pose in (Pose2(0.5, 0.5, 0.0), Pose3(np.full(3, 0.5), np.eye(3))):
        d = len(pose.translation)
        OnlineFullMap(toy, window=1, prior_every=1)._add(Scan(pose, np.eye(d)[:1], np.array([2.0])))
