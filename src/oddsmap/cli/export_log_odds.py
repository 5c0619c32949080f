# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` writes of the probability of cells: the view of log odds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.export_formats import BAGS, check_format_options, kind_of
from oddsmap.cli.export_plane import write_geotiff, write_overview, write_picture, write_ros
from oddsmap.cli.export_rerun import write_rerun
from oddsmap.cli.export_ros import header_of, write_bag
from oddsmap.cli.export_sources import open_source, prior_map, prior_of, thresholds_of
from oddsmap.cli.export_space import write_las, write_octomap, write_ply
from oddsmap.cli.files import check_files
from oddsmap.cli.map_regions import overview_of_large
from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.export_sources import Source
    from oddsmap.cli.voice import Voice

__all__ = ["write_calibrated", "write_full_map", "write_log_odds"]


def write_log_odds(
    source: Path, output: Path, options: Mapping[str, Any], force: bool, voice: Voice
) -> Written:
    """Write the probabilities of a map: as its suffix says.

    Args:
        source: a saved map, a full map, an OctoMap, or the YAML of a ROS map.
        output: the file to write.
        options: those of `oddsmap export` that are stated, by name.
        force: whether to replace existing files.
        voice: says what is doubtful about a prior's file.

    Returns:
        What was written.

    Raises:
        OddsmapError: an option does not fit the map or the file, or one cannot be read or written.
    """
    return _write(source, output, options, force, voice, calibrated=False)


def write_calibrated(
    source: Path, output: Path, options: Mapping[str, Any], force: bool, voice: Voice
) -> Written:
    """Write probabilities fitted to the map's counts; arguments and errors as `write_log_odds`."""
    return _write(source, output, options, force, voice, calibrated=True)


def _write(
    source: Path,
    output: Path,
    options: Mapping[str, Any],
    force: bool,
    voice: Voice,
    *,
    calibrated: bool,
) -> Written:
    from oddsmap.map_files.ros_writer import image_beside
    from oddsmap.posterior.belief import Belief

    kind = kind_of(output, options)
    check_format_options(output, kind, options)
    header_of(options)  # refuses what no message can have
    number, prior_file = prior_of(options.get("prior"), source)
    rates = {name: options.get(name) for name in ("p_hit", "p_miss")}
    if kind != ".ot":  # which bounds what it writes itself, also of maps without counts
        rates["clamp"] = options.get("clamp")
    _check_values(options, number)
    read = [source, prior_file, options.get("trajectory")]
    beside = image_beside(output, options.get("mode", "trinary")) if kind == ".yaml" else None
    check_files(read, output, beside=beside, force=force, is_bag=kind == "ros2-bag")
    prior = number if prior_file is None else prior_map(prior_file, voice)
    around = options.get("neighbours", False)
    if kind == ".png" and not calibrated and prior_file is None:
        large = overview_of_large(source, options, rates, number)
        if large is not None:
            return write_overview(large, source, output, options, force)
    view = open_source(
        source, prior, rates, voice, options=options, calibrated=calibrated, neighbours=around
    )
    limits = thresholds_of(view, options)
    if isinstance(view, Belief):
        view.thresholds = limits
    return _WRITERS[kind](view, output, options, force)


def write_full_map(
    source: Path, output: Path, options: Mapping[str, Any], force: bool, voice: Voice
) -> Written:
    """Write a full map, whose one posterior this is; arguments and errors as `write_log_odds`.

    Raises:
        InputError: another kind of map.
    """
    from oddsmap.errors import InputError
    from oddsmap.full_map.store import is_full_map

    if source.exists() and not is_full_map(source):
        raise InputError(
            f"{source}: not a full map, and hits and passes no longer tell which beam met which "
            "cells: oddsmap build LOG --estimator full-map makes one from the log"
        )
    return write_log_odds(source, output, options, force, voice)


def _check_values(options: Mapping[str, Any], prior: float | None) -> None:
    """Refuse values that are right for no map, before one is loaded."""
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.odds import Thresholds

    rates = {name: options.get(name) for name in ("p_hit", "p_miss", "clamp")}
    EvidenceMap(1.0).log_odds(prior=prior, **rates)
    # One alone is checked beside the other one that the map has.
    Thresholds(options.get("free", 0.0), options.get("occupied", 1.0))
    low, high = options.get("z_min"), options.get("z_max")
    if low is not None and high is not None and not low < high:
        raise ConfigError(f"--z-min has to lie below --z-max, got {low:g} and {high:g}")


def _write_npz(view: Source, output: Path, options: Mapping[str, Any], force: bool) -> Written:
    from oddsmap.errors import ConfigError
    from oddsmap.maps.voxel_map import VoxelMap

    if isinstance(view, VoxelMap):
        raise ConfigError(f"{output}: the arrays list hits and passes, an OctoMap has none")
    view.save_npz(output, force=force)
    return Written([output])


_Writer = Callable[["Source", Path, Mapping[str, Any], bool], Written]

_WRITERS: dict[str, _Writer] = {
    ".yaml": write_ros,
    ".png": write_picture,
    ".npz": _write_npz,
    ".tif": write_geotiff,
    ".bt": write_octomap,
    ".ot": write_octomap,
    ".ply": write_ply,
    ".las": write_las,
    ".laz": write_las,
    ".rrd": write_rerun,
    **dict.fromkeys(BAGS, write_bag),
}
