# SPDX-License-Identifier: Apache-2.0
"""Evidence added to a saved map: only the shards that it reaches are read and written.

The new map is made beside the old one, as any save does, and takes its place in one step. Shards
that nothing was added to are not copied: they are hard links to the old map's files, which stay
when that folder goes.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.atomic_write import one_writer
from oddsmap.errors import InputError, OutputError
from oddsmap.evidence.append_arrays import UntouchedShards, form_of_sum
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import attributes_of, empty_map, fill_map, map_header, read_empty
from oddsmap.evidence.stored_tiles import Place, StoredShard, reached_shards, stored_tiles
from oddsmap.map_files.side_by_side import do_side_by_side
from oddsmap.map_files.zarr_folder import SHARD, new_folder, shard_files
from oddsmap.map_files.zarr_header import Header, whole_numbers
from oddsmap.map_files.zarr_shards import SavedShards
from oddsmap.map_files.zarr_snapshot import Mark, mark_of, read_unchanged, settled

__all__ = ["Appended", "append_map"]

Box = tuple[IntArray, IntArray]

# Without locks another may have replaced the map each time that it was read.
_TRIES = 100


class Appended(NamedTuple):
    """What adding to a saved map did."""

    cells_new: int
    """How many cells have evidence that had none."""
    shards_written: int
    """How many shards hold what was added; hits and passes count as one."""
    shards_kept: int
    """How many others there are, which were left as they are."""
    copied: bool
    """Whether these were copied, for want of hard links."""
    rewritten: str | None
    """Why they were written anew, too; None: they were not."""


class _ReplacedError(Exception):
    """The map is not the one any more that was read."""


class _Old(NamedTuple):
    """What of a saved map is needed to add to it."""

    header: Header
    files: dict[str, list[Place]]
    known: Box | None
    """The box of its cells with evidence; None where there are none."""
    touched: Evidence
    """The cells of the shards that are reached."""


def append_map(
    evidence: Evidence,
    path: str | os.PathLike[str],
    *,
    any_sensor: bool = False,
    waiting: Callable[[], None] = lambda: None,
) -> Appended:
    """Add evidence to a saved map, as merging and saving the whole would, bit for bit.

    The old map stays in place until the new one is complete. Several processes may add to one map:
    each waits for the one before. Time and memory go with the shards that are reached, beside a
    hard link for each of the others; all are written anew where a count does not fit the arrays'
    type any more, or a fraction of a vote comes to whole votes.

    Args:
        evidence: what is to be added.
        path: a folder that `save_map` wrote.
        any_sensor: as in `Evidence.merge`.
        waiting: called once where another process is adding to the map.

    Raises:
        InputError: it is no map, damaged, or the two do not add up: see `Evidence.merge`.
        MapTooLargeError: a cell would pass 2^46 votes, or there is no memory for what is reached.
        OutputError: it cannot be written. In all cases the old map is as it was.
    """
    target = settled(Path(path))
    if target.is_symlink():  # it stays one, to the new map
        target = target.resolve()
    _check_same_kind(read_empty(target, Evidence), evidence, target, any_sensor=any_sensor)
    with one_writer(target, waiting):
        for _ in range(_TRIES):
            try:
                return _append(evidence, target, any_sensor=any_sensor)
            except _ReplacedError:
                continue
    raise OutputError(
        f"{path}: was replaced each of the {_TRIES} times that it was read: wait until what writes "
        "it has finished"
    )


def _append(evidence: Evidence, path: Path, *, any_sensor: bool) -> Appended:
    seen: list[Mark | None] = []

    def read() -> _Old:
        seen.append(mark_of(path))
        return _read_reached(path, evidence, any_sensor=any_sensor)

    def check() -> None:
        if mark_of(path) != seen[-1]:
            raise _ReplacedError

    old = read_unchanged(path, read)
    total, side = old.touched, SHARD[evidence.ndim]
    before = total.cell_count()
    total.merge(evidence, any_sensor=any_sensor)
    lo, hi = _joint(old.known, evidence.bounds(), evidence.ndim)
    first = lo // side
    shape = tuple(int(n) * side for n in (-(-hi // side) - first)[::-1])
    shift = (old.header.origin_cell // side - first)[::-1]
    reached = {tuple((place - first)[::-1].tolist()) for place in reached_shards(evidence)}
    kept: set[Place] = set()
    copied, why = False, None
    with new_folder(path, shape, force=True, check=check) as folder:
        for stored in stored_tiles(total):
            form, reason = form_of_sum(stored, old.header)
            stored.create(folder, form)
            write = partial(StoredShard.write, folder=folder, first_place=first)
            do_side_by_side(write, stored.shards(form))
            for name in stored.names:
                rest = UntouchedShards(path, old.header, name, shift)
                places = [each for each in old.files[name] if rest.moved(each) not in reached]
                kept |= set(places)
                try:
                    if reason is None:
                        linked = [rest.link(place, folder) for place in places]
                        copied |= not all(linked)
                    else:
                        anew = partial(rest.write_anew, folder=folder, form=form)
                        do_side_by_side(anew, places)
                        why = reason if places else why
                except InputError:
                    check()  # damaged, or replaced meanwhile
                    raise
        attributes = attributes_of(total, first * side, lo, hi)
        folder.seal({**old.header.attributes, **attributes})
    return Appended(total.cell_count() - before, len(reached), len(kept), copied, why)


def _read_reached(path: Path, evidence: Evidence, *, any_sensor: bool) -> _Old:
    """Read the shards that evidence reaches; errors as in `read_map`, or the two do not add up."""
    header = map_header(path)
    touched = empty_map(path, Evidence, header)
    _check_same_kind(touched, evidence, path, any_sensor=any_sensor)
    d, shards = touched.ndim, SavedShards(path, header)
    there = set(shards.places(header.arrays))  # which looks for all that were written
    files = {name: [tuple(at) for at in shard_files(path, name, d)] for name in header.arrays}
    reached = reached_shards(evidence) - header.origin_cell // SHARD[d]
    places = [at for at in (tuple(place[::-1].tolist()) for place in reached) if at in there]
    fill_map(touched, shards, None, None, places=places)
    lo, hi = (
        np.array(whole_numbers(header.attributes, f"known_cells_{end}"), np.int64)
        for end in ("lo", "hi")
    )
    return _Old(header, files, (lo, hi) if there else None, touched)


def _check_same_kind(saved: Evidence, more: Evidence, path: Path, *, any_sensor: bool) -> None:
    try:
        saved.check_same_kind_as(more, any_sensor=any_sensor, done="added")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _joint(known: Box | None, more: Box | None, d: int) -> Box:
    """The box of the cells of both; that of one cell where there are none."""
    boxes = [box for box in (known, more) if box is not None]
    boxes = boxes or [(np.zeros(d, np.int64), np.ones(d, np.int64))]
    return np.min([lo for lo, _ in boxes], axis=0), np.max([hi for _, hi in boxes], axis=0)
