# SPDX-License-Identifier: Apache-2.0
"""3D scans into tiles, one whole vote per cell and beam: count in blocks, then add them up.

What `counts3d.py` does for votes of any weight, with whole votes of 16 bits in place of weights of
64, and the slabs of many rays listed before they are counted.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined, kernel
from oddsmap.kernels.trace.rays3d import RAYS, emit_ray, put_ray, set_up
from oddsmap.kernels.units import FRACTION_BITS, HITS, PASSES
from oddsmap.kernels.vote.block_table import slot_of
from oddsmap.kernels.vote.tiles import (
    NARROW_MAX,
    TileArrays,
    add_units,
    find_or_insert,
    grow_load,
)

__all__ = ["apply_beams", "count_rays"]

SLABS = 1024
"""About how many slabs are listed before their cells are counted."""

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Counts = npt.NDArray[np.uint16]


@borrowing
def count_rays(
    origins: FloatArray,
    whose: IntArray,
    ends: FloatArray,
    hit: npt.NDArray[np.bool_],
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    rays: FloatArray,
    buffer: npt.NDArray[np.signedinteger],
    table: npt.NDArray[np.int32],
    used: IntArray,
    counts: Counts,
    first: int,
) -> int:
    """Count the rays that pass and hit each cell.

    Args:
        origins: where bundles start [cells], shape (bundles, 3).
        whose: the bundle of each ray, shape (n,).
        ends: end points [cells], shape (n, 3). No cell may be counted more than 65,535 times
            before `apply_beams`.
        hit: False where a ray only clears, shape (n,).
        lo: first cell of the window, a multiple of the block's side.
        bits: log2 of the side of a block.
        blocks: strides of the window's blocks: 1, blocks along x, blocks along x and y.
        rays: room to describe some, shape (COLUMNS * RAYS,).
        buffer: room for their cells, shape (3, SLABS + those of one ray + 9).
        table: zeros, one for each block of the window.
        used: used[0] is how many blocks were touched; then their places in the table.
        counts: zeros, shape (2, cells of all blocks), block 0 unused.
        first: ray to go on with.

    Returns:
        The ray to go on with once there is room for more blocks; -1 when done.
    """
    room = used.shape[0] - 1
    for begin in range(first, ends.shape[0], RAYS):
        many = min(RAYS, ends.shape[0] - begin)
        for j in range(many):
            put_ray(rays, np.uint64(j), origins, whose[begin + j], ends, begin + j)
        set_up(lo, bits, blocks, rays, many)
        at = 0
        while at < many:
            slabs, ray = 0, at
            while ray < many and slabs < SLABS:
                slabs = emit_ray(rays, ray, 0, bits, blocks, buffer, slabs)
                ray += 1
            if used[0] + 3 * slabs + ray - at > room:
                return begin + at
            _count_passes(buffer, slabs, np.uint64(3 * bits), table, used, counts[PASSES])
            for i in range(begin + at, begin + ray):
                if hit[i]:
                    _count_hit(ends, i, lo, bits, blocks, table, used, counts[HITS])
            at = ray
    return -1


@inlined
def _count_passes(
    buffer: npt.NDArray[np.signedinteger],
    slabs: int,
    shift: np.uint64,
    table: npt.NDArray[np.int32],
    used: IntArray,
    passes: Counts,
) -> None:
    within = (np.uint64(1) << shift) - np.uint64(1)
    for k in range(slabs):
        # The three cells of a slab may be one or two: each counts once. Without branches, which
        # rays would take at random.
        entry = np.uint64(buffer[0, np.uint64(k)])
        leave = np.uint64(buffer[1, np.uint64(k)])
        middle = np.uint64(buffer[2, np.uint64(k)])
        slot = slot_of(entry >> shift, table, used)
        passes[(slot << shift) + (entry & within)] += np.uint16(1)
        slot = slot_of(leave >> shift, table, used)
        passes[(slot << shift) + (leave & within)] += np.uint16(leave != entry)
        slot = slot_of(middle >> shift, table, used)
        apart = (middle != entry) & (middle != leave)
        passes[(slot << shift) + (middle & within)] += np.uint16(apart)


@inlined
def _count_hit(
    ends: FloatArray,
    i: int,
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    table: npt.NDArray[np.int32],
    used: IntArray,
    hits: Counts,
) -> None:
    mask = (1 << bits) - 1
    block, place = np.int64(0), np.int64(0)
    for axis in range(3):
        cell = np.int64(math.floor(ends[i, axis])) - lo[axis]
        block += (cell >> bits) * blocks[axis]
        place += (cell & mask) << (bits * axis)
    slot = slot_of(np.uint64(block), table, used)
    hits[(slot << np.uint64(3 * bits)) + np.uint64(place)] += np.uint16(1)


@kernel
def apply_beams(
    tiles: TileArrays,
    first_tile: IntArray,
    across: int,
    up: int,
    table: npt.NDArray[np.int32],
    used: IntArray,
    counts: Counts,
) -> bool:
    """Add counts to tiles and zero them; False where a cell passed MAX_UNITS.

    Args:
        tiles: the tile store, with room for all used blocks.
        first_tile: tile coordinates of the window's first block, shape (3,).
        across: blocks of the window along x.
        up: blocks of the window along y.
        table: see `count_rays`; zeros again afterwards, as are `used[0]` and `counts`.
        used: see `count_rays`.
        counts: see `count_rays`.
    """
    key = np.empty(3, np.int64)
    cells = tiles.narrow.shape[2]
    units = np.empty((2, cells), np.int64)
    fits = True
    for slot in range(1, used[0] + 1):
        block = used[slot]
        key[0] = first_tile[0] + block % across
        key[1] = first_tile[1] + block // across % up
        key[2] = first_tile[2] + block // (across * up)
        table[block] = 0
        used[slot] = find_or_insert(tiles, key)
    for slot in range(1, used[0] + 1):
        fits &= _add_block(tiles, used[slot], counts, slot * cells, units)
    used[0] = 0
    return fits


@borrowing
def _add_block(tiles: TileArrays, tile: int, counts: Counts, start: int, units: IntArray) -> bool:
    cells = tiles.narrow.shape[2]
    hit, free = counts[HITS], counts[PASSES]
    most = np.uint16(0)
    for k in range(cells):
        at = np.uint64(start + k)
        most = max(most, max(hit[at], free[at]))
    if np.int64(tiles.load[tile]) + np.int64(most) > NARROW_MAX:
        for k in range(cells):
            at = np.uint64(start + k)
            units[HITS, np.uint64(k)] = np.int64(hit[at]) << FRACTION_BITS
            units[PASSES, np.uint64(k)] = np.int64(free[at]) << FRACTION_BITS
            hit[at] = 0
            free[at] = 0
        return add_units(tiles, tile, units[HITS], units[PASSES])
    hits, passes = tiles.narrow[tile, HITS], tiles.narrow[tile, PASSES]
    for k in range(cells):
        at = np.uint64(start + k)
        hits[np.uint64(k)] += np.uint8(hit[at])
        passes[np.uint64(k)] += np.uint8(free[at])
        hit[at] = 0
        free[at] = 0
    grow_load(tiles, tile, np.int64(most))
    return True
