# SPDX-License-Identifier: Apache-2.0
"""A 3D scan into tiles: mark the blocks that its rays touch, then apply them one by one.

The window around a scan is a table of blocks, and a block gets memory (one byte per cell) when it
is first touched: large windows cost their table only, and what is swept afterwards is what was
marked. Blocks are the map's tiles, so the map's hash is asked once per block and scan.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined, kernel
from oddsmap.kernels.trace.rays3d import FIRST, RAYS, emit_ray, put_ray, ray_axis, set_up
from oddsmap.kernels.units import HITS, PASSES
from oddsmap.kernels.vote.block_table import slot_of
from oddsmap.kernels.vote.tiles import TileArrays, find_or_insert, make_room_for_vote

__all__ = [
    "BIN_COLUMNS",
    "BIN_COUNT",
    "SLABS",
    "apply_marks",
    "mark_hits",
    "mark_passes",
    "sort_rays",
]

FREE, OCCUPIED = 1, 2

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Marks = npt.NDArray[np.uint8]

COARSE = 8
"""Bins of directions along each side of a cube's face on the coarsest level, see `_advance`."""
LEVELS = 3
"""Each level has twice as many bins per side as the one before."""
FINE = COARSE << (LEVELS - 1)
BIN_COUNT = sum(6 * (COARSE << level) ** 2 for level in range(LEVELS))
BIN_COLUMNS = 11
"""What is known of the rays of a bin: lowest and highest slope along b and c, lowest corner of
their start points and highest one, and the cell of their first slab."""
START, HIGHEST_START, FIRST_SLAB = 4, 7, 10
SLABS = 1024
"""About how many slabs are listed before their cells are marked."""
STRIDE = 17
"""Rays are taken 17 apart, from each of 17 beginnings in turn. LIDARs list 16, 32, 64... beams to a
column: a stride prime to these spreads the first rays over all directions."""
ROUNDS = ((0,), (8,), (4, 12), (2, 6, 10, 14), (1, 3, 5, 7, 9, 11, 13, 15, 16))
"""The beginnings; after each round but the last, what is marked is looked through."""
ORDER = np.array([begin for part in ROUNDS for begin in part], np.int64)
LAST_OF_ROUND = np.array([part[-1] for part in ROUNDS[:-1]], np.int64)


@borrowing
def sort_rays(
    origins: FloatArray,
    whose: IntArray,
    ends: FloatArray,
    bins: npt.NDArray[np.int32],
    spans: FloatArray,
) -> None:
    """Sort the rays of a scan into bins of directions, on several levels.

    A level has face * side^2 + (bin of slope b) * side + (bin of slope c), side = COARSE << level,
    face = 2 * dominant axis, + 1 where the ray falls along it; the levels follow each other.

    Args:
        origins: where bundles start [cells], shape (bundles, 3).
        whose: the bundle of each ray, shape (n,).
        ends: end points [cells], shape (n, 3).
        bins: takes the bin of each ray on the finest level, shape (n,).
        spans: takes what is known of the rays of each bin, shape (BIN_COUNT, BIN_COLUMNS). A bin
            without rays has a lowest slope above the highest.
    """
    finest = BIN_COUNT - 6 * FINE * FINE
    several = origins.shape[0] > 1
    for at in range(BIN_COUNT):
        spans[at, 0], spans[at, 1], spans[at, 2], spans[at, 3] = 2.0, -2.0, 2.0, -2.0
        for axis in range(3):
            spans[at, START + axis] = np.inf if several else origins[0, axis]
            spans[at, HIGHEST_START + axis] = -np.inf if several else origins[0, axis]
    for i in range(ends.shape[0]):
        ox, oy, oz = origins[whose[i], 0], origins[whose[i], 1], origins[whose[i], 2]
        dx, dy, dz = ends[i, 0] - ox, ends[i, 1] - oy, ends[i, 2] - oz
        axis = ray_axis(dx, dy, dz)
        da, db, dc = (dx, dy, dz) if axis == 0 else ((dy, dz, dx) if axis == 1 else (dz, dx, dy))
        # Not times 1 / da, which is infinite where da is next to nothing.
        p, q = (db / abs(da), dc / abs(da)) if da != 0.0 else (0.0, 0.0)
        face = 2 * axis + (1 if da < 0 else 0)
        at_p = min(FINE - 1, np.int64((p + 1.0) * (0.5 * FINE)))
        at_q = min(FINE - 1, np.int64((q + 1.0) * (0.5 * FINE)))
        at = finest + (face * FINE + at_p) * FINE + at_q
        bins[i] = at
        spans[at, 0] = min(spans[at, 0], p)
        spans[at, 1] = max(spans[at, 1], p)
        spans[at, 2] = min(spans[at, 2], q)
        spans[at, 3] = max(spans[at, 3], q)
        if several:
            spans[at, START] = min(spans[at, START], ox)
            spans[at, START + 1] = min(spans[at, START + 1], oy)
            spans[at, START + 2] = min(spans[at, START + 2], oz)
            spans[at, HIGHEST_START] = max(spans[at, HIGHEST_START], ox)
            spans[at, HIGHEST_START + 1] = max(spans[at, HIGHEST_START + 1], oy)
            spans[at, HIGHEST_START + 2] = max(spans[at, HIGHEST_START + 2], oz)
    for at in range(BIN_COUNT - 1, 6 * COARSE * COARSE - 1, -1):
        parent = BIN_TREE[at, 0]
        spans[parent, 0] = min(spans[parent, 0], spans[at, 0])
        spans[parent, 1] = max(spans[parent, 1], spans[at, 1])
        spans[parent, 2] = min(spans[parent, 2], spans[at, 2])
        spans[parent, 3] = max(spans[parent, 3], spans[at, 3])
        for axis in range(3):
            low, high = START + axis, HIGHEST_START + axis
            spans[parent, low] = min(spans[parent, low], spans[at, low])
            spans[parent, high] = max(spans[parent, high], spans[at, high])
    for at in range(BIN_COUNT):
        a, falls = BIN_TREE[at, 1] // 2, BIN_TREE[at, 1] & 1
        if falls:
            spans[at, FIRST_SLAB] = np.ceil(spans[at, HIGHEST_START + a]) - 1.0
        else:
            spans[at, FIRST_SLAB] = np.floor(spans[at, START + a])


def _bin_tree() -> IntArray:
    """Each bin's parent one level up (-1 on the coarsest) and face, shape (BIN_COUNT, 2)."""
    tree = []
    before = 0
    for level in range(LEVELS):
        side = COARSE << level
        above = before - 6 * (side // 2) ** 2
        for face in range(6):
            for p in range(side):
                for q in range(side):
                    parent = above + (face * (side // 2) + p // 2) * (side // 2) + q // 2
                    tree.append((parent if level > 0 else -1, face))
        before += 6 * side * side
    return np.array(tree, np.int64)


BIN_TREE = _bin_tree()


@borrowing
def mark_hits(
    ends: FloatArray,
    hit: npt.NDArray[np.bool_],
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    table: npt.NDArray[np.int32],
    used: IntArray,
    marks: Marks,
) -> bool:
    """Mark the cells that rays end in, once all passes of a scan are marked.

    Arguments as in `mark_passes`.

    Returns:
        False: nothing was done, there must be room for more blocks in `used` and `marks`.
    """
    if used[0] + ends.shape[0] > used.shape[0] - 1:
        return False
    shift = 3 * bits
    mask = (1 << bits) - 1
    for i in range(ends.shape[0]):
        if not hit[i]:
            continue
        block, place = np.int64(0), np.int64(0)
        for axis in range(3):
            cell = np.int64(math.floor(ends[i, axis])) - lo[axis]
            block += (cell >> bits) * blocks[axis]
            place += (cell & mask) << (bits * axis)
        slot = np.int64(slot_of(np.uint64(block), table, used))
        marks[(slot << shift) + place] = OCCUPIED
    return True


@inlined
def _mark_passes(
    buffer: npt.NDArray[np.signedinteger],
    slabs: int,
    shift: np.uint64,
    table: npt.NDArray[np.int32],
    used: IntArray,
    marks: Marks,
) -> None:
    within = (np.uint64(1) << shift) - np.uint64(1)
    for k in range(slabs):
        for row in range(3):
            code = np.uint64(buffer[row, np.uint64(k)])
            slot = slot_of(code >> shift, table, used)
            marks[(slot << shift) + (code & within)] = FREE


@borrowing
def mark_passes(
    origins: FloatArray,
    whose: IntArray,
    ends: FloatArray,
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    bins: npt.NDArray[np.int32],
    spans: FloatArray,
    done: npt.NDArray[np.int32],
    rays: FloatArray,
    buffer: npt.NDArray[np.signedinteger],
    table: npt.NDArray[np.int32],
    used: IntArray,
    marks: Marks,
    skips: bool,
    first: int,
) -> int:
    """Mark the cells that the rays of a scan pass.

    Args:
        origins: where bundles start [cells], shape (bundles, 3).
        whose: the bundle of each ray, shape (n,).
        ends: end points [cells], shape (n, 3).
        lo: first cell of the window, a multiple of the block's side.
        bits: log2 of the side of a block.
        blocks: strides of the window's blocks: 1, blocks along x, blocks along x and y.
        bins: from `sort_rays`.
        spans: from `sort_rays`.
        done: zeros at the first call, shape (bins,): leading slabs known to be marked, counted
            from the first slab of any ray of the bin.
        rays: room to describe some, shape (COLUMNS * RAYS,).
        buffer: room for their cells, shape (3, SLABS + those of one ray + 9).
        table: zeros, one for each block of the window.
        used: used[0] is how many blocks were touched; then their places in the table.
        marks: zeros, one byte per cell, block after block, block 0 unused.
        skips: False: few rays, for which looking up what is marked would take longer than marking
            it again; `bins` and `spans` are not looked at.
        first: where to go on; 0 at the first call.

    Returns:
        Where to go on once there is room for more blocks in `used` and `marks`; -1 when done.
    """
    count = ends.shape[0]
    room = used.shape[0] - 1
    several = origins.shape[0] > 1
    before = 0
    for begin in ORDER:
        n = (count - begin + STRIDE - 1) // STRIDE
        for batch in range(0, n, RAYS):
            many = min(RAYS, n - batch)
            at = max(first - before, 0)
            before += many
            if at >= many:
                continue
            for j in range(many):
                i, ray = begin + (batch + j) * STRIDE, np.uint64(j)
                put_ray(rays, ray, origins, whose[i], ends, i)
            set_up(lo, bits, blocks, rays, many)
            while at < many:
                # Many rays at a time, too: a loop's end is a branch that is guessed wrong.
                slabs, ray = 0, at
                while ray < many and slabs < SLABS:
                    own = bins[begin + (batch + ray) * STRIDE] if skips else 0
                    skip = done[own] if skips else 0
                    if skip > 0 and several:  # of which some start further on than others
                        start = rays[FIRST + np.uint64(ray)] + lo[BIN_TREE[own, 1] // 2]
                        skip = max(0, skip - np.int64(abs(start - spans[own, FIRST_SLAB])))
                    slabs = emit_ray(rays, ray, skip, bits, blocks, buffer, slabs)
                    ray += 1
                if used[0] + 3 * slabs > room:
                    return before - many + at
                at = ray
                _mark_passes(buffer, slabs, np.uint64(3 * bits), table, used, marks)
        if skips and before > first and begin in LAST_OF_ROUND:
            _advance(lo, bits, blocks, spans, done, table, marks)
    return -1


@borrowing
def _advance(
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    spans: FloatArray,
    done: npt.NDArray[np.int32],
    table: npt.NDArray[np.int32],
    marks: Marks,
) -> None:
    """For each bin of directions, count the leading slabs whose whole cross-section is marked.

    Rays that are still to come have nothing to add there and start behind (near the sensor whole
    regions are marked by the first few rays). It asks the marks themselves, so it changes none.
    Coarse bins come first, and finer ones go on where they stopped: the cross-sections of fine bins
    overlap, and near the sensor a cell would be asked for many times.
    """
    for at in range(BIN_COUNT):
        if spans[at, 0] > spans[at, 1]:
            continue
        parent = BIN_TREE[at, 0]
        if parent >= 0:
            ahead = np.int32(abs(spans[at, FIRST_SLAB] - spans[parent, FIRST_SLAB]))
            done[at] = max(done[at], done[parent] - ahead)
        done[at] = _marked_slabs(at, done[at], spans, lo, bits, blocks, table, marks)


@borrowing
def _marked_slabs(
    at: int,
    slab: int,
    spans: FloatArray,
    lo: IntArray,
    bits: int,
    blocks: IntArray,
    table: npt.NDArray[np.int32],
    marks: Marks,
) -> int:
    # How many leading slabs of a bin are marked, if the first `slab` ones are known to be.
    shift = 3 * bits
    mask = (1 << bits) - 1
    face = BIN_TREE[at, 1]
    a = face // 2
    b = a + 1 if a < 2 else 0
    c = b + 1 if b < 2 else 0
    # The box that the rays start in: a point, or where the sensor was meanwhile.
    a0, a1 = spans[at, START + a], spans[at, HIGHEST_START + a]
    b0, b1 = spans[at, START + b] - lo[b], spans[at, HIGHEST_START + b] - lo[b]
    c0, c1 = spans[at, START + c] - lo[c], spans[at, HIGHEST_START + c] - lo[c]
    first = np.int64(spans[at, FIRST_SLAB]) - lo[a]
    if face & 1:
        step = -1
        to_border = a1 - spans[at, FIRST_SLAB]
    else:
        step = 1
        to_border = spans[at, FIRST_SLAB] + 1.0 - a0
    length = a1 - a0
    p_lo, p_hi, q_lo, q_hi = spans[at, 0], spans[at, 1], spans[at, 2], spans[at, 3]
    a_block, b_block, c_block = blocks[a], blocks[b], blocks[c]
    a_place, b_place, c_place = bits * a, bits * b, bits * c
    blocks_there = table.shape[0]
    while True:
        # From the near border (the start, in slab 0) to the far one, for all slopes of the bin and
        # all start points.
        far = to_border + slab
        near = max(far - 1.0 - length, 0.0)
        b_lo = np.int64(b0 + p_lo * (far if p_lo < 0 else near) - 1e-6)
        b_hi = np.int64(b1 + p_hi * (far if p_hi > 0 else near) + 1e-6)
        c_lo = np.int64(c0 + q_lo * (far if q_lo < 0 else near) - 1e-6)
        c_hi = np.int64(c1 + q_hi * (far if q_hi > 0 else near) + 1e-6)
        cell_a = first + step * slab
        a_part = (cell_a >> bits) * a_block
        a_within = (cell_a & mask) << a_place
        for cell_c in range(c_lo, c_hi + 1):
            part = a_part + (cell_c >> bits) * c_block
            within = a_within + ((cell_c & mask) << c_place)
            for cell_b in range(b_lo, b_hi + 1):
                # A cell outside the window may be taken for another one here; no ray gets there.
                block = part + (cell_b >> bits) * b_block
                if block < 0 or block >= blocks_there:
                    return slab
                slot = np.int64(table[np.uint64(block)])
                place = (slot << shift) + within + ((cell_b & mask) << b_place)
                if slot == 0 or marks[np.uint64(place)] == 0:
                    return slab
        slab += 1


@kernel
def apply_marks(
    tiles: TileArrays,
    first_tile: IntArray,
    across: int,
    up: int,
    table: npt.NDArray[np.int32],
    used: IntArray,
    marks: Marks,
) -> bool:
    """Add marks to tiles and zero them; False where a cell passed MAX_UNITS.

    Args:
        tiles: the tile store, with room for all used blocks.
        first_tile: tile coordinates of the window's first block, shape (3,).
        across: blocks of the window along x.
        up: blocks of the window along y.
        table: see `mark_passes`; zeros again afterwards, as are `used[0]` and `marks`.
        used: see `mark_passes`.
        marks: see `mark_passes`.
    """
    key = np.empty(3, np.int64)
    cells = tiles.narrow.shape[2]
    fits = True
    for slot in range(1, used[0] + 1):
        block = used[slot]
        key[0] = first_tile[0] + block % across
        key[1] = first_tile[1] + block // across % up
        key[2] = first_tile[2] + block // (across * up)
        tile = find_or_insert(tiles, key)
        fits &= make_room_for_vote(tiles, tile)
        table[block] = 0
        used[slot] = tile
    # A loop of its own: look-ups wait for memory, and several do so at once where no work on cells
    # lies between them.
    for slot in range(1, used[0] + 1):
        hits, passes = tiles.narrow[used[slot], HITS], tiles.narrow[used[slot], PASSES]
        start = slot * cells
        for k in range(cells):
            mark = marks[np.uint64(start + k)]
            hits[np.uint64(k)] += np.uint8(mark >> 1)
            passes[np.uint64(k)] += np.uint8(mark & 1)
            marks[np.uint64(start + k)] = 0
    used[0] = 0
    return fits
