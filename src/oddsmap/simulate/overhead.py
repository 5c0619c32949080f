# SPDX-License-Identifier: Apache-2.0
"""A camera that looks down on a floor plan, with a detector that errs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.scans.grid_scan import GridScan
from oddsmap.simulate.floor_plan import FloorPlan

__all__ = ["OverheadCamera"]


@dataclass(frozen=True, slots=True)
class OverheadCamera:
    """Labels of a grid of pixels around the sensor, from a confusion model.

    Each pixel on its own looks at its centre and draws one of three cases:

    - with `p_unseen`: not seen, NaN;
    - where the centre is occupied: 1 with `true_positive_rate`, else 0;
    - where it is free: 1 with `false_positive_rate`, else 0.

    Where the pixels lie on the cells of a map, these are the readings that `OverheadSensor` takes
    them for. Turned by another angle, a pixel that holds the centre of a cell may look at the cell
    beside it: outlines are then off by up to half a pixel's diagonal, as with a real camera.

    Args:
        height: rows of pixels, along y (left).
        width: columns of pixels, along x (forward).
        pixel: side of a pixel [m].
        corner: lower left corner of pixel (0, 0) in the sensor frame [m]; None: the grid is
            centred on the sensor.
        true_positive_rate: P(seen occupied | occupied).
        false_positive_rate: P(seen occupied | free).
        p_unseen: probability that a pixel says nothing.

    Raises:
        ConfigError: a parameter outside its range.
    """

    height: int = 40
    width: int = 60
    pixel: float = 0.05
    corner: tuple[float, float] | None = None
    true_positive_rate: float = 0.9
    false_positive_rate: float = 0.1
    p_unseen: float = 0.0

    def __post_init__(self) -> None:
        if self.height < 1 or self.width < 1:
            raise ConfigError(
                "OverheadCamera: height and width must be at least 1, "
                f"got {self.height} and {self.width}"
            )
        if not 0 < self.pixel < math.inf:
            raise ConfigError(f"OverheadCamera: pixel must be above 0 m, got {self.pixel}")
        if self.corner is not None and not all(math.isfinite(at) for at in self.corner):
            raise ConfigError(f"OverheadCamera: corner must be finite [m], got {self.corner}")
        for name in ("true_positive_rate", "false_positive_rate", "p_unseen"):
            p = getattr(self, name)
            if not 0 <= p <= 1:
                raise ConfigError(f"OverheadCamera: {name} must be in [0, 1], got {p}")

    def scan(
        self,
        plan: FloorPlan,
        pose: Pose2,
        rng: np.random.Generator,
        *,
        stamp_ns: int | None = None,
    ) -> GridScan:
        """Take one picture.

        The same generator state gives the same picture. Two numbers are drawn for each pixel
        whatever it sees, so that a pixel keeps its luck when a probability is changed.

        Args:
            plan: what stands where, in the map frame.
            pose: of the sensor in the map frame.
            rng: where the chance comes from.
            stamp_ns: time of the picture [ns], handed on.

        Returns:
            The labels and their pose.

        Raises:
            InputError: the pose is not finite.
        """
        if not pose.is_finite:
            raise InputError(f"OverheadCamera.scan: the pose is not finite: {pose}")
        left, low = self.corner or (-self.width * self.pixel / 2, -self.height * self.pixel / 2)
        x = left + (np.arange(self.width) + 0.5) * self.pixel
        y = low + (np.arange(self.height) + 0.5) * self.pixel
        centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        occupied = plan.contains(pose.transform(centres)).reshape(self.height, self.width)
        chance, luck = rng.random((2, self.height, self.width))
        rate = np.where(occupied, self.true_positive_rate, self.false_positive_rate)
        seen = np.where(luck < self.p_unseen, np.nan, chance < rate)
        return GridScan(pose, seen, self.pixel, (left, low), stamp_ns)
