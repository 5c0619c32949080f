# SPDX-License-Identifier: Apache-2.0
"""2D scans into tiles, one whole vote per cell and beam: count in a window, apply it by tiles.

What `weights2d.py` does for votes of any weight, with whole votes of 16 bits in place of weights of
64, many beams' slabs listed before they are counted, and tiles that nothing touched passed over.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.segments2d import emit_passes
from oddsmap.kernels.units import FRACTION_BITS, HITS, PASSES
from oddsmap.kernels.vote.tiles import (
    NARROW_MAX,
    TileArrays,
    add_units,
    find_or_insert,
    grow_load,
    has_room,
)
from oddsmap.kernels.vote.window2d import (
    DONE,
    FULL,
    OVERFLOW,
    SLABS,
    Room,
    clear_margin,
    describe,
    window_box,
)

__all__ = ["MOST_BEAMS", "count_beams"]

MOST_BEAMS = (1 << 16) - 1
"""A scan of more beams could pass what a count of 16 bits holds."""

Counts = npt.NDArray[np.uint16]


@borrowing
def count_beams(
    tiles: TileArrays,
    side: int,
    scans: ScanCells,
    first: int,
    window: Counts,
    block_tiles: int,
    room: Room,
) -> tuple[int, int]:
    """Give each cell one whole vote per beam.

    Args:
        tiles: the tile store, changed in place.
        side: cells along a tile's side.
        scans: the batch, of at most MOST_BEAMS a scan; `tips` is not read.
        first: scan to begin with.
        window: zeros, shape (2, at least (block_tiles * side + 2)^2); zeros again afterwards.
        block_tiles: how many tiles there may be along a window's side.
        room: to work in.

    Returns:
        The scan to go on with, and DONE, FULL or OVERFLOW.
    """
    table, box, key = room.table, room.box, room.key
    for scan in range(first, scans.tiles_lo.shape[0]):
        begin, end = scans.bundles[scan], scans.bundles[scan + 1]
        across = scans.tiles_hi[scan, 0] - scans.tiles_lo[scan, 0]
        up = scans.tiles_hi[scan, 1] - scans.tiles_lo[scan, 1]
        if not has_room(tiles, across * up, True):
            return scan, FULL
        alone = end - begin == 1
        if alone:
            describe(scans, begin, table)
        for block_y in range((up + block_tiles - 1) // block_tiles):
            for block_x in range((across + block_tiles - 1) // block_tiles):
                block = block_x, block_y
                stride = 0
                for bundle in range(begin, end):
                    if not alone:
                        describe(scans, bundle, table)
                    clipped = window_box(scans, scan, bundle, block, block_tiles, side, box)
                    stride = box[1] - box[0] + 2
                    count = scans.offsets[bundle + 1] - scans.offsets[bundle]
                    _count_passes(table, count, box, clipped, stride, window[PASSES], room.buffer)
                    _count_hits(scans, bundle, box, stride, window[HITS])
                key[0] = scans.tiles_lo[scan, 0] + block_x * block_tiles
                key[1] = scans.tiles_lo[scan, 1] + block_y * block_tiles
                if not _apply(tiles, side, window, stride, room):
                    return scan, OVERFLOW
    return scans.tiles_lo.shape[0], DONE


@borrowing
def _count_passes(
    table: npt.NDArray[np.int64],
    count: int,
    box: npt.NDArray[np.int64],
    clipped: bool,
    stride: int,
    window: Counts,
    buffer: npt.NDArray[np.int32],
) -> None:
    slabs = 0
    for i in range(count):
        slabs = emit_passes(table, i, 0, box, clipped, stride, buffer, slabs)
        if slabs >= SLABS:
            _count(buffer, slabs, window)
            slabs = 0
    _count(buffer, slabs, window)


@inlined
def _count(buffer: npt.NDArray[np.int32], slabs: int, window: Counts) -> None:
    for k in range(slabs):
        one, other = np.uint64(buffer[0, np.uint64(k)]), np.uint64(buffer[1, np.uint64(k)])
        window[one] += np.uint16(1)
        # Without a branch, which beams would take at random.
        window[other] += np.uint16(other != one)


@borrowing
def _count_hits(
    scans: ScanCells, bundle: int, box: npt.NDArray[np.int64], stride: int, window: Counts
) -> None:
    x_cell = np.int64(math.floor(scans.origins[bundle, 0]))
    y_cell = np.int64(math.floor(scans.origins[bundle, 1]))
    for i in range(scans.offsets[bundle], scans.offsets[bundle + 1]):
        if scans.hit[i]:
            x = np.int64(math.floor(scans.ends[i, 0])) - x_cell
            y = np.int64(math.floor(scans.ends[i, 1])) - y_cell
            if box[0] <= x < box[1] and box[2] <= y < box[3]:
                window[(y - box[2] + 1) * stride + x - box[0] + 1] += np.uint16(1)


@borrowing
def _apply(tiles: TileArrays, side: int, window: Counts, stride: int, room: Room) -> bool:
    """Add the window's counts to tiles, the first of which is at `room.key`, and zero it."""
    fits = True
    box, key, band = room.box, room.key, room.band
    hit, free = window[HITS], window[PASSES]
    across, up = (box[1] - box[0]) // side, (box[3] - box[2]) // side
    x_tile, y_tile = key[0], key[1]
    # Indices are unsigned here, so that loops over cells vectorise.
    for tile_y in range(up):
        corner = (tile_y * side + 1) * stride + 1
        # The most that a cell of each column has, in long loops: which tiles were touched, and by
        # how much their cells grow.
        for k in range(across * side):
            band[np.uint64(k)] = 0
        for row in range(side):
            for k in range(across * side):
                at = np.uint64(corner + row * stride + k)
                band[np.uint64(k)] = max(band[np.uint64(k)], max(hit[at], free[at]))
        for tile_x in range(across):
            most = np.uint16(0)
            for k in range(tile_x * side, (tile_x + 1) * side):
                most = max(most, band[np.uint64(k)])
            if most == 0:
                continue
            key[0], key[1] = x_tile + tile_x, y_tile + tile_y
            slot = find_or_insert(tiles, key)
            start = corner + tile_x * side
            if np.int64(tiles.load[slot]) + np.int64(most) <= NARROW_MAX:
                _add_votes(tiles, slot, hit, free, start, stride, side)
                grow_load(tiles, slot, np.int64(most))
            else:
                fits &= _add_units(tiles, slot, hit, free, start, stride, side, room.units)
    clear_margin(hit, stride, box[3] - box[2])
    clear_margin(free, stride, box[3] - box[2])
    return fits


@borrowing
def _add_votes(
    tiles: TileArrays, slot: int, hit: Counts, free: Counts, start: int, stride: int, side: int
) -> None:
    # Counts that bytes can take.
    hits, passes = tiles.narrow[slot, HITS], tiles.narrow[slot, PASSES]
    for row in range(side):
        at, to = start + row * stride, row * side
        for k in range(side):
            hits[np.uint64(to + k)] += np.uint8(hit[np.uint64(at + k)])
            passes[np.uint64(to + k)] += np.uint8(free[np.uint64(at + k)])
            hit[np.uint64(at + k)] = 0
            free[np.uint64(at + k)] = 0


@borrowing
def _add_units(
    tiles: TileArrays,
    slot: int,
    hit: Counts,
    free: Counts,
    start: int,
    stride: int,
    side: int,
    units: npt.NDArray[np.int64],
) -> bool:
    # Counts that may not fit bytes; False where a cell passed MAX_UNITS.
    hits, passes = units[HITS], units[PASSES]
    for row in range(side):
        at, to = start + row * stride, row * side
        for k in range(side):
            hits[np.uint64(to + k)] = np.int64(hit[np.uint64(at + k)]) << FRACTION_BITS
            passes[np.uint64(to + k)] = np.int64(free[np.uint64(at + k)]) << FRACTION_BITS
            hit[np.uint64(at + k)] = 0
            free[np.uint64(at + k)] = 0
    return add_units(tiles, slot, hits, passes)
