# SPDX-License-Identifier: Apache-2.0
"""Which cells of a distance field have to be worked out anew once obstacles have changed."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import BoolArray, IntArray
from oddsmap.query.boxes import Box

__all__ = ["boxes_to_renew"]

_SIDE = {2: 32, 3: 16}
"""Cells along a block's side: what is worked out anew is whole blocks."""


def boxes_to_renew(
    box: Box, stays: Box, where: Box, changed: BoolArray, farthest: int, halo: int
) -> list[Box]:
    """Boxes that hold each cell whose distance may be another one, once each.

    Args:
        box: the cells of the field.
        stays: those of which there is a distance already.
        where: cells that may have changed.
        changed: whether they have, in the shape of `where`.
        farthest: no distance that there is, and none that matters, is larger [cells].
        halo: how far around a box is looked for obstacles [cells].

    Returns:
        Disjoint boxes: some, one around all of them, or all cells, by the least work.
    """
    side = _SIDE[len(box.lo)]
    rows = np.argwhere(changed)[:, ::-1] + where.lo
    if box.size == 0 or (len(rows) == 0 and stays.equals(box)):
        return []
    blocks = [-(-n // side) for n in box.shape]
    dirty = np.zeros(blocks, np.bool_)
    if not stays.equals(box):
        # Blocks that have a cell without a distance.
        kept = np.zeros(blocks, np.bool_)
        first = -(-(stays.lo - box.lo) // side)
        past = np.where(stays.hi == box.hi, blocks[::-1], (stays.hi - box.lo) // side)
        kept[tuple(slice(int(a), int(b)) for a, b in zip(first[::-1], past[::-1], strict=True))] = 1
        dirty = ~kept
    if len(rows):
        dirty |= _near(np.unique((rows - box.lo) // side, axis=0), blocks, side, farthest)
    parts = [_of_blocks(part, box, side) for part in _covering(dirty)]
    hull = parts[0]
    for part in parts[1:]:
        hull = hull.hull(part)
    choices = [
        ([box], box.size),
        (parts, _work(parts, box, halo)),
        ([hull], _work([hull], box, halo)),
    ]
    return min(choices, key=lambda choice: choice[1])[0]


def _near(changed: IntArray, blocks: list[int], side: int, farthest: int) -> BoolArray:
    """Blocks that have a cell within reach of a changed block, along each axis."""
    reach = -(-farthest // side)
    size = np.array(blocks[::-1])
    near = np.zeros(blocks, np.bool_)
    # Blocks outside the field are moved to its border, as far as they reach in.
    lo, hi = np.maximum(changed - reach, 0), np.minimum(changed + reach + 1, size)
    ends = np.zeros([n + 1 for n in blocks], np.int64)
    lo, hi = lo[(lo < hi).all(axis=1)], hi[(lo < hi).all(axis=1)]
    # +1 and -1 at the corners of each box of blocks, summed up along each axis.
    for corner in np.ndindex(*(2,) * len(blocks)):
        at = np.where(np.array(corner), hi, lo)
        np.add.at(ends, tuple(at.T[::-1]), -1 if sum(corner) % 2 else 1)
    for axis in range(len(blocks)):
        np.cumsum(ends, axis=axis, out=ends)
    near[...] = ends[tuple(slice(0, n) for n in blocks)] > 0
    return near


def _covering(dirty: BoolArray) -> list[Box]:
    """Disjoint boxes of blocks: runs along x, together where the next row has the same."""
    open_runs: dict[tuple[int, ...], Box] = {}
    done: list[Box] = []
    for row in np.ndindex(*dirty.shape[:-1]):
        steps = np.flatnonzero(np.diff(np.concatenate([[0], dirty[row].view(np.int8), [0]])))
        now: dict[tuple[int, ...], Box] = {}
        for a, b in zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True):
            key = (a, b, *row[:-1])
            lo = np.array([a, *row[::-1]], np.int64)
            begun = open_runs.pop(key, None)
            hi = np.array([b, *(n + 1 for n in row[::-1])], np.int64)
            now[key] = Box(lo if begun is None else begun.lo, hi)
        done += open_runs.values()
        open_runs = now
    return [*done, *open_runs.values()]


def _of_blocks(part: Box, box: Box, side: int) -> Box:
    return Box(box.lo + part.lo * side, np.minimum(box.lo + part.hi * side, box.hi))


def _work(parts: list[Box], box: Box, halo: int) -> int:
    return sum(part.wider(halo).meet(box).size for part in parts)
