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
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.cell_index import cell_box, indices_in
from oddsmap.config.config import Config
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.stored_tiles import (
    LENGTHS,
    VOTES,
    Form,
    StoredShard,
    stored_tiles,
    unit_of,
)
from oddsmap.evidence.tiles import Census, TileStore
from oddsmap.map_files.side_by_side import do_side_by_side
from oddsmap.map_files.zarr_folder import (
    EVIDENCE_MAP,
    FORMAT_VERSION,
    FULL_MAP,
    SHARD,
    NewFolder,
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

__all__ = [
    "MapWriter",
    "attributes_of",
    "empty_map",
    "extent_of",
    "fill_map",
    "is_map",
    "map_header",
    "new_saved_map",
    "read_empty",
    "read_map",
    "read_once",
    "save_map",
    "stores_of",
]

E = TypeVar("E", bound=Evidence)


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
    censuses = [tiles.census() for tiles in stores_of(evidence)]
    with new_saved_map(evidence, censuses, path, force=force) as writer:
        do_side_by_side(writer.write, writer.shards(evidence))


def stores_of(evidence: Evidence) -> list[TileStore]:
    """The stores of tiles that a map is saved from: votes, and lengths where it keeps them."""
    return [stored.tiles for stored in stored_tiles(evidence)]


class MapWriter:
    """A map's folder that is being filled, by one part of the map after the other."""

    def __init__(
        self, folder: NewFolder, like: Evidence, censuses: Sequence[Census], first_place: IntArray
    ) -> None:
        self._folder, self._first_place = folder, first_place
        self._forms = [Form.narrowest(census) for census in censuses]
        for stored, form in zip(stored_tiles(like), self._forms, strict=True):
            stored.create(folder, form)

    def shards(self, part: Evidence) -> Iterator[StoredShard]:
        """What is to be written of a part of the map; no shard is in two of them."""
        for stored, form in zip(stored_tiles(part), self._forms, strict=True):
            yield from stored.shards(form)

    def write(self, shard: StoredShard) -> None:
        """Write a shard; threads may write several."""
        shard.write(self._folder, self._first_place)


@contextmanager
def new_saved_map(
    like: Evidence, censuses: Sequence[Census], path: str | os.PathLike[str], *, force: bool
) -> Iterator[MapWriter]:
    """Write a map by parts; the old one stays in place until the new one is complete.

    Args:
        like: a map of the same configuration and provenance.
        censuses: of each of its `stores_of`, what all parts together hold.
        path: folder to make.
        force: True if an existing map may be replaced.

    Raises:
        OutputError: as in `save_map`.
    """
    lo, hi, first, shape = extent_of(censuses, like.ndim)
    with new_folder(Path(path), shape, force=force) as folder:
        yield MapWriter(folder, like, censuses, first // SHARD[like.ndim])
        folder.seal(attributes_of(like, first, lo, hi))


def extent_of(
    censuses: Sequence[Census], d: int
) -> tuple[IntArray, IntArray, IntArray, tuple[int, ...]]:
    """Where a map lies.

    Args:
        censuses: of the weights that are counted together.
        d: 2 or 3.

    Returns:
        Its first known cell, the cell past its last, the first cell of its arrays, shape (d,) each,
        x first; and the shape of the arrays.
    """
    boxes = [census.bounds for census in censuses if census.bounds is not None]
    boxes = boxes or [(np.zeros(d, np.int64), np.ones(d, np.int64))]
    lo = np.min([first for first, _ in boxes], axis=0)
    hi = np.max([past for _, past in boxes], axis=0)
    shard = SHARD[d]
    first = lo // shard * shard
    return lo, hi, first, tuple(int(n) for n in (-(-hi // shard) * shard - first)[::-1])


def attributes_of(
    evidence: Evidence, first: IntArray, lo: IntArray, hi: IntArray
) -> dict[str, Any]:
    """What a saved map says of itself; the cells are those of `extent_of`."""
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
    return read_unchanged(Path(path), lambda: read_once(Path(path), kind, box_lo, box_hi))


def read_empty(path: str | os.PathLike[str], kind: type[E]) -> E:
    """What a saved map says of itself: the same map without evidence; errors as in `read_map`."""
    return read_unchanged(Path(path), lambda: empty_map(Path(path), kind, map_header(Path(path))))


def read_once(
    path: Path,
    kind: type[E],
    lo: IntArray | None,
    hi: IntArray | None,
    take: Callable[[E], None] | None = None,
) -> E:
    """Read a map once; `take` gets what each shard holds, and then the map is empty again."""
    header = map_header(path)
    evidence = empty_map(path, kind, header)
    d = evidence.ndim
    if any(box is not None and box.shape != (d,) for box in (lo, hi)):
        raise InputError(f"{path}: a box needs {d} indices each, got lo {lo} and hi {hi}")
    if lo is not None and hi is not None:
        cell_box(lo, hi, d)
    fill_map(evidence, SavedShards(path, header), lo, hi, take=take)
    return evidence


def fill_map(
    evidence: E,
    shards: SavedShards,
    lo: IntArray | None,
    hi: IntArray | None,
    *,
    take: Callable[[E], None] | None = None,
    places: Sequence[tuple[int, ...]] | None = None,
) -> None:
    """Add what a box of a saved map holds, or of some of its shards, to an empty one."""
    for stored in stored_tiles(evidence):
        unit = stored.unit_in(shards.header)
        for chunks in shards.read_all(stored.names, lo, hi, places):
            stored.fill(chunks, unit, lo, hi)
            if take is not None:
                take(evidence)
                stored.tiles.clear()


def map_header(path: Path) -> Header:
    """The header of a saved map; what is damaged is a ValueError, or another of `DAMAGE`."""
    if format_of(path) == FULL_MAP:
        raise InputError(
            f"{path}: a full map, which has no hits and passes: read it with oddsmap.load_full_map"
        )
    if not is_map(path):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
        raise InputError(
            f"{path}: not a saved map, which is a Zarr folder with hits and passes; if it is a "
            "log, make a map of it first: oddsmap build LOG --resolution 0.05 -o MAP.zarr"
        )
    return read_header(path, EVIDENCE_MAP)


def empty_map(path: Path, kind: type[E], header: Header) -> E:
    """A map of the settings and the provenance in a header, without evidence; errors as above."""
    attributes = header.attributes
    config = Config.from_dict(attributes["config"], str(path))
    _check(header, config)
    evidence = kind(
        config.map.resolution,
        votes=config.map.votes,
        half_life=config.map.half_life,
        t_ref_ns=config.map.t_ref_ns,
        half_life_scans=config.map.half_life_scans,
        ref_scan=config.map.ref_scan,
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
    expected = {*VOTES, *(LENGTHS if config.map.path_lengths else ())}
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
        unit_of(array.attributes, name)
    votes = [header.arrays[name] for name in VOTES]
    if len({(each.dtype, each.attributes["weight_unit"]) for each in votes}) > 1:
        raise ValueError("hits and passes are stored in different units")
    lo, hi = (whole_numbers(header.attributes, f"known_cells_{end}") for end in ("lo", "hi"))
    begin = header.origin_cell.tolist()
    inside = len(lo) == len(hi) == len(begin) and all(
        a <= b < c <= a + n for a, b, c, n in zip(begin, lo, hi, header.shape[::-1], strict=True)
    )
    if not inside:
        raise ValueError(f"known cells {lo} to {hi} lie outside the arrays, which begin at {begin}")
