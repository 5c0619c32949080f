# SPDX-License-Identifier: Apache-2.0
"""A world of upright solids on the ground: where a ray meets it, and what lies inside."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import InputError
from oddsmap.short_repr import short_repr
from oddsmap.simulate.solids import Ground, Solid

__all__ = ["World3D"]


# Rays are cast in blocks of this many: temporary arrays of 64 kB stay in the cache.
_BLOCK = 1 << 13

# On its way to a relief a ray moves at least this far at once [m]: a ray that grazes the ground
# ends after finitely many steps. A ridge whose top a ray cuts by less may be missed.
_SHORTEST_STEP = 0.02
# Halvings of the last step: 0.02 m / 2^34 is 1e-12 m.
_HALVINGS = 34

_NOT_UNIT = 1e-6


@dataclass(frozen=True, slots=True)
class World3D:
    """Solids on (or above, or partly in) the ground; they may touch and overlap.

    Args:
        solids: boxes and cylinders.
        ground: what is below; None: nothing.
    """

    solids: tuple[Solid, ...]
    ground: Ground | None
    _centres: FloatArray = field(init=False, repr=False, compare=False)
    _radii: FloatArray = field(init=False, repr=False, compare=False)

    __repr__ = short_repr

    def __init__(self, solids: Iterable[Solid], ground: Ground | None = None) -> None:
        things = tuple(solids)
        centres = [(s.x, s.y, (s.z_min + s.z_max) / 2) for s in things]
        radii = [math.hypot(s.radius, (s.z_max - s.z_min) / 2) for s in things]
        object.__setattr__(self, "solids", things)
        object.__setattr__(self, "ground", ground)
        object.__setattr__(self, "_centres", np.array(centres, dtype=np.float64).reshape(-1, 3))
        object.__setattr__(self, "_radii", np.array(radii, dtype=np.float64))

    def cast(
        self, origin: npt.ArrayLike, directions: npt.ArrayLike, *, reach: float = math.inf
    ) -> FloatArray:
        """Distance along each ray of one sensor to the first surface.

        From inside a solid, its surface is met from within; from below the ground the distance
        is 0.

        Args:
            origin: where the rays start [m], shape (3,).
            directions: unit vectors, shape (n, 3).
            reach: surfaces farther than this are not met [m].

        Returns:
            Distances [m], shape (n,); +Inf where no surface is met.

        Raises:
            InputError: another shape, an origin that is not finite, a direction that is not a
                unit vector, or a reach that is not above 0 (with a relief: not finite).
        """
        o, d = np.asarray(origin, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        if o.shape != (3,) or d.ndim != 2 or d.shape[1] != 3:
            raise InputError(
                "World3D.cast: an origin (3,) and directions (n, 3) are needed, "
                f"got {o.shape} and {d.shape}"
            )
        if not np.isfinite(o).all():
            raise InputError("World3D.cast: the origin is not finite")
        norms = np.sqrt((d * d).sum(axis=1))
        if not (np.abs(norms - 1.0) <= _NOT_UNIT).all():  # NaN fails as well
            bad = int(np.flatnonzero(~(np.abs(norms - 1.0) <= _NOT_UNIT))[0])
            raise InputError(
                f"World3D.cast: direction {bad} has length {norms[bad]:.6g}: give unit vectors"
            )
        endless = self.ground is not None and bool(self.ground.waves) and math.isinf(reach)
        if not reach > 0 or endless:
            raise InputError(
                f"World3D.cast: reach must be above 0 m (finite over a relief): {reach}"
            )
        near = self._near_to_far(o, reach)
        distances = np.empty(len(d))
        for i in range(0, len(d), _BLOCK):
            block = d[i : i + _BLOCK]
            best = np.full(len(block), np.inf)
            for k in near:
                self._meet(k, o, block, best)
            if self.ground is not None:
                _meet_ground(self.ground, o, block, best, reach)
            distances[i : i + _BLOCK] = np.where(best <= reach, best, np.inf)
        return distances

    def contains(self, points: npt.ArrayLike) -> BoolArray:
        """Whether each point lies inside a solid or below the ground; surfaces are outside.

        Args:
            points: [m], shape (n, 3).

        Returns:
            True inside, shape (n,).

        Raises:
            InputError: another shape, or a point that is not finite.
        """
        p = np.asarray(points, dtype=np.float64)
        if p.ndim != 2 or p.shape[1] != 3:
            raise InputError(f"World3D.contains: points (n, 3) are needed, got {p.shape}")
        if not np.isfinite(p).all():
            raise InputError("World3D.contains: a point is not finite")
        inside = np.zeros(len(p), dtype=np.bool_)
        if self.ground is not None:
            inside |= p[:, 2] < self.ground.height(p[:, 0], p[:, 1])
        for solid in self.solids:
            level = np.flatnonzero((p[:, 2] > solid.z_min) & (p[:, 2] < solid.z_max))
            inside[level] |= solid.outline_contains(p[level, :2])
        return inside

    def _near_to_far(self, o: FloatArray, reach: float) -> list[int]:
        gaps = np.sqrt(((self._centres - o) ** 2).sum(axis=1)) - self._radii
        order = np.argsort(gaps, kind="stable")
        return [int(k) for k in order if gaps[k] <= reach]

    def _meet(self, k: int, o: FloatArray, d: FloatArray, best: FloatArray) -> None:
        """Shorten the rays that meet solid k before anything else.

        Few rays come near the ball around any one solid, and of those some end before it: the
        rest is not looked at, which saves nine tenths of the time.
        """
        to, radius = self._centres[k] - o, self._radii[k]
        along = d[:, 0] * to[0] + d[:, 1] * to[1] + d[:, 2] * to[2]
        room = radius**2 * (1 + 1e-9) - float(to @ to)
        rays = np.flatnonzero(
            (along * along + room >= 0.0) & (along >= -radius) & (along - radius <= best)
        )
        if not len(rays):
            return
        t = _to_solid(self.solids[k], o, d[rays])
        best[rays] = np.minimum(best[rays], t)


def _to_solid(solid: Solid, o: FloatArray, d: FloatArray) -> FloatArray:
    """Distance of n rays to one solid [m]: the part of the ray in its outline and its heights."""
    enter, leave = solid.outline_interval(o[None, :2], d[:, :2])
    dz = d[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (solid.z_min - o[2]) / dz, (solid.z_max - o[2]) / dz
    level = dz == 0.0
    if level.any():
        between = solid.z_min <= o[2] <= solid.z_max
        one = np.where(level, -np.inf if between else np.inf, one)
        other = np.where(level, np.inf, other)
    enter = np.maximum(enter, np.minimum(one, other))
    leave = np.minimum(leave, np.maximum(one, other))
    met = (enter <= leave) & (leave >= 0.0)
    return np.where(met, np.where(enter >= 0.0, enter, leave), np.inf)


def _meet_ground(
    ground: Ground, o: FloatArray, d: FloatArray, best: FloatArray, reach: float
) -> None:
    """Shorten the rays that meet the ground before anything else."""
    if o[2] <= ground.height(o[0:1], o[1:2])[0]:
        best[:] = 0.0
        return
    if not ground.waves:
        down = np.flatnonzero(d[:, 2] < 0.0)
        best[down] = np.minimum(best[down], (ground.z - o[2]) / d[down, 2])
        return
    # Above the highest crest there is nothing to look for, nor behind the nearest solid.
    top = ground.z + ground.relief
    dz = d[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        to_top = (top - o[2]) / dz
    start = np.where((o[2] > top) & (dz < 0.0), to_top, 0.0)
    stop = np.minimum(best, reach)
    stop = np.where((o[2] < top) & (dz > 0.0), np.minimum(stop, to_top), stop)
    rays = np.flatnonzero(((o[2] <= top) | (dz < 0.0)) & (start <= stop))
    found = _walk_to_relief(ground, o, d[rays], start[rays], stop[rays])
    best[rays] = np.minimum(best[rays], found)


def _walk_to_relief(
    ground: Ground, o: FloatArray, d: FloatArray, start: FloatArray, stop: FloatArray
) -> FloatArray:
    """Walk along rays in steps that the steepest slope allows; halve the step that goes below.

    Source: J. C. Hart, "Sphere tracing" (1996), with the bound of a height field.
    """
    found = np.full(len(d), np.inf)
    sinking = ground.steepest * np.hypot(d[:, 0], d[:, 1]) - d[:, 2]
    rays, t = np.arange(len(d)), start.copy()
    above = _clearance(ground, o, d, t)
    low, high, below = [], [], []
    while len(rays):
        rate = sinking[rays]
        # A ray that climbs faster than any slope never comes down.
        with np.errstate(divide="ignore"):
            step = np.where(rate > 0.0, np.maximum(above / rate, 0.0), np.inf)
        ahead = t + np.maximum(step, _SHORTEST_STEP)
        inside = np.minimum(ahead, stop[rays])
        above = _clearance(ground, o, d[rays], inside)
        hit = above <= 0.0
        low.append(t[hit])
        high.append(inside[hit])
        below.append(rays[hit])
        go_on = ~hit & (ahead < stop[rays])
        rays, t, above = rays[go_on], inside[go_on], above[go_on]
    if low:
        which = np.concatenate(below)
        found[which] = _halve(ground, o, d[which], np.concatenate(low), np.concatenate(high))
    return found


def _halve(
    ground: Ground, o: FloatArray, d: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        under = _clearance(ground, o, d, middle) <= 0.0
        low, high = np.where(under, low, middle), np.where(under, middle, high)
    return (low + high) / 2


def _clearance(ground: Ground, o: FloatArray, d: FloatArray, t: FloatArray) -> FloatArray:
    """Height of the points at t above the ground [m]."""
    x, y, z = (o[axis] + d[:, axis] * t for axis in range(3))
    return np.asarray(z - ground.height(x, y))
