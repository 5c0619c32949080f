# SPDX-License-Identifier: Apache-2.0
"""Logs in, numbered beams out: what estimators that keep the beams have in common."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from oddsmap.config.config import Config
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report
from oddsmap.sensors.base import RangingSensor
from oddsmap.sensors.registry import settings_of
from oddsmap.sensors.usable_beams import usable_beams

if TYPE_CHECKING:
    from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = ["BeamCollector", "ranging_sensor"]

# Settings of the filter that would change which readings count, and how much.
_OF_THE_FILTER = {
    "map": ("half_life", "half_life_scans", "path_lengths"),
    "sensor": ("mark_z_min", "mark_z_max", "body_min", "body_max"),
}


class BeamCollector:
    """Collects the scans of logs, and lists the cells of their beams.

    Args:
        config: its sensor, and a resolution.
        estimator: what the provenance calls the estimator.

    Attributes:
        model: the sensor's forward model.
        report: what was used and what was skipped when beams were last listed.
        provenance: what the readings came from.

    Raises:
        ConfigError: the sensor has no forward model, or a setting of the filter is set.
    """

    def __init__(self, config: Config, estimator: str) -> None:
        self._sensor = ranging_sensor(config)
        self.model: ForwardModel = self._sensor.forward_model()
        self.report = Report()
        self.provenance: list[dict[str, object]] = []
        self._resolution, self._estimator = config.map.resolution, estimator
        self._scans: list[Measurement] = []
        self._read = Report()

    def __len__(self) -> int:
        """How many scans there are."""
        return len(self._scans)

    def add_log(self, log: Log | Iterable[Measurement]) -> None:
        """Take all scans of a log, and note it in the provenance."""
        started = time.perf_counter()
        before = len(self._scans)
        self._scans.extend(log)
        self._read.read_s += time.perf_counter() - started
        self._read.skipped += getattr(log, "skipped", {})
        path = getattr(log, "path", None)
        self.provenance.append(
            {
                "source": None if path is None else Path(path).name,
                "scans": len(self._scans) - before,
                "sensor": settings_of(self._sensor),
                "estimator": self._estimator,
            }
        )

    def list_beams(
        self, prior: tuple[float, float], model: ForwardModel | None = None
    ) -> tuple[CellField, BeamRows]:
        """The cells that the beams are about, with the prior's belief, and the beams' rows.

        Args:
            prior: p(x) of a 2D cell, and of a 3D cell.
            model: in place of the sensor's own forward model.

        Raises:
            InputError: no usable scan, or 2D and 3D scans together.
            MapTooLargeError: it would not fit in memory.
        """
        from oddsmap.forward.beam_rows import list_rows
        from oddsmap.kernels.infer.beam_factor import NAT

        if not self._scans:
            raise InputError("the scans: no usable scan (there are none); nothing to map")
        self.report = dataclasses.replace(self._read, skipped=Counter(self._read.skipped))
        beams, scan_count, skipped = usable_beams(self._scans, self._sensor, self._resolution)
        self.report.add(scan_count, len(beams), skipped)
        if scan_count == 0:
            reasons = ", ".join(f"{n} x {why}" for why, n in self.report.skipped.most_common())
            raise InputError(f"the scans: no usable scan ({reasons}); nothing to map")
        p = prior[beams.ndim - 2]
        field = CellField(beams.ndim, round(math.log(p / (1.0 - p)) * NAT))
        return field, list_rows(field, beams, model or self.model, self._resolution)


def ranging_sensor(config: Config) -> RangingSensor:
    """The sensor of a configuration that full-map estimation can take.

    Raises:
        ConfigError: its sensor has no forward model, or something is set that the forward model
            does not know and that would change what is mapped.
    """
    sensor = config.sensor
    if not isinstance(sensor, RangingSensor):
        raise ConfigError(
            f"full-map estimation is for beams and cones; a sensor of kind {sensor.kind} sees "
            "cells one by one: use --estimator filter, which is exact for it"
        )
    for section, names in _OF_THE_FILTER.items():
        for name in names:
            value = getattr(getattr(config, section), name)
            if value is not None and value is not False:
                raise ConfigError(
                    f"{section}.{name} is for the filter, full-map estimation has no such thing: "
                    f"leave it out, or use --estimator filter (got {value})"
                )
    return sensor
