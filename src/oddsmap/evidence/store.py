# SPDX-License-Identifier: Apache-2.0
"""A map on disk: a Zarr folder that any Zarr reader opens.

    zarr.open("intel.zarr")["hits"][...]       # votes, rows = y, columns = x
    zarr.open("intel.zarr").attrs["resolution"]

A map that keeps the lengths of beams has a third array, `lengths`. The arrays cover the box of
known cells, rounded to whole shards. Shards lie on one grid for all maps of a resolution (multiples
of the shard's side, counted from the map's origin), and empty ones are not written: a region can be
read, or written by another process, on its own. The attribute `shards` lists those that were
written, so that one that has gone missing is noticed. `oddsmap.map_files.zarr_folder` is the folder
itself; docs/formats.md lists every attribute.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.cell_index import indices_in
from oddsmap.config.config import Config
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import HEAVIEST, TileStore
from oddsmap.kernels.units import ONE, PASSES
from oddsmap.map_files.zarr_folder import (
    EVIDENCE_MAP,
    FORMAT_VERSION,
    FULL_MAP,
    SHARD,
    format_of,
    new_folder,
)
from oddsmap.map_files.zarr_header import (
    Header,
    check_equal,
    check_place,
    read_header,
    whole_numbers,
)
from oddsmap.map_files.zarr_shards import SavedShards
from oddsmap.map_files.zarr_snapshot import holds, read_unchanged

__all__ = ["is_map", "read_map", "save_map"]

E = TypeVar("E", bound=Evidence)

_VOTES = {
    "hits": "weight of the readings that ended in the cell [weight_unit votes]",
    "passes": "weight of the readings that went through it [weight_unit votes]",
}
_LENGTHS = {"lengths": "length of the beams inside the cell [weight_unit sides of a cell]"}


def is_map(path: str | os.PathLike[str]) -> bool:
    """Whether a path looks like a saved map: a Zarr folder with hits and passes."""
    return holds(path, "hits")


def save_map(evidence: Evidence, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a map; the old one stays in place until the new one is complete.

    Args:
        evidence: the map.
        path: folder to make, by custom with the suffix .zarr.
        force: True if an existing map may be replaced.

    Raises:
        OutputError: it exists and `force` is False, or is no map, or cannot be written.
    """
    d = evidence.ndim
    shard = SHARD[d]
    bounds = evidence.bounds()
    lo, hi = bounds if bounds is not None else (np.zeros(d, np.int64), np.ones(d, np.int64))
    first = lo // shard * shard
    shape = tuple(int(n) for n in (-(-hi // shard) * shard - first)[::-1])
    stored: list[tuple[TileStore, slice, dict[str, str]]] = [(evidence.tiles, slice(0, 2), _VOTES)]
    if evidence.lengths is not None:
        stored.append((evidence.lengths, slice(PASSES, PASSES + 1), _LENGTHS))
    with new_folder(Path(path), shape, force=force) as folder:
        for tiles, channels, texts in stored:
            census = tiles.census()
            unit = ONE if census.whole_votes else 1
            # By name: Zarr knows one uint64.
            dtype = np.dtype(np.min_scalar_type(census.largest // unit).str)
            for name, text in texts.items():
                folder.create(name, dtype, 0, {"description": text, "weight_unit": unit / ONE})
            for begin in _shards_of(tiles, shard, lo, hi):
                place = tuple(((begin - first)[::-1] // shard).tolist())
                weights = tiles.counts_in(begin, shard, unit, dtype)[channels]
                for name, cells in zip(texts, weights, strict=True):
                    folder.write(name, place, cells)
        folder.seal(_attributes(evidence, first, lo, hi))


def _attributes(evidence: Evidence, first: IntArray, lo: IntArray, hi: IntArray) -> dict[str, Any]:
    return {
        "format": EVIDENCE_MAP,
        "format_version": FORMAT_VERSION,
        "resolution": evidence.resolution,
        "origin": [float(i) * evidence.resolution for i in first],
        "origin_cell": [int(i) for i in first],
        "known_cells_lo": [int(i) for i in lo],
        "known_cells_hi": [int(i) for i in hi],
        "votes": evidence.votes,
        "config": evidence.config.to_dict(),
        "provenance": evidence.provenance,
    }


def _shards_of(tiles: TileStore, shard: int, lo: IntArray, hi: IntArray) -> IntArray:
    # Every shard that a tile reaches into (a tile's side need not divide a shard's) and that has
    # known cells.
    side, d = tiles.side, tiles.ndim
    reach = np.array(list(product((*range(0, side, shard), side - 1), repeat=d)))
    found = [
        np.unique((coords[:, None] * side + reach).reshape(-1, d) // shard, axis=0)
        for coords, _ in tiles.chunks()
    ]
    begin = np.unique(np.concatenate([np.empty((0, d), np.int64), *found]), axis=0) * shard
    return begin[((begin + shard > lo) & (begin < hi)).all(axis=1)]


def read_map(
    path: str | os.PathLike[str],
    kind: type[E],
    *,
    lo: npt.ArrayLike | None = None,
    hi: npt.ArrayLike | None = None,
) -> E:
    """Read evidence that `save_map` wrote, as that class: see `oddsmap.load_map`."""
    box_lo = indices_in(lo) if lo is not None else None
    box_hi = indices_in(hi) if hi is not None else None
    evidence = read_unchanged(Path(path), lambda: _read(Path(path), kind, box_lo, box_hi))
    if box_lo is not None or box_hi is not None:
        nothing = np.zeros(evidence.ndim, np.int64)
        low, high = evidence.bounds() or (nothing, nothing)
        # An open side lies where the cells end, or at the other side where there are none.
        if box_lo is None:
            box_lo = low if box_hi is None else np.minimum(low, box_hi)
        evidence = evidence.crop(box_lo, np.maximum(high, box_lo) if box_hi is None else box_hi)
    return evidence


def _read(path: Path, kind: type[E], lo: IntArray | None, hi: IntArray | None) -> E:
    if format_of(path) == FULL_MAP:
        raise InputError(
            f"{path}: a full map, which has no hits and passes: read it with oddsmap.load_full_map"
        )
    if not is_map(path):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
        raise InputError(
            f"{path}: not a saved map (a Zarr folder with hits and passes, as oddsmap build makes)"
        )
    header = read_header(path, EVIDENCE_MAP)
    evidence = _empty_map(path, kind, header)
    d = evidence.ndim
    if any(box is not None and box.shape != (d,) for box in (lo, hi)):
        raise InputError(f"{path}: a box needs {d} indices each, got lo {lo} and hi {hi}")
    stored = [(evidence.tiles, tuple(_VOTES))]
    if evidence.lengths is not None:
        stored.append((evidence.lengths, tuple(_LENGTHS)))
    shards = SavedShards(path, header)
    for tiles, names in stored:
        for place in shards.places(names):
            begin = np.array(place[::-1], np.int64) * SHARD[d] + header.origin_cell
            if lo is not None and (begin + SHARD[d] <= lo).any():
                continue
            if hi is not None and (begin >= hi).any():
                continue
            weights = [_checked(shards.read(name, place), header, name) for name in names]
            if len(weights) == 1:  # lengths are stored in place of passes
                weights = [np.zeros_like(weights[0]), *weights]
            unit = _unit_of(header.arrays[names[0]].attributes, names[0])
            tiles.fill_counts(begin, unit, np.stack(weights))
    return evidence


def _empty_map(path: Path, kind: type[E], header: Header) -> E:
    attributes = header.attributes
    config = Config.from_dict(attributes["config"], str(path))
    _check(header, config)
    evidence = kind(
        config.map.resolution,
        votes=config.map.votes,
        half_life=config.map.half_life,
        t_ref_ns=config.map.t_ref_ns,
        path_lengths=config.map.path_lengths,
        sensor=config.sensor,
        posterior=config.posterior,
        ndim=len(header.shape),
    )
    evidence.provenance = list(attributes["provenance"])
    return evidence


def _check(header: Header, config: Config) -> None:
    """Refuse a map that contradicts itself."""
    check_place(header, config.map.resolution)
    check_equal(header.attributes, "votes", config.map.votes)
    expected = {*_VOTES, *(_LENGTHS if config.map.path_lengths else ())}
    if set(header.arrays) != expected:
        raise ValueError(
            f"it has the arrays {', '.join(header.arrays)}, and its configuration needs "
            f"{', '.join(sorted(expected))}"
        )
    for name, array in header.arrays.items():
        if array.dtype.kind != "u":
            raise ValueError(f"{name} holds {array.dtype}, which are no counts")
        if array.fill_value != 0:
            raise ValueError(f"{name} has the fill value {array.fill_value}, and 0 is no evidence")
        _unit_of(array.attributes, name)
    votes = [header.arrays[name] for name in _VOTES]
    if len({(each.dtype, each.attributes["weight_unit"]) for each in votes}) > 1:
        raise ValueError("hits and passes are stored in different units")
    lo, hi = (whole_numbers(header.attributes, f"known_cells_{end}") for end in ("lo", "hi"))
    begin = header.origin_cell.tolist()
    inside = len(lo) == len(hi) == len(begin) and all(
        a <= b < c <= a + n for a, b, c, n in zip(begin, lo, hi, header.shape[::-1], strict=True)
    )
    if not inside:
        raise ValueError(f"known cells {lo} to {hi} lie outside the arrays, which begin at {begin}")


def _unit_of(attributes: Mapping[str, Any], name: str) -> int:
    """Units in one count of an array."""
    unit = attributes["weight_unit"]
    if isinstance(unit, bool) or unit not in (1.0, 1 / ONE):
        raise ValueError(f"{name} has weight_unit {unit!r:.40}, which is 1.0 or 1/{ONE}")
    return round(float(unit) * ONE)


def _checked(stored: npt.NDArray[Any], header: Header, name: str) -> npt.NDArray[Any]:
    unit = _unit_of(header.arrays[name].attributes, name)
    if stored.max() > HEAVIEST // unit:
        raise ValueError(f"{name} holds weights that are not counts of 0 to 2^46 votes")
    return stored
