# SPDX-License-Identifier: Apache-2.0
"""Saved maps of which a command reads a part: the box that --box says, and what a picture shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.array_types import Region
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.scale.saved_map import SavedMap

__all__ = ["box_of", "corners_of", "overview_of_large", "read_part"]

# What drawing takes a cell of the rectangle that holds the map.
_DRAWN_BYTES = 32
# Of a picture's pixels, what its margins leave: more blocks would be drawn by fours.
_OF_PICTURE = 0.94

Corners = tuple[list[float], list[float]]


def corners_of(box: str) -> Corners:
    """The two corners that --box says.

    Raises:
        ConfigError: it is no four or six numbers, or the corners are not in order.
    """
    from oddsmap.errors import ConfigError

    try:
        numbers = [float(word) for word in box.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) not in (4, 6):
        raise ConfigError(
            f'--box {box}: four numbers [metres] are needed, as in --box "0 0 40 25" (x0 y0 x1 '
            "y1), or six for a 3D map (x0 y0 z0 x1 y1 z1)"
        )
    lo, hi = numbers[: len(numbers) // 2], numbers[len(numbers) // 2 :]
    if not all(a < b for a, b in zip(lo, hi, strict=True)):
        raise ConfigError(f"--box {box}: the lowest corner comes first, then the highest")
    return lo, hi


def box_of(saved: SavedMap[EvidenceMap], corners: Corners) -> Region:
    """The cells of a map whose centres lie between two corners: first and past the last.

    Raises:
        InputError: the corners have another number of axes than the map.
    """
    from oddsmap.errors import InputError

    lo, hi = corners
    if len(lo) != saved.ndim:
        raise InputError(
            f"{saved.path}: is a {saved.ndim}D map, whose box has {2 * saved.ndim} numbers; --box "
            f"has {2 * len(lo)}"
        )
    return saved.region_of(lo, hi)


def read_part(
    source: Path, *, box: str | None = None, shown: Sequence[float] | None = None
) -> EvidenceMap:
    """A saved map, or a part of it.

    Args:
        source: the map.
        box: what --box says; None: all.
        shown: x_min, y_min, x_max, y_max of a picture [m], for which no more of a 2D map is read.

    Raises:
        InputError: it is no map, --box has another number of axes, or holds no evidence.
    """
    from oddsmap.errors import InputError
    from oddsmap.evidence_map import EvidenceMap, load_map

    if box is None and shown is None:
        return load_map(source)
    saved = EvidenceMap.open(source)
    if box is None:
        cells = None if shown is None else _cells_shown(saved, shown)
        return load_map(source) if cells is None else saved.crop(*cells)
    part = saved.crop(*box_of(saved, corners_of(box)))
    if part.cell_count() == 0:
        raise InputError(
            f"{source}: no evidence in the box {box}; oddsmap info says how far the map reaches"
        )
    return part


def _cells_shown(saved: SavedMap[EvidenceMap], crop: Sequence[float]) -> Region | None:
    """The cells of a 2D map that a picture of a crop shows, and some more; None: that is not told.

    A picture of a 3D map may depend on the ground around it.
    """
    import numpy as np

    if saved.ndim != 2 or not np.isfinite(crop).all() or not crop[0] < crop[2]:
        return None
    if not crop[1] < crop[3]:
        return None
    edge = 2.0 * saved.resolution
    return saved.region_of(np.subtract(crop[:2], edge), np.add(crop[2:], edge))


def overview_of_large(
    source: Path, options: Mapping[str, Any], rates: Mapping[str, Any], prior: float | None
) -> ProbabilityMap | None:
    """A 2D map for a picture, in blocks of cells, where it would not fit in memory whole.

    Args:
        source: a map of any kind.
        options: those of `oddsmap export` that are stated, by name.
        rates: p_hit, p_miss and clamp; None: the map's own.
        prior: likewise.

    Returns:
        None: it fits, or is no such map.
    """
    import math

    from oddsmap.evidence.store import is_map
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.limits import memory_limit
    from oddsmap.plot.layout import MAX_PIXELS

    if "box" in options or "crop" in options or not is_map(source):
        return None
    saved = EvidenceMap.open(source)
    box = saved.bounds()
    if saved.ndim != 2 or box is None:
        return None
    if math.prod(int(n) for n in box[1] - box[0]) * _DRAWN_BYTES <= memory_limit():
        return None
    pixels = int(_OF_PICTURE * options.get("size", MAX_PIXELS))
    return saved.overview(pixels, view=lambda part: part.log_odds(prior=prior, **rates))
