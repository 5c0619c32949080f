# SPDX-License-Identifier: Apache-2.0
"""Sensors that observe cells themselves, like a camera that looks down.

A reading is about one cell and nothing else, so given the map the readings are independent of
each other: the Markov assumption of the Bayes filter holds, and its product of cells *is* the joint
posterior p(m | z_1:t). With rates of true and of false detections t and f, Bayes' rule at prior 1/2
gives

    p(x | seen occupied) = t / (t + f),    p(x | seen free) = (1 - t) / (2 - t - f).

It holds while each reading is one cell's: pixels much larger than a cell cover many cells at
once, and their errors are shared.

Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), sections 4.2 and 9.2.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.limits import MAX_COORDINATE
from oddsmap.odds import logit
from oddsmap.scans.grid_scan import GridScan
from oddsmap.sensors.cell_votes import CellVotes

if TYPE_CHECKING:
    from oddsmap.scans.measurement import Measurement

__all__ = ["OverheadSensor"]


# Cells that one scan may span: 1.3 GB while it is taken apart.
_MAX_SCAN_CELLS = 1 << 25


@dataclass(frozen=True, slots=True, kw_only=True)
class OverheadSensor:
    """A sensor that sees whether cells are occupied, and errs at known rates.

    A cell is observed where its centre lies in a pixel of the grid, and gets what that pixel says,
    once per scan; a centre within 1e-6 pixels of a border belongs to the upper one. "Seen occupied"
    is one hit, "seen free" one pass. A probability p is the part of a vote whose log Bayes factor
    is logit(p), rounded to 1/65536: logit(p) / logit(p_hit) of a hit for p above 1/2,
    logit(p) / logit(p_miss) of a pass below it, and at most one: a detector is not taken to be
    surer than the confusion model says that it is. p = 1/2 says nothing.

    Rates and prior can be changed after mapping where readings are labels. Parts of votes were made
    with the rates of this model; under others they are scaled.

    Args:
        true_positive_rate: P(seen occupied | occupied).
        false_positive_rate: P(seen occupied | free), below the other.

    Raises:
        ConfigError: a rate is outside (0, 1), or they are equal or the wrong way round.
    """

    kind: ClassVar[str] = "overhead"
    names: ClassVar[tuple[str, ...]] = ("overhead",)
    evidence_from: ClassVar[Literal["rays", "cells"]] = "cells"
    default_votes: ClassVar[str] = "scan"

    true_positive_rate: float = 0.9
    false_positive_rate: float = 0.1

    def __post_init__(self) -> None:
        for name in ("true_positive_rate", "false_positive_rate"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise ConfigError(f"sensor.{name} lies between 0 and 1, got {value}")
        # As what is made of them: rates may differ and yet be too close to tell apart.
        if not 0.0 < self.p_miss < 0.5 < self.p_hit < 1.0:
            raise ConfigError(
                "sensor.false_positive_rate must lie below true_positive_rate, got "
                f"{self.false_positive_rate} and {self.true_positive_rate}"
            )

    @property
    def p_hit(self) -> float:
        """p(x | seen occupied) at prior 1/2."""
        return self.true_positive_rate / (self.true_positive_rate + self.false_positive_rate)

    @property
    def p_miss(self) -> float:
        """p(x | seen free) at prior 1/2."""
        missed = 1.0 - self.true_positive_rate
        return missed / (missed + (1.0 - self.false_positive_rate))

    def weights(self, seen: npt.ArrayLike) -> tuple[IntArray, IntArray]:
        """Hits and passes of readings.

        Args:
            seen: 0 to 1, any shape.

        Returns:
            hits and passes in units of 1/65536 vote, of that shape.
        """
        from oddsmap.kernels.units import ONE

        p = np.asarray(seen, np.float64)
        if ((p == 0.0) | (p == 1.0)).all():  # labels: the same without logarithms
            hits = p.astype(np.int64) * ONE
            return hits, ONE - hits
        with np.errstate(divide="ignore"):  # 0 and 1: infinite, which is capped
            factor = logit(p)
        votes = (factor / float(logit(self.p_hit)), factor / float(logit(self.p_miss)))
        hits, passes = (np.rint(ONE * np.clip(vote, 0.0, 1.0)).astype(np.int64) for vote in votes)
        return hits, passes

    def votes(
        self, scans: Sequence[Measurement], resolution: float
    ) -> tuple[Iterator[CellVotes], Counter[str]]:
        """List the cells that the scans see.

        Args:
            scans: grid scans.
            resolution: side of a map cell [m].

        Returns:
            The votes of the scans that see at least one cell, one by one; and how many scans were
            skipped, by reason, which is complete after the last of them. A pixel that did not see
            is no fault and not counted.

        Raises:
            InputError: a scan of ranges.
            MapTooLargeError: a scan spans too many cells (when its turn comes).
        """
        grids = [scan for scan in scans if isinstance(scan, GridScan)]
        if len(grids) < len(scans):
            raise InputError("a scan has ranges and sees no cells: it needs another sensor model")
        skipped: Counter[str] = Counter()
        return self._listed(grids, resolution, skipped), skipped

    def _listed(
        self, scans: Sequence[GridScan], resolution: float, skipped: Counter[str]
    ) -> Iterator[CellVotes]:
        limit = MAX_COORDINATE * resolution
        for scan in scans:
            pose = scan.map_from_sensor
            if not pose.is_finite:
                skipped["scan.nan_pose"] += 1
                continue
            if max(abs(pose.x), abs(pose.y)) >= limit:
                skipped["scan.pose_too_far"] += 1
                continue
            index, seen = self._cells(scan, resolution)
            if len(seen) == 0:
                skipped["scan.empty"] += 1
                continue
            offsets = np.array([0, len(seen)], np.int64)
            yield CellVotes(offsets, index, *self.weights(seen), beams=len(seen))

    def _cells(self, scan: GridScan, resolution: float) -> tuple[IntArray, FloatArray]:
        """The cells that a scan sees, shape (n, 2), and what it says of them, shape (n,)."""
        from oddsmap.kernels.vote.grid_cells import list_seen_cells

        pose, (left, low) = scan.map_from_sensor, scan.corner
        height, width = scan.seen.shape
        right, top = left + width * scan.resolution, low + height * scan.resolution
        corners = pose.transform(np.array([(left, low), (right, low), (left, top), (right, top)]))
        # A margin of one cell: a centre within rounding of the outline may count as inside.
        lo = np.floor(corners.min(axis=0) / resolution) - 1
        hi = np.floor(corners.max(axis=0) / resolution) + 2
        cell_count = float((hi - lo).prod())
        if cell_count > _MAX_SCAN_CELLS:
            raise MapTooLargeError(
                f"one scan of {width} x {height} pixels of {scan.resolution:g} m spans "
                f"{cell_count:.1e} cells of {resolution:g} m "
                f"(limit {_MAX_SCAN_CELLS:.1e}): use a coarser resolution"
            )
        index, values = np.empty((int(cell_count), 2), np.int64), np.empty(int(cell_count))
        count = list_seen_cells(
            scan.seen, lo.astype(np.int64), hi.astype(np.int64), resolution,
            pose.x, pose.y, pose.theta, scan.corner, scan.resolution, index, values,
        )  # fmt: skip
        return index[:count], values[:count]
