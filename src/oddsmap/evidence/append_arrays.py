# SPDX-License-Identifier: Apache-2.0
"""The arrays of a saved map that is added to: what they become, and the shards that stay."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.stored_tiles import Form, Place, StoredTiles, check_counts, unit_of
from oddsmap.kernels.units import ONE
from oddsmap.map_files.zarr_folder import CHUNK, SHARD, NewFolder
from oddsmap.map_files.zarr_header import Header
from oddsmap.map_files.zarr_shards import SavedShards
from oddsmap.map_files.zarr_snapshot import read_unchanged

__all__ = ["UntouchedShards", "form_of_sum"]


def form_of_sum(stored: StoredTiles, header: Header) -> tuple[Form, str | None]:
    """The form of arrays that something was added to; why it is another than before.

    Args:
        stored: all cells of the shards that something was added to.
        header: of the saved map.
    """
    array, census = header.arrays[stored.names[0]], stored.tiles.census()
    before = stored.unit_in(header)
    unit = ONE if before == ONE and census.whole_votes else 1
    # Of the votes that were whole 65536 times as many units: 16 bits more.
    units = np.dtype(np.uint32 if array.dtype.itemsize <= 2 else np.uint64)
    kept = array.dtype if unit == before else units
    needed = np.min_scalar_type(census.largest // unit)
    form = Form(unit, needed if needed.itemsize > kept.itemsize else kept)
    if unit != before:
        return form, "parts of votes were added to whole votes"
    if form.dtype != array.dtype:
        return form, f"a count passed what {array.dtype} holds"
    return form, None


class UntouchedShards(NamedTuple):
    """The shards of an array that nothing was added to, on their way to the new map."""

    path: Path
    """Of the old map."""
    header: Header
    name: str
    shift: IntArray
    """How much further a place is in the new map, in shards, z before y before x."""

    def moved(self, place: Place) -> Place:
        """A place in the new map's arrays."""
        return tuple((np.array(place) + self.shift).tolist())

    def link(self, place: Place, folder: NewFolder) -> bool:
        """Take a shard as it is; False where it had to be copied.

        Raises:
            InputError: it is gone.
        """
        file = self.path.joinpath(self.name, "c", *map(str, place))
        try:
            checksum = self.header.checksums.get(self.name, {}).get(place)
            return folder.take_over(self.name, self.moved(place), file, checksum)
        except FileNotFoundError:
            raise InputError(f"{file}: is missing, and belongs to the map") from None

    def write_anew(self, place: Place, folder: NewFolder, form: Form) -> None:
        """Write a shard in another form.

        Raises:
            InputError: it is damaged.
        """
        name, d = self.name, len(place)
        before = unit_of(self.header.arrays[name].attributes, name)

        def read() -> tuple[IntArray, npt.NDArray[Any]]:
            chunks = SavedShards(self.path, self.header).read([name], place)
            check_counts(chunks.cells[0], before, name)
            at = chunks.first - self.header.origin_cell - np.array(place[::-1]) * SHARD[d]
            across = SHARD[d] // CHUNK[d]
            return (at // CHUNK[d] * across ** np.arange(d)).sum(axis=1), chunks.cells[0]

        numbers, cells = read_unchanged(self.path, read)
        counts = cells.astype(form.dtype) * form.dtype.type(before // form.unit)
        folder.write(name, self.moved(place), numbers, counts)
