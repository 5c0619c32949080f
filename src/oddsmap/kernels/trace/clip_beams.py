# SPDX-License-Identifier: Apache-2.0
"""Readings to end points, for scans of any dimension.

One pass over the beams in place of a dozen NumPy passes: 10 ns per beam instead of 110, which was
as much as the mapping itself. The readable version is in tests/naive/beams.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.trace.readings import CLEARS, NAN, SEEN, Limits, judge

__all__ = ["BODY", "HEIGHT", "REASONS", "ScanCells", "cell_bounds", "cut_beams"]

HEIGHT, BODY, REASONS = 4, 5, 6
"""Why a hit is skipped: outside the heights that may mark, or on the robot's own body. In the
counts, of which there are REASONS, they follow why a beam is: NAN, BELOW, NO_RETURN and ZERO of
`readings.py`."""

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class ScanCells(NamedTuple):
    """A batch of scans of m segments in all, coordinates in cells (position / resolution).

    A scan is one bundle of segments, or several that start in different places.
    """

    origins: FloatArray
    """Where each bundle starts, shape (bundles, d)."""
    bundles: IntArray
    """First bundle of each scan and the end, shape (scans + 1,)."""
    offsets: IntArray
    """First segment of each bundle and the end, shape (bundles + 1,)."""
    ends: FloatArray
    """Where the free part of each segment ends, shape (m, d): its cell gets no pass."""
    tips: FloatArray
    """Where the occupied part ends, shape (m, d); equal to `ends` for one occupied cell."""
    fades: FloatArray
    """Where passes begin to fade, shape (m, d); equal to `ends` where they do not."""
    hit: npt.NDArray[np.bool_]
    """False where nothing was seen and the segment only clears, shape (m,)."""
    tiles_lo: IntArray
    """First tile of each scan's window, shape (scans, d)."""
    tiles_hi: IntArray
    """Past its last tile, shape (scans, d)."""


@borrowing
def cut_beams(
    ranges: FloatArray,
    vectors: FloatArray,
    told: FloatArray,
    shared: bool,
    measured: npt.NDArray[np.bool_],
    starts: npt.NDArray[np.int64],
    origins: FloatArray,
    rotations: FloatArray,
    shifts: FloatArray,
    limits: Limits,
    half_width: float,
    fade: float,
    heights: tuple[float, float],
    body: FloatArray,
    ends: FloatArray,
    tips: FloatArray,
    fades: FloatArray,
    hit: npt.NDArray[np.bool_],
    offsets: npt.NDArray[np.int64],
    skipped: npt.NDArray[np.int64],
) -> None:
    """Sort the beams of some scans and give each usable one its end points in the map frame [m].

    Args:
        ranges: all readings [m], shape (n,).
        vectors: unit vectors along the beams in the sensor frame, or where they end [m], shape
            (n, d), or one bundle's if `shared`.
        told: the same in the frame that the body is told in, the sensor's at the time of a beam.
        shared: True where every bundle has the same vectors.
        measured: True where a bundle's vectors are the points that the sensor gave, shape
            (bundles,): a range times a unit vector is rounded, and may miss a border of cells.
        starts: first beam of each bundle and the end, shape (bundles + 1,).
        origins: where bundles start [m], shape (bundles, d).
        rotations: map_from_sensor, shape (bundles, d, d).
        shifts: where bundles start in the frame of `told` [m], shape (bundles, d).
        limits: see `judge`.
        half_width: half the length of the occupied region [m].
        fade: the way before that region over which passes fade [m].
        heights: lowest and highest z in the map frame at which a return marks [m]; 3D only.
        body: lowest and highest corner of the robot's body in the sensor frame [m], shape (2, 3): a
            return in this box does not mark; in 2D its heights are infinite.
        ends: where the free part ends, shape (n, d), the first offsets[-1] rows are filled.
        tips: where the occupied part ends; may be `ends` itself where half_width is 0.
        fades: where passes begin to fade; may be `ends` itself where fade is 0.
        hit: False where the beam only clears, shape (n,).
        offsets: first usable beam of each bundle and the end, shape (bundles + 1,).
        skipped: counts by NAN, BELOW, NO_RETURN, ZERO, HEIGHT, BODY, added to.
    """
    # Scalars for three axes, the third of which is idle in 2D: loops over axes of a length
    # known only at run time cost three times as much.
    in_3d = origins.shape[1] == 3
    filtered = in_3d or body[0, 0] <= body[1, 0]
    used = 0
    offsets[0] = 0
    ox, oy, oz = 0.0, 0.0, 0.0
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    dz, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    for bundle in range(origins.shape[0]):
        ox, oy = origins[bundle, 0], origins[bundle, 1]
        sx, sy = shifts[bundle, 0], shifts[bundle, 1]
        xx, xy = rotations[bundle, 0, 0], rotations[bundle, 0, 1]
        yx, yy = rotations[bundle, 1, 0], rotations[bundle, 1, 1]
        if in_3d:
            oz = origins[bundle, 2]
            sz = shifts[bundle, 2]
            xz, yz = rotations[bundle, 0, 2], rotations[bundle, 1, 2]
            zx, zy, zz = rotations[bundle, 2, 0], rotations[bundle, 2, 1], rotations[bundle, 2, 2]
        start = starts[bundle] if shared else 0
        for i in range(starts[bundle], starts[bundle + 1]):
            reading = ranges[i]
            verdict, reach = judge(reading, limits)
            if verdict < CLEARS:
                skipped[verdict] += 1
                continue
            seen = verdict == SEEN
            dx, dy = vectors[i - start, 0], vectors[i - start, 1]
            rx, ry, rz = xx * dx + xy * dy, yx * dx + yy * dy, 0.0
            if in_3d:
                dz = vectors[i - start, 2]
                rx, ry, rz = rx + xz * dz, ry + yz * dz, zx * dx + zy * dy + zz * dz
            if not math.isfinite(rx + ry + rz):
                skipped[NAN] += 1
                continue
            half = half_width if seen else 0.0
            # How many vectors to go: of points exactly 1 to the return.
            length = reading if measured[bundle] else 1.0
            near = max(reach - half, 0.0) / length
            ends[used, 0], ends[used, 1] = ox + rx * near, oy + ry * near
            if in_3d:
                ends[used, 2] = oz + rz * near
            if fade > 0.0:
                begin = max(near - fade / length, 0.0) if seen else near
                fades[used, 0], fades[used, 1] = ox + rx * begin, oy + ry * begin
                if in_3d:
                    fades[used, 2] = oz + rz * begin
            if half_width > 0.0:
                far = (reach + half) / length
                tips[used, 0], tips[used, 1] = ox + rx * far, oy + ry * far
                if in_3d:
                    tips[used, 2] = oz + rz * far
            if filtered and seen:
                # Filters say what may mark, never what may clear.
                way = reach / length
                z = oz + rz * way
                tx, ty = told[i - start, 0], told[i - start, 1]
                tz = told[i - start, 2] if in_3d else 0.0
                bx, by, bz = sx + tx * way, sy + ty * way, sz + tz * way
                if (
                    body[0, 0] <= bx <= body[1, 0]
                    and body[0, 1] <= by <= body[1, 1]
                    and body[0, 2] <= bz <= body[1, 2]
                ):
                    skipped[BODY] += 1
                    seen = False
                elif z < heights[0] or z > heights[1]:
                    skipped[HEIGHT] += 1
                    seen = False
            hit[used] = seen
            used += 1
        offsets[bundle + 1] = used


@borrowing
def cell_bounds(
    points: FloatArray,
    offsets: npt.NDArray[np.int64],
    resolution: float,
    lo: FloatArray,
    hi: FloatArray,
    way: FloatArray,
) -> None:
    """Turn points [m] into cells, in place, and measure each bundle.

    Args:
        points: shape (m, d), changed from metres to cells.
        offsets: first point of each bundle and the end, shape (bundles + 1,).
        resolution: side of a cell [m].
        lo: the box of each bundle, shape (bundles, d), widened by its points [cells].
        hi: likewise.
        way: sum over a bundle's points of their distance along the axes from the first `lo`
            (the sensor) [cells], shape (bundles,): bounds how many cells are passed.
    """
    in_3d = points.shape[1] == 3
    z0, z1, sz = 0.0, 0.0, 0.0
    for bundle in range(offsets.shape[0] - 1):
        sx, sy = lo[bundle, 0], lo[bundle, 1]
        x0, x1, y0, y1 = sx, hi[bundle, 0], sy, hi[bundle, 1]
        if in_3d:
            sz = lo[bundle, 2]
            z0, z1 = sz, hi[bundle, 2]
        total = 0.0
        for i in range(offsets[bundle], offsets[bundle + 1]):
            # By division: 0.15 / 0.05 is below 3 and lies in cell 2, 0.15 * 20 is 3.
            x, y = points[i, 0] / resolution, points[i, 1] / resolution
            points[i, 0], points[i, 1] = x, y
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
            total += abs(x - sx) + abs(y - sy)
            if in_3d:
                z = points[i, 2] / resolution
                points[i, 2] = z
                z0, z1 = min(z0, z), max(z1, z)
                total += abs(z - sz)
        lo[bundle, 0], hi[bundle, 0], lo[bundle, 1], hi[bundle, 1] = x0, x1, y0, y1
        if in_3d:
            lo[bundle, 2], hi[bundle, 2] = z0, z1
        way[bundle] += total
