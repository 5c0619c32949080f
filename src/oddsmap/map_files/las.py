# SPDX-License-Identifier: Apache-2.0
"""The occupied cells of a map as LAS or LAZ points: for CloudCompare, QGIS, PDAL, survey software.

Source: ASPRS, LAS specification 1.4, R15; the package laspy.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.fields import CellPoints, PointPart
from oddsmap.odds import Thresholds

__all__ = ["errors_of_laz", "laspy_module", "save_las"]

_POINT_FORMAT = 6  # the plainest of LAS 1.4
_LARGEST = (1 << 31) - 1  # coordinates are an int32
_DIMENSIONS = (
    ("probability", "p(occupied)"),
    ("size", "side of the cube [m]"),
    ("hits", "weight [votes]"),
    ("passes", "weight [votes]"),
)


def save_las(
    cells: CellPoints,
    path: str | Path,
    *,
    crs: str | None = None,
    thresholds: Thresholds | None = None,
    force: bool = False,
) -> Path:
    """Write one point for each occupied cell, LAS 1.4, LAZ where the suffix says so.

    Coordinates count half cells from a corner of the map, so that the centre of every cell is
    exact. Further dimensions, float32, are `probability`, `size` [m], and where the map has counts
    `hits` and `passes` [votes], which need not be whole.

    Args:
        cells: the map's cells, or leaves of an octree.
        path: the file to write, named `.las` or `.laz`.
        crs: what its coordinates are in, such as EPSG:32632, see
            `oddsmap.map_files.geotiff.checked_crs`; None: not known.
        thresholds: the probability from which a cell counts as occupied; by default 0.65.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        ConfigError: laspy is not installed (for a CRS pyproj and rasterio, too), the suffix is
            another, or the CRS does not fit.
        InputError: the map has more than 2^30 cells along an axis.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".las", ".laz"):
        raise ConfigError(f"{path}: points of this kind are named .las or .laz")
    compressed = path.suffix.lower() == ".laz"
    header = _header(cells, path, crs)
    faults = errors_of_laz() if compressed else ()
    check_output(path, force=force)
    import laspy

    with atomic_output(path, force=force) as part, part.open("w+b") as file:
        try:
            with laspy.open(
                file, "w", header=header, do_compress=compressed, closefd=False
            ) as writer:
                for some in cells.points((thresholds or Thresholds()).occupied):
                    writer.write_points(_record(some, header))
        except faults as error:  # the disk is full
            raise OSError(str(error)) from None
    return path


def _record(some: PointPart, header: Any) -> Any:
    import laspy

    record = laspy.ScaleAwarePointRecord.zeros(len(some.side), header=header)
    for axis, name in enumerate("XYZ"):
        halves = (some.centre[:, axis] - header.offsets[axis]) / header.scales[axis]
        record[name] = np.rint(halves).astype(np.int32)
    record["return_number"] = record["number_of_returns"] = np.ones(len(record), np.uint8)
    values = (some.probability, some.side, some.hits, some.passes)
    for (name, _), column in zip(_DIMENSIONS, values, strict=True):
        if column is not None:
            record[name] = column
    return record


def errors_of_laz() -> tuple[type[Exception], ...]:
    """What the compressor raises.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        lazrs = import_module("lazrs")  # has no types
    except ImportError:
        raise ConfigError('LAZ is written with lazrs: pip install "oddsmap[survey]"') from None
    return (lazrs.LazrsError,)


def laspy_module() -> Any:
    """The package that writes LAS.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        return import_module("laspy")
    except ImportError:
        raise ConfigError(
            'LAS and LAZ are written with laspy: pip install "oddsmap[survey]"'
        ) from None


def _header(cells: CellPoints, path: Path, crs: str | None) -> Any:
    laspy = laspy_module()
    bounds = cells.bounds()
    header = laspy.LasHeader(point_format=_POINT_FORMAT, version="1.4")
    header.generating_software = "oddsmap"
    first = np.zeros(3) if bounds is None else bounds[0]
    if bounds is not None and (2 * (bounds[1] - bounds[0]) > _LARGEST).any():
        raise InputError(f"{path}: a LAS has room for 2^30 cells along an axis: crop the map")
    header.offsets = first * cells.resolution
    header.scales = np.full(3, cells.resolution / 2)
    kept = _DIMENSIONS if cells.has_counts else _DIMENSIONS[:2]
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, np.float32, description=words) for name, words in kept]
    )
    _add_crs(header, crs)
    return header


def _add_crs(header: Any, crs: str | None) -> None:
    if crs is None:
        return
    from oddsmap.map_files.geotiff import checked_crs

    checked_crs(crs)
    try:
        import pyproj
    except ImportError:
        raise ConfigError(
            '--crs of a LAS is written with pyproj: pip install "oddsmap[geo]"'
        ) from None
    header.add_crs(pyproj.CRS.from_user_input(crs))
