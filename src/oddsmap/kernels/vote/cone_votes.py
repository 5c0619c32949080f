# SPDX-License-Identifier: Apache-2.0
"""The cells of wide beams and their votes, in 2D and in 3D.

A 2D map is taken as the one layer of a 3D map in which the sensor is, so one kernel serves both.
Cells are visited row by row along x; each row's interval comes from a quadratic, widened by half a
cell, and only the test of the cell itself decides. The rule in words is `ConeSensor`'s; as a loop
over all cells it is in tests/naive/cones.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.units import ONE

__all__ = ["ConeModel", "Cones", "Room", "list_cones"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_PARALLEL = 1e-5
"""A row within this of a side of the cone (as a difference of squared cosines) takes the cone's box
instead: its quadratic would be ill-conditioned."""

_SLIVER = 1e-9
"""Share of the axis; a cell that has no more of it is one whose corner is touched."""


class Cones(NamedTuple):
    """The wide beams of some scans, lengths and positions in cells."""

    origins: FloatArray
    """Sensor positions, shape (scans, d)."""
    offsets: IntArray
    """First beam of each scan and the end, shape (scans + 1,)."""
    axes: FloatArray
    """Unit vectors in the map frame, shape (m, d)."""
    reach: FloatArray
    """Range of the return, or how far a no-return clears, shape (m,)."""
    ends: FloatArray
    """The point of the axis at that range, shape (m, d)."""
    seen: npt.NDArray[np.bool_]
    """True where it is a return, False for a no-return, shape (m,)."""
    hit: npt.NDArray[np.bool_]
    """False where the cone only clears: a no-return, or a return that may not mark, shape (m,)."""


class ConeModel(NamedTuple):
    """What a cell of a cone gets."""

    cosine: float
    """Of half the opening angle; a cell is inside where the cosine of its angle is not less."""
    sine: float
    half_angle: float
    """[rad]"""
    half_width: float
    """Half the radial depth of the occupied arc [cells]."""
    angular_falloff: float
    range_falloff: float
    """By how much a weight is less for each cell of range."""
    pass_falloff: float
    share: bool


class Room(NamedTuple):
    """Where the votes are put."""

    index: IntArray
    """Cells, shape (n, d)."""
    hits: IntArray
    passes: IntArray
    """[1/65536 vote], shape (n,)."""
    arc: IntArray
    """Scratch: which entries of a beam are of its occupied arc, shape (n,)."""
    shares: FloatArray
    """Scratch: their weights, shape (n,)."""


@inlined
def _extent(a: float, model: ConeModel) -> float:
    # How far the unit cone reaches in the direction that makes an angle of cosine a with its axis.
    if a >= model.cosine:
        return 1.0
    return max(0.0, a * model.cosine + math.sqrt(max(0.0, 1.0 - a * a)) * model.sine)


@borrowing
def _span(
    a: float, b: float, s: float, cosine_squared: float, low: float, high: float
) -> tuple[float, float]:
    """The part of a row that is inside a cone, within an interval; (1, -1) for none.

    The row's points are x along it, at a squared distance s from the apex; a x + b is their
    component along the axis of the cone. Not exact to the last digits.
    """
    square = a * a - cosine_squared
    if abs(square) < _PARALLEL:
        return low, high
    linear = a * b
    remainder = square * (b * b - cosine_squared * s)
    discriminant = linear * linear - remainder
    root = math.sqrt(max(0.0, discriminant))
    if square > 0.0:  # the row goes on inside the cone forever
        if a > 0.0:
            return max(low, (root - linear) / square), high
        return low, min(high, (-root - linear) / square)
    # A row that touches the cone's side is inside; its terms cancel but for rounding.
    outside = discriminant < -1e-12 * (linear * linear + abs(square) * (b * b + s))
    if outside or b - a * linear / square < -1.0:  # or it meets the cone's mirror image
        return 1.0, -1.0
    return max(low, (root - linear) / square), min(high, (-root - linear) / square)


@inlined
def _beside_axis(model: ConeModel, along: float, r: float) -> float:
    # Elfes and Moravec: less toward the cone's side, by the square of the angle.
    if model.angular_falloff == 0.0 or r == 0.0:
        return 1.0
    off = math.acos(min(1.0, along / r)) / model.half_angle
    return max(0.0, 1.0 - model.angular_falloff * off * off)


@inlined
def _at_range(model: ConeModel, r: float) -> float:
    return max(0.0, 1.0 - model.range_falloff * r)


@inlined
def _pass_units(model: ConeModel, weight: float, r: float, reach: float) -> int:
    faded = 1.0 - model.pass_falloff * ((r / reach) * (r / reach))
    return np.int64(np.rint(ONE * (weight * faded)))


@borrowing
def list_cones(cones: Cones, model: ConeModel, first: int, offsets: IntArray, room: Room) -> int:
    """List the votes of whole scans, as many as there is room for.

    Args:
        cones: the beams.
        model: the weights.
        first: which scan to begin with.
        offsets: takes the first entry of each listed scan and the end, shape (scans + 1,).
        room: takes the entries.

    Returns:
        How many scans were listed.
    """
    scans = cones.origins.shape[0]
    used = np.int64(0)
    offsets[0] = 0
    for scan in range(first, scans):
        for i in range(cones.offsets[scan], cones.offsets[scan + 1]):
            used = _list_cone(cones, model, scan, i, room, used)
            if used < 0:
                return scan - first
        offsets[scan - first + 1] = used
    return scans - first


@borrowing
def _list_cone(cones: Cones, model: ConeModel, scan: int, i: int, room: Room, used: int) -> int:
    # One beam's entries from `used` on; returns where they end, -1 without room for them.
    in_3d = cones.origins.shape[1] == 3
    # Relative to the cell of the sensor: UTM coordinates cost no digits. In 2D z is level.
    cell_x, cell_y = math.floor(cones.origins[scan, 0]), math.floor(cones.origins[scan, 1])
    fx, fy, fz = cones.origins[scan, 0] - cell_x, cones.origins[scan, 1] - cell_y, 0.5
    ax, ay, az = cones.axes[i, 0], cones.axes[i, 1], 0.0
    to_x, to_y, to_z = cones.ends[i, 0] - cell_x, cones.ends[i, 1] - cell_y, 0.5
    cell_z = 0.0
    if in_3d:
        cell_z = math.floor(cones.origins[scan, 2])
        fz = cones.origins[scan, 2] - cell_z
        az = cones.axes[i, 2]
        to_z = cones.ends[i, 2] - cell_z
    end_x, end_y, end_z = math.floor(to_x), math.floor(to_y), math.floor(to_z)
    hit, reach = cones.hit[i], cones.reach[i]
    # A no-return clears as far as a return in the middle of a cell; a return that may not mark
    # clears no more than one that does.
    half = model.half_width if cones.seen[i] else 0.5
    near = reach - half
    far = reach + half if hit else near
    capacity = room.hits.shape[0]
    arcs = 0

    if far > 0.0:
        x_lo, x_hi = -far * _extent(-ax, model), far * _extent(ax, model)
        y_lo, y_hi = -far * _extent(-ay, model), far * _extent(ay, model)
        z_lo, z_hi = 0.0, 0.0
        # Seen along x, the cone is a sector of the plane, or all of it.
        flat = ay * ay + az * az
        ring = flat > model.sine * model.sine
        qy, qz, wide = 0.0, 0.0, 0.0
        if in_3d:
            z_lo, z_hi = -far * _extent(-az, model), far * _extent(az, model)
            if ring:
                qy, qz = ay / math.sqrt(flat), az / math.sqrt(flat)
                wide = 1.0 - model.sine * model.sine / flat
        ball = far * far * (1.0 + 1e-12)
        for iz in range(math.ceil(z_lo + fz - 1.0), math.floor(z_hi + fz) + 1):
            z = (iz + 0.5) - fz
            remainder = ball - z * z
            if remainder < 0.0:
                continue
            low, high = max(y_lo, -math.sqrt(remainder)), min(y_hi, math.sqrt(remainder))
            if in_3d and ring:
                low, high = _span(qy, qz * z, z * z, wide, low, high)
            for iy in range(math.ceil(low + fy - 1.0), math.floor(high + fy) + 1):
                y = (iy + 0.5) - fy
                s = y * y + z * z
                remainder = ball - s
                if remainder < 0.0:
                    continue
                b = ay * y + az * z
                left, right = _span(
                    ax, b, s, model.cosine * model.cosine,
                    max(x_lo, -math.sqrt(remainder)), min(x_hi, math.sqrt(remainder)),
                )  # fmt: skip
                begin, end = math.ceil(left + fx - 1.0), math.floor(right + fx) + 1
                if used + (end - begin) > capacity:
                    return -1
                for ix in range(begin, end):
                    x = (ix + 0.5) - fx
                    along = ax * x + b
                    r = math.sqrt(x * x + s)
                    if along < model.cosine * r or r > far:
                        continue
                    if ix == end_x and iy == end_y and iz == end_z:
                        continue
                    weight = _beside_axis(model, along, r) * _at_range(model, r)
                    room.hits[used] = 0
                    if r < near:
                        room.passes[used] = _pass_units(model, weight, r, reach)
                    elif hit:
                        room.passes[used] = 0
                        room.arc[arcs], room.shares[arcs] = used, weight
                        arcs += 1
                    else:
                        continue
                    room.index[used, 0] = np.int64(cell_x) + ix
                    room.index[used, 1] = np.int64(cell_y) + iy
                    if in_3d:
                        room.index[used, 2] = np.int64(cell_z) + iz
                    used += 1

    # The cells that the axis passes, from border to border (Amanatides and Woo 1987): those whose
    # centre is outside the cone are not listed yet.
    jx, last_x, step_x, next_x, side_x = _steps(fx, to_x)
    jy, last_y, step_y, next_y, side_y = _steps(fy, to_y)
    jz, last_z, step_z, next_z, side_z = _steps(fz, to_z)
    entered = 0.0
    while True:
        tx = next_x if jx != last_x else np.inf
        ty = next_y if jy != last_y else np.inf
        tz = next_z if jz != last_z else np.inf
        left_at = min(tx, ty, tz, 1.0)
        passed = left_at - entered > _SLIVER
        if passed and not (jx == end_x and jy == end_y and jz == end_z):
            x, y, z = (jx + 0.5) - fx, (jy + 0.5) - fy, (jz + 0.5) - fz
            r = math.sqrt(x * x + (y * y + z * z))
            outside = ax * x + (ay * y + az * z) < model.cosine * r
            if outside and (r < near or (hit and r <= far)):
                if used == capacity:
                    return -1
                room.hits[used], room.passes[used] = 0, 0
                if r < near:
                    room.passes[used] = _pass_units(model, _at_range(model, r), r, reach)
                else:
                    room.arc[arcs], room.shares[arcs] = used, _at_range(model, r)
                    arcs += 1
                room.index[used, 0] = np.int64(cell_x) + jx
                room.index[used, 1] = np.int64(cell_y) + jy
                if in_3d:
                    room.index[used, 2] = np.int64(cell_z) + jz
                used += 1
        if jx == last_x and jy == last_y and jz == last_z:
            break
        entered = max(entered, left_at)
        if tx <= ty and tx <= tz:
            jx, next_x = jx + step_x, next_x + side_x
        elif ty <= tz:
            jy, next_y = jy + step_y, next_y + side_y
        else:
            jz, next_z = jz + step_z, next_z + side_z
    if not hit:
        return used

    if used == capacity:
        return -1
    x, y, z = (end_x + 0.5) - fx, (end_y + 0.5) - fy, (end_z + 0.5) - fz
    room.arc[arcs] = used
    room.shares[arcs] = _at_range(model, math.sqrt(x * x + (y * y + z * z)))
    arcs += 1
    room.hits[used], room.passes[used] = 0, 0
    room.index[used, 0] = np.int64(cell_x) + np.int64(end_x)
    room.index[used, 1] = np.int64(cell_y) + np.int64(end_y)
    if in_3d:
        room.index[used, 2] = np.int64(cell_z) + np.int64(end_z)
    _share_hit(room, arcs, model.share)
    return used + 1


@inlined
def _steps(start: float, stop: float) -> tuple[int, int, int, float, float]:
    # Along one axis: first and last cell, step, share of the way at the first border, and between
    # borders. A stop on a border belongs to the cell before it: the next one is only touched.
    cell = np.int64(math.floor(start))
    way = abs(stop - start)
    last, step, border, side = cell, np.int64(1), np.inf, np.inf
    if stop > start:
        last, border, side = np.int64(math.ceil(stop)) - 1, (cell + 1 - start) / way, 1.0 / way
    elif stop < start:
        last, step = np.int64(math.floor(stop)), np.int64(-1)
        border, side = (start - cell) / way, 1.0 / way
    return cell, last, step, border, side


@borrowing
def _share_hit(room: Room, arcs: int, share: bool) -> None:
    # Differences of a rounded running sum: the shares of one return add up to ONE exactly.
    total = 0.0
    for k in range(arcs):
        total += room.shares[k]
    if not share:
        for k in range(arcs):
            room.hits[room.arc[k]] = np.int64(np.rint(ONE * room.shares[k]))
    elif total > 0.0:
        running, assigned = 0.0, np.int64(0)
        for k in range(arcs):
            running += room.shares[k]
            upto = np.int64(np.rint(ONE * (running / total)))
            room.hits[room.arc[k]] = upto - assigned
            assigned = upto
    else:  # beyond what the falloff leaves a weight to: the axis has it all
        room.hits[room.arc[arcs - 1]] = ONE
