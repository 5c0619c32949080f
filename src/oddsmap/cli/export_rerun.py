# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` writes for Rerun: `.rrd`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.export_formats import HEIGHTS
from oddsmap.cli.export_plane import plane_of
from oddsmap.cli.export_ros import space_asked_for
from oddsmap.cli.export_space import note_of_shift
from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.export_sources import Source

__all__ = ["write_rerun"]


def write_rerun(view: Source, output: Path, options: Mapping[str, Any], force: bool) -> Written:
    """Write a 2D map as a grid, a 3D map as its occupied voxels."""
    from oddsmap.cli.export_sources import thresholds_of
    from oddsmap.cli.undecided import undecided_in_points
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.octomap_range import shift_of
    from oddsmap.map_files.rerun_file import save_rerun_plane, save_rerun_space

    stated = options.get("shift")
    shift = None if stated is None else shift_of(stated, view.resolution)
    space = space_asked_for(view, options)
    if space is None:
        if options.keys() & {"free", "occupied"} and not options.keys() & set(HEIGHTS):
            raise ConfigError(
                "--free and --occupied decide which voxels an .rrd has, and this map is 2D: it is "
                "written with its probabilities"
            )
        plane, notes = plane_of(view, options)
        save_rerun_plane(plane, output, shift=shift, force=force)
        return Written([output], (*notes, *note_of_shift(shift)))
    limits = thresholds_of(space, options)
    save_rerun_space(space, output, thresholds=limits, shift=shift, force=force)
    note = undecided_in_points(space, limits)
    return Written([output], (*(() if note is None else (note,)), *note_of_shift(shift)))
