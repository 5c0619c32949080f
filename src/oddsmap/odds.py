# SPDX-License-Identifier: Apache-2.0
"""Probabilities, log odds, and the decisions based on them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError

__all__ = ["State", "Thresholds", "decided_by", "logit", "sigmoid"]


def logit(p: npt.ArrayLike) -> FloatArray:
    """Log odds of a probability: log p / (1 - p)."""
    chance = np.asarray(p, dtype=np.float64)
    return np.asarray(np.log(chance) - np.log1p(-chance))


def sigmoid(log_odds: npt.ArrayLike) -> FloatArray:
    """Probability of log odds: 1 / (1 + exp(-l)), without overflow."""
    x = np.asarray(log_odds, dtype=np.float64)
    small = np.exp(-np.abs(x))
    return np.where(x >= 0, 1.0, small) / (1.0 + small)


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


def decided_by(given: Thresholds | None, own: Thresholds) -> Thresholds:
    """The thresholds that are given, or else a map's own.

    Raises:
        ConfigError: what is given is something else, such as one probability.
    """
    if given is None:
        return own
    if not isinstance(given, Thresholds):
        raise ConfigError(
            f"thresholds are oddsmap.Thresholds(free=0.196, occupied=0.65), got {given!r}"
        )
    return given
