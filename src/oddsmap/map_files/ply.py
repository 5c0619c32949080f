# SPDX-License-Identifier: Apache-2.0
"""The occupied cells of a map as a PLY point cloud: for CloudCompare, MeshLab, Open3D, Blender."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError
from oddsmap.map_files.fields import Leaves
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
    probability = sigmoid(voxels.log_odds)
    known = np.ones(len(probability), np.bool_)
    occupied = (thresholds or Thresholds()).state(probability, known) == State.OCCUPIED
    side = np.int64(1) << voxels.level[occupied].astype(np.int64)
    vertex = np.empty(len(side), _VERTEX)
    for axis, name in enumerate("xyz"):
        vertex[name] = (voxels.index[occupied, axis] + side / 2) * voxels.resolution
    vertex["probability"] = probability[occupied]
    vertex["size"] = side * voxels.resolution
    properties = "".join(
        f"property {_NAMES[_VERTEX[name].str]} {name}\n" for name in _VERTEX.names or ()
    )
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment occupied cells of a map, by oddsmap\n"
        f"comment cell_size {float(voxels.resolution)!r}\n"
        f"element vertex {len(vertex)}\n{properties}end_header\n"
    )
    with atomic_output(path, force=force) as part, part.open("wb") as file:
        file.write(header.encode("ascii"))
        file.write(vertex.tobytes())
    return path
