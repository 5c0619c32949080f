# SPDX-License-Identifier: Apache-2.0
"""What adds scans to tiles: one protocol, and the table that says which class does it.

Another way to integrate (another sensor's, a GPU's) is a class and a line in `_INTEGRATORS`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from importlib import import_module
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import Sensor

__all__ = ["METHODS", "Counts", "Integrator", "make_integrators"]

Counts = tuple[int, int, Counter[str]]
"""Scans used, beams used, and what was skipped by reason."""

METHODS = ("rays", "projective")


class Integrator(Protocol):
    """Adds scans to tiles, with memory of its own to work in: one per thread."""

    tiles: TileStore
    """Where the votes go: the map's, or its own, which are added to the map's at the end."""
    scale: int
    """What the scans to come weigh [1/65536]."""
    lost: npt.NDArray[np.int64]
    """How many weights above 0 have become 0 by the scale: votes, path lengths."""

    @classmethod
    def for_threads(cls, evidence: Evidence, sensor: Any, threads: int) -> Sequence[Integrator]:
        """One for each thread, for a map and a sensor model.

        Raises:
            ConfigError: the map or the sensor wants votes that this way cannot give.
        """

    def add(self, scans: Sequence[Measurement]) -> Counts:
        """Add a batch."""


# By where a sensor's evidence comes from, the map's dimensions and the method. Imported when used:
# kernels are heavy.
_INTEGRATORS = {
    ("rays", 2, "rays"): ("oddsmap.integrate.rays2d", "Integrator2D"),
    ("rays", 3, "rays"): ("oddsmap.integrate.rays3d", "Integrator3D"),
    ("rays", 3, "projective"): ("oddsmap.integrate.depth_images", "ProjectiveIntegrator"),
    ("cells", 2, "rays"): ("oddsmap.integrate.named_cells", "CellIntegrator"),
    ("cells", 3, "rays"): ("oddsmap.integrate.named_cells", "CellIntegrator"),
}


def make_integrators(
    evidence: Evidence, sensor: Sensor, threads: int, method: str
) -> Sequence[Integrator]:
    """One integrator for each thread.

    Raises:
        ConfigError: an unknown method, or one that the sensor or the map cannot take.
        InputError: a method for 3D maps, and the map is 2D.
    """
    if method not in METHODS:
        raise ConfigError(f'method is "rays" or "projective", got {method!r}')
    if method == "projective" and evidence.ndim != 3:
        raise InputError('method "projective" is for depth images (DepthScan) and 3D maps')
    key = sensor.evidence_from, evidence.ndim, method
    if key not in _INTEGRATORS:
        raise ConfigError(
            f'method "projective" takes each pixel as a narrow beam, the sensor is of kind '
            f'{sensor.kind}: use method "rays"'
        )
    module, name = _INTEGRATORS[key]
    kind: type[Integrator] = getattr(import_module(module), name)
    return kind.for_threads(evidence, sensor, threads)
