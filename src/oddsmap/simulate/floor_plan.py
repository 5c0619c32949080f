# SPDX-License-Identifier: Apache-2.0
"""A plan of solid obstacles: where a ray meets them, what lies inside, and the true grid."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import InputError
from oddsmap.short_repr import short_repr
from oddsmap.simulate.shapes import Disc, Shape

__all__ = ["FloorPlan"]


# Both ends of an edge are drawn out by this part of its length, so that rounding opens no gap
# between two edges that share a corner.
_OVERLAP = 1e-9

# Rays are cast in blocks of about this many (ray, edge) pairs: 0.5 MB for each temporary array
# stays in the cache.
_PAIRS_PER_BLOCK = 1 << 16

_NOT_UNIT = 1e-6


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """Solid 2D obstacles; they may touch and overlap, and the rest is free.

    Args:
        obstacles: rectangles, discs and polygons; see also `walls_around`.
    """

    obstacles: tuple[Shape, ...]
    _starts: FloatArray = field(init=False, repr=False, compare=False)
    _edges: FloatArray = field(init=False, repr=False, compare=False)
    _discs: FloatArray = field(init=False, repr=False, compare=False)

    __repr__ = short_repr

    def __init__(self, obstacles: Iterable[Shape]) -> None:
        shapes = tuple(obstacles)
        rings = [shape.vertices for shape in shapes if not isinstance(shape, Disc)]
        discs = [(shape.x, shape.y, shape.radius) for shape in shapes if isinstance(shape, Disc)]
        starts = np.concatenate([*rings, np.empty((0, 2))])
        ends = np.concatenate([*(np.roll(ring, -1, axis=0) for ring in rings), np.empty((0, 2))])
        object.__setattr__(self, "obstacles", shapes)
        object.__setattr__(self, "_starts", starts)
        object.__setattr__(self, "_edges", ends - starts)
        object.__setattr__(self, "_discs", np.array(discs, dtype=np.float64).reshape(-1, 3))

    def cast(self, origins: npt.ArrayLike, directions: npt.ArrayLike) -> FloatArray:
        """Distance along each ray to the first surface.

        A surface that is touched counts as met. From inside an obstacle, the surface is met
        from within.

        Args:
            origins: where the rays start [m], shape (n, 2), or (2,) for all of them.
            directions: unit vectors, shape (n, 2).

        Returns:
            Distances [m], shape (n,); +Inf where no surface is met.

        Raises:
            InputError: another shape, an origin that is not finite, or a direction that is not a
                unit vector.
        """
        d = np.asarray(directions, dtype=np.float64)
        o = np.asarray(origins, dtype=np.float64)
        if d.ndim != 2 or d.shape[1] != 2 or o.shape not in (d.shape, (2,)):
            raise InputError(
                "FloorPlan.cast: origins (n, 2) or (2,) and directions (n, 2) are needed, "
                f"got {o.shape} and {d.shape}"
            )
        if not np.isfinite(o).all():
            raise InputError("FloorPlan.cast: an origin is not finite")
        norms = np.hypot(d[:, 0], d[:, 1])
        if not (np.abs(norms - 1.0) <= _NOT_UNIT).all():  # NaN fails as well
            bad = int(np.flatnonzero(~(np.abs(norms - 1.0) <= _NOT_UNIT))[0])
            raise InputError(
                f"FloorPlan.cast: direction {bad} has length {norms[bad]:.6g}: give unit vectors"
            )
        o = np.broadcast_to(o, d.shape)
        distances = np.empty(len(d))
        rays = max(1, _PAIRS_PER_BLOCK // max(1, len(self._edges) + len(self._discs)))
        for i in range(0, len(d), rays):
            block = slice(i, i + rays)
            to_edge = _to_edges(o[block], d[block], self._starts, self._edges)
            to_disc = _to_discs(o[block], d[block], self._discs)
            distances[block] = np.minimum(to_edge, to_disc)
        return distances

    def contains(self, points: npt.ArrayLike) -> BoolArray:
        """Whether each point lies inside an obstacle.

        On the outline of a rectangle, the left and lower sides are inside and the right and
        upper ones outside, as for cells; a disc is inside where the distance is below its radius.

        Args:
            points: [m], shape (n, 2).

        Returns:
            True inside, shape (n,).

        Raises:
            InputError: another shape, or a point that is not finite.
        """
        p = np.asarray(points, dtype=np.float64)
        if p.ndim != 2 or p.shape[1] != 2:
            raise InputError(f"FloorPlan.contains: points (n, 2) are needed, got {p.shape}")
        if not np.isfinite(p).all():
            raise InputError("FloorPlan.contains: a point is not finite")
        inside = np.zeros(len(p), dtype=np.bool_)
        for shape in self.obstacles:
            if isinstance(shape, Disc):
                inside |= np.hypot(p[:, 0] - shape.x, p[:, 1] - shape.y) < shape.radius
                continue
            # Few points are near any one shape: this saves nine tenths of the time.
            ring = shape.vertices
            near = np.flatnonzero(((p >= ring.min(axis=0)) & (p <= ring.max(axis=0))).all(axis=1))
            if len(near):
                inside[near] |= _inside_ring(p[near], ring)
        return inside

    def rasterise(
        self,
        resolution: float,
        first_cell: tuple[int, int],
        end_cell: tuple[int, int],
        *,
        samples: int = 1,
    ) -> BoolArray:
        """The true grid: which cells are occupied.

        A cell (ix, iy) covers [ix*r, (ix+1)*r) in x and [iy*r, (iy+1)*r) in y. It is occupied
        where its centre lies inside an obstacle; with `samples` = s, where any of the centres
        of its s x s equal parts does.

        Args:
            resolution: side r of a cell [m].
            first_cell: (ix, iy) of the lower left cell.
            end_cell: (ix, iy) one beyond the upper right cell.
            samples: parts of a cell looked at, along each axis.

        Returns:
            True for occupied, shape (rows, columns): row 0 is the lowest y, column 0 the lowest x.

        Raises:
            InputError: a resolution or `samples` that is not positive, or a window without cells.
        """
        if not (math.isfinite(resolution) and resolution > 0):
            raise InputError(f"rasterise: resolution must be positive [m], got {resolution}")
        if samples < 1:
            raise InputError(f"rasterise: samples must be at least 1, got {samples}")
        columns, rows = end_cell[0] - first_cell[0], end_cell[1] - first_cell[1]
        if columns < 1 or rows < 1:
            raise InputError(
                f"rasterise: end_cell must lie beyond first_cell, got {first_cell} to {end_cell}"
            )
        x = _sample_points(first_cell[0], columns, samples) * resolution
        y = _sample_points(first_cell[1], rows, samples) * resolution
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        inside = self.contains(points).reshape(rows, samples, columns, samples)
        return np.asarray(inside.any(axis=(1, 3)))


def _sample_points(first: int, count: int, samples: int) -> FloatArray:
    """Sample points along one axis, in cells."""
    return first + (np.arange(count * samples) + 0.5) / samples


def _to_edges(o: FloatArray, d: FloatArray, starts: FloatArray, edges: FloatArray) -> FloatArray:
    """Distance of n rays to the nearest of m edges [m], shape (n,).

    Solves o + t*d = start + u*edge for every pair with Cramer's rule.
    """
    if not len(edges):
        return np.full(len(o), np.inf)
    dx, dy = d[:, :1], d[:, 1:]
    gap_x = starts[:, 0] - o[:, :1]
    gap_y = starts[:, 1] - o[:, 1:]
    edge_x, edge_y = edges[:, 0], edges[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (dx * edge_y - dy * edge_x)
        t = (gap_x * edge_y - gap_y * edge_x) * scale
        u = (gap_x * dy - gap_y * dx) * scale
        # Parallel pairs give NaN or Inf in u and meet nothing; the edges next to them do.
        met = (t >= 0.0) & (u >= -_OVERLAP) & (u <= 1.0 + _OVERLAP)
    return np.asarray(np.where(met, t, np.inf).min(axis=1))


def _to_discs(o: FloatArray, d: FloatArray, discs: FloatArray) -> FloatArray:
    """Distance of n rays to the nearest of m discs [m], shape (n,)."""
    if not len(discs):
        return np.full(len(o), np.inf)
    gap_x = discs[:, 0] - o[:, :1]
    gap_y = discs[:, 1] - o[:, 1:]
    along = gap_x * d[:, :1] + gap_y * d[:, 1:]
    across = gap_x * d[:, 1:] - gap_y * d[:, :1]
    half_chord = np.sqrt(np.maximum(discs[:, 2] ** 2 - across**2, 0.0))
    near, far = along - half_chord, along + half_chord
    t = np.where(near >= 0.0, near, far)
    met = (np.abs(across) <= discs[:, 2]) & (t >= 0.0)
    return np.asarray(np.where(met, t, np.inf).min(axis=1))


def _inside_ring(points: FloatArray, ring: FloatArray) -> BoolArray:
    """Even-odd rule: a ray to the right of an inner point crosses the ring an odd number of times.

    Source: Shimrat, "Algorithm 112: position of point relative to polygon", CACM 5 (1962).
    """
    x, y = points.T
    inside = np.zeros(len(points), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(ring.tolist(), np.roll(ring, -1, axis=0).tolist(), strict=True):
        if ay != by:
            crosses = (y < ay) != (y < by)
            inside ^= crosses & (x < ax + (y - ay) * ((bx - ax) / (by - ay)))
    return inside
