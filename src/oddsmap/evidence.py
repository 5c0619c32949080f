# SPDX-License-Identifier: Apache-2.0
"""The map: for each cell, how many hits and how many passes.

Both are exact integers, in units of 1/65536 vote. They add up in any order, so maps of one frame
merge by addition; every posterior is a view of them, made when it is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from oddsmap.config import Config, MapConfig, PosteriorConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.kernels.tiles import ONE
from oddsmap.sensors.beam import BeamSensor
from oddsmap.tiles import TileStore

if TYPE_CHECKING:
    from oddsmap.integrate import Report
    from oddsmap.posterior.log_odds import LogOdds

__all__ = ["EvidenceMap"]

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

# 32 x 32 cells: measured best of 16, 32 and 64 for 2D scans at 0.05 m. 8^3 for space.
_TILE_SIDE = {2: 32, 3: 8}


class EvidenceMap:
    """Hits and passes of a field of cells; grows in every direction.

    Cell i covers [i * resolution, (i + 1) * resolution) in the map frame, along each axis.

    Args:
        resolution: side of a cell [m].

    Other Args:
        votes: "scan" or "beam", see `build_map`.
        sensor: the sensor model that evidence is made with; its p_hit and p_miss are the
            defaults of the views.
        posterior: defaults of the views.
        ndim: 2 for maps of the plane, 3 for maps of space.
        tile_side: cells along a tile's side: memory and speed, never a result.

    Raises:
        ConfigError: a value is outside its range.
    """

    def __init__(
        self,
        resolution: float,
        *,
        votes: str = "scan",
        sensor: BeamSensor | None = None,
        posterior: PosteriorConfig | None = None,
        ndim: int = 2,
        tile_side: int | None = None,
    ) -> None:
        self.config = Config(
            map=MapConfig(resolution=float(resolution), votes=votes),
            sensor=sensor or BeamSensor(),
            posterior=posterior or PosteriorConfig(),
        )
        if ndim not in _TILE_SIDE:
            raise ConfigError(f"a map has 2 or 3 dimensions, got {ndim}")
        self.tiles = TileStore(ndim, tile_side or _TILE_SIDE[ndim])
        self.provenance: list[dict[str, Any]] = []
        self.report: Report | None = None

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.config.map.resolution

    @property
    def votes(self) -> str:
        """How a scan votes: "scan" or "beam"."""
        return self.config.map.votes

    @property
    def sensor(self) -> BeamSensor:
        """The sensor model."""
        return self.config.sensor

    @property
    def ndim(self) -> int:
        """2 for a map of the plane, 3 for a map of space."""
        return self.tiles.ndim

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self.tiles.nbytes

    def new_tiles(self) -> TileStore:
        """An empty store of the same shape, to be filled beside this one and added to it."""
        return TileStore(self.ndim, self.tiles.side)

    def record(self, path: str | os.PathLike[str] | None, **facts: object) -> None:
        """Note in `provenance` what evidence came from; facts are plain values for JSON."""
        from oddsmap import __version__

        source = None if path is None else Path(path).name
        self.provenance.append({"source": source, **facts, "oddsmap": __version__})

    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of cells with evidence: first index and past the last, shape (d,), x first.

        Returns:
            None where there is no evidence at all.
        """
        lo, hi = None, None
        for index, _, _ in self._chunks():
            if len(index):
                lo = index.min(axis=0) if lo is None else np.minimum(lo, index.min(axis=0))
                hi = index.max(axis=0) if hi is None else np.maximum(hi, index.max(axis=0))
        return None if lo is None or hi is None else (lo, hi + 1)

    def cells(self) -> tuple[IntArray, IntArray, IntArray]:
        """The cells with evidence, in order of their index, x changing fastest.

        Returns:
            index, shape (n, d), x first; hits and passes, shape (n,), in units of 1/65536 vote.
        """
        parts = list(self._chunks())
        index = np.concatenate([np.empty((0, self.ndim), np.int64), *(part[0] for part in parts)])
        hits = np.concatenate([np.empty(0, np.int64), *(part[1] for part in parts)])
        passes = np.concatenate([np.empty(0, np.int64), *(part[2] for part in parts)])
        order = np.lexsort(index.T)
        return index[order], hits[order], passes[order]

    def cell_count(self) -> int:
        """How many cells have evidence."""
        return sum(len(index) for index, _, _ in self._chunks())

    def _chunks(self) -> Iterator[tuple[IntArray, IntArray, IntArray]]:
        side, d = self.tiles.side, self.ndim
        for coords, units in self.tiles.chunks():
            tile, cell = np.nonzero(units.any(axis=1))
            # Cells of a tile lie row by row, x fastest: the reverse of the axes of coords.
            within = np.stack(np.unravel_index(cell, (side,) * d)[::-1], axis=1)
            yield coords[tile] * side + within, units[tile, 0, cell], units[tile, 1, cell]

    def region(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Hits and passes [votes] of a box of cells.

        Args:
            lo: first cell, shape (d,), x first.
            hi: past the last cell, shape (d,).

        Returns:
            hits and passes, shape (ny, nx) or (nz, ny, nx).

        Raises:
            InputError: lo and hi are not d indices each, or hi < lo.
        """
        hits, passes = self.region_units(lo, hi)
        return hits / ONE, passes / ONE

    def region_units(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[IntArray, IntArray]:
        """As `region`, in units of 1/65536 vote."""
        first, last = self._box(lo, hi)
        side, d = self.tiles.side, self.ndim
        tile_lo, tile_hi = first // side, -(-last // side)
        span = (tile_hi - tile_lo)[::-1]
        # Seen as tiles of cells, (2, ty, side, tx, side), whole tiles are put in place at once.
        full = np.zeros((2, *(n for count in span for n in (int(count), side))), np.int64)
        coords = self.tiles.coords
        slots = np.flatnonzero(((coords >= tile_lo) & (coords < tile_hi)).all(axis=1))
        at = (coords[slots] - tile_lo)[:, ::-1]
        where = [part for axis in range(d) for part in (at[:, axis], slice(None))]
        full[(slice(None), *where)] = self.tiles.units(slots).reshape(-1, 2, *(side,) * d)
        flat = full.reshape(2, *(span * side))
        begin, end = (first - tile_lo * side)[::-1], (last - tile_lo * side)[::-1]
        cut = tuple(slice(a, b) for a, b in zip(begin, end, strict=True))
        return flat[0][cut].copy(), flat[1][cut].copy()

    def _box(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> tuple[IntArray, IntArray]:
        first, last = np.asarray(lo, np.int64), np.asarray(hi, np.int64)
        if first.shape != (self.ndim,) or last.shape != first.shape or (last < first).any():
            raise InputError(
                f"a region needs lo <= hi of {self.ndim} indices, got {lo!r} and {hi!r}"
            )
        return first, last

    def add_cells(self, index: IntArray, hits: IntArray, passes: IntArray) -> None:
        """Add weights to single cells.

        Args:
            index: cell indices, shape (n, d), x first, each at most once.
            hits: units of 1/65536 vote, shape (n,).
            passes: units of 1/65536 vote, shape (n,).

        Raises:
            InputError: a negative weight, or shapes that do not fit.
            MapTooLargeError: a cell would pass 2^46 votes.
        """
        index = np.asarray(index, np.int64)
        shaped = index.ndim == 2 and index.shape[1] == self.ndim
        if not (shaped and np.shape(hits) == np.shape(passes) == (len(index),)):
            raise InputError(f"cells need index (n, {self.ndim}), hits (n,) and passes (n,)")
        if len(index) == 0:
            return
        if min(hits.min(), passes.min()) < 0:
            raise InputError("evidence only adds up: a weight is negative")
        side = self.tiles.side
        coords, tile = np.unique(index // side, axis=0, return_inverse=True)
        units = np.zeros((len(coords), 2, side**self.ndim), np.int64)
        within = np.ravel_multi_index(tuple((index % side).T[::-1]), (side,) * self.ndim)
        units[tile.ravel(), 0, within] = hits
        units[tile.ravel(), 1, within] = passes
        self.tiles.add(coords, units)

    def merge(self, other: EvidenceMap) -> None:
        """Add another map of the same frame to this one, exactly.

        Raises:
            InputError: the maps differ in resolution, dimensions or kind of votes.
        """
        for name in ("resolution", "ndim", "votes"):
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                raise InputError(
                    f"maps of different {name} cannot be added: {mine} here, {theirs} there"
                )
        if self.tiles.side == other.tiles.side:
            self.tiles.merge(other.tiles)
        else:
            self.add_cells(*other.cells())
        self.provenance.extend(other.provenance)

    def crop(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> EvidenceMap:
        """A new map with the cells of a box alone; arguments and errors as in `region`."""
        first, last = self._box(lo, hi)
        index, hits, passes = self.cells()
        inside = ((index >= first) & (index < last)).all(axis=1)
        part = self.like()
        part.add_cells(index[inside], hits[inside], passes[inside])
        part.provenance = list(self.provenance)
        return part

    def like(self) -> EvidenceMap:
        """An empty map with the same configuration."""
        return EvidenceMap(
            self.resolution,
            votes=self.votes,
            sensor=self.sensor,
            posterior=self.config.posterior,
            ndim=self.ndim,
            tile_side=self.tiles.side,
        )

    def log_odds(
        self,
        *,
        p_hit: float | None = None,
        p_miss: float | None = None,
        prior: float | None = None,
    ) -> LogOdds:
        """The posterior of the Bayes filter, a view: see `oddsmap.posterior.log_odds.LogOdds`.

        Args:
            p_hit: p(x | z) of a hit at prior 1/2; default: the map's sensor model.
            p_miss: p(x | z) of a pass at prior 1/2; likewise.
            prior: p(x); default: the map's configuration.
        """
        from oddsmap.posterior.log_odds import LogOdds

        return LogOdds(self, p_hit=p_hit, p_miss=p_miss, prior=prior)

    def save(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the map as a Zarr folder: see `oddsmap.store.save_map`."""
        from oddsmap.store import save_map

        save_map(self, path, force=force)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> EvidenceMap:
        """Read a map that `save` wrote: see `oddsmap.store.load_map`."""
        from oddsmap.store import load_map

        return load_map(path)
