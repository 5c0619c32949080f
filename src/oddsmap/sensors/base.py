# SPDX-License-Identifier: Apache-2.0
"""What a sensor model is: the protocols that integration, full maps and scores ask for.

A model is a frozen dataclass whose fields are its settings (docs/sensors.md). It gives evidence in
one of two ways: along rays, as segments of free and occupied space, or as votes of single cells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol, runtime_checkable

from oddsmap.array_types import FloatArray
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.cell_votes import CellVotes
from oddsmap.sensors.filters import AngleWindow
from oddsmap.sensors.inverse_model import HitShape
from oddsmap.sensors.segments import Segments

if TYPE_CHECKING:
    from oddsmap.forward.model import ForwardModel
    from oddsmap.kernels.trace.readings import Limits

__all__ = ["CellSensor", "RangingSensor", "RaySensor", "Sensor"]


class Sensor(Protocol):
    """What all sensor models have."""

    kind: ClassVar[str]
    """Its name in a configuration: `sensor.kind`."""
    names: ClassVar[tuple[str, ...]]
    """What `--sensor` calls it, by what people have."""
    default_votes: ClassVar[str]
    """"scan" where a whole scan is one measurement, "beam" where each reading is one."""
    evidence_from: ClassVar[Literal["rays", "cells"]]
    """Which of `RaySensor` and `CellSensor` it is."""

    @property
    def p_hit(self) -> float:
        """p(x | z) of a hit at prior 1/2."""

    @property
    def p_miss(self) -> float:
        """p(x | z) of a pass at prior 1/2."""


class RaySensor(Sensor, Protocol):
    """A sensor of narrow beams: its evidence lies on rays."""

    @property
    def hit_shape(self) -> HitShape:
        """How a beam votes around its return."""

    @property
    def whole_votes(self) -> bool:
        """True where each beam gives whole votes, with a hit for one cell alone."""

    @property
    def limits(self) -> Limits:
        """Which readings count: see `oddsmap.kernels.trace.readings`."""

    @property
    def heights(self) -> tuple[float, float]:
        """Lowest and highest height in the map frame at which a return marks [m]."""

    @property
    def body(self) -> FloatArray:
        """Corners of the body's box in the sensor frame [m], shape (2, 3); in 2D of any height."""

    @property
    def angle_window(self) -> AngleWindow:
        """Lowest and highest azimuth of a beam that counts [rad]; None: all count."""

    def segments(
        self, scans: Sequence[Measurement], farthest: float = ...
    ) -> tuple[Segments, Counter[str]]:
        """Segments of free and occupied space, and how much was skipped, by reason."""


class CellSensor(Sensor, Protocol):
    """A sensor that names the cells itself."""

    def votes(
        self, scans: Sequence[Measurement], resolution: float
    ) -> tuple[Iterator[CellVotes], Counter[str]]:
        """Votes of cells of that side [m], and how much was skipped, by reason."""


@runtime_checkable
class RangingSensor(Sensor, Protocol):
    """A sensor that a forward model p(z | map, pose) predicts, of either way."""

    @property
    def forward_limits(self) -> Limits:
        """Which readings the forward model predicts; no-returns reach to infinity."""

    def forward_model(self) -> ForwardModel:
        """The forward model.

        Raises:
            ConfigError: a setting that it needs is missing.
        """
