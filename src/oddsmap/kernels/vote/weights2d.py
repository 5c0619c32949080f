# SPDX-License-Identifier: Apache-2.0
"""2D scans into tiles, with votes that fade, weigh less or are shared: weights in a window."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined
from oddsmap.kernels.trace.clip_beams import ScanCells
from oddsmap.kernels.trace.hit_region import BeamShape, fade_cells, zone_cells
from oddsmap.kernels.trace.segments2d import emit_passes
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.kernels.vote.forgetting import scale_units
from oddsmap.kernels.vote.tiles import TileArrays, add_units, find_or_insert, has_room
from oddsmap.kernels.vote.window2d import (
    DONE,
    FULL,
    OVERFLOW,
    Room,
    clear_margin,
    describe,
    window_box,
)

__all__ = ["count_votes"]


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
    clear_margin(window[HITS], stride, box[3] - box[2])
    clear_margin(window[PASSES], stride, box[3] - box[2])
    return fits
