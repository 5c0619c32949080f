# SPDX-License-Identifier: Apache-2.0
"""The fields of a record of MCAP, one after the other."""

from __future__ import annotations

import struct

from oddsmap.recordings.container import ChunkError

__all__ = ["Fields"]

_PAIR = struct.Struct("<HQ")


class Fields:
    """What stands in a record, read in its order.

    Args:
        content: the record without its kind and length.
    """

    def __init__(self, content: bytes | memoryview) -> None:
        self._content = memoryview(content)
        self.place = 0

    def number(self, size: int) -> int:
        """An unsigned number of some bytes."""
        return int.from_bytes(self._take(size), "little")

    def text(self) -> str:
        """A text with its length."""
        try:
            return bytes(self.data()).decode()
        except UnicodeDecodeError:
            raise ChunkError("a damaged record (a text that is none)") from None

    def data(self) -> bytes:
        """Bytes with their length."""
        return bytes(self._take(self.number(4)))

    def map_of_u16_u64(self) -> dict[int, int]:
        """Numbers by the numbers of channels."""
        content = self._take(self.number(4))
        if len(content) % _PAIR.size:
            raise ChunkError("a damaged record (a map that is none)")
        return dict(_PAIR.iter_unpack(content))

    def skip(self, size: int) -> None:
        """Leave some bytes out."""
        self._take(size)

    def rest(self) -> bytes:
        """All bytes that are left."""
        return bytes(self._take(len(self._content) - self.place))

    def _take(self, size: int) -> memoryview:
        start, self.place = self.place, self.place + size
        if self.place > len(self._content):
            raise ChunkError("a damaged record (it ends too early)")
        return self._content[start : self.place]
