# SPDX-License-Identifier: Apache-2.0
"""The occupied cells of a map as a PLY point cloud: for CloudCompare, MeshLab, Open3D, Blender."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray
from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError
from oddsmap.map_files.fields import LeafPart, Leaves
from oddsmap.map_files.front import put_in_front
from oddsmap.map_files.morton import unmorton
from oddsmap.odds import State, Thresholds, sigmoid

__all__ = ["save_ply"]

# Centres in double precision: at UTM coordinates single precision is off by half a metre.
_VERTEX = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("probability", "<f4"), ("size", "<f4")]
)
_NAMES = {"<f8": "double", "<f4": "float"}


def save_ply(
    voxels: Leaves,
    path: str | Path,
    *,
    thresholds: Thresholds | None = None,
    force: bool = False,
) -> Path:
    """Write one point for each occupied leaf, binary little endian.

    A vertex has the centre `x`, `y`, `z` [m] (double), `probability` and `size`, the side of the
    cube [m] (float). The header has the side of a cell as well: `comment cell_size 0.1`.

    Args:
        voxels: the map's leaves.
        path: the file to write, named `.ply`.
        thresholds: the probability from which a cell counts as occupied; by default 0.65.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        ConfigError: the suffix is another.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix != ".ply":
        raise ConfigError(f"{path}: a PLY is named .ply; give a name that ends in .ply")
    check_output(path, force=force)
    limits = thresholds or Thresholds()
    count = 0
    with atomic_output(path, force=force) as part, part.open("w+b") as file:
        for leaves in voxels.parts(sigmoid):
            known = np.ones(len(leaves.value), np.bool_)
            vertex = _vertices(voxels, leaves, limits.state(leaves.value, known) == State.OCCUPIED)
            file.write(vertex.tobytes())
            count += len(vertex)
        put_in_front(file, _header(voxels, count).encode("ascii"))
    return path


def _vertices(voxels: Leaves, leaves: LeafPart, chosen: BoolArray) -> npt.NDArray[np.void]:
    index = unmorton(leaves.code[chosen]) + voxels.base
    side = np.int64(1) << leaves.level[chosen].astype(np.int64)
    vertex = np.empty(len(side), _VERTEX)
    for axis, name in enumerate("xyz"):
        vertex[name] = (index[:, axis] + side / 2) * voxels.resolution
    vertex["probability"] = leaves.value[chosen]
    vertex["size"] = side * voxels.resolution
    return vertex


def _header(voxels: Leaves, count: int) -> str:
    properties = "".join(
        f"property {_NAMES[_VERTEX[name].str]} {name}\n" for name in _VERTEX.names or ()
    )
    return (
        "ply\nformat binary_little_endian 1.0\ncomment occupied cells of a map, by oddsmap\n"
        f"comment cell_size {float(voxels.resolution)!r}\n"
        f"element vertex {count}\n{properties}end_header\n"
    )
