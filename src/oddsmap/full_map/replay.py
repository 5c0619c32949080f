# SPDX-License-Identifier: Apache-2.0
"""Which scans an online estimator keeps, and which of them are swept again.

A reservoir holds a uniform sample of all scans that were ever offered to it, however many there
were: Vitter, Random sampling with a reservoir (1985), algorithm R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError

if TYPE_CHECKING:
    from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = ["KeptScan", "Reservoir", "Schedule"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """How often an online estimator looks at a scan; see `OnlineFullMap`.

    Raises:
        ConfigError: a value is outside its range.
    """

    window: int
    replay: int
    reservoir: int | None
    prior_every: int

    def __post_init__(self) -> None:
        for name, min_value in (("window", 0), ("replay", 0), ("reservoir", 1), ("prior_every", 1)):
            value = getattr(self, name)
            if value is not None and value < min_value:
                raise ConfigError(f"{name}: at least {min_value} is needed, got {value}")


@dataclass(frozen=True, slots=True, eq=False)
class KeptScan:
    """A scan whose messages may still be renewed.

    Args:
        rows: its beams and their cells.
        messages: of each row [1 / NAT].
        blocks: numbers of the blocks that its cells are in.
    """

    rows: BeamRows
    messages: npt.NDArray[np.int32]
    blocks: npt.NDArray[np.int32]

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return sum(array.nbytes for array in (*self.rows, self.messages, self.blocks))


class Reservoir:
    """Up to `capacity` scans, each that was offered being held with the same probability.

    Args:
        capacity: how many it holds; None: all.
        seed: of the random numbers.

    Attributes:
        capacity: see there.
        scans: those held, in no order.
        nbytes: bytes that they take.
    """

    def __init__(self, capacity: int | None, seed: int) -> None:
        self.capacity = capacity
        self.scans: list[KeptScan] = []
        self.nbytes = 0
        self._offered = 0
        self._rng = np.random.default_rng(seed)

    def offer(self, scan: KeptScan) -> None:
        """Take a scan in, or let it go, or another one in its place."""
        self._offered += 1
        if self.capacity is None or len(self.scans) < self.capacity:
            self.scans.append(scan)
            self.nbytes += scan.nbytes
            return
        place = int(self._rng.integers(self._offered))
        if place < self.capacity:
            self.nbytes += scan.nbytes - self.scans[place].nbytes
            self.scans[place] = scan

    def draw(self, count: int) -> list[KeptScan]:
        """Different ones of the scans held, in random order: `count`, or all if they are fewer."""
        count = min(count, len(self.scans))
        if count == 0:
            return []
        chosen = self._rng.choice(len(self.scans), count, replace=False)
        return [self.scans[i] for i in chosen]
