# SPDX-License-Identifier: Apache-2.0
"""A map of probabilities without counts.

It is what a posterior gives to exports, and what a file without evidence (a ROS map) arrives as:
a prior, or something to compare with, never evidence.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError, InputError

__all__ = ["ProbabilityMap", "State", "Thresholds"]


class State(IntEnum):
    """What is decided about a cell."""

    UNKNOWN = -1
    """No evidence at all: never the same as p = 0.5."""
    FREE = 0
    UNDECIDED = 50
    """Seen, and the probability lies between the thresholds."""
    OCCUPIED = 100


@dataclass(frozen=True, slots=True)
class Thresholds:
    """A seen cell is free where p <= `free`, occupied where p >= `occupied` (Nav2's defaults)."""

    free: float = 0.196
    occupied: float = 0.65

    def __post_init__(self) -> None:
        if not 0.0 <= self.free < self.occupied <= 1.0:
            raise ConfigError(
                f"thresholds need 0 <= free < occupied <= 1, got {self.free} and {self.occupied}"
            )

    def state(
        self, probability: npt.NDArray[np.float64], observed: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.int8]:
        """Decide cells: values of `State`, of the shape of the two arrays."""
        state = np.full(probability.shape, State.UNDECIDED, dtype=np.int8)
        state[probability <= self.free] = State.FREE
        state[probability >= self.occupied] = State.OCCUPIED
        state[~observed] = State.UNKNOWN
        return state


@dataclass(frozen=True, slots=True, eq=False)
class ProbabilityMap:
    """Probabilities of a rectangle of cells in the plane.

    Args:
        probability: p(occupied), shape (ny, nx), row = y ascending, column = x ascending.
        observed: True where there was evidence, same shape.
        resolution: side of a cell [m].
        origin: position in the map frame of the lower left corner of cell (0, 0) [m].
        yaw: rotation of the grid about that corner [rad], counter-clockwise.

    Raises:
        InputError: shapes differ or the resolution is not positive.
    """

    probability: npt.NDArray[np.float64]
    observed: npt.NDArray[np.bool_]
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    yaw: float = 0.0

    def __post_init__(self) -> None:
        if self.probability.ndim != 2 or self.probability.shape != self.observed.shape:
            raise InputError(
                "a probability map needs two arrays of one shape (ny, nx), "
                f"got {self.probability.shape} and {self.observed.shape}"
            )
        if not 0.0 < self.resolution < float("inf"):
            raise InputError(f"a map needs a positive resolution [m], got {self.resolution}")

    def state(self, thresholds: Thresholds | None = None) -> npt.NDArray[np.int8]:
        """Decide each cell: values of `State`, shape (ny, nx)."""
        return (thresholds or Thresholds()).state(self.probability, self.observed)
