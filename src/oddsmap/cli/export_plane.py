# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` writes of planes: ROS maps, pictures, GeoTIFF; and planes of space."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.export_formats import HEIGHTS
from oddsmap.cli.picture_options import frame_options
from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.export_sources import Source
    from oddsmap.map_files.fields import Plane
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.odds import Thresholds

__all__ = ["grid_of", "plane_of", "write_geotiff", "write_overview", "write_picture", "write_ros"]

Options = Mapping[str, Any]


def write_picture(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write a picture: `.png`, `.pdf` or `.svg`."""
    from oddsmap.plot.picture import save_picture

    grid = grid_of(view, options)[0]
    save_picture(grid, output, force=force, **frame_options(options))
    return Written([output], grid.notes)


def write_overview(
    grid: ProbabilityMap, source: Path, output: Path, options: Options, force: bool
) -> Written:
    """Write a picture of a map that does not fit in memory, from blocks of its cells."""
    from oddsmap.errors import ConfigError
    from oddsmap.plot.picture import save_picture

    if _banded(options):
        raise ConfigError(
            "--z-min, --z-max, --ground, --rule and --slab need a 3D map, this one is 2D"
        )
    save_picture(grid, output, force=force, **frame_options(options))
    side = f"{grid.resolution:g} m"
    return Written(
        [output],
        (
            f"{source.name} does not fit in memory as a picture of all its cells: drawn in blocks "
            f"of {side}; --box or --crop draws a part of it in its cells",
        ),
    )


def write_ros(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write a ROS map: `.yaml` and its image."""
    from oddsmap.cli.undecided import knows_undecided, undecided_in_plane
    from oddsmap.map_files.plane import ArrayPlane
    from oddsmap.map_files.ros_writer import save_ros

    grid, thresholds = grid_of(view, options)
    mode = options.get("mode", "trinary")
    written = save_ros(grid, output, mode=mode, thresholds=thresholds, force=force)
    notes: tuple[str, ...] = grid.notes
    if mode == "trinary" and not knows_undecided(notes):
        note = undecided_in_plane(ArrayPlane(grid), thresholds, view)
        notes += () if note is None else (note,)
    return Written(list(written), notes)


def write_geotiff(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write a GeoTIFF: `.tif`."""
    from oddsmap.map_files.geotiff import save_geotiff

    crs = options.get("crs")
    plane, notes = plane_of(view, options)
    save_geotiff(plane, output, crs=crs, force=force)
    if crs is not None:
        return Written([output], notes)
    return Written(
        [output],
        (
            *notes,
            "the file does not say where on the Earth it is: --crs EPSG:32632 (or what your "
            "coordinates are in) does",
        ),
    )


def plane_of(view: Source, options: Options) -> tuple[Plane, tuple[str, ...]]:
    """A 2D map, or a band of heights of a 3D map, for files that take it in parts; and notes."""
    from oddsmap.map_files.plane import ArrayPlane
    from oddsmap.posterior.belief import Belief

    if isinstance(view, Belief) and view.ndim == 2 and not _banded(options):
        return view.plane(), ()
    grid = grid_of(view, options)[0]
    return ArrayPlane(grid), grid.notes


def grid_of(view: Source, options: Options) -> tuple[ProbabilityMap, Thresholds]:
    """A 2D map, or a band of heights of a 3D map, and the thresholds of its view.

    Raises:
        ConfigError: heights are asked of a 2D map, or none of a 3D map.
    """
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.errors import ConfigError
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.posterior.belief import Belief
    from oddsmap.projection.project import project

    z_min, z_max = options.get("z_min"), options.get("z_max")
    rule, slab = options.get("rule", "slabs"), options.get("slab")
    ground = options.get("ground", "none")
    thresholds = thresholds_of(view, options)
    if isinstance(view, ProbabilityMap) or (isinstance(view, Belief) and view.ndim == 2):
        if _banded(options):
            raise ConfigError(
                "--z-min, --z-max, --ground, --rule and --slab need a 3D map, this one is 2D"
            )
        if isinstance(view, ProbabilityMap):
            # What is doubtful about its file has been said when it was opened.
            return dataclasses.replace(view, notes=()), thresholds
        return view.to_probability_map(), thresholds
    if z_min is None and z_max is None:
        raise ConfigError(
            "this map is 3D: say which heights make the 2D map, for example "
            "--z-min 0.2 --z-max 1.8 --ground relative"
        )
    lowest = -float("inf") if z_min is None else z_min
    highest = float("inf") if z_max is None else z_max
    grid = project(
        view, lowest, highest, ground="relative" if ground == "relative" else None, rule=rule,
        slab=slab, thresholds=thresholds,
    )  # fmt: skip
    return grid, thresholds


def _banded(options: Options) -> bool:
    return options.get("ground", "none") != "none" or any(
        name in options for name in HEIGHTS if name != "ground"
    )
