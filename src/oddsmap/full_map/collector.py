# SPDX-License-Identifier: Apache-2.0
"""Logs in, numbered beams out: what estimators that keep the beams have in common."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

from oddsmap.config.config import Config
from oddsmap.errors import InputError
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel
from oddsmap.full_map.readings import ranging_sensor, usable_beams
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.report import Report

if TYPE_CHECKING:
    from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = ["BeamCollector"]


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
                "source": None if path is None else str(path).rsplit("/", 1)[-1],
                "scans": len(self._scans) - before,
                "sensor": {"kind": self._sensor.kind, **dataclasses.asdict(self._sensor)},
                "estimator": self._estimator,
            }
        )

    def list_beams(
        self, prior: tuple[float, float], model: ForwardModel | None = None
    ) -> tuple[CellField, BeamRows]:
        """The cells that the beams speak of, with the prior's belief, and the beams' rows.

        Args:
            prior: p(x) of a cell of the plane, and of one of space.
            model: in place of the sensor's own forward model.

        Raises:
            InputError: no usable scan, or scans of the plane and of space together.
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
