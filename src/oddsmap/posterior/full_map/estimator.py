# SPDX-License-Identifier: Apache-2.0
"""The whole map at once, from p(z | map, pose): batch estimation.

    scans -> usable_beams        # readings.py: what carries information
          -> list_rows           # rows.py: the cells of each beam, numbered
          -> Propagation.run     # propagation.py: messages until they rest
          -> FullMap             # view.py

docs/method/full-map.md explains the method.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterable
from functools import cache

import numpy as np

from oddsmap.config import Config, MapConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.integrate import Report, said_of_sensor
from oddsmap.posterior.full_map.field import CellField
from oddsmap.posterior.full_map.readings import usable_beams
from oddsmap.posterior.full_map.settings import FullMapConfig
from oddsmap.posterior.full_map.view import FullMap
from oddsmap.scan import Log
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.cone_beams import Beams
from oddsmap.sensors.kinds import KINDS, Measurement, Sensor

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
        log: what `open_log` gives, or any scans.
        resolution: side of a cell [m].
        sensor: the sensor model; default: what the log says of its sensor, as in `build_map`.
        settings: how beliefs are propagated.
        threads: how many to work with; changes no bit of the result.
        progress: called after each sweep with its number and the residual [nats].

    Returns:
        The map; its `report` says what was used and what was skipped.

    Raises:
        InputError: no usable scan, or scans of the plane and of space together.
        ConfigError: a parameter outside its range, or a sensor without range_max.
        MapTooLargeError: it would not fit in memory.
    """
    if sensor is None:
        said = said_of_sensor(log)
        sensor = KINDS[said.pop("kind")](**said)
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
        threads: how many to work with; changes no bit of the result.

    Raises:
        ConfigError: the sensor has no forward model, or a parameter is outside its range.
    """

    def __init__(self, config: Config, *, threads: int = 1) -> None:
        sensor = config.sensor
        if not isinstance(sensor, BeamSensor | ConeSensor):
            raise ConfigError(
                f"full-map estimation is for beams and cones; a sensor of kind {sensor.kind} sees "
                "cells one by one: use --estimator filter, which is exact for it"
            )
        if threads < 1:
            raise ConfigError(f"threads: at least 1 is needed, got {threads}")
        self.config = config
        self.report = Report()
        self._sensor = sensor
        self._model = sensor.forward_model()
        self._threads = threads
        self._scans: list[Measurement] = []
        self._provenance: list[dict[str, object]] = []

    def add_log(self, log: Log | Iterable[Measurement]) -> None:
        """Take all scans of a log, and note it in the map's provenance."""
        started = time.perf_counter()
        before = len(self._scans)
        self._scans.extend(log)
        self.report.read_s += time.perf_counter() - started
        self.report.skipped += getattr(log, "skipped", {})
        path = getattr(log, "path", None)
        self._provenance.append(
            {
                "source": None if path is None else str(path).rsplit("/", 1)[-1],
                "scans": len(self._scans) - before,
                "sensor": {"kind": self._sensor.kind, **dataclasses.asdict(self._sensor)},
                "estimator": "full-map",
            }
        )

    def estimate(self, progress: Callable[[int, float], None] | None = None) -> FullMap:
        """Estimate the map; errors and result as in `build_full_map`."""
        from oddsmap.kernels.beam_factor import NAT
        from oddsmap.posterior.full_map.propagation import Propagation
        from oddsmap.posterior.full_map.rows import list_rows, note_observed

        if not self._scans:
            raise InputError("the scans: no usable scan (there are none); nothing to map")
        beams, scan_count, skipped = usable_beams(self._scans, self._sensor)
        self.report.add(scan_count, len(beams), skipped)
        if scan_count == 0:
            reasons = ", ".join(f"{n} x {why}" for why, n in self.report.skipped.most_common())
            raise InputError(f"the scans: no usable scan ({reasons}); nothing to map")
        settings = self.config.full_map
        resolution = self.config.map.resolution
        self.report.compile_s += _compile()
        started = time.perf_counter()
        prior = settings.prior_in(beams.ndim)
        field = CellField(beams.ndim, round(math.log(prior / (1.0 - prior)) * NAT))
        rows = list_rows(field, beams, self._model, resolution)
        detection = np.array([self._model.detection])
        noise = self._model.noise(resolution)
        work = Propagation(field, rows, noise, detection, settings, self._threads)
        sweeps, residual = work.run(progress)
        note_observed(field, rows, self._model, resolution, detection)
        self.report.integrate_s += time.perf_counter() - started
        full_map = FullMap(
            self.config,
            field.coords,
            (field.belief / NAT).astype(np.float32).reshape(-1, field.block_cells),
            field.observed.reshape(-1, field.block_cells),
            sweeps=sweeps,
            residual=residual,
        )
        full_map.report = self.report
        full_map.provenance = list(self._provenance)
        return full_map


def _compile() -> float:
    """Compile the kernels, or load them from the cache; returns the seconds that took."""
    started = time.perf_counter()
    _compile_once()
    return time.perf_counter() - started


@cache
def _compile_once() -> None:
    # Toy maps go through the same kernels, one of the plane and one of space.
    from oddsmap.posterior.full_map.propagation import Propagation
    from oddsmap.posterior.full_map.rows import list_rows, note_observed

    model = ConeSensor(cone_deg=30.0, range_max=3.0).forward_model()
    for d in (2, 3):
        field = CellField(d, 0)
        beams = Beams(np.zeros((1, d)), np.eye(d)[:1], np.array([2.0]))
        rows = list_rows(field, beams, model, 1.0)
        for schedule in ("chunks", "sequential"):
            settings = FullMapConfig(sweeps=1, schedule=schedule)
            Propagation(field, rows, model.noise(1.0), np.ones(1), settings).run()
        note_observed(field, rows, model, 1.0, np.ones(1))
