# SPDX-License-Identifier: Apache-2.0
"""What the page is given of a map of probabilities: a full map, a ROS map, an OctoMap.

Such a map has no counts, so that no sensor model can be tuned on it: the page gets the probability
of each cell, and thresholds decide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.full_map.full_map import FullMap
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.maps.voxel_map import VoxelMap
from oddsmap.odds import Thresholds
from oddsmap.viewer.facts import sources_of
from oddsmap.viewer.layout import MOST_VOXELS

__all__ = ["Given", "GivenMap", "box_of", "check_beside", "given_of"]

GivenMap: TypeAlias = "FullMap | ProbabilityMap | VoxelMap"
"""A map without counts that the page shows."""

# Of a cell: an origin as near to a corner of cells is one, and was rounded in the file.
_SAME = 1e-6


class Given(NamedTuple):
    """Cells with their probabilities, and their place in the world."""

    name: str
    """Of the file."""
    what: str
    """What the map is, in words."""
    ndim: int
    resolution: float
    cells: IntArray
    """Shape (n, d), x first."""
    probability: FloatArray
    """p(occupied), shape (n,)."""
    known: int
    """How many are known; of a 3D map those that cannot be occupied are not listed."""
    bounds: tuple[IntArray, IntArray]
    """The box of known cells: the first index and one past the last."""
    thresholds: Thresholds
    corner: tuple[float, float]
    """Where the corner between cells (-1, -1) and (0, 0) lies [m]."""
    yaw: float
    """How the cells are turned about that [rad]."""
    sources: list[dict[str, Any]]

    def facts(self, **more: Any) -> dict[str, Any]:
        """What the page says of the map and starts from, as plain values, and more of these."""
        return {
            "name": PurePath(self.name).name,
            "what": self.what,
            "cells": self.known,
            "free": self.thresholds.free,
            "occupied": self.thresholds.occupied,
            **more,
        }

    def page_facts(self, box: tuple[IntArray, IntArray]) -> dict[str, Any]:
        """What the page is told of this map where it is the first one.

        Args:
            box: of all that is shown.
        """
        lo, hi = box
        return {
            "counts": False,
            "name": PurePath(self.name).name,
            "sources": self.sources,
            "resolution": self.resolution,
            "corner": list(self.corner),
            "yaw": self.yaw,
            "lo": lo.tolist(),
            "hi": hi.tolist(),
            "cells": self.known,
            "unit": 1.0,
            "rounded": False,
            "free": self.thresholds.free,
            "occupied": self.thresholds.occupied,
            "calibrated": None,
        }


def given_of(view: GivenMap, name: str, *, above: float | None = None) -> Given:
    """The cells of a map without counts.

    Args:
        view: the map.
        name: of its file.
        above: of a 3D map, the probability that cells have to exceed to be listed; None: the map's
            own threshold for free ones.

    Raises:
        InputError: it knows no cell, or too many.
    """
    if isinstance(view, ProbabilityMap):
        given = _of_plane(view, name)
    elif isinstance(view, VoxelMap):
        given = _of_leaves(view, name, Thresholds().free if above is None else above)
    else:
        given = _of_full_map(view, name, above)
    if given.known == 0:
        raise InputError(f"{name}: no cell of the map is known, nothing to show")
    return given


def _of_plane(view: ProbabilityMap, name: str) -> Given:
    y, x = np.nonzero(view.observed)
    index = np.stack([x, y], axis=1).astype(np.int64)
    corner = view.origin
    if view.yaw == 0.0:
        # As the cells of other maps, which count from the origin of the world, where they can.
        first = [_whole(place / view.resolution) for place in view.origin]
        index += first
        corner = tuple(
            place - n * view.resolution if abs(place / view.resolution - n) > _SAME else 0.0
            for place, n in zip(view.origin, first, strict=True)
        )  # type: ignore[assignment]  # two numbers, as there are two axes
    return Given(
        name, "ROS map", 2, view.resolution, index, view.probability[y, x], len(index),
        _box_of(index), Thresholds(), corner, view.yaw, [],
    )  # fmt: skip


def _whole(cells: float) -> int:
    """The cell that a number of cells lies in; the nearest one where it is hardly off a corner."""
    nearest = round(cells)
    return nearest if abs(cells - nearest) <= _SAME else math.floor(cells)


def _of_full_map(view: FullMap, name: str, above: float | None) -> Given:
    index, probability = view.cells()
    cells, bounds = len(index), _box_of(index)
    if view.ndim == 3:
        listed = probability > (view.thresholds.free if above is None else above)
        index, probability = index[listed], probability[listed]
    what = "full map"
    if view.method == "map":
        what = "full map (method map: its values are no marginals)"
    return Given(
        name, what, view.ndim, view.resolution, index, probability, cells, bounds,
        view.thresholds, (0.0, 0.0), 0.0, sources_of(view.provenance),
    )  # fmt: skip


def _of_leaves(view: VoxelMap, name: str, above: float) -> Given:
    listed = view.probability > above
    some = VoxelMap(view.index[listed], view.log_odds[listed], view.resolution, view.level[listed])
    if some.cell_count > MOST_VOXELS:
        raise InputError(
            f"{name}: {some.cell_count:,} voxels that may be occupied, the page shows up to "
            f"{MOST_VOXELS:,}; show a map of a part of it, or a coarser one"
        )
    index, probability = some.cells(max_cells=MOST_VOXELS)
    nothing = (np.zeros(3, np.int64),) * 2
    return Given(
        name, "OctoMap", 3, view.resolution, index, probability, view.cell_count,
        view.bounds() or nothing, Thresholds(), (0.0, 0.0), 0.0, [],
    )  # fmt: skip


def _box_of(index: IntArray) -> tuple[IntArray, IntArray]:
    if len(index) == 0:
        nothing = np.zeros(index.shape[1], np.int64)
        return nothing, nothing
    return index.min(axis=0), index.max(axis=0) + 1


def check_beside(first: Mapping[str, Any], given: Given) -> None:
    """Refuse a map whose cells are not those of the one that it is shown beside.

    Args:
        first: what the page is told of that one.
        given: the other one, of as many dimensions.

    Raises:
        InputError: it has another resolution, or lies between the cells.
    """
    if not math.isclose(given.resolution, first["resolution"], rel_tol=1e-9):
        raise InputError(
            f"{given.name}: cells of {given.resolution:g} m, those of {first['name']} have "
            f"{first['resolution']:g} m: show maps of one resolution, or each alone"
        )
    if given.yaw != first["yaw"] or not np.allclose(
        given.corner, first["corner"], rtol=0.0, atol=_SAME * given.resolution
    ):
        raise InputError(
            f"{given.name}: its cells lie between those of {first['name']}, or are turned: show "
            "each map alone"
        )


def box_of(
    name: str, bounds: tuple[IntArray, IntArray], beside: Sequence[Given]
) -> tuple[IntArray, IntArray]:
    """The box around a map and those that are shown beside it.

    Args:
        name: of the map's file.
        bounds: its box: the first index and one past the last.
        beside: the others.

    Raises:
        InputError: one of them has other dimensions.
    """
    lo, hi = bounds
    for given in beside:
        if given.ndim != len(lo):
            raise InputError(
                f"{given.name}: a {given.ndim}D map, which cannot be shown beside {name}, a "
                f"{len(lo)}D one; show it alone"
            )
        lo, hi = np.minimum(lo, given.bounds[0]), np.maximum(hi, given.bounds[1])
    return lo, hi
