# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` writes as messages of ROS: MCAP and bags."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from oddsmap.cli.export_formats import HEIGHTS, kind_of
from oddsmap.cli.export_plane import plane_of
from oddsmap.cli.export_space import note_of_shift
from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.export_sources import Source
    from oddsmap.map_files.ros_bag import BagKind
    from oddsmap.map_files.ros_messages import MapHeader, RosMessages, TopicMessage
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.odds import Thresholds
    from oddsmap.posterior.belief import Belief

__all__ = ["header_of", "space_asked_for", "write_bag"]

Options = Mapping[str, Any]

_Made: TypeAlias = (
    "tuple[Callable[[RosMessages], Iterator[TopicMessage]], tuple[str, ...]]"  # and notes
)

_KINDS: dict[str, BagKind] = {
    ".mcap": "mcap",
    ".bag": "bag",
    "ros2-bag": "ros2-bag",
    "foxglove": "mcap",
}


def header_of(options: Options, evidence_ns: int | None = None) -> MapHeader:
    """Frame and time of a map, as the options say.

    Args:
        options: --frame and --stamp, where they are stated.
        evidence_ns: the time that the map counts back from, if it has one.

    Raises:
        ConfigError: messages cannot have them.
    """
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.ros_messages import MapHeader, check_header

    stamp = options.get("stamp")
    if stamp is not None and not 0.0 <= stamp < 1e10:
        raise ConfigError(f"--stamp is a time in seconds since 1970, got {stamp}")
    stamp_ns = evidence_ns or 0 if stamp is None else round(stamp * 1e9)
    header = MapHeader(options.get("frame", "map"), stamp_ns)
    check_header(header)
    return header


def write_bag(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write a 2D map as a grid, a 3D map as OctoMaps and points, in `.mcap` or a bag."""
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.map_files.ros_bag import save_bag
    from oddsmap.posterior.count_view import CountView

    limits = thresholds_of(view, options)
    since = view.evidence.config.map.t_ref_ns if isinstance(view, CountView) else None
    space = space_asked_for(view, options)
    kind = kind_of(output, options)
    if kind == "foxglove":
        make, notes = _cells_alone(view, space, options, limits)
    elif space is None:
        make, notes = _grids(view, options, limits)
    else:
        make, notes = _octomaps(space, output, options, limits)
    save_bag(make, output, _KINDS[kind], header=header_of(options, since), force=force)
    return Written([output], notes)


def _cells_alone(
    view: Source, space: Belief | VoxelMap | None, options: Options, limits: Thresholds
) -> _Made:
    """The one Grid or VoxelGrid that has all of a map."""
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.grid_messages import grid_messages
    from oddsmap.map_files.voxel_messages import voxel_messages

    for name in ("mode", "shift"):
        if name in options:
            raise ConfigError(
                f"--{name} shapes messages of ROS; a Grid or VoxelGrid of --format foxglove has "
                "probabilities, at the map's coordinates"
            )
    if space is not None:
        return voxel_messages(space, thresholds=limits), ()
    if options.keys() & {"free", "occupied"} and not options.keys() & set(HEIGHTS):
        raise ConfigError(
            "--free and --occupied decide nothing in a Grid, which has the probabilities of this "
            "2D map"
        )
    plane, notes = plane_of(view, options)
    return grid_messages(plane), notes


def _grids(view: Source, options: Options, limits: Thresholds) -> _Made:
    from oddsmap.cli.undecided import knows_undecided, undecided_in_plane
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.grid_messages import (
        MOST_GRID_CELLS,
        check_plane_size,
        has_cell_grid,
        plane_messages,
    )

    if "shift" in options:
        raise ConfigError("--shift moves an OctoMap, and this map is 2D")
    (plane, notes), mode = plane_of(view, options), options.get("mode", "trinary")
    check_plane_size(plane)  # before all of it is gone through
    if mode == "trinary" and not knows_undecided(notes):
        note = undecided_in_plane(plane, limits, view)
        notes += () if note is None else (note,)
    if not has_cell_grid(plane):
        notes += (
            f"/map_cells with probabilities and counts is left out: more than {MOST_GRID_CELLS:,} "
            "cells are more than Foxglove draws; a GeoTIFF (.tif) has them",
        )
    return plane_messages(plane, mode=mode, thresholds=limits), notes


def _octomaps(
    space: Belief | VoxelMap, output: Path, options: Options, limits: Thresholds
) -> _Made:
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.octomap_range import check_keys, shift_of
    from oddsmap.map_files.space_messages import space_messages

    if "mode" in options:
        raise ConfigError(
            "--mode says how a 2D map is written; this map is 3D: leave it out, or make a plane "
            "of it (--z-min, --z-max)"
        )
    stated = options.get("shift")
    shift = None if stated is None else shift_of(stated, space.resolution)
    check_keys(output, space.bounds(), space.resolution, shift)
    leaves = space.leaves(shift)
    return space_messages(leaves, space, thresholds=limits, shift=shift), note_of_shift(shift)


def space_asked_for(view: Source, options: Options) -> Belief | VoxelMap | None:
    """A 3D map that is to be written as such; None: a plane."""
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.maps.voxel_map import VoxelMap

    if isinstance(view, ProbabilityMap) or any(name in options for name in HEIGHTS):
        return None
    return view if isinstance(view, VoxelMap) or view.ndim == 3 else None
