# SPDX-License-Identifier: Apache-2.0
"""3D scans whose votes add up, or whose hits have a width: weights, not marks.

As `rays3d.py`, with two weights of 64 bits per cell in place of one byte and every ray gone
through whole: a ray that passes a marked cell has a vote to add there.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing
from oddsmap.kernels.trace.hit_region import BeamShape, fade_cells, zone_cells
from oddsmap.kernels.trace.rays3d import RAYS, emit_ray, put_ray, set_up
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.kernels.vote.block_table import slot_of

__all__ = ["count_scan"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@borrowing
def count_scan(
    origins: FloatArray,
    whose: IntArray,
    fades: FloatArray,
    ends: FloatArray,
    tips: FloatArray,
    hit: npt.NDArray[np.bool_],
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    every_beam: bool,
    shape: BeamShape,
    rays: FloatArray,
    buffer: npt.NDArray[np.signedinteger],
    table: npt.NDArray[np.int32],
    used: IntArray,
    weights: IntArray,
    zone: IntArray,
    zone_left: FloatArray,
    zone_weights: IntArray,
    first: int,
) -> int:
    """Weigh the cells that the rays of one scan pass and hit, in units of 1/65536 vote.

    Args:
        origins: where bundles start [cells], shape (bundles, 3).
        whose: the bundle of each ray, shape (n,).
        fades: where the passes of each ray begin to fade [cells], shape (n, 3).
        ends: where its free part ends, shape (n, 3).
        tips: where its occupied part ends, shape (n, 3).
        hit: False where a ray only clears, shape (n,).
        lo: first cell of the window, a multiple of the block's side.
        bits: log2 of the side of a block.
        blocks: strides of the window's blocks: 1, blocks along x, blocks along x and y.
        every_beam: True: weights add up; False: a cell keeps the largest.
        shape: how a ray votes around its return.
        rays: room to describe some, shape (COLUMNS * RAYS,).
        buffer: room for one ray, shape (3, slabs + 9).
        table: zeros, one for each block of the window.
        used: used[0] is how many blocks were touched; then their places in the table.
        weights: zeros, shape (2, cells of all blocks), block 0 unused.
        zone: room for the cells of one ray's occupied part, or of its fading one, shape
            (enough, 3).
        zone_left: room for where they are left, shape (enough,).
        zone_weights: room for their weights, shape (enough,).
        first: ray to go on with.

    Returns:
        The ray to go on with once there is room for more blocks; -1 when done.
    """
    shift = np.uint64(3 * bits)
    within = (np.uint64(1) << shift) - np.uint64(1)
    room = used.shape[0] - 1
    for begin in range(first, ends.shape[0], RAYS):
        many = min(RAYS, ends.shape[0] - begin)
        for j in range(many):
            put_ray(rays, np.uint64(j), origins, whose[begin + j], fades, begin + j)
        set_up(lo, bits, blocks, rays, many)
        for j in range(many):
            i = begin + j
            if used[0] + 3 * buffer.shape[1] + 2 * zone.shape[0] > room:
                return i
            slabs = emit_ray(rays, j, 0, bits, blocks, buffer, 0)
            for k in range(slabs):
                # The three cells of a slab may be one or two: each counts once.
                entry, leave = np.uint64(buffer[0, k]), np.uint64(buffer[1, k])
                for row in range(3):
                    code = np.uint64(buffer[row, k])
                    if (row > 0 and code == entry) or (row > 1 and code == leave):
                        continue
                    slot = slot_of(code >> shift, table, used)
                    at = (slot << shift) + (code & within)
                    weights[PASSES, at] = weights[PASSES, at] + ONE if every_beam else ONE
            if shape.fade > 0.0:
                count = fade_cells(
                    origins[whose[i]], fades, ends, i, shape.fade, zone, zone_left, zone_weights
                )
                _add_cells(
                    zone, zone_weights, count, PASSES, lo, bits, blocks, every_beam,
                    table, used, weights,
                )  # fmt: skip
            if hit[i]:
                count = zone_cells(ends, tips, i, shape, zone, zone_left, zone_weights)
                _add_cells(
                    zone, zone_weights, count, HITS, lo, bits, blocks, every_beam,
                    table, used, weights,
                )  # fmt: skip
    return -1


@borrowing
def _add_cells(
    zone: IntArray,
    zone_weights: IntArray,
    count: int,
    channel: int,
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    every_beam: bool,
    table: npt.NDArray[np.int32],
    used: IntArray,
    weights: IntArray,
) -> None:
    mask = (1 << bits) - 1
    for k in range(count):
        block, place = np.uint64(0), np.uint64(0)
        for axis in range(3):
            cell = zone[k, axis] - lo[axis]
            block += np.uint64((cell >> bits) * blocks[axis])
            place += np.uint64((cell & mask) << (bits * axis))
        slot = slot_of(block, table, used)
        at = (slot << np.uint64(3 * bits)) + place
        before = weights[channel, at]
        weight = zone_weights[k]
        weights[channel, at] = before + weight if every_beam else max(before, weight)
