# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap view` shows: a map of any kind, and what is given to be seen with it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.viewer.given import Given, GivenMap

__all__ = ["page_of"]

# What `oddsmap landmarks` writes.
_LANDMARKS = (".csv", ".json")


def page_of(source: Path, beside: Sequence[Path], landmarks: Path | None, voice: Voice) -> bytes:
    """The payload of the page.

    Args:
        source: a saved map, a full map, an OctoMap, the YAML of a ROS map, or landmarks.
        beside: maps of probabilities of the same cells: the second to the fourth of these kinds.
        landmarks: to be drawn on a 2D map; None: none are.
        voice: says what is doubtful about a ROS map.

    Raises:
        OddsmapError: one is none of these, has counts and is to lie beside, or lies on other cells.
    """
    from oddsmap.errors import ConfigError
    from oddsmap.landmarks.reported import read_landmarks
    from oddsmap.viewer.given import given_of
    from oddsmap.viewer.given_sheets import given_payload
    from oddsmap.viewer.landmarks import landmark_facts, landmarks_payload
    from oddsmap.viewer.plane import plane_payload
    from oddsmap.viewer.space import space_payload

    name = _name(source)
    if source.suffix.lower() in _LANDMARKS and source.is_file():
        if beside or landmarks is not None:
            raise ConfigError(
                f"{source}: landmarks lie on top of a map: oddsmap view MAP --landmarks {source}"
            )
        return landmarks_payload(read_landmarks(source), name)
    more = {} if landmarks is None else {"landmarks": landmark_facts(read_landmarks(landmarks))}
    first = _without_counts(source, voice)
    others = [_beside(path, voice) for path in beside]
    if first is not None:
        given = given_of(first, name)
        _check_plane(given.ndim, landmarks)
        free = given.thresholds.free
        return given_payload([given, *_given(others, beside, free)], **more)
    grid = _with_counts(source)
    _check_plane(grid.ndim, landmarks)
    free = grid.config.posterior.thresholds.free
    payload = plane_payload if grid.ndim == 2 else space_payload
    return payload(grid, name, _given(others, beside, free), **more)


def _check_plane(ndim: int, landmarks: Path | None) -> None:
    from oddsmap.errors import ConfigError

    if ndim == 3 and landmarks is not None:
        raise ConfigError(
            f"--landmarks {landmarks}: landmarks are drawn on 2D maps, this one is 3D; show them "
            f"alone (oddsmap view {landmarks})"
        )


def _given(maps: Sequence[GivenMap], paths: Sequence[Path], free: float) -> list[Given]:
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
