# SPDX-License-Identifier: Apache-2.0
"""Evidence: for each cell, how many hits and how many passes.

Both are exact integers, in units of 1/65536 vote. They add up in any order, so maps of one frame
merge by addition. This is data alone: `oddsmap.EvidenceMap` adds the views and the files.
"""

from __future__ import annotations

import copy
import math
import os
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_box, cell_indices, check_room
from oddsmap.config.config import Config, MapConfig, PosteriorConfig
from oddsmap.errors import ConfigError, InputError, shown
from oddsmap.evidence.arithmetic import (
    check_same_kind,
    coarser,
    difference,
    factor_of,
    merge_tiles,
)
from oddsmap.evidence.frames import axes_of, axes_of_up, turned
from oddsmap.evidence.tiles import Census, TileStore
from oddsmap.kernels.units import ONE, PASSES
from oddsmap.limits import TILE_SIDE
from oddsmap.query.places import Placed
from oddsmap.scans.report import Report
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.registry import Sensor
from oddsmap.version import __version__

__all__ = ["Evidence"]

# What a region takes a cell while it is made: two weights of 8 bytes, and as much as votes.
_REGION_BYTES = 32


class Evidence(Placed):
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
        return TileStore(self.ndim, self.tiles.side)

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

    def merge(self, other: Evidence, *, any_sensor: bool = False) -> None:
        """Add another map of the same frame to this one, exactly.

        Args:
            other: the map to add.
            any_sensor: True: also one of another kind of sensor. The sum does not know any more
                which votes were whose, and views weigh all by this map's sensor model.

        Raises:
            InputError: the maps differ in resolution, dimensions, kind of votes, half-life or what
                it counts back from (see `rescaled`), in whether they keep lengths, or in the kind
                of sensor.
        """
        self._check_same_kind(other, any_sensor=any_sensor, done="added")
        merge_tiles(self.tiles, other.tiles)
        if self.lengths is not None and other.lengths is not None:
            merge_tiles(self.lengths, other.lengths)
        self.provenance.extend(copy.deepcopy(other.provenance))

    def subtract(self, other: Evidence, *, any_sensor: bool = False) -> None:
        """Take the evidence of another map out of this one again, exactly: `merge` undone.

        Of the provenance, too, the other's entries are taken out where they are all there;
        otherwise an entry notes what was subtracted.

        Args:
            other: what is to be taken out.
            any_sensor: as in `merge`.

        Raises:
            InputError: as in `merge`, or a cell has less than is to be taken out; then nothing
                has changed.
        """
        self._check_same_kind(other, any_sensor=any_sensor, done="subtracted")
        left, lengths = difference(self.tiles, other.tiles, self.resolution), self.lengths
        if self.lengths is not None and other.lengths is not None:
            lengths = difference(self.lengths, other.lengths, self.resolution)
        self.tiles, self.lengths = left, lengths
        theirs, own = copy.deepcopy(other.provenance), copy.deepcopy(self.provenance)
        try:
            for entry in theirs:
                own.remove(entry)
        except ValueError:
            self.record(None, subtracted=theirs)
        else:
            self.provenance = own

    def _check_same_kind(self, other: Evidence, *, any_sensor: bool, done: str) -> None:
        if not isinstance(other, Evidence):
            raise InputError(
                f"only evidence is {done}, and a {type(other).__name__} holds no hits and passes"
            )
        if self.ndim != other.ndim:
            raise InputError(
                f"maps of different ndim cannot be {done}: one is {self.ndim}D, the other "
                f"{other.ndim}D"
            )
        check_same_kind(self.config, other.config, any_sensor=any_sensor, done=done)

    def __add__(self, other: object) -> Self:
        """A new map with the evidence of both: see `merge`."""
        if not isinstance(other, Evidence):
            return NotImplemented
        total = self._copy()
        total.merge(other)
        return total

    def __radd__(self, other: object) -> Self:
        """What `sum` of several maps begins with: 0 and the first."""
        return self._copy() if isinstance(other, int) and other == 0 else NotImplemented

    def __sub__(self, other: object) -> Self:
        """A new map without the evidence of the other: see `subtract`."""
        if not isinstance(other, Evidence):
            return NotImplemented
        rest = self._copy()
        rest.subtract(other)
        return rest

    def _copy(self) -> Self:
        twin = self.like()
        twin.tiles, twin.lengths = copy.deepcopy(self.tiles), copy.deepcopy(self.lengths)
        twin.provenance = copy.deepcopy(self.provenance)
        return twin

    def resample(self, resolution: float) -> Self:
        """A new map of larger cells, each with the sum of the evidence of those that lie in it.

        It is exact, and not what mapping at that resolution makes: there a scan or a beam votes
        once for a large cell, here once for each small cell in it that it met. So a cell has more
        votes, hits from a wall and passes from the space before it among them, and its posterior
        is more extreme.

        Args:
            resolution: side of a cell [m], a whole multiple of this map's.

        Raises:
            ConfigError: it is none; the nearest are named.
            InputError: the map keeps lengths, which have no exact sum.
            MapTooLargeError: a cell would pass 2^46 votes.
        """
        factor = factor_of(self.resolution, resolution)
        if factor == 1:
            return self._copy()
        if self.lengths is not None:
            raise InputError(
                "the map keeps path lengths, in 65536ths of a cell's side: those of a larger cell "
                "are no whole numbers of them; build the map again at the coarser resolution"
            )
        large = self.like(resolution=float(resolution))
        coarser(large.tiles, self.tiles, factor)
        large.provenance = copy.deepcopy(self.provenance)
        large.record(None, resampled_from=self.resolution)
        return large

    def rotated(self, axes: str | None = None, *, up: str | None = None) -> Self:
        """A new map in a frame turned by quarter turns about the origin, exactly.

        Cells go to whole cells, with their hits, passes and lengths. Heights that the sensor model
        has for marks (mark_z_min, mark_z_max) stay the numbers that they were.

        Args:
            axes: the old axis that each new one is, in order: "z -x -y" makes x of z, y of -x and
                z of -y, which takes an optical frame (x right, y down, z forward) to x forward,
                y left, z up. In 2D such as "y -x".
            up: 3D, in place of `axes`: the old axis that is to point up, such as "-y". x stays, or
                y where x points up.

        Raises:
            ConfigError: not one of the two, axes that are not each axis once or a mirror image, or
                `up` of a 2D map.
        """
        if (axes is None) == (up is None):
            raise ConfigError("a map is turned by axes or by up: give one of the two")
        if up is not None and self.ndim != 3:
            raise ConfigError('up turns maps of space, this one is 2D: give axes, such as "y -x"')
        stated = axes_of_up(up) if up is not None else " ".join(str(axes).replace(",", " ").split())
        source, is_reversed = axes_of(stated, self.ndim)
        other = self.like()
        turned(other.tiles, self.tiles, source, is_reversed)
        if other.lengths is not None and self.lengths is not None:
            turned(other.lengths, self.lengths, source, is_reversed)
        other.provenance = copy.deepcopy(self.provenance)
        other.record(None, rotated=stated)
        return other

    def crop(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> Self:
        """A new map with only the cells of a box; arguments and errors as in `region`."""
        first, last = cell_box(lo, hi, self.ndim)
        part = self.like()
        _crop_tiles(part.tiles, self.tiles, first, last)
        if part.lengths is not None and self.lengths is not None:
            _crop_tiles(part.lengths, self.lengths, first, last)
        part.provenance = copy.deepcopy(self.provenance)
        return part

    def crop_box(self, lo: npt.ArrayLike, hi: npt.ArrayLike) -> Self:
        """A new map with only the cells whose centres lie in a box of metres.

        Args:
            lo: lowest corner [m], shape (d,), x first; a centre on it is inside.
            hi: highest corner [m], shape (d,); a centre on it is outside.

        Raises:
            InputError: they are not d numbers each, or hi is not above lo.
        """
        return self.crop(*self.region_of(lo, hi))

    def rescaled(self, t_ref_ns: int) -> Self:
        """A new map whose half-life counts back from a later time, to go on with later scans.

        Every weight is multiplied by one factor and rounded, so the result differs from that of a
        map made for this t_ref_ns by roundings: it is inexact. The provenance says so, and how
        many weights above 0 became 0.

        Args:
            t_ref_ns: the later time [ns].

        Raises:
            ConfigError: the map has no half-life, or the time is earlier than its own.
        """
        half_life, before = self.config.map.half_life, self.config.map.t_ref_ns
        if half_life is None or before is None:
            raise ConfigError("only evidence with a half-life can be rescaled: this map has none")
        if t_ref_ns < before:
            raise ConfigError(
                f"t_ref_ns {t_ref_ns} is earlier than the map's {before}: what was forgotten "
                "cannot come back"
            )
        factor = math.exp2(-(t_ref_ns - before) / (1e9 * half_life))
        later = self.like(t_ref_ns=t_ref_ns)
        underflowed = _add_scaled(later.tiles, self.tiles, factor)
        facts = {
            "rescaled_from_t_ref_ns": before,
            "t_ref_ns": t_ref_ns,
            "vote.underflow": underflowed,
        }
        if later.lengths is not None and self.lengths is not None:
            facts["length.underflow"] = _add_scaled(later.lengths, self.lengths, factor)
        later.provenance = copy.deepcopy(self.provenance)
        later.record(None, **facts)
        return later

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


def _crop_tiles(to: TileStore, tiles: TileStore, first: IntArray, last: IntArray) -> None:
    side, d = tiles.side, tiles.ndim
    for coords, units in tiles.chunks(first // side, -(-last // side)):
        # Which of a tile's cells lie in the box, axis by axis.
        along = coords[:, :, None] * side + np.arange(side)
        inside = (along >= first[:, None]) & (along < last[:, None])
        kept = inside[:, 0]
        for axis in range(1, d):
            kept = (inside[:, axis, :, None] & kept[:, None, :]).reshape(len(coords), -1)
        cut = units * kept[:, None, :]
        some = cut.any(axis=(1, 2))
        to.fill(coords[some], cut[some])


def _add_scaled(to: TileStore, tiles: TileStore, factor: float) -> int:
    """Add weights times a factor; returns how many above 0 became 0."""
    underflowed = 0
    for coords, units in tiles.chunks():
        scaled = np.rint(units * factor).astype(np.int64)
        underflowed += int(np.count_nonzero((units > 0) & (scaled == 0)))
        kept = scaled.any(axis=(1, 2))
        to.add(coords[kept], scaled[kept])
    return underflowed
