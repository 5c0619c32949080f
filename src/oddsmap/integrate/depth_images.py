# SPDX-License-Identifier: Apache-2.0
"""Depth images into tiles by projection: free space from the image, hits from its points.

See docs/method-depth.md for what that approximates, and how well.
"""

from __future__ import annotations

import math
import threading
from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.integrate.rays3d import Integrator3D
from oddsmap.integrate.to_cells import check_size
from oddsmap.kernels.trace.clip_beams import BODY, HEIGHT, REASONS
from oddsmap.kernels.trace.readings import BELOW, NAN, NO_RETURN
from oddsmap.kernels.vote.depth_image import TEXEL_BITS, depth_box, mark_ends, mark_free, read_depth
from oddsmap.limits import MAX_COORDINATE
from oddsmap.poses.product import inverse
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import RaySensor
from oddsmap.sensors.filters import check_filters

__all__ = ["ProjectiveIntegrator"]


# Near a border of cells rounding decides: 2^-46 of the largest coordinate is some 100 roundings.
_ROUNDING = 2.0**-46
# A sum of three numbers is off by less than this share of the largest: 2^-53 each.
_SLACK = 1e-14
# Depths have been rounded to float32, by 2^-24 of them.
_WIDER = 1.0 + 2.0**-20


class ProjectiveIntegrator(Integrator3D):
    """Adds depth images to tiles, with memory of its own to mark in: one per thread.

    Args:
        evidence: the map whose resolution applies.
        sensor: the limits of range and the filters.
        tiles: where the votes go.
        lock: guards the tiles; one for all integrators that share them.

    Raises:
        ConfigError: the map or the sensor wants votes that projection cannot give.
    """

    def __init__(
        self, evidence: Evidence, sensor: RaySensor, tiles: TileStore, lock: threading.Lock
    ) -> None:
        if evidence.votes != "scan":
            raise ConfigError('method "projective" asks each cell once: it needs votes="scan"')
        for name in ("sigma", "fade", "half_width"):
            value = getattr(sensor.hit_shape, name)
            if value != 0.0:
                field, value = ("hit_width", 2 * value) if name == "half_width" else (name, value)
                raise ConfigError(
                    f'method "projective" gives one whole hit per beam: it needs sensor.{field} = '
                    f"0, got {value:g}"
                )
        if evidence.config.map.forgets:
            own = evidence.config.map
            name = "half_life" if own.half_life is not None else "half_life_scans"
            raise ConfigError(f'method "projective" gives whole votes: it takes no map.{name}')
        check_filters(3, sensor.heights, sensor.body, sensor.angle_window)
        super().__init__(evidence, sensor, tiles, lock)
        self._filters = np.isfinite(sensor.heights).any() or np.isfinite(sensor.body).all()
        self._camera: _Lookup | None = None

    def add(self, scans: Sequence[Measurement]) -> tuple[int, int, Counter[str]]:
        """Add a batch: returns images used, pixels used, and what was skipped by reason."""
        scan_count, used, skipped = 0, 0, Counter[str]()
        for scan in scans:
            if not isinstance(scan, DepthScan):
                raise InputError(
                    'method "projective" is for depth images (DepthScan), got '
                    f"{type(scan).__name__}: "
                    'use method "rays"'
                )
            pixels, reasons = self._add_image(scan)
            scan_count, used = scan_count + (pixels > 0), used + pixels
            skipped += reasons
        return scan_count, used, skipped

    def _add_image(self, scan: DepthScan) -> tuple[int, Counter[str]]:
        """Add one image; returns the pixels used, 0 where none could be."""
        pose, resolution = scan.map_from_sensor, self._resolution
        if not pose.is_finite:
            return 0, Counter({"scan.nan_pose": 1})
        if np.abs(pose.translation).max() >= MAX_COORDINATE * resolution:
            return 0, Counter({"scan.pose_too_far": 1})
        if self._camera is None or self._camera.camera != scan.camera:
            self._camera = _Lookup(scan.camera)
        image = self._camera
        depth = np.ascontiguousarray(scan.depth)
        if depth.dtype != np.float32:
            depth = depth.astype(np.float64)
        skipped = np.zeros(REASONS, np.int64)
        used = read_depth(
            depth, image.range_per_depth, self._sensor.limits,
            image.clear, image.seen, image.min_clear, image.max_clear, skipped,
        )  # fmt: skip
        reasons = Counter({"scan.empty": int(used == 0)})
        if used:
            self._mark_and_apply(depth, pose.rotation, pose.translation, image, skipped)
        return used, +(reasons + _reasons(skipped))

    def _mark_and_apply(
        self,
        depth: npt.NDArray[np.floating],
        rotation: FloatArray,
        origin: FloatArray,
        image: _Lookup,
        skipped: IntArray,
    ) -> None:
        camera, resolution, side = image.camera, self._resolution, self.tiles.side
        lo, hi = np.zeros(3), np.zeros(3)
        size = (camera.width, camera.height)
        block = resolution * side
        touched = depth_box(image.max_clear, image.intrinsics, size, rotation, block, lo, hi)
        lo, hi = (origin + _WIDER * lo) / resolution, (origin + _WIDER * hi) / resolution
        # A margin of one cell, for rounding.
        start, past = np.floor((np.floor(lo) - 1) / side), np.floor((np.floor(hi) + 1) / side) + 1
        check_size(
            np.zeros(1, np.int64), np.array([touched * side]), (past - start)[None] * side,
            resolution, side, self._max_cells,
        )  # fmt: skip
        tiles_lo, shape = start.astype(np.int64), (past - start).astype(np.int64)
        window = self._window
        window.open(int(shape.prod()))
        first = tiles_lo * side

        places = _places(image, rotation, origin / resolution, first, shape * side, resolution)
        slack = _SLACK * np.abs(places).max(axis=2).sum(axis=1)
        half = 0.5 * math.sqrt(3.0) * resolution
        while not mark_free(
            places, slack, half, image.clear, image.min_clear, image.max_clear, self._bits, shape,
            window.table, window.used, window.cells[0],
        ):  # fmt: skip
            window.grow(0)

        sensor = self._sensor
        farthest = float(np.abs([lo, hi]).max())
        margin = 1.0 if self._filters else 1e-9 + _ROUNDING * farthest
        codes = self._code_buffer(shape, (1, camera.width))[0]
        row = 0
        while row >= 0:
            row = mark_ends(
                depth, image.seen, image.x, image.y, rotation, origin, resolution,
                sensor.heights, sensor.body, first, self._bits,
                np.array([1, shape[0], shape[0] * shape[1]]), margin, codes,
                window.table, window.used, window.cells[0], skipped, row,
            )  # fmt: skip
            if row >= 0:
                window.grow(camera.width)
        self._apply(tiles_lo, shape)


class _Lookup:
    """What is the same for all images of a camera, and memory for one image."""

    def __init__(self, camera: PinholeCamera) -> None:
        self.camera = camera
        self.intrinsics = (camera.fx, camera.fy, camera.cx, camera.cy)
        self.range_per_depth = camera.range_per_depth
        self.x = (np.arange(camera.width, dtype=np.float64) - camera.cx) / camera.fx
        self.y = (np.arange(camera.height, dtype=np.float64) - camera.cy) / camera.fy
        size = (camera.height, camera.width)
        self.clear = np.zeros(size, np.float32)
        self.seen = np.zeros(size, np.uint8)
        texels = tuple(-(-n // (1 << TEXEL_BITS)) for n in size)
        levels = max(texels).bit_length() + 1
        self.min_clear = np.zeros((levels, *texels), np.float32)
        self.max_clear = np.zeros((levels, *texels), np.float32)


def _places(
    image: _Lookup,
    rotation: FloatArray,
    origin: FloatArray,
    first: IntArray,
    cells: IntArray,
    resolution: float,
) -> FloatArray:
    """Projections of the centres of a window's cells, see `mark_free`: one part for each axis."""
    fx, fy, cx, cy = image.intrinsics
    back = inverse(rotation)
    if back is None:
        raise InputError("a pose's rotation cannot be inverted: it is not a rotation")
    x, y, z = resolution * back
    u, v = fx * x + (cx + 0.5) * z, fy * y + (cy + 0.5) * z
    ways = np.stack([u, v, z, image.camera.width * z - u, image.camera.height * z - v])
    centres = first[:, None] + np.arange(int(cells.max())) + 0.5 - origin[:, None]
    return np.ascontiguousarray(ways[:, :, None] * centres)


def _reasons(skipped: IntArray) -> Counter[str]:
    return Counter(
        {
            "beam.nan": int(skipped[NAN]),
            "beam.below_range_min": int(skipped[BELOW]),
            "beam.no_return": int(skipped[NO_RETURN]),
            "hit.outside_heights": int(skipped[HEIGHT]),
            "hit.on_body": int(skipped[BODY]),
        }
    )
