# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap view` shows: a map of any kind, and what is given to be seen with it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.viewer.given import Given, GivenMap

__all__ = ["LANDMARKS", "Page", "counts_page", "page_of"]

LANDMARKS = (".csv", ".json")
"""What `oddsmap landmarks` writes, by its suffix."""


class Page(NamedTuple):
    """What a page is given."""

    payload: bytes
    grid: EvidenceMap | None
    """The map with counts that it shows; None: it shows none."""


def page_of(source: Path, beside: Sequence[Path], landmarks: Path | None, voice: Voice) -> Page:
    """The page of a file.

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
    from oddsmap.viewer.landmarks import landmarks_payload

    name = _name(source)
    if source.suffix.lower() in LANDMARKS and source.is_file():
        if beside or landmarks is not None:
            raise ConfigError(
                f"{source}: landmarks lie on top of a map: oddsmap view MAP --landmarks {source}"
            )
        return Page(landmarks_payload(read_landmarks(source), name), None)
    first = _without_counts(source, voice)
    if first is None:
        return counts_page(_with_counts(source), name, beside, landmarks, voice)
    given = given_of(first, name)
    on_top = _on_top(given.ndim, landmarks)
    others = _given(beside, given.thresholds.free, voice)
    return Page(given_payload([given, *others], **on_top), None)


def counts_page(
    grid: EvidenceMap, name: str, beside: Sequence[Path], landmarks: Path | None, voice: Voice
) -> Page:
    """The page of a map with counts; arguments and errors as in `page_of`."""
    from oddsmap.viewer.plane import plane_payload
    from oddsmap.viewer.space import space_payload

    on_top = _on_top(grid.ndim, landmarks)
    others = _given(beside, grid.config.posterior.thresholds.free, voice)
    payload = plane_payload if grid.ndim == 2 else space_payload
    return Page(payload(grid, name, others, **on_top), grid)


def _on_top(ndim: int, landmarks: Path | None) -> dict[str, Any]:
    """Landmarks as facts of the page."""
    from oddsmap.errors import ConfigError
    from oddsmap.landmarks.reported import read_landmarks
    from oddsmap.viewer.landmarks import landmark_facts

    if landmarks is None:
        return {}
    if ndim == 3:
        raise ConfigError(
            f"--landmarks {landmarks}: landmarks are drawn on 2D maps, this one is 3D; show them "
            f"alone (oddsmap view {landmarks})"
        )
    return {"landmarks": landmark_facts(read_landmarks(landmarks))}


def _given(paths: Sequence[Path], free: float, voice: Voice) -> list[Given]:
    """Maps that lie beside another one, whose lowest threshold is `free`."""
    from oddsmap.viewer.given import given_of

    # Voxels up to the page's lowest threshold, which is the first map's, never show.
    return [given_of(_beside(path, voice), _name(path), above=free) for path in paths]


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
