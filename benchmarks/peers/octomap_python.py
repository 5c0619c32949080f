# SPDX-License-Identifier: Apache-2.0
"""OctoMap, as `pip install octomap-python` gives it: plain insertion, with all its defaults.

`insertPointCloud(points, origin)` without a limit of range, with inner nodes updated at once, each
point with a ray of its own (not discretised): one update a cell and scan, hits before passes.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Cloud", "available", "cells", "insert", "known_cells", "leaves", "seconds", "write"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

Cloud = tuple[FloatArray, FloatArray]
"""End points in the map frame [m], shape (n, 3), and the sensor's position [m], shape (3,)."""

_DEPTH, _HALF = 16, 1 << 15


def available() -> tuple[bool, str]:
    """Whether it is installed, and its version or how to get it."""
    if importlib.util.find_spec("octomap") is None:
        return False, "not available: pip install octomap-python"
    return True, "octomap-python " + importlib.metadata.version("octomap-python")


def insert(clouds: Sequence[Cloud], resolution: float) -> Any:
    """A new tree with some scans."""
    import octomap

    tree = octomap.OcTree(resolution)
    for points, origin in clouds:
        tree.insertPointCloud(points, origin)
    return tree


def seconds(clouds: Sequence[Cloud], resolution: float) -> tuple[float, float]:
    """CPU and wall time of insertion into a new tree; taking the tree down is not in it."""
    cpu, wall = time.process_time(), time.perf_counter()
    tree = insert(clouds, resolution)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    del tree
    return cpu, wall


def leaves(tree: Any) -> tuple[IntArray, IntArray, FloatArray]:
    """Leaves of a tree: lowest cell (ix, iy, iz), cells along a side, log odds."""
    rows = []
    for leaf in tree.begin_leafs():
        key = leaf.getKey()
        rows.append((key[0], key[1], key[2], leaf.getDepth(), leaf.getValue()))
    table = np.array(rows, np.float64).reshape(-1, 5)
    side = 1 << (_DEPTH - table[:, 3].astype(np.int64))
    # The key of a pruned leaf is that of its middle.
    first = table[:, :3].astype(np.int64) - _HALF
    return np.where(side[:, None] > 1, first - side[:, None] // 2, first), side, table[:, 4]


def cells(tree: Any) -> tuple[IntArray, FloatArray]:
    """Every known cell (ix, iy, iz), pruned leaves taken apart, and its log odds."""
    first, side, log_odds = leaves(tree)
    parts, values = [], []
    for width in np.unique(side):
        chosen = side == width
        within = np.stack(np.meshgrid(*[np.arange(width)] * 3, indexing="ij"), axis=-1)
        parts.append((first[chosen, None, :] + within.reshape(1, -1, 3)).reshape(-1, 3))
        values.append(np.repeat(log_odds[chosen], width**3))
    return np.concatenate(parts), np.concatenate(values)


def known_cells(tree: Any) -> int:
    """How many cells are known, pruned leaves counted in full."""
    depths = np.fromiter((leaf.getDepth() for leaf in tree.begin_leafs()), np.int64)
    return int((1 << 3 * (_DEPTH - depths)).sum())


def write(tree: Any, path: Path) -> int:
    """Write the `.ot`; returns its size in bytes."""
    tree.write(str(path).encode())
    return path.stat().st_size
