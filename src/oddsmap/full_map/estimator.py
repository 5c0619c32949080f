# SPDX-License-Identifier: Apache-2.0
"""The whole map at once, from p(z | map, pose): batch estimation.

    scans -> usable_beams        # readings.py: what carries information
          -> list_rows           # forward/beam_rows.py: the cells of each beam, numbered
          -> Propagation.run     # belief_propagation.py: messages until they rest
         (-> gibbs, hill_climb   # joint_samples.py: from there on, where they are asked for)
          -> FullMap             # full_map.py

docs/method/full-map.md explains the method.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError
from oddsmap.full_map.collector import BeamCollector
from oddsmap.full_map.full_map import FullMap
from oddsmap.full_map.toy_beams import toy_beams
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor, sensor_of_log
from oddsmap.short_repr import counted, described
from oddsmap.warm_up import warm_up

if TYPE_CHECKING:
    from oddsmap.full_map.belief_propagation import Propagation
    from oddsmap.full_map.joint_samples import JointSamples

__all__ = ["FullMapEstimator", "build_full_map"]


def build_full_map(
    log: Log | Iterable[Measurement],
    resolution: float,
    *,
    sensor: Sensor | None = None,
    settings: FullMapConfig | None = None,
    threads: int = 1,
    progress: Callable[[int, float], None] | None = None,
) -> FullMap:
    """Estimate the whole map from a log: the way to go for wide beams.

    Args:
        log: what `open_log` returns, or any scans.
        resolution: side of a cell [m].
        sensor: the sensor model; default: what the log says about its sensor, as in `build_map`.
        settings: how beliefs are propagated.
        threads: how many threads to use; does not change the result by a bit.
        progress: called after each sweep with its number and the residual [nats].

    Returns:
        The map; its `report` says what was used and what was skipped.

    Raises:
        InputError: no usable scan, or 2D and 3D scans together.
        ConfigError: a parameter outside its range, or a sensor without range_max.
        MapTooLargeError: it would not fit in memory.
    """
    if sensor is None:
        sensor = sensor_of_log(log)
    config = Config(
        map=MapConfig(resolution=float(resolution), votes=sensor.default_votes),
        sensor=sensor,
        full_map=settings or FullMapConfig(),
    )
    estimator = FullMapEstimator(config, threads=threads)
    estimator.add_log(log)
    return estimator.estimate(progress)


class FullMapEstimator:
    """Collects beams and estimates the map that explains them.

    Args:
        config: resolution, sensor and settings.
        threads: how many threads to use; does not change the result by a bit.

    Raises:
        ConfigError: the sensor has no forward model, a parameter is outside its range, or a
            setting of the filter is set.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield f"cells of {self.config.map.resolution:g} m"
        yield f"sensor {self.config.sensor.kind}, {self.config.full_map.method}"
        yield counted(len(self._beams), "scan")

    def __init__(self, config: Config, *, threads: int = 1) -> None:
        self._beams = BeamCollector(config, "full-map")
        if threads < 1:
            raise ConfigError(f"threads: at least 1 is needed, got {threads}")
        self.config = config
        self._threads = threads

    @property
    def report(self) -> Report:
        """What was used and what was skipped by the last `estimate` or `sample`."""
        return self._beams.report

    def add_log(self, log: Log | Iterable[Measurement]) -> None:
        """Take all scans of a log, and note it in the map's provenance."""
        self._beams.add_log(log)

    def estimate(self, progress: Callable[[int, float], None] | None = None) -> FullMap:
        """Estimate the map; errors and result as in `build_full_map`."""
        from oddsmap.full_map.joint_samples import log_odds_by_climbing, log_odds_by_gibbs
        from oddsmap.kernels.infer.beam_factor import NAT

        work, sweeps, residual, started = self._propagate(
            progress, joint=self.config.full_map.method != "sum-product"
        )
        field = work.field
        if self.config.full_map.method == "gibbs":
            log_odds, residual = log_odds_by_gibbs(work)
            sweeps = self.config.full_map.samples
        elif self.config.full_map.method == "map":
            log_odds, sweeps, residual = log_odds_by_climbing(work)
        else:
            log_odds = field.belief / NAT
        self.report.integrate_s += time.perf_counter() - started
        full_map = FullMap(
            self.config,
            field.coords,
            log_odds.astype(np.float32).reshape(-1, field.block_cells),
            field.observed.reshape(-1, field.block_cells),
            sweeps=sweeps,
            residual=residual,
        )
        full_map.report = self.report
        chosen = self.config.full_map.values_in(field.ndim)
        full_map.provenance = [{**entry, **chosen} for entry in self._beams.provenance]
        return full_map

    def sample(
        self,
        count: int,
        *,
        every: int = 10,
        progress: Callable[[int, float], None] | None = None,
    ) -> JointSamples:
        """Draw whole maps from p(m | z_1:t), by Gibbs sampling from where sum-product ends.

        Neighbouring cells of one map fit each other, as they do not where each is drawn from its
        own probability: for planners that want to know if a gap is open, not how likely a cell.
        Seed, burn-in and the others are those of the settings, whatever their method.

        Args:
            count: how many maps.
            every: sweeps from one map to the next; maps a few sweeps apart are alike.
            progress: as in `build_full_map`, of the sum-product sweeps.

        Raises:
            ConfigError: count or every is below 1.
            InputError: as in `build_full_map`, and MapTooLargeError too.
        """
        from oddsmap.full_map.joint_samples import draw_maps

        for name, value in (("count", count), ("every", every)):
            if value < 1:
                raise ConfigError(f"sample: {name} is at least 1, got {value}")
        work, _, _, started = self._propagate(progress, joint=True)
        samples = draw_maps(work, count, every)
        self.report.integrate_s += time.perf_counter() - started
        return samples

    def _propagate(
        self, progress: Callable[[int, float], None] | None, *, joint: bool
    ) -> tuple[Propagation, int, float, float]:
        """Sweep until messages rest: the propagation, its sweeps and residual, when it began."""
        from oddsmap.forward.beam_rows import note_observed
        from oddsmap.full_map.belief_propagation import Propagation

        settings, resolution = self.config.full_map, self.config.map.resolution
        compile_s = warm_up(_estimate_toys, joint)
        started = time.perf_counter()
        field, rows = self._beams.list_beams((settings.prior_in(2), settings.prior_in(3)))
        if field.ndim != 2 and settings.prior_model == "windows":
            raise ConfigError(
                "full_map.prior_model windows has been learnt for 2D maps, and these scans make a "
                "3D one: leave it at ising"
            )
        self.report.compile_s += compile_s
        model = self._beams.model
        detection = np.array([model.detection])
        noise = model.noise(resolution)
        work = Propagation(field, rows, noise, detection, settings, self._threads)
        sweeps, residual = work.run(progress)
        note_observed(field, rows, model, resolution, detection)
        return work, sweeps, residual, started


def _estimate_toys(joint: bool) -> None:
    from oddsmap.forward.beam_rows import note_observed
    from oddsmap.full_map.belief_propagation import Propagation
    from oddsmap.full_map.joint_samples import draw_maps, log_odds_by_climbing

    for field, rows, model in toy_beams():
        for schedule in ("chunks", "sequential"):
            settings = FullMapConfig(sweeps=1, burn_in=0, schedule=schedule)
            work = Propagation(field, rows, model.noise(1.0), np.ones(1), settings)
            work.run()
        note_observed(field, rows, model, 1.0, np.ones(1))
        if joint:
            draw_maps(work, 1, 1)
            if field.ndim == 2:
                work.config = FullMapConfig(method="gibbs", prior_model="windows", burn_in=0)
                draw_maps(work, 1, 1)
                work.config = settings
            log_odds_by_climbing(work)
