# SPDX-License-Identifier: Apache-2.0
"""What readings a map predicts along rays: what is asked of a forward model, and its answer.

The models themselves lie above this room: a map hands one the probabilities of its cells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, shown
from oddsmap.short_repr import short_repr

__all__ = ["MapAlongRays", "RangeDistribution", "RangeModel", "model_of"]


@dataclass(frozen=True, slots=True, eq=False)
class RangeDistribution:
    """p(z) along rays, all of it: each row of `probability` with the two others adds up to 1.

    Attributes:
        edges: of the bins of readings [m], from range_min to range_max, shape (bins + 1,).
        probability: of a reading in each bin, shape (n, bins).
        no_return: probability of a no-return, shape (n,).
        no_information: probability that noise takes a reading below range_min, where it says
            nothing, shape (n,).
    """

    edges: FloatArray
    probability: FloatArray
    no_return: FloatArray
    no_information: FloatArray

    __repr__ = short_repr

    @property
    def middles(self) -> FloatArray:
        """Of the bins [m], shape (bins,)."""
        return (self.edges[1:] + self.edges[:-1]) / 2.0

    @property
    def density(self) -> FloatArray:
        """Probability per metre of a reading, shape (n, bins) [1 / m]."""
        return np.asarray(self.probability / np.diff(self.edges))


@dataclass(frozen=True, slots=True, eq=False)
class MapAlongRays:
    """A map and rays through it, in the frame that cells count from.

    Attributes:
        resolution: side of a cell [m].
        origins: [m], shape (n, d).
        directions: unit vectors, shape (n, d).
        occupancy: probabilities of cells, shape (m, d) in, (m,) out.
        reflects: True: these are of cells returning the beam, whatever the sensor's detection.
    """

    resolution: float
    origins: FloatArray
    directions: FloatArray
    occupancy: Callable[[IntArray], FloatArray]
    reflects: bool


class RangeModel(Protocol):
    """A forward model of ranges."""

    def expected_ranges(self, rays: MapAlongRays) -> FloatArray:
        """Mean distance of the first echo [m], shape (n,)."""

    def range_distribution(self, rays: MapAlongRays, bin_width: float | None) -> RangeDistribution:
        """p(z) along each ray."""


def model_of(sensor: object) -> RangeModel:
    """The forward model of a sensor, or the model itself.

    Raises:
        ConfigError: it has none, or a setting that it needs is missing.
    """
    make = getattr(sensor, "forward_model", None)
    model = sensor if make is None else make()
    if not callable(getattr(model, "range_distribution", None)):
        raise ConfigError(
            "ranges are predicted by a sensor of beams or cones with its range_max, as in "
            f"sensor=BeamSensor(range_max=30.0), got {shown(sensor)}"
        )
    predicting: RangeModel = model  # type: ignore[assignment]
    return predicting
