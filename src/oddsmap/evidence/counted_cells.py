# SPDX-License-Identifier: Apache-2.0
"""Hits and passes of a field of cells: made, filled and read.

What is done with whole maps (sums, boxes, other frames) is `oddsmap.evidence.evidence.Evidence`.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_box, cell_indices, check_room
from oddsmap.config.config import Config, MapConfig, PosteriorConfig
from oddsmap.errors import ConfigError, InputError, shown
from oddsmap.evidence.tiles import Census, TileStore
from oddsmap.kernels.units import ONE, PASSES
from oddsmap.limits import TILE_SIDE
from oddsmap.query.places import Placed
from oddsmap.scans.report import Report
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.registry import Sensor
from oddsmap.short_repr import counted, described, grid_facts, in_bytes
from oddsmap.version import __version__

__all__ = ["CountedCells"]

# A census of as much takes 45 ms; of more, tiles are counted.
_CENSUS_BYTES = 1 << 26
# What a region takes a cell while it is made: two weights of 8 bytes, and as much as votes.
_REGION_BYTES = 32


class CountedCells(Placed):
    """Hits and passes of a field of cells; grows in every direction.

    Cell i covers [i * resolution, (i + 1) * resolution) in the map frame, along each axis.

    Args:
        resolution: side of a cell [m].

    Other Args:
        votes: "scan" or "beam", see `build_map`; default: the choice of the kind of sensor.
        half_life: after this time evidence weighs half [s]; None: it never fades.
        t_ref_ns: the time at which evidence weighs 1 [ns]; with a half-life only.
        half_life_scans: after so many scans evidence weighs half; None: it never fades.
        ref_scan: the number of the scan at which it weighs 1; with half_life_scans only.
        path_lengths: True: also keep the length of beams inside cells.
        sensor: the sensor model that evidence is made with; its p_hit and p_miss are the
            defaults of the views.
        posterior: defaults of the views.
        ndim: 2 for 2D maps, 3 for 3D maps.
        tile_side: cells along a tile's side: memory and speed, never a result.

    Raises:
        ConfigError: a value is outside its range.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from self.place_facts()
        yield f'votes "{self.votes}", sensor {self.sensor.kind}'
        forgets = self.config.map
        if forgets.half_life is not None:
            yield f"half-life {forgets.half_life:g} s"
        if forgets.half_life_scans is not None:
            yield f"half-life {forgets.half_life_scans:g} scans"
        if self.lengths is not None:
            yield "with path lengths"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        resolution: float,
        *,
        votes: str | None = None,
        half_life: float | None = None,
        t_ref_ns: int | None = None,
        half_life_scans: float | None = None,
        ref_scan: int | None = None,
        path_lengths: bool = False,
        sensor: Sensor | None = None,
        posterior: PosteriorConfig | None = None,
        ndim: int = 2,
        tile_side: int | None = None,
    ) -> None:
        sensor = sensor or BeamSensor()
        try:
            side = float(resolution)
        except (TypeError, ValueError):
            raise ConfigError(
                f"map.resolution is the side of a cell [m], got {shown(resolution)}"
            ) from None
        self.config = Config(
            map=MapConfig(
                resolution=side,
                votes=votes or sensor.default_votes,
                half_life=half_life,
                t_ref_ns=t_ref_ns,
                half_life_scans=half_life_scans,
                ref_scan=ref_scan,
                path_lengths=path_lengths,
            ),
            sensor=sensor,
            posterior=posterior or PosteriorConfig(),
        )
        if ndim not in TILE_SIDE:
            raise ConfigError(f"a map has 2 or 3 dimensions, got {ndim}")
        if half_life is not None and t_ref_ns is None:
            raise ConfigError(
                "map.half_life needs map.t_ref_ns, the time it counts back from [ns]: give that of "
                "the last scan, as build_map and oddsmap build do"
            )
        if half_life_scans is not None and ref_scan is None:
            raise ConfigError(
                "map.half_life_scans needs map.ref_scan, the number of the scan it counts back "
                "from: give that of the last scan, as build_map and oddsmap build do"
            )
        self.tiles = TileStore(ndim, tile_side or TILE_SIDE[ndim])
        self.lengths = self.new_tiles() if path_lengths else None
        """Length of beams inside cells [1/65536 of a cell's side], stored in place of passes."""
        self.provenance: list[dict[str, Any]] = []
        self.report: Report | None = None

    def place_facts(self) -> list[str]:
        """Resolution, what is known, and where, for `repr`: in milliseconds, also of large maps."""
        tiles = self.tiles
        if not tiles.count:
            return [*grid_facts(self.ndim, self.resolution, None, None), "empty"]
        if self.nbytes <= _CENSUS_BYTES:
            census = tiles.census()
            return grid_facts(self.ndim, self.resolution, census.cells, census.bounds)
        box = tiles.side * tiles.coords.min(axis=0), tiles.side * (tiles.coords.max(axis=0) + 1)
        return [*grid_facts(self.ndim, self.resolution, None, box), counted(tiles.count, "tile")]

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.config.map.resolution

    @property
    def votes(self) -> str:
        """How a scan votes: "scan" or "beam"."""
        return self.config.map.votes

    @property
    def sensor(self) -> Sensor:
        """The sensor model."""
        return self.config.sensor

    @property
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""
        return self.tiles.ndim

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self.tiles.nbytes + (self.lengths.nbytes if self.lengths is not None else 0)

    def new_tiles(self) -> TileStore:
        """An empty store of the same shape, to be filled alongside this one and added to it."""
        return self.tiles.like()

    def record(self, path: str | os.PathLike[str] | None, **facts: object) -> None:
        """Note in `provenance` where evidence came from; facts are plain values for JSON."""
        source = None if path is None else Path(path).name
        self.provenance.append({"source": source, **facts, "oddsmap": __version__})

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of cells with evidence: first index and past the last, shape (d,), x first.

        Returns:
            None where there is no evidence at all.
        """
        stores = (self.tiles, self.lengths) if self.lengths is not None else (self.tiles,)
        found = [box for tiles in stores if (box := tiles.census().bounds) is not None]
        if not found:
            return None
        return np.min([lo for lo, _ in found], axis=0), np.max([hi for _, hi in found], axis=0)

    def census(self) -> Census:
        """How many cells have evidence, and the sums of their hits and passes, in one pass."""
        return self.tiles.census()

    def cells(self) -> tuple[IntArray, IntArray, IntArray]:
        """The cells with evidence, in order of their index, x changing fastest.

        Returns:
            index, shape (n, d), x first; hits and passes, shape (n,), in units of 1/65536 vote.
        """
        return self.tiles.cells()

    def cell_lengths(self) -> tuple[IntArray, IntArray]:
        """The cells in which beams have a length, in order of their index, x changing fastest.

        Returns:
            index, shape (n, d), x first; lengths, shape (n,), in 1/65536 of a cell's side.

        Raises:
            InputError: the map keeps no lengths.
        """
        index, _, lengths = self._kept_lengths().cells()
        return index, lengths

    def cell_count(self) -> int:
        """How many cells have evidence."""
        return self.tiles.census().cells

    def region(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Hits and passes [votes] of a box of cells.

        Args:
            lo: first cell, shape (d,), x first.
            hi: past the last cell, shape (d,).

        Returns:
            hits and passes, shape (ny, nx) or (nz, ny, nx).

        Raises:
            InputError: lo and hi are not d whole numbers each, or hi < lo.
            MapTooLargeError: the box does not fit in memory.
        """
        hits, passes = self.region_units(lo, hi)
        return hits / ONE, passes / ONE

    def region_units(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[IntArray, IntArray]:
        """As `region`, in units of 1/65536 vote."""
        hits, passes = self.tiles.region(*self._box(lo, hi))
        return hits, passes

    def region_lengths(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> FloatArray:
        """Length of the beams inside each cell of a box [m]; arguments and errors as in `region`.

        A beam has a length in every cell that it crosses, up to its return or to where it clears.

        Raises:
            InputError: the map keeps no lengths.
        """
        tiles = self._kept_lengths()
        lengths: FloatArray = tiles.region(*self._box(lo, hi))[PASSES] * (self.resolution / ONE)
        return lengths

    def _kept_lengths(self) -> TileStore:
        if self.lengths is None:
            raise InputError(
                'the map keeps no path lengths: build it with map.path_lengths (and votes "beam")'
            )
        return self.lengths

    def _box(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[IntArray, IntArray]:
        """A box that is to become an array."""
        first, last = cell_box(lo, hi, self.ndim)
        check_room(first, last, _REGION_BYTES)
        return first, last

    def add_cells(self, index: IntArray, hits: IntArray, passes: IntArray) -> None:
        """Add weights to single cells.

        Args:
            index: cell indices, shape (n, d), x first; what is given for one cell adds up.
            hits: units of 1/65536 vote, shape (n,).
            passes: units of 1/65536 vote, shape (n,).

        Raises:
            InputError: a negative weight, one that is no whole number, or shapes that do not fit.
            MapTooLargeError: a cell would pass 2^46 votes.
        """
        cells = cell_indices(index, self.ndim)
        weights = [np.asarray(kind) for kind in (hits, passes)]
        if any(weight.shape != (len(cells),) for weight in weights):
            raise InputError(f"cells need index (n, {self.ndim}), hits (n,) and passes (n,)")
        if len(cells) == 0:
            return
        if any(weight.dtype.kind not in "iu" for weight in weights):
            raise InputError("weights are whole numbers of 1/65536 vote: multiply votes by 65536")
        if min(int(weight.min()) for weight in weights) < 0:
            raise InputError("evidence only adds up: a weight is negative")
        self.tiles.add_cells(cells, np.stack(weights, axis=1))

    def like(self, *, t_ref_ns: int | None = None, resolution: float | None = None) -> Self:
        """An empty map with the same configuration, or for another t_ref_ns or resolution [m]."""
        own = self.config.map
        return type(self)(
            self.resolution if resolution is None else resolution,
            votes=self.votes,
            half_life=own.half_life,
            t_ref_ns=own.t_ref_ns if t_ref_ns is None else t_ref_ns,
            half_life_scans=own.half_life_scans,
            ref_scan=own.ref_scan,
            path_lengths=own.path_lengths,
            sensor=self.sensor,
            posterior=self.config.posterior,
            ndim=self.ndim,
            tile_side=self.tiles.side,
        )

    def _copy(self) -> Self:
        twin = self.like()
        twin.tiles, twin.lengths = copy.deepcopy(self.tiles), copy.deepcopy(self.lengths)
        twin.provenance = copy.deepcopy(self.provenance)
        return twin
