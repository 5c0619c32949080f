# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` reads: a map of any kind, and what is to be its prior."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from oddsmap.cli.map_regions import read_part

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.odds import Thresholds
    from oddsmap.posterior.belief import Belief
    from oddsmap.posterior.prior import MapLike

__all__ = [
    "Source",
    "check_no_image",
    "is_ros_map",
    "load_ros_map",
    "open_source",
    "prior_map",
    "prior_of",
    "thresholds_of",
]

Source: TypeAlias = "Belief | VoxelMap | ProbabilityMap"
"""A map that is open: a view of counts, or one that has none."""


def is_ros_map(path: Path) -> bool:
    """Whether a file is named as the YAML of a ROS map."""
    return path.suffix.lower() in (".yaml", ".yml") and not path.is_dir()


def open_source(
    source: Path,
    prior: float | MapLike | None,
    rates: Mapping[str, Any],
    voice: Voice,
    *,
    options: Mapping[str, Any] | None = None,
    calibrated: bool = False,
    neighbours: bool = False,
) -> Source:
    """Open a map, with the view of its log odds where it has counts, or the calibrated one.

    Args:
        source: a saved map, a full map, an OctoMap, or the YAML of a ROS map.
        prior: for a map with counts; None: the map's own.
        rates: p_hit, p_miss and clamp, likewise.
        voice: says what is doubtful about a ROS map.
        options: those of `oddsmap export` that are stated, by name; of a saved map only what --box
            or --crop says is read; None: none.
        calibrated: which view; a map without counts has none.
        neighbours: whether that looks at the counts around a cell, too.

    Raises:
        OddsmapError: it is none of these, or has no counts and is asked for what needs them.
    """
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.voxel_map import load_octomap

    kind = "an OctoMap" if is_octomap(source) else "a full map" if is_full_map(source) else None
    if is_ros_map(source):
        kind = "a ROS map"
    if kind is not None and calibrated:
        raise ConfigError(
            f"{source}: {kind} has no counts, which --posterior calibrated is fitted to"
        )
    if kind is not None and any(value is not None for value in (prior, *rates.values())):
        raise ConfigError(
            f"{source}: {kind} has no counts; --prior, --p-hit and --p-miss need those, and so "
            "does --clamp but for an .ot"
        )
    stated = options or {}
    if kind is not None and "box" in stated:
        raise ConfigError(f"{source}: {kind} is read whole; --box is for maps of oddsmap build")
    if kind == "a ROS map":
        return load_ros_map(source, voice)
    if kind is not None:
        return load_octomap(source) if is_octomap(source) else load_full_map(source)
    check_no_image(source)
    if calibrated:
        grid = load_map(source)
        return grid.calibrated(prior=prior, clamp=rates.get("clamp"), neighbours=neighbours)
    grid = read_part(source, box=stated.get("box"), shown=stated.get("crop"))
    return grid.log_odds(prior=prior, **rates)


def thresholds_of(view: Source, options: Mapping[str, Any]) -> Thresholds:
    """What is free and what is occupied: --free and --occupied, or else as the map says.

    Raises:
        ConfigError: no cell could be both as it should.
    """
    from oddsmap.odds import Thresholds
    from oddsmap.posterior.belief import Belief

    own = view.thresholds if isinstance(view, Belief) else Thresholds()
    return Thresholds(options.get("free", own.free), options.get("occupied", own.occupied))


def load_ros_map(path: Path, voice: Voice) -> ProbabilityMap:
    """Read a ROS map, and say what is doubtful about it."""
    from oddsmap.maps.probability_map import load_ros

    found = load_ros(path)
    for note in found.notes:
        voice.note(path, note, err=True)
    return found


def check_no_image(path: Path) -> None:
    """Refuse the image of a ROS map, which does not say where its cells are.

    Raises:
        InputError: it is an image.
    """
    from oddsmap.errors import InputError

    if path.suffix.lower() not in (".pgm", ".png", ".bmp") or not path.is_file():
        return
    beside = path.with_suffix(".yaml")
    there = f"give {beside}" if beside.is_file() else "its YAML has them: give that"
    raise InputError(f"{path}: an image says no resolution and no origin; {there}")


def prior_of(text: str | None, source: Path) -> tuple[float | None, Path | None]:
    """What --prior says: a number, or a file.

    Raises:
        ConfigError: neither, or the map itself.
    """
    from oddsmap.errors import ConfigError

    if text is None:
        return None, None
    try:
        return float(text), None
    except ValueError:
        path = Path(text)
    if not path.exists():
        raise ConfigError(
            f"--prior {text}: neither a number nor a file; give a probability between 0 and 1, "
            "or a map (.zarr, .yaml of a ROS map, .bt or .ot)"
        )
    if path.resolve() == source.resolve():
        raise ConfigError(f"--prior {text}: the map itself; its evidence would count twice")
    return None, path


def prior_map(path: Path, voice: Voice) -> MapLike:
    """The map that is to be a prior.

    Raises:
        OddsmapError: it is none.
    """
    from oddsmap.errors import ConfigError
    from oddsmap.evidence.store import is_map
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.voxel_map import load_octomap

    if is_full_map(path):
        raise ConfigError(
            f"--prior {path}: a full map; export it as a ROS map (.yaml, --mode raw), which can be "
            "a prior"
        )
    if is_map(path):
        return load_map(path)
    if is_ros_map(path):
        return load_ros_map(path, voice)
    check_no_image(path)
    if is_octomap(path):
        return load_octomap(path)
    raise ConfigError(
        f"--prior {path}: not a map that can be a prior; known: a saved map (.zarr), the .yaml of "
        "a ROS map, an OctoMap (.bt, .ot)"
    )
