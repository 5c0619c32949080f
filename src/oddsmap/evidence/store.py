# SPDX-License-Identifier: Apache-2.0
"""A map on disk: a Zarr folder that any Zarr reader opens.

    zarr.open("intel.zarr")["hits"][...]       # votes, rows = y, columns = x
    zarr.open("intel.zarr").attrs["resolution"]

A map that keeps the lengths of beams has a third array, `lengths`. The arrays cover the box of
known cells, rounded to whole shards. Shards lie on one grid for all maps of a resolution (multiples
of the shard's side, counted from the map's origin), and empty ones are not written: a region can be
read, or written by another process, on its own. The attribute `shards` lists those that were
written, so that one that has gone missing is noticed.
docs/formats.md lists every attribute.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.atomic_write import atomic_output
from oddsmap.config.config import Config
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import MAX_UNITS, ONE, PASSES

if TYPE_CHECKING:
    import zarr

__all__ = ["CHUNK", "FORMAT_VERSION", "SHARD", "is_map", "read_map", "save_map", "shard_files"]

E = TypeVar("E", bound=Evidence)

FORMAT = "oddsmap evidence map"
FORMAT_VERSION = 1


# Side of a chunk (the unit of compression) and of a shard (one file) [cells].
CHUNK = {2: 128, 3: 32}
SHARD = {2: 1024, 3: 128}
_AXES = ("z", "y", "x")
_VOTES = {
    "hits": "weight of the readings that ended in the cell [weight_unit votes]",
    "passes": "weight of the readings that went through it [weight_unit votes]",
}
_LENGTHS = {"lengths": "length of the beams inside the cell [weight_unit sides of a cell]"}


def is_map(path: str | os.PathLike[str]) -> bool:
    """Whether a path looks like a saved map: a Zarr folder with hits and passes."""
    folder = Path(path)
    return (folder / "zarr.json").is_file() and (folder / "hits").is_dir()


def save_map(evidence: Evidence, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a map; the old one stays in place until the new one is complete.

    Args:
        evidence: the map.
        path: folder to make, by custom with the suffix .zarr.
        force: True if an existing one may be replaced.

    Raises:
        OutputError: it exists and `force` is False, or cannot be written.
    """
    import zarr

    d = evidence.ndim
    shard = SHARD[d]
    bounds = evidence.bounds()
    lo, hi = bounds if bounds is not None else (np.zeros(d, np.int64), np.ones(d, np.int64))
    first = lo // shard * shard
    shape = (-(-hi // shard) * shard - first)[::-1]
    stored: list[tuple[TileStore, slice, dict[str, str]]] = [(evidence.tiles, slice(0, 2), _VOTES)]
    if evidence.lengths is not None:
        stored.append((evidence.lengths, slice(PASSES, PASSES + 1), _LENGTHS))
    with atomic_output(Path(path), force=force) as part:
        root = zarr.open_group(part, mode="w", zarr_format=3)
        written: dict[str, list[list[int]]] = {}
        for tiles, channels, texts in stored:
            max_units, whole = _largest(tiles)
            unit = ONE if whole else 1
            dtype = np.dtype(
                np.min_scalar_type(max_units // unit).str
            )  # by name: Zarr knows one uint64
            arrays = [
                root.create_array(
                    name,
                    shape=tuple(int(n) for n in shape),
                    chunks=(CHUNK[d],) * d,
                    shards=(shard,) * d,
                    dtype=dtype,
                    fill_value=0,
                    dimension_names=_AXES[-d:],
                    attributes={"description": text, "weight_unit": unit / ONE},
                )
                for name, text in texts.items()
            ]
            for begin in _shards_of(tiles, shard, lo, hi):
                weights = tiles.region(begin, begin + shard)[channels]
                at = (begin - first)[::-1]
                where = tuple(slice(int(a), int(a) + shard) for a in at)
                for array, units in zip(arrays, weights, strict=True):
                    array[where] = (units // unit).astype(dtype)
            written |= {name: shard_files(part, name, d) for name in texts}
        root.attrs.update({**_attributes(evidence, first, lo, hi), "shards": written})


def _attributes(evidence: Evidence, first: IntArray, lo: IntArray, hi: IntArray) -> dict[str, Any]:
    return {
        "format": FORMAT,
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


def _largest(tiles: TileStore) -> tuple[int, bool]:
    max_units, fraction = 0, 0
    for _, units in tiles.chunks():
        max_units = max(max_units, int(units.max(initial=0)))
        fraction |= int(np.bitwise_or.reduce(units & (ONE - 1), axis=None))
    return max_units, fraction == 0


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
    import zarr

    if not is_map(path):
        if (Path(path) / "zarr.json").is_file() and (Path(path) / "log_odds").is_dir():
            raise InputError(
                f"{path}: a full map, which has no hits and passes: read it with "
                "oddsmap.load_full_map"
            )
        if not Path(path).exists():
            raise InputError(f"{path}: no such file or folder")
        raise InputError(
            f"{path}: not a saved map (a Zarr folder with hits and passes, as oddsmap build makes)"
        )
    try:
        root = zarr.open_group(Path(path), mode="r")
        attributes = dict(root.attrs)
        evidence, first = _empty_map(path, kind, attributes)
        d = evidence.ndim
        box_lo = np.asarray(lo, np.int64) if lo is not None else None
        box_hi = np.asarray(hi, np.int64) if hi is not None else None
        if any(box is not None and box.shape != (d,) for box in (box_lo, box_hi)):
            raise InputError(f"{path}: a box needs {d} indices each, got lo {lo!r} and hi {hi!r}")
        stored = [(evidence.tiles, tuple(_VOTES))]
        if evidence.lengths is not None:
            stored.append((evidence.lengths, tuple(_LENGTHS)))
        for tiles, names in stored:
            for begin in _stored_shards(root, Path(path), names, first, d):
                end = begin + _shard_side(root)
                if box_lo is not None and (end <= box_lo).any():
                    continue
                if box_hi is not None and (begin >= box_hi).any():
                    continue
                _add_shard(tiles, root, names, begin, end, first)
    except (
        OSError, LookupError, AttributeError, TypeError, ValueError, ArithmeticError, RuntimeError,
    ) as error:  # fmt: skip
        if isinstance(error, InputError | ConfigError):
            raise
        raise InputError(f"{path}: damaged, cannot be read as a map: {error}") from None
    if box_lo is not None or box_hi is not None:
        low, high = evidence.bounds() or (np.zeros(d, np.int64), np.zeros(d, np.int64))
        # An open side lies where the cells end, or at the other side where there are none.
        if box_lo is None:
            box_lo = low if box_hi is None else np.minimum(low, box_hi)
        evidence = evidence.crop(box_lo, np.maximum(high, box_lo) if box_hi is None else box_hi)
    return evidence


def _empty_map(
    path: str | os.PathLike[str], kind: type[E], attributes: dict[str, Any]
) -> tuple[E, IntArray]:
    if attributes.get("format") != FORMAT:
        raise InputError(f"{path}: a Zarr folder, but not one of oddsmap (attribute format)")
    version = attributes.get("format_version")
    if version != FORMAT_VERSION:
        raise InputError(
            f"{path}: format version {version}, this oddsmap reads {FORMAT_VERSION}: update oddsmap"
        )
    config = Config.from_dict(attributes["config"], str(path))
    first = np.array(attributes["origin_cell"], np.int64)
    if first.shape not in ((2,), (3,)):
        raise ValueError("attribute origin_cell needs 2 or 3 indices")
    evidence = kind(
        config.map.resolution,
        votes=config.map.votes,
        half_life=config.map.half_life,
        t_ref_ns=config.map.t_ref_ns,
        path_lengths=config.map.path_lengths,
        sensor=config.sensor,
        posterior=config.posterior,
        ndim=len(first),
    )
    evidence.provenance = list(attributes["provenance"])
    return evidence, first


def _array(root: zarr.Group, name: str) -> zarr.Array[Any]:
    import zarr

    array = root[name]
    if not isinstance(array, zarr.Array):
        raise ValueError(f"{name} is not an array")
    return array


def _shard_side(root: zarr.Group) -> int:
    array = _array(root, "hits")
    return int((array.shards or array.chunks)[0])


def shard_files(path: Path, name: str, d: int) -> list[list[int]]:
    """Place of each file of an array, in shards, z and y before x; an empty file counts as none."""
    folder = path / name / "c"
    files = (file for file in folder.glob("/".join("*" * d)) if file.stat().st_size)
    return sorted([int(part) for part in file.relative_to(folder).parts] for file in files)


def _stored_shards(
    root: zarr.Group, path: Path, names: tuple[str, ...], first: IntArray, d: int
) -> Iterator[IntArray]:
    # The files that exist: a map may span far more shards than were ever written.
    side = _shard_side(root)
    written: Any = root.attrs["shards"]
    found: set[tuple[int, ...]] = set()
    for name in names:
        files = {tuple(place) for place in shard_files(path, name, d)}
        # To Zarr a missing file is a shard of zeros; here it would be evidence lost silently.
        missing = [place for place in written[name] if tuple(place) not in files]
        if missing:
            raise ValueError(f"{name}/c/{'/'.join(map(str, missing[0]))} is missing or empty")
        found |= files
    for indices in sorted(found):
        yield np.array(indices[::-1], np.int64) * side + first


def _add_shard(
    tiles: TileStore,
    root: zarr.Group,
    names: tuple[str, ...],
    begin: IntArray,
    end: IntArray,
    first: IntArray,
) -> None:
    d, side = tiles.ndim, tiles.side
    cut = tuple(
        slice(int(a), int(b))
        for a, b in zip((begin - first)[::-1], (end - first)[::-1], strict=True)
    )
    weights = []
    for name in names:
        array = _array(root, name)
        unit = round(float(str(array.attrs["weight_unit"])) * ONE)
        stored = np.asarray(array[cut])
        if (
            stored.dtype.kind not in "ui"
            or not 0 <= stored.min() <= stored.max() <= MAX_UNITS // unit
        ):
            raise ValueError(f"{name} holds weights that are not counts of 0 to 2^46 votes")
        weights.append(stored.astype(np.int64) * unit)
    if len(weights) == 1:  # lengths are stored in place of passes
        weights.insert(0, np.zeros_like(weights[0]))
    # Seen as tiles: (ty, side, tx, side) becomes (ty, tx, side, side), one row per tile.
    count = int(end[0] - begin[0]) // side
    blocks = np.stack(weights).reshape(2, *(count, side) * d)
    order = [1 + 2 * axis for axis in range(d)] + [0] + [2 + 2 * axis for axis in range(d)]
    units = blocks.transpose(order).reshape(count**d, 2, side**d)
    used = np.flatnonzero(units.any(axis=(1, 2)))
    coords = np.stack(np.unravel_index(used, (count,) * d)[::-1], axis=1) + begin // side
    tiles.add(coords, units[used])
