# SPDX-License-Identifier: Apache-2.0
"""2D scans into tiles: mark a window around each scan, then apply it tile by tile.

The ray loop touches no hash: passes and hits are marked in a dense window that covers the scan,
and the window is then swept once. A window too large to be held is cut into blocks, and the scan
is traced once per block; which block a cell falls in changes no bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.hit_region import BeamShape, fade_cells, zone_cells
from oddsmap.kernels.trace.segments2d import emit_passes, saturated_slabs, set_up
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.kernels.vote.forgetting import scale_units
from oddsmap.kernels.vote.tiles import (
    TileArrays,
    add_units,
    find_or_insert,
    has_room,
    make_room_for_vote,
)

__all__ = ["DONE", "FULL", "OVERFLOW", "SLABS", "Room", "count_votes", "mark_votes"]

DONE, FULL, OVERFLOW = 0, 1, 2
"""All scans done; more tiles must be made room for first; a cell passed MAX_UNITS."""

_COARSEST = 16
"""Every 16th segment is traced whole, the ones between start where these two have diverged. With
1081 beams of 0.25 degrees at 0.05 m this halves the time (see benchmarks/README.md)."""

SLABS = 1024
"""About how many slabs are listed before their cells are marked."""

_FREE, _OCCUPIED = 1, 2


class Room(NamedTuple):
    """What the kernels here work in: they make no arrays of their own."""

    table: npt.NDArray[np.int64]
    """One scan's segments, shape (at least segments, COLUMNS)."""
    buffer: npt.NDArray[np.int32]
    """Segments' slabs, shape (2, at least SLABS + borders that one crosses + 10)."""
    units: npt.NDArray[np.int64]
    """One tile's hits and passes, shape (2, cells)."""
    box: npt.NDArray[np.int64]
    """A window, shape (4,)."""
    key: npt.NDArray[np.int64]
    """A tile's coordinates, shape (2,)."""
    band: npt.NDArray[np.uint8]
    """The columns of a window, shape (at least its width,)."""
    found: npt.NDArray[np.int64]
    """Tiles across a window, shape (at least so many, 2)."""


@borrowing
def _describe(scans: ScanCells, bundle: int, table: npt.NDArray[np.int64]) -> None:
    ox, oy = scans.origins[bundle]
    first = scans.offsets[bundle]
    for i in range(first, scans.offsets[bundle + 1]):
        set_up(ox, oy, scans.fades[i, 0], scans.fades[i, 1], table, i - first)


@borrowing
def _window_box(
    scans: ScanCells,
    scan: int,
    bundle: int,
    block: tuple[int, int],
    block_tiles: int,
    side: int,
    box: npt.NDArray[np.int64],
) -> bool:
    # Box of one block of the scan's window, relative to the bundle's first cell; True if it is not
    # all.
    clipped = False
    for axis in range(2):
        cell = np.int64(math.floor(scans.origins[bundle, axis]))
        lo = scans.tiles_lo[scan, axis] + block[axis] * block_tiles
        hi = min(lo + block_tiles, scans.tiles_hi[scan, axis])
        clipped |= lo > scans.tiles_lo[scan, axis] or hi < scans.tiles_hi[scan, axis]
        box[2 * axis] = lo * side - cell
        box[2 * axis + 1] = hi * side - cell
    return clipped


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
            _describe(scans, begin, table)
        for block_y in range((up + block_tiles - 1) // block_tiles):
            for block_x in range((across + block_tiles - 1) // block_tiles):
                block = block_x, block_y
                stride = 0
                # All passes first: hits of one bundle go before the passes of another.
                for bundle in range(begin, end):
                    if not alone:
                        _describe(scans, bundle, table)
                    clipped = _window_box(scans, scan, bundle, block, block_tiles, side, box)
                    stride = box[1] - box[0] + 2
                    count = scans.offsets[bundle + 1] - scans.offsets[bundle]
                    _mark_passes(table, count, box, clipped, stride, window, buffer)
                for bundle in range(begin, end):
                    _window_box(scans, scan, bundle, block, block_tiles, side, box)
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
    _clear_margin(window, stride, box[3] - box[2])
    return fits


@borrowing
def _clear_margin(window: npt.NDArray[np.generic], stride: int, height: int) -> None:
    window[:stride] = 0
    window[(height + 1) * stride : (height + 2) * stride] = 0
    for row in range(1, height + 1):
        window[row * stride] = 0
        window[row * stride + stride - 1] = 0


@borrowing
def count_votes(
    tiles: TileArrays,
    side: int,
    scans: ScanCells,
    first: int,
    window: npt.NDArray[np.int64],
    block_tiles: int,
    room: Room,
    every_beam: bool,
    shape: BeamShape,
    scale: int,
    cells: npt.NDArray[np.int64],
    left: npt.NDArray[np.float64],
    weights: npt.NDArray[np.int64],
    lost: npt.NDArray[np.int64],
) -> tuple[int, int]:
    """Votes that add up (`every_beam`), fade, or weigh less; in units of 1/65536 vote.

    Args:
        tiles: the tile store, changed in place.
        side: cells along a tile's side.
        scans: the batch.
        first: scan to begin with.
        window: zeros, shape (2, at least (block_tiles * side + 2)^2); zeros again afterwards.
        block_tiles: how many tiles there may be along a window's side.
        room: to work in.
        every_beam: True: the weights of a scan's beams add up. False: a cell gets the largest hit
            weight of the scan, and only if that is 0 the largest pass weight.
        shape: how a beam votes around its return.
        scale: what the scans' votes weigh [1/65536], see `scale_units`.
        cells: room for the cells of one beam's occupied part, or of its fading one, shape
            (enough, 2).
        left: room for where they are left, shape (enough,).
        weights: room for their weights, shape (enough,).
        lost: lost[0] grows by the weights above 0 that the scale has made 0.

    Returns:
        The scan to go on with, and DONE, FULL or OVERFLOW.
    """
    table, buffer, box, key = room.table, room.buffer, room.box, room.key
    for scan in range(first, scans.tiles_lo.shape[0]):
        begin, end = scans.bundles[scan], scans.bundles[scan + 1]
        across = scans.tiles_hi[scan, 0] - scans.tiles_lo[scan, 0]
        up = scans.tiles_hi[scan, 1] - scans.tiles_lo[scan, 1]
        if not has_room(tiles, across * up, True):
            return scan, FULL
        alone = end - begin == 1
        if alone:
            _describe(scans, begin, table)
        for block_y in range((up + block_tiles - 1) // block_tiles):
            for block_x in range((across + block_tiles - 1) // block_tiles):
                block = block_x, block_y
                stride = 0
                for bundle in range(begin, end):
                    if not alone:
                        _describe(scans, bundle, table)
                    clipped = _window_box(scans, scan, bundle, block, block_tiles, side, box)
                    stride = box[1] - box[0] + 2
                    _count_bundle(
                        scans, bundle, table, box, clipped, stride, window, buffer,
                        every_beam, shape, cells, left, weights,
                    )  # fmt: skip
                key[0] = scans.tiles_lo[scan, 0] + block_x * block_tiles
                key[1] = scans.tiles_lo[scan, 1] + block_y * block_tiles
                if not _apply_counts(tiles, side, window, stride, room, every_beam, scale, lost):
                    return scan, OVERFLOW
    return scans.tiles_lo.shape[0], DONE


@borrowing
def _count_bundle(
    scans: ScanCells,
    bundle: int,
    table: npt.NDArray[np.int64],
    box: npt.NDArray[np.int64],
    clipped: bool,
    stride: int,
    window: npt.NDArray[np.int64],
    buffer: npt.NDArray[np.int32],
    every_beam: bool,
    shape: BeamShape,
    cells: npt.NDArray[np.int64],
    left: npt.NDArray[np.float64],
    weights: npt.NDArray[np.int64],
) -> None:
    hits, passes = window[HITS], window[PASSES]
    origin, first = scans.origins[bundle], scans.offsets[bundle]
    for i in range(first, scans.offsets[bundle + 1]):
        slabs = emit_passes(table, i - first, 0, box, clipped, stride, buffer, 0)
        _count_passes(passes, buffer, slabs, every_beam)
        if shape.fade > 0.0:
            count = fade_cells(origin, scans.fades, scans.ends, i, shape.fade, cells, left, weights)
            _count_cells(origin, cells, weights, count, box, stride, passes, every_beam)
        if scans.hit[i]:
            count = zone_cells(scans.ends, scans.tips, i, shape, cells, left, weights)
            _count_cells(origin, cells, weights, count, box, stride, hits, every_beam)


@inlined
def _count_passes(
    window: npt.NDArray[np.int64], buffer: npt.NDArray[np.int32], slabs: int, every_beam: bool
) -> None:
    for k in range(slabs):
        one, other = np.uint64(buffer[0, np.uint64(k)]), np.uint64(buffer[1, np.uint64(k)])
        if every_beam:
            window[one] += ONE
            # Without a branch, which beams would take at random.
            window[other] += ONE * np.int64(other != one)
        else:
            window[one] = ONE
            window[other] = ONE


@borrowing
def _count_cells(
    origin: npt.NDArray[np.float64],
    cells: npt.NDArray[np.int64],
    weights: npt.NDArray[np.int64],
    count: int,
    box: npt.NDArray[np.int64],
    stride: int,
    window: npt.NDArray[np.int64],
    every_beam: bool,
) -> None:
    x_cell = np.int64(math.floor(origin[0]))
    y_cell = np.int64(math.floor(origin[1]))
    for k in range(count):
        x, y = cells[k, 0] - x_cell, cells[k, 1] - y_cell
        if box[0] <= x < box[1] and box[2] <= y < box[3]:
            at = (y - box[2] + 1) * stride + x - box[0] + 1
            window[at] = window[at] + weights[k] if every_beam else max(window[at], weights[k])


@borrowing
def _apply_counts(
    tiles: TileArrays,
    side: int,
    window: npt.NDArray[np.int64],
    stride: int,
    room: Room,
    every_beam: bool,
    scale: int,
    lost: npt.NDArray[np.int64],
) -> bool:
    """Add the window's weights to tiles, the first of which is at `room.key`, and zero it."""
    fits = True
    box, key, hits, passes = room.box, room.key, room.units[HITS], room.units[PASSES]
    across, up = (box[1] - box[0]) // side, (box[3] - box[2]) // side
    x_tile, y_tile = key[0], key[1]
    for tile_y in range(up):
        for tile_x in range(across):
            corner = (tile_y * side + 1) * stride + tile_x * side + 1
            seen = np.int64(0)
            for row in range(side):
                for k in range(side):
                    at = corner + row * stride + k
                    hit, free = window[HITS, at], window[PASSES, at]
                    if not every_beam and hit > 0:
                        free = np.int64(0)
                    hits[row * side + k] = hit
                    passes[row * side + k] = free
                    seen |= hit | free
                    window[HITS, at] = 0
                    window[PASSES, at] = 0
            lost[0] += scale_units(hits, scale) + scale_units(passes, scale)
            if seen != 0 and (hits.any() or passes.any()):
                key[0], key[1] = x_tile + tile_x, y_tile + tile_y
                fits &= add_units(tiles, find_or_insert(tiles, key), hits, passes)
    _clear_margin(window[HITS], stride, box[3] - box[2])
    _clear_margin(window[PASSES], stride, box[3] - box[2])
    return fits
