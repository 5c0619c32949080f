# SPDX-License-Identifier: Apache-2.0
"""The likelihood field: how well the ends of beams lie on occupied cells, for many poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.kernels.query.distances import FAR, mark_cells
from oddsmap.kernels.query.pose_likelihoods import field_log_likelihoods
from oddsmap.limits import memory_limit
from oddsmap.odds import Thresholds
from oddsmap.query.boxes import Box
from oddsmap.query.given_numbers import check_numbers
from oddsmap.query.obstacles import Obstacles, View
from oddsmap.query.pose_batches import over_poses
from oddsmap.query.scan_at_poses import Poses, PosesLike, ScanBeams
from oddsmap.query.squared_distances import Squared, none_of, squared_to
from oddsmap.scans.scan import Scan
from oddsmap.short_repr import described, grid_facts, in_bytes

__all__ = ["LikelihoodField"]

# While distances are worked out: a mark and at most 8 bytes of a distance for each cell, and for
# each squared distance up to the largest its log likelihood and what that comes from.
_BYTES, _BYTES_OF_ROW = 9, 40


class LikelihoodField:
    """Distances to the nearest occupied cell at one moment, as a model of p(scan | map, pose).

    For each beam that returned, with d the distance from the middle of the cell that holds its end
    to the middle of the nearest occupied cell, exact, and at most `max_distance`:

        p = z_hit exp(-d^2 / (2 sigma_hit^2)) + z_rand / range_max

    The log likelihood of a scan is the sum of log p: beams are taken as independent. AMCL's plain
    model sums p^3 in place of that, "an ad hoc weighting scheme" by its own comment; this is what
    its `likelihood_field_prob` does. Beams that did not return are left out, and so are readings
    that carry no information.

    Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), table 6.3, without the factor of the
    normal distribution, as in AMCL (amcl_laser.cpp, LikelihoodFieldModelProb).

    Args:
        view: the map.
        thresholds: what is free and what is occupied; None: the view's.
        range_max: readings from here on are no-returns [m].
        sigma_hit: standard deviation of d [m].
        z_hit: weight of ends at obstacles.
        z_rand: weight of random readings.
        max_distance: a larger distance counts as this [m].

    Raises:
        ConfigError: an argument is outside its range.
        MapTooLargeError: memory does not hold the box of occupied cells.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        box = (self._lo[: self.ndim], (self._lo + self._shape)[: self.ndim])
        yield from grid_facts(self.ndim, self.resolution, None, box)
        yield f"range_max {self.range_max:g} m"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        view: View,
        *,
        thresholds: Thresholds | None,
        range_max: float,
        sigma_hit: float,
        z_hit: float,
        z_rand: float,
        max_distance: float,
    ) -> None:
        for name, value in (
            ("range_max", range_max),
            ("sigma_hit", sigma_hit),
            ("max_distance", max_distance),
        ):
            check_numbers(**{name: value})
            if not 0.0 < value < math.inf:
                raise ConfigError(f"{name} is a length above 0 [m], got {value}")
        if not (0.0 < z_hit < math.inf and 0.0 <= z_rand < math.inf):
            raise ConfigError(
                f"z_hit is a weight above 0 and z_rand one of 0 or more, got {z_hit} and {z_rand}"
            )
        cells = max_distance / view.resolution
        if cells >= FAR:
            raise ConfigError(
                f"max_distance is less than 2^30 cells, {FAR * view.resolution:g} m here, got "
                f"{max_distance}"
            )
        self.ndim, self.resolution, self.range_max = view.ndim, view.resolution, float(range_max)
        self._frame = view._map_from_cells()
        reach = math.floor(cells**2)
        occupied = Obstacles("occupied", thresholds).cells(view)
        box = _box_around(occupied, math.isqrt(reach), reach + 1)
        squares = np.arange(reach + 1 if box.size else 0)
        d = np.append(np.sqrt(squares) * view.resolution, max_distance)
        with np.errstate(divide="ignore"):
            self._log_p = np.log(z_hit * np.exp(-0.5 * (d / sigma_hit) ** 2) + z_rand / range_max)
        self._squared = _distances(occupied, box, reach)
        self._lo, self._shape = np.zeros(3, np.int64), np.ones(3, np.int64)
        self._lo[: self.ndim], self._shape[: self.ndim] = box.lo, box.hi - box.lo

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self._squared.nbytes + self._log_p.nbytes

    def log_likelihood(
        self,
        poses: PosesLike,
        scan: Scan,
        *,
        max_beams: int | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Log p(scan | map, pose) for each of many poses, not normalised.

        Args:
            poses: of the sensor in the map frame: x, y, yaw [m, m, rad], shape (n, 3), in a 3D map
                matrices [R | t], shape (n, 4, 4); or `Pose` objects.
            scan: its own pose is not looked at.
            max_beams: at most so many beams, evenly spaced; None: all.
            threads: how many; the result is the same.

        Returns:
            The sum of log p of its beams, shape (n,); 0 where none of them returned.

        Raises:
            InputError: poses of another shape, not finite or too far away, or a scan of another
                dimension.
            ConfigError: another argument is outside its range.
        """
        at = Poses.of(poses, self, self._frame)
        beams = ScanBeams.of(scan, self.ndim, max_beams)
        back = beams.ranges < self.range_max
        ends = beams.origins[back] + beams.directions[back] * beams.ranges[back, None]
        turns, places, points = _in_space(at, ends)

        def add_up(part: slice, out: FloatArray) -> None:
            field_log_likelihoods(
                self._squared, self._lo, self._shape, self.ndim == 3, self._log_p, self.resolution,
                turns[part], places[part], points, out,
            )  # fmt: skip

        return over_poses(len(at), len(ends), add_up, threads)


def _in_space(at: Poses, ends: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same in 3D: what is 2D lies at z = 0."""
    n, d = at.positions.shape
    if d == 3:
        return at.rotations, at.positions, ends
    turns = np.zeros((n, 3, 3))
    turns[:, :2, :2], turns[:, 2, 2] = at.rotations, 1.0
    return turns, np.pad(at.positions, ((0, 0), (0, 1))), np.pad(ends, ((0, 0), (0, 1)))


def _box_around(occupied: IntArray, margin: int, rows: int) -> Box:
    """The cells so near to an occupied one along each axis, in which distances have so many rows.

    Raises:
        MapTooLargeError: they do not fit in memory.
    """
    if len(occupied) == 0:
        return Box(*(np.zeros(occupied.shape[1], np.int64),) * 2)
    box = Box(occupied.min(axis=0), occupied.max(axis=0) + 1).wider(margin)
    needed, limit = _BYTES * box.size + _BYTES_OF_ROW * rows, memory_limit()
    if needed > limit:
        raise MapTooLargeError(
            f"a likelihood field of {' x '.join(map(str, box.shape[::-1]))} cells takes "
            f"{needed / 1e9:.3g} GB of memory (there are {limit / 1e9:.3g} GB): crop the map, "
            "resample it to larger cells, or give a smaller max_distance"
        )
    return box


def _distances(occupied: IntArray, box: Box, reach: int) -> Squared:
    """Squared distances of the cells of a box to the nearest occupied one [cells^2].

    Returns:
        At most `reach` + 1, flat, x fastest, in as few bytes as hold them.
    """
    mask = np.zeros(box.shape, np.uint8)
    ones = np.ones(len(occupied), np.uint8)
    mark_cells(occupied, ones, box.lo, box.hi, mask.reshape(-1))
    dtype = np.int32 if reach < none_of(np.int32) - 1 else np.int64
    squared = squared_to(mask, box, box, reach, dtype, 1) if box.size else np.empty(0, dtype)
    np.minimum(squared, reach + 1, out=squared)
    return squared.astype(np.uint16 if reach < none_of(np.uint16) else dtype, copy=False).ravel()
