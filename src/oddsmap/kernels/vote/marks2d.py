# SPDX-License-Identifier: Apache-2.0
"""2D scans into tiles, one whole vote per cell and scan: mark a window, then apply it by tiles."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.segments2d import emit_passes, saturated_slabs
from oddsmap.kernels.units import HITS, PASSES
from oddsmap.kernels.vote.tiles import (
    TileArrays,
    find_or_insert,
    has_room,
    make_room_for_vote,
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

__all__ = ["mark_votes"]

_COARSEST = 16
"""Every 16th segment is traced whole, the ones between start where these two have diverged. With
1081 beams of 0.25 degrees at 0.05 m this halves the time (see benchmarks/README.md)."""

_FREE, _OCCUPIED = 1, 2


@borrowing
def mark_votes(
    tiles: TileArrays,
    side: int,
    scans: ScanCells,
    first: int,
    window: npt.NDArray[np.uint8],
    block_tiles: int,
    room: Room,
) -> tuple[int, int]:
    """Give each cell at most one whole vote per scan, hits before passes.

    Args:
        tiles: the tile store, changed in place.
        side: cells along a tile's side.
        scans: the batch; `tips` is not read.
        first: scan to begin with.
        window: zeros, at least (block_tiles * side + 2)^2 long; zeros again afterwards.
        block_tiles: how many tiles there may be along a window's side.
        room: to work in.

    Returns:
        The scan to go on with, and DONE, FULL or OVERFLOW.
    """
    table, buffer, box, key = room.table, room.buffer, room.box, room.key
    for scan in range(first, scans.tiles_lo.shape[0]):
        begin, end = scans.bundles[scan], scans.bundles[scan + 1]
        across = scans.tiles_hi[scan, 0] - scans.tiles_lo[scan, 0]
        up = scans.tiles_hi[scan, 1] - scans.tiles_lo[scan, 1]
        if not has_room(tiles, across * up, False):
            return scan, FULL
        alone = end - begin == 1
        if alone:
            describe(scans, begin, table)
        for block_y in range((up + block_tiles - 1) // block_tiles):
            for block_x in range((across + block_tiles - 1) // block_tiles):
                block = block_x, block_y
                stride = 0
                # All passes first: hits of one bundle go before the passes of another.
                for bundle in range(begin, end):
                    if not alone:
                        describe(scans, bundle, table)
                    clipped = window_box(scans, scan, bundle, block, block_tiles, side, box)
                    stride = box[1] - box[0] + 2
                    count = scans.offsets[bundle + 1] - scans.offsets[bundle]
                    _mark_passes(table, count, box, clipped, stride, window, buffer)
                for bundle in range(begin, end):
                    window_box(scans, scan, bundle, block, block_tiles, side, box)
                    _mark_hits(scans, bundle, box, stride, window)
                key[0] = scans.tiles_lo[scan, 0] + block_x * block_tiles
                key[1] = scans.tiles_lo[scan, 1] + block_y * block_tiles
                if not _apply_marks(tiles, side, window, stride, room):
                    return scan, OVERFLOW
    return scans.tiles_lo.shape[0], DONE


@borrowing
def _mark_passes(
    table: npt.NDArray[np.int64],
    count: int,
    box: npt.NDArray[np.int64],
    clipped: bool,
    stride: int,
    window: npt.NDArray[np.uint8],
    buffer: npt.NDArray[np.int32],
) -> None:
    # Coarse to fine: first every 16th segment, then the ones half way between two done ones.
    half, slabs = _COARSEST, 0
    while half > 0:
        start, step = (0, half) if half == _COARSEST else (half, 2 * half)
        for i in range(start, count, step):
            skip = 0
            if half < _COARSEST and i + half < count:
                skip = saturated_slabs(table, i, i - half, i + half)
            slabs = emit_passes(table, i, skip, box, clipped, stride, buffer, slabs)
            # Many at a time: the end of a loop is a branch that is guessed wrong, 5 ns per beam.
            if slabs >= SLABS:
                _mark(buffer, slabs, window)
                slabs = 0
        half //= 2
    _mark(buffer, slabs, window)


@inlined
def _mark(buffer: npt.NDArray[np.int32], slabs: int, window: npt.NDArray[np.uint8]) -> None:
    for k in range(slabs):
        window[np.uint64(buffer[0, np.uint64(k)])] = _FREE
        window[np.uint64(buffer[1, np.uint64(k)])] = _FREE


@borrowing
def _mark_hits(
    scans: ScanCells,
    bundle: int,
    box: npt.NDArray[np.int64],
    stride: int,
    window: npt.NDArray[np.uint8],
) -> None:
    x_cell = np.int64(math.floor(scans.origins[bundle, 0]))
    y_cell = np.int64(math.floor(scans.origins[bundle, 1]))
    for i in range(scans.offsets[bundle], scans.offsets[bundle + 1]):
        if scans.hit[i]:
            x = np.int64(math.floor(scans.ends[i, 0])) - x_cell
            y = np.int64(math.floor(scans.ends[i, 1])) - y_cell
            if box[0] <= x < box[1] and box[2] <= y < box[3]:
                window[(y - box[2] + 1) * stride + x - box[0] + 1] = _OCCUPIED


@borrowing
def _apply_marks(
    tiles: TileArrays,
    side: int,
    window: npt.NDArray[np.uint8],
    stride: int,
    room: Room,
) -> bool:
    """Add the window's marks to tiles, the first of which is at `room.key`, and zero the window."""
    fits = True
    box, key, band, found = room.box, room.key, room.band, room.found
    across, up = (box[1] - box[0]) // side, (box[3] - box[2]) // side
    x_tile, y_tile = key[0], key[1]
    # Indices are unsigned here, so that loops over cells vectorise: 15 times faster.
    for tile_y in range(up):
        corner = (tile_y * side + 1) * stride + 1
        # Which columns of a row of tiles have marks: in long loops, a third of the time of asking
        # tile by tile.
        for k in range(across * side):
            band[np.uint64(k)] = 0
        for row in range(side):
            for k in range(across * side):
                band[np.uint64(k)] |= window[np.uint64(corner + row * stride + k)]
        # Tiles first, then cells: look-ups wait for memory, and so several do at once.
        count = 0
        for tile_x in range(across):
            seen = np.uint8(0)
            for k in range(tile_x * side, (tile_x + 1) * side):
                seen |= band[np.uint64(k)]
            if seen == 0:
                continue
            key[0], key[1] = x_tile + tile_x, y_tile + tile_y
            slot = find_or_insert(tiles, key)
            fits &= make_room_for_vote(tiles, slot)
            found[count, 0], found[count, 1] = slot, corner + tile_x * side
            count += 1
        for i in range(count):
            slot = found[i, 0]
            hits, passes = tiles.narrow[slot, HITS], tiles.narrow[slot, PASSES]
            for row in range(side):
                at, to = found[i, 1] + row * stride, row * side
                for k in range(side):
                    mark = window[np.uint64(at + k)]
                    hits[np.uint64(to + k)] += np.uint8(mark >> 1)
                    passes[np.uint64(to + k)] += np.uint8(mark & 1)
                    window[np.uint64(at + k)] = 0
    clear_margin(window, stride, box[3] - box[2])
    return fits
