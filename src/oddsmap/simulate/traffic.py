# SPDX-License-Identifier: Apache-2.0
"""Walkers and cars that move through a world: where they are when, and which beams meet them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.scans.scan import Scan
from oddsmap.simulate.solids import Box, Cylinder, Ground, Solid
from oddsmap.simulate.town import on_lane
from oddsmap.simulate.world3d import World3D

__all__ = ["Mover", "MovingWorld", "traffic"]

_WALKER = Cylinder(0.0, 0.0, 0.25, 0.0, 1.7)
_CAR = Box(0.0, 0.0, 4.2, 1.8, 0.0, 1.5)
_WALKING, _DRIVING = 1.2, 7.0  # [m/s]
_LANE = 1.5  # cars drive this far to the left of the middle of the street [m]


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A solid that goes along a line at one speed, and back again at its end.

    Args:
        solid: its shape and heights; x, y and yaw are those of the line, and its heights are
            counted from the ground.
        route: corners of the line [m], shape (n, 2), at least two.
        speed: [m/s], above 0.
        ahead: how far along the line it is at time 0 [m].

    Raises:
        ConfigError: the line has no length, or the speed is not above 0.
    """

    solid: Solid
    route: npt.NDArray[np.float64]
    speed: float
    ahead: float = 0.0

    def __post_init__(self) -> None:
        route = np.asarray(self.route, np.float64)
        object.__setattr__(self, "route", route)
        if route.ndim != 2 or route.shape[1] != 2 or len(route) < 2 or not self._length() > 0:
            raise ConfigError(f"Mover: a route has two points (x, y) or more, got {route.shape}")
        if not (math.isfinite(self.speed) and self.speed > 0 and math.isfinite(self.ahead)):
            raise ConfigError(
                f"Mover: the speed is above 0 m/s and ahead a length, got {self.speed}, "
                f"{self.ahead}"
            )

    def _length(self) -> float:
        return float(np.hypot(*np.diff(self.route, axis=0).T).sum())

    def at(self, time_s: float, ground: Ground | None = None) -> Solid:
        """Where it is.

        Args:
            time_s: time [s].
            ground: what it stands on; None: z = 0.
        """
        ways = np.diff(self.route, axis=0)
        corners = np.concatenate([[0.0], np.cumsum(np.hypot(*ways.T))])
        whole = corners[-1]
        gone = (self.ahead + self.speed * time_s) % (2 * whole)
        gone = min(gone, 2 * whole - gone)
        x, y = (float(np.interp(gone, corners, self.route[:, axis])) for axis in (0, 1))
        base = 0.0 if ground is None else float(ground.height(np.array([x]), np.array([y]))[0])
        heights = {"z_min": base + self.solid.z_min, "z_max": base + self.solid.z_max}
        if isinstance(self.solid, Cylinder):
            return dataclasses.replace(self.solid, x=x, y=y, **heights)
        k = min(int(np.searchsorted(corners, gone, side="right")) - 1, len(ways) - 1)
        yaw = math.atan2(ways[k, 1], ways[k, 0])
        return dataclasses.replace(self.solid, x=x, y=y, yaw=yaw, **heights)


@dataclass(frozen=True, slots=True)
class MovingWorld:
    """A world at rest, and what moves in it.

    Args:
        still: what does not move.
        movers: what does.
    """

    still: World3D
    movers: tuple[Mover, ...]

    def __init__(self, still: World3D, movers: Iterable[Mover]) -> None:
        object.__setattr__(self, "still", still)
        object.__setattr__(self, "movers", tuple(movers))

    def at(self, time_s: float) -> World3D:
        """The world as it is at that time [s]."""
        there = (mover.at(time_s, self.still.ground) for mover in self.movers)
        return World3D((*self.still.solids, *there), self.still.ground)

    def meets_movers(self, scan: Scan, time_s: float) -> BoolArray:
        """Which beams of a scan end at something that moves: the truth, shape (n,).

        Args:
            scan: taken in `at(time_s)`, with the pose that it was taken from.
            time_s: the time [s].

        Raises:
            InputError: the scan is not in space.
        """
        if scan.directions.shape[1] != 3:
            raise InputError("MovingWorld.meets_movers: a scan in space is needed, got one in 2D")
        pose = scan.map_from_sensor
        ways = scan.directions @ np.asarray(pose.rotation).T
        movers = World3D(mover.at(time_s, self.still.ground) for mover in self.movers)
        to_movers = movers.cast(pose.translation, ways)
        near = np.flatnonzero(np.isfinite(to_movers) & np.isfinite(scan.ranges))
        meets = np.zeros(len(ways), np.bool_)
        reach = float(to_movers[near].max(initial=1.0)) + 1.0
        to_still = self.still.cast(pose.translation, ways[near], reach=reach)
        meets[near] = to_movers[near] < to_still
        return meets


def traffic(seed: int = 0, *, walkers: int = 10, cars: int = 5) -> tuple[Mover, ...]:
    """Walkers and cars on the street of `drive3d`.

    Walkers cross it, or go along its sides; cars drive in the lane to the left of the sensor's, at
    7 m/s, half of them against its way.

    Args:
        seed: another number, others on their ways.
        walkers: how many walk.
        cars: how many drive.
    """
    rng = np.random.default_rng(seed)
    movers = []
    for k in range(walkers):
        where = rng.random()
        if k % 2:
            ways = on_lane(np.array([where, where]), np.array([-2.2, 2.2]))
        else:
            side = float(rng.choice([-1, 1]) * rng.uniform(1.8, 2.2))
            ways = on_lane(where + np.linspace(0.0, 0.15, 20), np.full(20, side))
        movers.append(Mover(_WALKER, ways, _WALKING * rng.uniform(0.7, 1.3), rng.uniform(0, 8)))
    lane = on_lane(np.linspace(0.0, 1.0, 200), np.full(200, -_LANE))
    for k in range(cars):
        way = lane[::-1] if k % 2 else lane
        movers.append(Mover(_CAR, way, _DRIVING * rng.uniform(0.8, 1.2), rng.uniform(0.0, 140.0)))
    return tuple(movers)
