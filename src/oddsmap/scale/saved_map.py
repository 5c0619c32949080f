# SPDX-License-Identifier: Apache-2.0
"""A saved map that stays on the disk: regions and points of it are read when they are asked for."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_box
from oddsmap.config.config import Config
from oddsmap.errors import ConfigError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.lookup import units_at
from oddsmap.evidence.saved_parts import SavedParts
from oddsmap.evidence.tiles import distinct_rows
from oddsmap.kernels.units import ONE
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import Thresholds
from oddsmap.posterior.calibrated import Calibrated
from oddsmap.posterior.count_view import CountView
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.posterior.neighbour_view import NeighbourView
from oddsmap.query.places import Placed, points_in
from oddsmap.query.queries import PointStates
from oddsmap.scale.low_zoom import LowZoom
from oddsmap.scans.report import Report
from oddsmap.short_repr import counted, described, grid_facts

__all__ = ["SavedMap"]

E = TypeVar("E", bound=Evidence)

_CACHE = 1 << 28
_FIELDS = ("cell", "probability", "state", "hits", "passes")


class SavedMap(Placed, Generic[E]):
    """A saved map of any size, of which only what is asked for is read.

    Opening it reads its header. `crop` and `crop_box` read a region, which is a map as any other:
    its views, files and pictures are those of the region. Questions about points read the shards
    that hold them and keep those that were used last; `overview` and `parts` go through the map a
    shard at a time. `EvidenceMap.open` makes one.

    Args:
        path: a folder that `EvidenceMap.save` or `oddsmap build` wrote.
        kind: what regions of it are, as `EvidenceMap`.

    Other Args:
        cache: bytes of shards that are kept in memory for questions about points.

    Attributes:
        report: what was used and what was skipped, where `build_saved_map` has just built it.

    Raises:
        InputError: not a map, or its header is damaged. Later, from whatever reads: a shard is
            damaged or missing, or the map has changed since it was opened.
        ConfigError: a negative cache.
    """

    def __init__(self, path: str | os.PathLike[str], kind: type[E], *, cache: int = _CACHE) -> None:
        if cache < 0:
            raise ConfigError(f"cache: bytes of shards to keep, 0 or more, got {cache}")
        self._saved = SavedParts(path, kind)
        self._cache_bytes = cache
        self._kept: OrderedDict[tuple[int, ...], E] = OrderedDict()
        self.report: Report | None = None

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield self.path.name
        yield from grid_facts(self.ndim, self.resolution, None, self.bounds())
        yield f'votes "{self.votes}", sensor {self.config.sensor.kind}'
        yield counted(self._saved.shard_count, "shard") if self._saved.shard_count else "empty"

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled: not the shards that are kept."""
        return {**self.__dict__, "_kept": OrderedDict()}

    @property
    def path(self) -> Path:
        """The folder."""
        return self._saved.path

    @property
    def config(self) -> Config:
        """All settings of the map, its sensor model among them."""
        return self._saved.like.config

    @property
    def provenance(self) -> list[dict[str, Any]]:
        """What it was made from."""
        return self._saved.like.provenance

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self._saved.like.resolution

    @property
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""
        return self._saved.like.ndim

    @property
    def votes(self) -> str:
        """How a scan votes: "scan" or "beam"."""
        return self._saved.like.votes

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of cells with evidence, first index and past the last, from the header alone."""
        return self._saved.bounds

    def crop(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> E:
        """A map of the cells of a box; nothing else is read.

        Args:
            lo: first cell, shape (d,), x first.
            hi: past the last cell, shape (d,).

        Raises:
            InputError: lo and hi are not d whole numbers each, or hi < lo; see also `SavedMap`.
        """
        return self._saved.read_box(*cell_box(lo, hi, self.ndim))

    def crop_box(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> E:
        """A map of the cells whose centres lie in a box of metres: see `EvidenceMap.crop_box`.

        Args:
            lo: lowest corner [m], shape (d,), x first.
            hi: highest corner [m].

        Raises:
            InputError: they are not d numbers each, or hi is not above lo; see also `SavedMap`.
        """
        return self.crop(*self.region_of(lo, hi))

    def region(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Hits and passes [votes] of a box of cells, as arrays: see `EvidenceMap.region`.

        Args:
            lo: first cell, shape (d,), x first.
            hi: past the last cell, shape (d,).
        """
        return self.crop(lo, hi).region(lo, hi)

    def parts(self) -> Iterator[E]:
        """The map in parts, one at a time: a map of each shard's cells; none is in two of them."""
        for place in self._saved.places():
            part = self._saved.read_shard(place)
            if part is not None:
                yield part

    def votes_at(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Hits and passes [votes] of the cells that hold points.

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Returns:
            hits and passes, shape (n,); 0 where there is no evidence.

        Raises:
            InputError: as in `LogOdds.at`; see also `SavedMap`.
        """
        cells = self.cell_of(points)
        hits, passes = np.zeros((2, len(cells)))
        for part, rows in self._by_shard(cells):
            found = units_at(part, cells[rows])
            hits[rows], passes[rows] = (units / ONE for units in found)
        return hits, passes

    def at(self, points: npt.ArrayLike, *, view: Callable[[E], CountView] = LogOdds) -> FloatArray:
        """p(occupied) at points: see `LogOdds.at`.

        Args:
            points: in the map frame [m], shape (n, d), x first.
            view: of a part of the map; default: that of its log odds. A calibrated one takes its
                `model` from elsewhere, for it would be fitted to the part.

        Returns:
            Shape (n,); the prior where nothing was seen.

        Raises:
            InputError: as in `LogOdds.at`; see also `SavedMap`.
            ConfigError: a view that is fitted to the part, or looks at cells around its own.
        """
        return self.states_at(points, view=view).probability

    def states_at(
        self,
        points: npt.ArrayLike,
        *,
        view: Callable[[E], CountView] = LogOdds,
        thresholds: Thresholds | None = None,
    ) -> PointStates:
        """All that is known at points: see `LogOdds.states_at`.

        Args:
            points: in the map frame [m], shape (n, d), x first.
            view: as in `at`.
            thresholds: what is free and what is occupied; None: the view's.

        Raises:
            InputError, ConfigError: as in `at`.
        """
        cells, places = self.cell_of(points), points_in(points, self.ndim)
        nowhere = self._nowhere(view).states_at(points, thresholds=thresholds)
        found = {name: getattr(nowhere, name) for name in _FIELDS}
        for part, rows in self._by_shard(cells):
            known = view(part).states_at(places[rows], thresholds=thresholds)
            for name in _FIELDS:
                found[name][rows] = getattr(known, name)
        return PointStates(**found)

    def overview(
        self, pixels: int = 1200, *, view: Callable[[E], CountView] = LogOdds
    ) -> ProbabilityMap:
        """The whole map in few pixels, a shard at a time, columns of a 3D map as one.

        A pixel is a block of 2^k cells along each side. It has the largest probability of its
        cells from 0.5 on, else the mean of those known, as in the pictures of maps.

        Args:
            pixels: along each side, at most; 2 to 3800.
            view: as in `at`.

        Raises:
            ConfigError: another number of pixels, or a view as in `at`.
            InputError: see `SavedMap`.
        """
        nothing = np.zeros(self.ndim, np.int64)
        unseen = self._nowhere(view).prior
        zoom = LowZoom(*(self.bounds() or (nothing, nothing)), pixels)
        self._saved.each(lambda part: zoom.add(view(part)))
        return zoom.result(self.resolution, unseen)

    def _nowhere(self, view: Callable[[E], CountView]) -> CountView:
        """The view of a map without evidence; refused where parts have no such view."""
        seen, again = (view(self._saved.like) for _ in range(2))
        if isinstance(seen, NeighbourView):
            raise ConfigError(
                "a view with neighbours looks at cells of other shards, too: take it of a region, "
                "saved.crop_box(lo, hi).calibrated(neighbours=True)"
            )
        if isinstance(seen, Calibrated) and seen.model is not getattr(again, "model", None):
            raise ConfigError(
                "a calibrated view would be fitted to each shard alone: take its model of a "
                "region, part.calibrated(model=saved.crop_box(lo, hi).calibrated().model)"
            )
        return seen

    def _by_shard(self, cells: IntArray) -> Iterator[tuple[E, IntArray]]:
        """The shards that hold cells, and which cells each of them holds."""
        if len(cells) == 0:
            return
        places, which = distinct_rows(self._saved.place_of(cells))
        order = np.argsort(which, kind="stable")
        ends = np.cumsum(np.bincount(which, minlength=len(places)))
        for place, rows in zip(places, np.split(order, ends[:-1]), strict=True):
            part = self._shard(place)
            if part is not None:
                yield part, rows

    def _shard(self, place: IntArray) -> E | None:
        key = tuple(place.tolist())
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        part = self._saved.read_shard(place)
        if part is None:
            return None
        self._kept[key] = part
        while len(self._kept) > 1 and sum(each.nbytes for each in self._kept.values()) > (
            self._cache_bytes
        ):
            self._kept.popitem(last=False)
        return part
