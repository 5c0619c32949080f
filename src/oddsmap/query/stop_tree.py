# SPDX-License-Identifier: Apache-2.0
"""Masks of the cells that end a ray, made of the states of all cells."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, IntArray
from oddsmap.kernels.query.state_blocks import BLOCK_BITS, UNKNOWN, StateBlocks
from oddsmap.kernels.query.stop_tree import SIDE_BITS, StopTree
from oddsmap.kernels.vote.tiles import enter

__all__ = ["plant"]

Masks = npt.NDArray[np.uint64]
Rows = npt.NDArray[np.int32]


def plant(blocks: StateBlocks, stop: np.uint8) -> tuple[StopTree, IntArray, IntArray]:
    """The tree of cells that have one of some states.

    Args:
        blocks: the states of cells.
        stop: bits of the states that end a ray.

    Returns:
        The tree, and the box of the blocks that have such a cell: first cell and past the last,
        shape (d,); if unknown cells end a ray they do so outside, too.
    """
    ndim = blocks.coords.shape[1]
    outside = bool(stop & UNKNOWN)
    used = slice(0, int(blocks.counts[0]))
    coords, states = blocks.coords[used], blocks.states[used]
    if not outside:
        chosen = (blocks.present[used] & stop) != 0
        coords, states = coords[chosen], states[chosen]
    if len(coords):
        lo, hi = coords.min(axis=0) << BLOCK_BITS, (coords.max(axis=0) + 1) << BLOCK_BITS
    else:
        lo = hi = np.zeros(ndim, np.int64)
    coords, leaves = _leaves(coords, (states & stop) != 0)
    if not outside:
        coords, leaves = coords[leaves != 0], leaves[leaves != 0]
    coords, nodes, leaves_of = _above(coords, leaves, outside)
    coords, roots, nodes_of = _above(coords, nodes, outside)
    slots = 64
    while slots < 2 * len(roots):
        slots *= 2
    tree = StopTree(
        table=np.full(slots, -1, np.int64),
        coords=coords,
        counts=np.array([len(roots)], np.int64),
        roots=roots,
        nodes_of=nodes_of,
        nodes=nodes,
        leaves_of=leaves_of,
        leaves=leaves,
    )
    enter(tree, 0)
    return tree, lo, hi


def _leaves(coords: IntArray, ends: BoolArray) -> tuple[IntArray, Masks]:
    """Leaves of blocks: their coordinates and masks."""
    n, ndim = coords.shape
    if SIDE_BITS[ndim] == BLOCK_BITS:
        return coords, _masks(ends)
    parts = 1 << (BLOCK_BITS - SIDE_BITS[ndim])
    side = 1 << SIDE_BITS[ndim]
    # Along each axis, z first, which leaf and which cell of it; then all leaves before all cells.
    split = ends.reshape(n, *(parts, side) * ndim)
    split = split.transpose(0, *range(1, 2 * ndim, 2), *range(2, 2 * ndim + 1, 2))
    within = np.stack(np.unravel_index(np.arange(parts**ndim), (parts,) * ndim)[::-1], axis=1)
    of_leaves = (coords[:, None] * parts + within).reshape(-1, ndim)
    return of_leaves, _masks(split.reshape(n * parts**ndim, side**ndim))


def _above(coords: IntArray, masks: Masks, outside: bool) -> tuple[IntArray, Masks, Rows]:
    """One level up: coordinates, masks, and the row of each child."""
    ndim = coords.shape[1]
    bits = SIDE_BITS[ndim]
    parents, which = _distinct(coords >> bits)
    within = coords - (coords >> bits << bits)
    place = (within << (bits * np.arange(ndim))).sum(axis=1)
    some = np.full((len(parents), 64), outside)
    some[which, place] = masks != 0
    rows = np.full((len(parents), 64), -1, np.int32)
    rows[which, place] = np.arange(len(coords))
    return parents, _masks(some), rows


def _distinct(coords: IntArray) -> tuple[IntArray, IntArray]:
    """Different rows, and which of them each row is."""
    if len(coords) == 0:
        return coords, np.empty(0, np.int64)
    lo = coords.min(axis=0)
    span = [int(n) for n in coords.max(axis=0) - lo + 1]
    if np.prod(np.array(span, np.float64)) < 2.0**62:
        # A number for each row: sorting numbers takes a tenth of the time of sorting rows.
        numbers = np.ravel_multi_index(tuple((coords - lo).T), span)
        found, which = np.unique(numbers, return_inverse=True)
        return np.stack(np.unravel_index(found, span), axis=1) + lo, which
    rows, which = np.unique(coords, axis=0, return_inverse=True)
    return rows, which.ravel()


def _masks(flags: BoolArray) -> Masks:
    """64 flags as the bits of one number, the first lowest: shape (n, 64) in, (n,) out."""
    packed = np.packbits(flags, axis=1, bitorder="little")
    return packed.view("<u8").ravel().astype(np.uint64)
