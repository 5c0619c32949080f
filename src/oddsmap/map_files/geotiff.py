# SPDX-License-Identifier: Apache-2.0
"""A plane as a GeoTIFF, for QGIS and other GIS: probability, hits and passes as bands.

Source: OGC 19-008r4, GeoTIFF 1.1; GDAL's driver GTiff.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias
from zlib import crc32

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.decoding import decoding
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.fields import Plane, PlanePart
from oddsmap.map_files.plane import windows

__all__ = ["checked_crs", "save_geotiff"]

Span: TypeAlias = tuple[int, int]

_TILE = 256
_MOST_CELLS = 1 << 34  # take half an hour; two places far from each other span more than that
_CACHE_MB = 64  # of GDAL, which else takes 5 % of the machine's memory


def save_geotiff(
    plane: Plane, path: str | Path, *, crs: str | None = None, force: bool = False
) -> Path:
    """Write a plane as bands of float32, tiled and deflated, north up unless it is rotated.

    Band 1, `probability`, is p(occupied), NaN where unknown. Where the map has counts, bands 2 and
    3 are `hits` and `passes` [votes], 0 where unknown. The first row is the highest y. Written in
    windows of a million cells, and read back before it takes its place.

    Args:
        plane: the map.
        path: the file to write, named `.tif` or `.tiff`.
        crs: what its coordinates are in, as PROJ names it (EPSG:32632, or WKT); None: not known.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: it has more than 2^34 cells.
        ConfigError: rasterio is not installed, the suffix is another, or see `checked_crs`.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise ConfigError(f"{path}: a GeoTIFF is named .tif; give a name that ends in .tif")
    checked = checked_crs(crs)
    rasterio = _rasterio()
    check_output(path, force=force)
    ny, nx = plane.shape
    if nx * ny > _MOST_CELLS:
        raise InputError(
            f"{path}: a plane of {nx} x {ny} cells, of which {_MOST_CELLS:.3g} can be written: "
            "make it of a coarser map, or crop it to what belongs together"
        )
    names = ("probability", "hits", "passes") if plane.has_counts else ("probability",)
    profile = {
        "driver": "GTiff", "width": nx, "height": ny, "count": len(names), "dtype": "float32",
        "nodata": math.nan, "crs": checked, "transform": _transform(plane), "tiled": True,
        "blockxsize": _TILE, "blockysize": _TILE, "compress": "deflate", "predictor": 3,
        "interleave": "band", "bigtiff": "if_safer",
    }  # fmt: skip
    with (
        atomic_output(path, force=force) as part,
        rasterio.Env(GDAL_CACHEMAX=_CACHE_MB),
        _faults_of_gdal(),
    ):
        sums = []
        with rasterio.open(part, "w", **profile) as file:
            file.update_tags(AREA_OR_POINT="Area", SOFTWARE="oddsmap")
            for number, name in enumerate(names, 1):
                file.set_band_description(number, name)
            for rows, columns in windows((ny, nx), from_top=True):
                bands = _bands(plane.part(rows, columns))[: len(names), ::-1]
                file.write(bands, window=_window(ny, rows, columns))
                sums.append(crc32(bands.tobytes()))
        # The last blocks are written on closing, and GDAL says nothing where there is no room.
        with rasterio.open(part) as file:
            for (rows, columns), expected in zip(
                windows((ny, nx), from_top=True), sums, strict=True
            ):
                if crc32(file.read(window=_window(ny, rows, columns)).tobytes()) != expected:
                    raise OSError("it is not what was written: is the disk full?")
    return path


def checked_crs(crs: str | None) -> Any:
    """A coordinate reference system in which a map in metres may be.

    Args:
        crs: as PROJ names it; None: none.

    Raises:
        ConfigError: it is not known, is not of a plane, or does not count metres; or rasterio is
            not installed.
    """
    if crs is None:
        return None
    rasterio = _rasterio()
    fault = f"--crs {crs}: not a coordinate reference system that PROJ knows"
    with (
        rasterio.Env(),
        decoding("the map's coordinates", fault, "say EPSG:32632, or WKT", ConfigError),
    ):
        found = rasterio.crs.CRS.from_user_input(crs)
    if not found.is_projected:
        raise ConfigError(
            f"--crs {crs}: not of a plane in metres, which the map is in: say the projected one, "
            "such as EPSG:32632 (UTM 32 north)"
        )
    name, metres = found.linear_units_factor
    if not math.isclose(metres, 1.0, rel_tol=1e-9):
        raise ConfigError(f"--crs {crs}: counts in {name}, and the map is in metres")
    return found


@contextmanager
def _faults_of_gdal() -> Iterator[None]:
    """Turn what GDAL could not write into an error of the system, as other files have them.

    Raises:
        OSError: it could not.
    """
    from rasterio.errors import RasterioError

    try:
        yield
    except RasterioError as error:
        raise OSError(str(error.__cause__ or error)) from None


def _window(ny: int, rows: Span, columns: Span) -> tuple[Span, Span]:
    """Rows of the image, of which the first is the top, and columns."""
    return (ny - rows[1], ny - rows[0]), columns


def _rasterio() -> Any:
    try:
        import rasterio
        import rasterio.crs
    except ImportError:
        raise ConfigError(
            'GeoTIFFs are written with rasterio: pip install "oddsmap[geo]"'
        ) from None
    return rasterio


def _transform(plane: Plane) -> Any:
    """Column and row of the image to x and y [m]: row 0 is the top."""
    from rasterio.transform import Affine

    (x, y), side, height = plane.origin, plane.resolution, plane.resolution * plane.shape[0]
    cos, sin = math.cos(plane.yaw), math.sin(plane.yaw)
    return Affine(
        side * cos, side * sin, x - height * sin, side * sin, -side * cos, y + height * cos
    )


def _bands(part: PlanePart) -> npt.NDArray[np.float32]:
    bands = np.zeros((3, *part.observed.shape), np.float32)
    bands[0] = np.nan
    np.copyto(bands[0], part.probability, where=part.observed, casting="same_kind")
    if part.hits is not None:
        bands[1], bands[2] = part.hits, part.passes
    return bands
