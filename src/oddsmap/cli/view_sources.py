# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap view` shows: a map of any kind, and what is given to be seen with it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.viewer.given import GivenMap

__all__ = ["page_of"]


def page_of(source: Path, beside: Sequence[Path], voice: Voice) -> bytes:
    """The payload of the page.

    Args:
        source: a saved map, a full map, an OctoMap, or the YAML of a ROS map.
        beside: maps of probabilities of the same cells: of these kinds but the first.
        voice: says what is doubtful about a ROS map.

    Raises:
        OddsmapError: one is none of these, has counts and is to lie beside, or lies on other cells.
    """
    from oddsmap.viewer.given import given_of
    from oddsmap.viewer.given_sheets import given_payload
    from oddsmap.viewer.plane import plane_payload
    from oddsmap.viewer.space import space_payload

    name = _name(source)
    first = _without_counts(source, voice)
    others = [_beside(path, voice) for path in beside]
    if first is not None:
        given = given_of(first, name)
        free = given.thresholds.free
        return given_payload([given, *_given(others, beside, free)])
    grid = _with_counts(source)
    free = grid.config.posterior.thresholds.free
    payload = plane_payload if grid.ndim == 2 else space_payload
    return payload(grid, name, _given(others, beside, free))


def _given(maps: Sequence[GivenMap], paths: Sequence[Path], free: float) -> list[Any]:
    from oddsmap.viewer.given import given_of

    # Voxels up to the page's lowest threshold, which is the first map's, never show.
    named = zip(maps, map(_name, paths), strict=True)
    return [given_of(view, name, above=free) for view, name in named]


def _name(path: Path) -> str:
    return path.name or path.resolve().name  # "." has none of its own


def _without_counts(path: Path, voice: Voice) -> GivenMap | None:
    """A map of probabilities; None: the file is of no such kind."""
    from oddsmap.cli.export_sources import is_ros_map, load_ros_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.voxel_map import load_octomap

    if is_full_map(path):
        return load_full_map(path)
    if is_ros_map(path):
        return load_ros_map(path, voice)
    return load_octomap(path) if is_octomap(path) else None


def _with_counts(path: Path) -> EvidenceMap:
    from oddsmap.cli.export_sources import check_no_image
    from oddsmap.evidence_map import load_map

    check_no_image(path)
    return load_map(path)


def _beside(path: Path, voice: Voice) -> GivenMap:
    from oddsmap.cli.export_sources import check_no_image
    from oddsmap.errors import ConfigError

    found = _without_counts(path, voice)
    if found is None:
        check_no_image(path)
        raise ConfigError(
            f"--with {path}: not a map of probabilities; known: a full map (.zarr), the .yaml of a "
            "ROS map, an OctoMap (.bt, .ot)"
        )
    return found
