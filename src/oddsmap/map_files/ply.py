# SPDX-License-Identifier: Apache-2.0
"""The occupied cells of a map as a PLY point cloud: for CloudCompare, MeshLab, Open3D, Blender."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError
from oddsmap.map_files.fields import CellPoints, PointPart
from oddsmap.map_files.front import put_in_front
from oddsmap.odds import Thresholds

__all__ = ["save_ply"]

# Centres in double precision: at UTM coordinates single precision is off by half a metre.
_VERTEX = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("probability", "<f4"), ("size", "<f4")]
_COUNTS = [("hits", "<f4"), ("passes", "<f4")]
_NAMES = {"<f8": "double", "<f4": "float"}


def save_ply(
    cells: CellPoints,
    path: str | Path,
    *,
    thresholds: Thresholds | None = None,
    force: bool = False,
) -> Path:
    """Write one point for each occupied cell, binary little endian.

    A vertex has the centre `x`, `y`, `z` [m] (double), `probability` and `size`, the side of the
    cube [m] (float), and where the map has counts `hits` and `passes` [votes] (float). The header
    has the side of a cell as well: `comment cell_size 0.1`.

    Args:
        cells: the map's cells, or leaves of an octree.
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
    kind = np.dtype(_VERTEX + (_COUNTS if cells.has_counts else []))
    count = 0
    with atomic_output(path, force=force) as part, part.open("w+b") as file:
        for some in cells.points((thresholds or Thresholds()).occupied):
            file.write(_vertices(some, kind).tobytes())
            count += len(some.side)
        put_in_front(file, _header(cells.resolution, kind, count).encode("ascii"))
    return path


def _vertices(some: PointPart, kind: np.dtype[np.void]) -> npt.NDArray[np.void]:
    vertex = np.empty(len(some.side), kind)
    for axis, name in enumerate("xyz"):
        vertex[name] = some.centre[:, axis]
    vertex["probability"], vertex["size"] = some.probability, some.side
    if some.hits is not None:
        vertex["hits"], vertex["passes"] = some.hits, some.passes
    return vertex


def _header(resolution: float, kind: np.dtype[np.void], count: int) -> str:
    properties = "".join(f"property {_NAMES[kind[name].str]} {name}\n" for name in kind.names or ())
    return (
        "ply\nformat binary_little_endian 1.0\ncomment occupied cells of a map, by oddsmap\n"
        f"comment cell_size {float(resolution)!r}\n"
        f"element vertex {count}\n{properties}end_header\n"
    )
