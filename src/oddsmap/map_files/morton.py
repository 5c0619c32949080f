# SPDX-License-Identifier: Apache-2.0
"""Morton codes: the order of the cells in an octree."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import IntArray

__all__ = ["MORTON_BITS", "morton", "unmorton"]

MORTON_BITS = 21
"""Bits of one axis in a Morton code: three of them fill 63."""


# Steps that move the bits of one axis apart, to every third place, and back.
_SPREAD = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def morton(place: IntArray) -> IntArray:
    """Morton codes of places of 0 to 2^21 - 1 cells along each axis.

    Args:
        place: shape (n, 3), x first; x takes the lowest bit.
    """
    code = np.zeros(len(place), np.int64)
    for axis in range(3):
        bits = place[:, axis].copy()
        for shift, mask in _SPREAD:
            bits |= bits << shift
            bits &= mask
        code |= bits << axis
    return code


def unmorton(code: IntArray) -> IntArray:
    """The inverse of `morton`: places, shape (n, 3)."""
    place = np.empty((len(code), 3), np.int64)
    masks = [*[mask for _, mask in _SPREAD][::-1], (1 << MORTON_BITS) - 1]
    shifts = [shift for shift, _ in _SPREAD][::-1]
    for axis in range(3):
        bits = (code >> axis) & masks[0]
        for shift, mask in zip(shifts, masks[1:], strict=True):
            bits |= bits >> shift
            bits &= mask
        place[:, axis] = bits
    return place
