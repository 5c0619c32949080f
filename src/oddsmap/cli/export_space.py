# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` writes of space: OctoMaps, and occupied cells as points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.export_sources import Source
    from oddsmap.map_files.octomap_range import Shift
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.posterior.belief import Belief

__all__ = ["note_of_shift", "space_of", "write_las", "write_octomap", "write_ply"]

Options = Mapping[str, Any]


def write_octomap(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write an OctoMap: `.bt` or `.ot`."""
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.map_files.octomap_range import shift_of
    from oddsmap.maps.voxel_map import VoxelMap

    space, shift = space_of(view), options.get("shift")
    clamp = options.get("clamp")
    if isinstance(space, VoxelMap):
        limits = thresholds_of(space, options)
        space.save_octomap(output, clamp=clamp, shift=shift, thresholds=limits, force=force)
    else:
        space.save_octomap(output, clamp=clamp, shift=shift, force=force)
    moved = None if shift is None else shift_of(shift, space.resolution)
    return Written([output], note_of_shift(moved))


def write_ply(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write the occupied cells as points: `.ply`."""
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.maps.voxel_map import VoxelMap

    space = space_of(view)
    if isinstance(space, VoxelMap):
        space.save_ply(output, thresholds=thresholds_of(space, options), force=force)
    else:
        space.save_ply(output, force=force)
    return Written([output], _left_out(space, options))


def write_las(view: Source, output: Path, options: Options, force: bool) -> Written:
    """Write the occupied cells as points: `.las` or `.laz`."""
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.maps.voxel_map import VoxelMap

    space = space_of(view)
    crs = options.get("crs")
    if isinstance(space, VoxelMap):
        limits = thresholds_of(space, options)
        space.save_las(output, crs=crs, thresholds=limits, force=force)
    else:
        space.save_las(output, crs=crs, force=force)
    return Written([output], _left_out(space, options))


def _left_out(space: Belief | VoxelMap, options: Options) -> tuple[str, ...]:
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.cli.undecided import undecided_in_points

    note = undecided_in_points(space, thresholds_of(space, options))
    return () if note is None else (note,)


def note_of_shift(shift: Shift | None) -> tuple[str, ...]:
    """What to know of a map that was moved."""
    return () if shift is None else (shift.words(),)


def space_of(view: Source) -> Belief | VoxelMap:
    """The same view, where it may be of space.

    Raises:
        InputError: a ROS map; other 2D maps say so themselves.
    """
    from oddsmap.errors import InputError
    from oddsmap.maps.probability_map import ProbabilityMap

    if isinstance(view, ProbabilityMap):
        raise InputError("an OctoMap, a PLY or a LAS needs a 3D map, a ROS map is 2D")
    return view
