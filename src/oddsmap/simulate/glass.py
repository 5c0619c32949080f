# SPDX-License-Identifier: Apache-2.0
"""Glass and leaves: surfaces that return only some of the beams that meet them.

Each cell of a surface has a reflectivity, the chance that it returns a beam which reaches it, drawn
anew for each beam and each cell: what a reflection map estimates. Where a cell returns a beam the
range is taken from geometry, half way through the cell, and not from range bins, so that an
estimator is not tried on its own assumptions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.scans.scan import Scan

__all__ = ["GlassScene", "GlassSensor", "glass_path", "glass_scene"]


_RESOLUTION = 0.1
# Blocks of 16 cells with an obstacle each, lanes of 8 cells around them.
_BLOCK, _LANE = 16, 8
_BLOCKS = (3, 2)
_REFLECTIVITIES = (0.15, 0.3, 0.6, 1.0, 0.15, 0.3)


@dataclass(frozen=True, slots=True, eq=False)
class GlassScene:
    """Cells and their reflectivities.

    Args:
        reflectivity: chance that a cell returns a beam that reaches it, 0 where there is nothing,
            shape (ny, nx); cell (0, 0) lies at the map's origin.
        resolution: side of a cell [m].

    Raises:
        InputError: no grid, a value outside [0, 1], or a resolution that is not positive.
    """

    reflectivity: FloatArray
    resolution: float

    def __post_init__(self) -> None:
        value = np.ascontiguousarray(self.reflectivity, dtype=np.float64)
        if value.ndim != 2 or not ((value >= 0.0) & (value <= 1.0)).all():
            raise InputError(
                f"a scene's reflectivities lie between 0 and 1, in a grid (ny, nx); got shape "
                f"{value.shape}"
            )
        if not 0.0 < self.resolution < math.inf:
            raise InputError(f"a scene needs a positive resolution [m], got {self.resolution}")
        object.__setattr__(self, "reflectivity", value)

    @property
    def surface(self) -> BoolArray:
        """True where a cell returns any beams, shape (ny, nx)."""
        return self.reflectivity > 0.0


def glass_scene(seed: int = 0) -> GlassScene:
    """A hall of 8 x 5.6 m with solid walls and six obstacles of glass, leaves or concrete.

    Each obstacle is a wall or the outline of a rectangle, one cell of 0.1 m thick, somewhere in
    its block of 1.6 x 1.6 m; in shuffled order their reflectivities are 0.15, 0.3, 0.6, 1, 0.15
    and 0.3. The lanes between the blocks are free.

    Args:
        seed: of the places, sizes and order.
    """
    rng = np.random.default_rng(seed)
    nx, ny = (count * (_BLOCK + _LANE) + _LANE for count in _BLOCKS)
    grid = np.zeros((ny, nx))
    grid[[0, -1], :] = 1.0
    grid[:, [0, -1]] = 1.0
    for number, reflectivity in enumerate(rng.permutation(_REFLECTIVITIES)):
        row, column = divmod(number, _BLOCKS[0])
        size = rng.integers(6, _BLOCK - 1, 2)
        # Every other one is a wall, along x or along y.
        if number % 2:
            size[rng.integers(2)] = 1
        x, y = (
            _LANE + block * (_BLOCK + _LANE) + int(rng.integers(1, _BLOCK - cells))
            for block, cells in zip((column, row), size, strict=True)
        )
        outline = grid[y : y + size[1], x : x + size[0]]
        outline[[0, -1], :] = reflectivity
        outline[:, [0, -1]] = reflectivity
    return GlassScene(grid, _RESOLUTION)


def glass_path(pose_count: int = 120, seed: int = 0) -> tuple[Pose2, ...]:
    """Poses along the lanes of `glass_scene`, at equal steps, turning at random.

    Args:
        pose_count: poses.
        seed: of the directions that the robot looks in.

    Raises:
        ConfigError: no pose.
    """
    if pose_count < 1:
        raise ConfigError(f"glass_path: pose_count must be at least 1, got {pose_count}")
    step = _BLOCK + _LANE
    xs, ys = (_RESOLUTION * (np.arange(n + 1) * step + _LANE / 2) for n in _BLOCKS)
    # Up and down the lanes between the blocks, then around them.
    corners = [(0, 0), (0, 2), (1, 2), (1, 0), (2, 0), (2, 2), (3, 2), (3, 0), (0, 0), (0, 1),
               (3, 1), (3, 2), (0, 2)]  # fmt: skip
    places = np.array([(xs[i], ys[j]) for i, j in corners])
    lengths = np.hypot(*np.diff(places, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    at = (np.arange(pose_count) + 0.5) / pose_count * along[-1]
    yaws = np.random.default_rng(seed).uniform(-math.pi, math.pi, pose_count)
    return tuple(
        Pose2(float(np.interp(s, along, places[:, 0])), float(np.interp(s, along, places[:, 1])),
              float(yaw))
        for s, yaw in zip(at, yaws, strict=True)
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class GlassSensor:
    """A ring of beams, narrow (a lidar) or wide (sonars), that may pass through what they meet.

    A beam meets each cell of a surface along one ray. For a cell that lies wholly in the cone it
    is a ray at random through the cell; where the cone or the cell is cut by the other, a ray at
    random through the narrower of the two, and the cell is met if the ray lies in the other one
    also (a beam narrower than the cells is one ray for all of them). A cell that is met returns
    the beam with its reflectivity, independently of all others, from half way along the ray's
    path inside it. The nearest return plus Gaussian noise is the reading; +Inf where there is
    none below range_max.

    Args:
        beam_count: beams in the ring, the first along the x axis, the others anticlockwise.
        cone_deg: full opening angle of each [deg], 0 (a ray) to 90.
        range_max: every reading is below it, or +Inf [m].
        sigma: standard deviation of the noise [m].

    Raises:
        ConfigError: a parameter outside its range.
    """

    beam_count: int
    cone_deg: float
    range_max: float
    sigma: float

    def __post_init__(self) -> None:
        if self.beam_count < 1:
            raise ConfigError(f"GlassSensor: beam_count is 1 or more, got {self.beam_count}")
        if not 0.0 <= self.cone_deg <= 90.0:
            raise ConfigError(f"GlassSensor: cone_deg lies between 0 and 90, got {self.cone_deg}")
        if not 0.0 < self.range_max < math.inf:
            raise ConfigError(f"GlassSensor: range_max is a length above 0 m, got {self.range_max}")
        if not 0.0 <= self.sigma < math.inf:
            raise ConfigError(f"GlassSensor: sigma is a length of 0 m or more, got {self.sigma}")

    @classmethod
    def lidar(cls) -> GlassSensor:
        """90 beams of half a degree, noise 0.01 m, up to 8 m."""
        return cls(beam_count=90, cone_deg=0.5, range_max=8.0, sigma=0.01)

    @classmethod
    def sonar(cls) -> GlassSensor:
        """24 cones of 15 degrees, noise 0.03 m, up to 4 m."""
        return cls(beam_count=24, cone_deg=15.0, range_max=4.0, sigma=0.03)

    @property
    def directions(self) -> FloatArray:
        """Unit vectors in the sensor frame, shape (beam_count, 2)."""
        angles = 2.0 * math.pi / self.beam_count * np.arange(self.beam_count)
        return np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def scan(
        self,
        scene: GlassScene,
        pose: Pose2,
        rng: np.random.Generator,
        *,
        stamp_ns: int | None = None,
    ) -> Scan:
        """Take one scan; the same generator state gives the same scan.

        Args:
            scene: what is there.
            pose: of the sensor in the map frame.
            rng: where the chance comes from.
            stamp_ns: time of the scan [ns], handed on.

        Returns:
            The scan, ranges [m], shape (beam_count,).

        Raises:
            InputError: the pose is not finite, or in a surface's cell.
        """
        if not pose.is_finite:
            raise InputError(f"GlassSensor.scan: the pose is not finite: {pose}")
        row, column = np.nonzero(scene.surface)
        low = np.stack([column, row], axis=1) * scene.resolution - pose.translation
        high = low + scene.resolution
        if ((low <= 0.0) & (high >= 0.0)).all(axis=1).any():
            raise InputError(
                f"the sensor at ({pose.translation[0]:.3f}, {pose.translation[1]:.3f}) stands in "
                "a surface: move it to free space"
            )
        # Each cell as seen from the sensor: middle direction and half extent.
        corners = np.stack([low, high], axis=2)
        x, y = corners[:, 0, [0, 0, 1, 1]], corners[:, 1, [0, 1, 0, 1]]
        centre = np.arctan2(y.mean(axis=1), x.mean(axis=1))
        off = _turned(np.arctan2(y, x) - centre[:, None])
        middle, extent = centre + (off.max(1) + off.min(1)) / 2, np.ptp(off, axis=1) / 2
        half = math.radians(self.cone_deg) / 2
        axes = self.directions @ pose.rotation.T
        n, cells = self.beam_count, len(row)
        axis = np.arctan2(axes[:, 1], axes[:, 0])[:, None]
        in_cone = axis + half * rng.uniform(-1.0, 1.0, (n, 1))
        in_cell = middle + extent * rng.uniform(-1.0, 1.0, (n, cells))
        ray = np.where(extent < half, in_cell, in_cone)
        met = (np.abs(_turned(ray - axis)) <= half + 1e-12) & (
            np.abs(_turned(ray - middle)) <= extent + 1e-12
        )
        returned = met & (rng.random((n, cells)) < scene.reflectivity[row, column])
        ranges = np.where(returned, _half_way(low, high, ray), np.inf).min(axis=1, initial=np.inf)
        ranges = np.maximum(ranges + self.sigma * rng.standard_normal(n), 0.0)
        ranges[ranges >= self.range_max] = np.inf
        return Scan(pose, self.directions, ranges, stamp_ns)


def _turned(angle: FloatArray) -> FloatArray:
    # The same angle between -pi and pi.
    return np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi


def _half_way(low: FloatArray, high: FloatArray, ray: FloatArray) -> FloatArray:
    # Distance to the middle of each ray's path in each cell, shape (beams, cells).
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.stack([np.cos(ray), np.sin(ray)], axis=2)
        one, other = low / way, high / way
    enter = np.fmax.reduce(np.fmin(one, other), axis=2)
    leave = np.fmin.reduce(np.fmax(one, other), axis=2)
    return np.asarray((enter + leave) / 2)
