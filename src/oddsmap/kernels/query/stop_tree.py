# SPDX-License-Identifier: Apache-2.0
"""Which cells end a ray, in a tree of bit masks that rays look up in registers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["SIDE_BITS", "StopTree"]

SIDE_BITS = {2: 3, 3: 2}
"""log2 of children along a side: 8 x 8 in 2D, 4 x 4 x 4 in 3D, so that 64 bits hold which of them
have a cell that ends a ray. Leaves are children of nodes, nodes of roots, and these are found by
hash: a root covers 512 x 512 cells or 64 x 64 x 64."""


class StopTree(NamedTuple):
    """Three levels of masks; the first three arrays are as in `TileArrays`, here of the roots.

    A bit that is not set: no cell in this child ends a ray. A bit that is set, and a row of -1: all
    of its cells do.
    """

    table: npt.NDArray[np.int64]
    """Open-addressing hash, a power of two long: row of a root, or -1."""
    coords: npt.NDArray[np.int64]
    """Coordinates of each root, shape (roots, d), x first."""
    counts: npt.NDArray[np.int64]
    """Roots used, shape (1,)."""
    roots: npt.NDArray[np.uint64]
    """Nodes in which a cell ends a ray, one bit each, x fastest, shape (roots,)."""
    nodes_of: npt.NDArray[np.int32]
    """Row of each node, or -1, shape (roots, 64)."""
    nodes: npt.NDArray[np.uint64]
    """Likewise the leaves of each node, shape (nodes,)."""
    leaves_of: npt.NDArray[np.int32]
    """Row of each leaf, or -1, shape (nodes, 64)."""
    leaves: npt.NDArray[np.uint64]
    """Likewise the cells of each leaf, shape (leaves,)."""
