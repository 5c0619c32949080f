# SPDX-License-Identifier: Apache-2.0
"""The likelihood field: how well the ends of beams lie on occupied cells, for many poses."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.kernels.query.pose_likelihoods import field_log_likelihoods
from oddsmap.limits import memory_limit
from oddsmap.odds import State
from oddsmap.query.given_numbers import check_numbers
from oddsmap.query.places import CellGrid
from oddsmap.query.pose_batches import over_poses
from oddsmap.query.scan_at_poses import Frame, Poses, PosesLike, ScanBeams
from oddsmap.scans.scan import Scan

__all__ = ["LikelihoodField"]

# Squared distances are kept in 16 bits.
_MOST_CELLS = 255
# Of the distances while they are worked out: a double, three numbers of 32 bits, and flags.
_BYTES = 24


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
        grid: the map.
        parts: its known cells, some at a time: index, shape (n, d), and state, shape (n,).
        frame: map_from_grid, if cells do not count from the map frame.
        range_max: readings from here on are no-returns [m].
        sigma_hit: standard deviation of d [m].
        z_hit: weight of ends at obstacles.
        z_rand: weight of random readings.
        max_distance: a larger distance counts as this [m].

    Raises:
        ConfigError: an argument is outside its range.
        MapTooLargeError: memory does not hold the box of occupied cells.
    """

    def __init__(
        self,
        grid: CellGrid,
        parts: Iterable[tuple[IntArray, npt.NDArray[np.int8]]],
        *,
        frame: Frame | None,
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
        if max_distance > _MOST_CELLS * grid.resolution:
            raise ConfigError(
                f"max_distance is at most {_MOST_CELLS} cells, {_MOST_CELLS * grid.resolution:g} m "
                f"here, got {max_distance}"
            )
        self.ndim, self.resolution, self.range_max = grid.ndim, grid.resolution, float(range_max)
        self._frame = frame
        cells = [index[state == State.OCCUPIED] for index, state in parts]
        occupied = np.concatenate([np.empty((0, grid.ndim), np.int64), *cells])
        squares = np.arange(math.floor((max_distance / grid.resolution) ** 2) + 1)
        d = np.append(np.sqrt(squares) * grid.resolution, max_distance)
        with np.errstate(divide="ignore"):
            self._log_p = np.log(z_hit * np.exp(-0.5 * (d / sigma_hit) ** 2) + z_rand / range_max)
        self._squared, self._lo, self._shape = _distances(occupied, len(squares))

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


def _distances(occupied: IntArray, far: int) -> tuple[npt.NDArray[np.uint16], IntArray, IntArray]:
    """Squared distances to the nearest occupied cell [cells], `far` where they reach that.

    Returns:
        The distances of a box around all cells nearer than that, flat, x fastest, its first cell
        and its cells along each axis, shape (3,).
    """
    from scipy.ndimage import distance_transform_edt

    if len(occupied) == 0:
        return np.empty(0, np.uint16), np.zeros(3, np.int64), np.zeros(3, np.int64)
    ndim, margin = occupied.shape[1], math.isqrt(far - 1)
    lo = occupied.min(axis=0) - margin
    shape = occupied.max(axis=0) + margin + 1 - lo
    needed = _BYTES * np.prod(shape.astype(np.float64))
    if needed > memory_limit():
        raise MapTooLargeError(
            f"a likelihood field of {' x '.join(map(str, shape.tolist()))} cells takes "
            f"{needed / 1e9:.3g} GB of memory (there are {memory_limit() / 1e9:.3g} GB): crop the "
            "map, or resample it to larger cells"
        )
    nothing = np.ones(shape[::-1], np.bool_)
    nothing[tuple((occupied - lo).T[::-1])] = False
    distance = distance_transform_edt(nothing)
    np.square(distance, out=distance)
    np.minimum(distance, far, out=distance)
    squared = np.rint(distance).astype(np.uint16).ravel()
    flat = [(0, 3 - ndim)]
    return squared, np.pad(lo, flat), np.pad(shape, flat, constant_values=1)
