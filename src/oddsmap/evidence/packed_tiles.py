# SPDX-License-Identifier: Apache-2.0
"""Tiles as they travel between processes: the used ones, in narrow types, compressed.

Not for keeping: another version of oddsmap may pack in another way, and refuses this one by its
number. What is kept is saved (`oddsmap.evidence.store`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError, shown
from oddsmap.kernels.units import HITS, ONE, PASSES
from oddsmap.kernels.vote.tiles import ANY_FULL, TILE_COUNT, WIDE_COUNT, TileArrays
from oddsmap.map_files.shard_bytes import pack_bytes, unpack_bytes

__all__ = ["PackedTiles", "pack_tiles"]

_VERSION = 2  # 1: arrays as they lie in memory
# Weights that are packed together: of more, compression gains nothing.
_WEIGHTS = 1 << 21
# zstd's fastest: of hall_os0 at 0.1 m 3.4 MB in 0.06 s, where its own choice makes 3.5 MB in 0.10.
_LEVEL = 1
_WHAT = "a pickled map"
_HEAD = 24


def pack_tiles(arrays: TileArrays, side: int) -> dict[str, Any]:
    """What the tiles of a store hold, as plain values for pickle."""
    used, rows = int(arrays.counts[TILE_COUNT]), int(arrays.counts[WIDE_COUNT])
    coords = arrays.coords[:used]
    about = np.array([coords.shape[1], side, used, rows, arrays.counts[ANY_FULL]])
    parts = [_packed(about), *map(_packed, coords.T)]
    parts += [_packed(arrays.load[:used]), _packed(arrays.wide_of[:used])]
    for level in (arrays.narrow[:used], arrays.wide[:rows]):
        parts += map(_packed, _runs(level))
    return {"version": _VERSION, "parts": parts}


class PackedTiles:
    """What `pack_tiles` gave, to be unpacked.

    Args:
        state: what it gave.

    Attributes:
        ndim: 2 or 3.
        side: cells along a tile's side.
        used: tiles.
        rows: wide rows.

    Raises:
        InputError: it is of another version, or damaged.
    """

    def __init__(self, state: Mapping[str, Any]) -> None:
        version = state.get("version", 1)
        if version != _VERSION:
            raise InputError(
                f"{_WHAT} is of another version of oddsmap (its tiles are packed in way "
                f"{shown(version)}, this one reads {_VERSION}): pickle between processes of one "
                "version; keep maps with save"
            )
        self._parts = state.get("parts")
        about = np.zeros(5, np.int64)
        self._unpack([about])
        self.ndim, self.side, self.used, self.rows, self._any_full = about.tolist()

    def fill(self, arrays: TileArrays) -> None:
        """Unpack all but the table into arrays that have just the room.

        Raises:
            InputError: it is damaged.
        """
        arrays.counts[:] = self.used, self.rows, self._any_full
        rest = [*arrays.coords.T, arrays.load, arrays.wide_of]
        rest += [*_runs(arrays.narrow), *_runs(arrays.wide)]
        self._unpack([np.zeros(5, np.int64), *rest], whole=True)

    def _unpack(self, into: list[npt.NDArray[Any]], *, whole: bool = False) -> None:
        parts = self._parts
        try:
            if not isinstance(parts, list) or (whole and len(parts) != len(into)):
                raise ValueError("parts are missing")
            for part, numbers in zip(parts, into, strict=False):
                _unpack(part, numbers)
        except (ValueError, TypeError) as error:
            raise InputError(f"{_WHAT} is damaged, send it again: {error}") from None


def _runs(level: npt.NDArray[Any]) -> Iterator[npt.NDArray[Any]]:
    """Hits of some tiles, their passes, and so on, shape (n, cells of a tile)."""
    count = max(1, _WEIGHTS // level.shape[2])
    for start in range(0, len(level), count):
        yield level[start : start + count, HITS]
        yield level[start : start + count, PASSES]


def _packed(numbers: npt.NDArray[Any]) -> bytes:
    """Integers as the least, the step between them, and how many steps each is above."""
    lo = int(numbers.min()) if numbers.size else 0
    above = numbers if lo == 0 else numbers.astype(np.int64) - lo
    step = 1 if numbers.itemsize < 8 or (above & (ONE - 1)).any() else ONE
    steps = above if step == 1 else above // step
    kind = np.min_scalar_type(int(steps.max(initial=0)))
    head = np.array([lo, step, kind.itemsize], "<i8")
    return pack_bytes(
        head.tobytes() + steps.astype(kind.newbyteorder("<"), copy=False).tobytes(), _LEVEL
    )


def _unpack(part: bytes, numbers: IntArray) -> None:
    """Unpack into an array of integers.

    Raises:
        ValueError: it is damaged.
    """
    content = memoryview(unpack_bytes(part, _HEAD + 8 * numbers.size, _WHAT))
    head, steps = content[:_HEAD], content[_HEAD:]
    lo, step, size = np.frombuffer(head, "<i8").tolist()
    if len(steps) != numbers.size * size:
        raise ValueError(f"{len(steps)} bytes are not {numbers.size} numbers")
    found = np.frombuffer(steps, f"<u{size}").reshape(numbers.shape)
    numbers[...] = found if step == 1 and lo == 0 else lo + step * found.astype(np.int64)
