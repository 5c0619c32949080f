# SPDX-License-Identifier: Apache-2.0
"""MCAP files, of whatever profile: what a message is, its channel says.

Source: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import replace
from typing import BinaryIO

from oddsmap.recordings.chunked_file import Block, ChunkedFile, read_exactly
from oddsmap.recordings.container import Channel, ChunkError, RawMessage
from oddsmap.recordings.mcap_records import Fields

__all__ = ["McapFile"]

MAGIC = b"\x89MCAP0\r\n"
# Kinds of records.
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS, _DATA_END = 7, 8, 11, 15
_LAST_KIND = 15  # those from 128 on are other programs'
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
# Of a file without chunks, so many bytes of messages are read in one go.
_STRETCH = 1 << 20
_FOOTER_SIZE = _RECORD.size + 20 + len(MAGIC)


class McapFile(ChunkedFile):
    """An MCAP file."""

    format = "MCAP"

    def _open(self, file: BinaryIO) -> None:
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        if file.read(len(MAGIC)) != MAGIC:
            raise ChunkError("an MCAP file of another version than 0")
        kind, _, end = self._record_at(file, len(MAGIC), self._size)
        if kind != _HEADER or end > self._size:
            raise ChunkError("an MCAP file that ends in its header")
        summary = self._summary_start(file)
        if summary and self._read_summary(file, summary):
            self._add_what_is_between(file, end, summary)
            return
        self._blocks, self.counts, self.channels, self._schemas = [], {}, {}, {}
        place = self._find_blocks(file, end, self._size)
        if summary is None:
            self._end_is_missing(place, "the recording is cut or was never closed: it ends")
        elif place < self._size:
            self._end_is_missing(place, "the recording is damaged")
        self._scan(file)

    def _summary_start(self, file: BinaryIO) -> int | None:
        """Where the summary is, 0 in a file without one; None where the file has no end."""
        try:
            place = self._size - _FOOTER_SIZE
            end = Fields(read_exactly(file, place, _FOOTER_SIZE))
            kind, length, start = end.number(1), end.number(8), end.number(8)
            end.number(8)
            crc, magic = end.number(4), end.rest()
            if (kind, length, magic) != (_FOOTER, 20, MAGIC) or start > place:
                return None
            if start and crc:
                # All of it up to the checksum itself.
                summary = read_exactly(file, start, self._size - start - len(MAGIC) - 4)
                if zlib.crc32(summary) != crc:
                    return None
        except ChunkError:
            return None
        return start

    def _read_summary(self, file: BinaryIO, place: int) -> bool:
        """Channels, counts and chunks, as the summary says; False where it does not say all."""
        chunks, stated = 0, None
        content = read_exactly(file, place, self._size - place - _FOOTER_SIZE)
        found: list[Block] = []
        try:
            for kind, body in _records_of(content):
                if kind == _SCHEMA:
                    self._take_schema(Fields(body))
                elif kind == _CHANNEL:
                    self._take_channel(Fields(body))
                elif kind == _CHUNK_INDEX:
                    found.append(self._indexed_chunk(Fields(body)))
                elif kind == _STATISTICS:
                    fields = Fields(body)
                    stated = fields.number(8)
                    fields.skip(2 + 4 + 4 + 4)
                    chunks = fields.number(4)
                    span = fields.number(8), fields.number(8)
                    self.counts = fields.map_of_u16_u64()
        except ChunkError:
            return False
        if stated is None or chunks != len(found) or sum(self.counts.values()) != stated:
            return False
        if not self.counts.keys() <= self.channels.keys():
            return False
        self.span_ns = span if stated else None
        self._blocks = sorted(found, key=lambda block: block.start)
        return True

    def _indexed_chunk(self, fields: Fields) -> Block:
        """The chunk that a record of the index is about.

        Its `start` and `length` are those of the whole record, with what belongs to it behind it.
        """
        span = fields.number(8), fields.number(8)
        start, length = fields.number(8), fields.number(8)
        offsets = fields.map_of_u16_u64()
        behind = fields.number(8)
        compression = fields.text()
        fields.skip(8)
        size = fields.number(8)
        # The index of a channel takes 15 bytes and 16 for each message, and one follows the other.
        places = sorted((place, key) for key, place in offsets.items())
        ends = [*(place for place, _ in places[1:]), start + length + behind]
        counts = {
            key: max(0, (end - place - 15) // 16)
            for (place, key), end in zip(places, ends, strict=False)
        }
        return Block(start, length + behind, compression, size, counts=counts or None, span_ns=span)

    def _add_what_is_between(self, file: BinaryIO, place: int, end: int) -> None:
        """Look at each chunk's own header, and for messages between chunks."""
        chunks, self._blocks = self._blocks, []
        for chunk in chunks:
            self._find_between(file, place, chunk.start)
            try:
                if chunk.start < place:
                    raise ChunkError("a chunk within another one")
                place = chunk.start + chunk.length
                kind, start, after = self._record_at(file, chunk.start, self._size)
                if kind != _CHUNK or after > chunk.start + chunk.length:
                    raise ChunkError("a damaged chunk (its header is none)")
                self._blocks.append(self._chunk_at(file, start, after, chunk))
            except ChunkError as error:
                self._lose(chunk, error)
        self._find_between(file, place, end)

    def _find_between(self, file: BinaryIO, place: int, end: int) -> None:
        if place < end and (reached := self._find_blocks(file, place, end)) < end:
            self._lose(Block(reached, 0, "", 0), ChunkError("bytes that are no records"))

    def _find_blocks(self, file: BinaryIO, place: int, end: int) -> int:
        """The blocks of a part of the file; returns where what can be read of it ends."""
        stretch = place
        while place < end:
            try:
                kind, start, after = self._record_at(file, place, end)
                if not 0 < kind <= _LAST_KIND and kind < 128:
                    break
                if kind == _MESSAGE and after <= end:
                    if after - stretch > _STRETCH:
                        self._add_stretch(stretch, place)
                        stretch = place
                    place = after
                    continue
                self._add_stretch(stretch, place)
                if kind == _CHUNK:
                    self._blocks.append(self._chunk_at(file, start, after, None))
                elif after > end:
                    return place
                elif kind == _MESSAGE_INDEX and self._blocks:
                    # Of the chunk before it, should that turn out to be damaged.
                    key = Fields(read_exactly(file, start, 2)).number(2)
                    counts = {**(self._blocks[-1].counts or {}), key: (after - start - 6) // 16}
                    self._blocks[-1] = replace(self._blocks[-1], counts=counts)
                elif kind == _SCHEMA:
                    self._take_schema(Fields(read_exactly(file, start, after - start)))
                elif kind == _CHANNEL:
                    self._take_channel(Fields(read_exactly(file, start, after - start)))
                elif kind in (_DATA_END, _FOOTER):
                    return end
            except ChunkError:
                break
            place = stretch = after
        self._add_stretch(stretch, min(place, end))
        return min(place, end)

    def _add_stretch(self, start: int, end: int) -> None:
        """Messages that stand in no chunk."""
        if end > start:
            self._blocks.append(Block(start, end - start, "", end - start))

    def _chunk_at(self, file: BinaryIO, start: int, end: int, known: Block | None) -> Block:
        """A chunk by its header; `known` is what the index says of it."""
        fields = Fields(read_exactly(file, start, min(end, self._size, start + 100) - start))
        span = fields.number(8), fields.number(8)
        size, crc = fields.number(8), fields.number(4)
        compression, length = fields.text(), fields.number(8)
        begin = start + fields.place
        if begin + length > end:
            raise ChunkError("a damaged chunk (it is longer than its record)")
        counts = None if known is None else known.counts
        return Block(
            begin,
            min(length, self._size - begin),
            compression,
            size,
            crc,
            counts,
            span,
            cut=begin + length > self._size,
        )

    def _take_schema(self, fields: Fields) -> None:
        key = fields.number(2)
        self._schemas.setdefault(key, (fields.text(), fields.text(), fields.data()))

    def _take_channel(self, fields: Fields) -> None:
        key, schema = fields.number(2), fields.number(2)
        topic, encoding = fields.text(), fields.text()
        name, how, content = self._schemas.get(schema, ("", "", b""))
        # The first counts, or a second reading would be another than the first where they differ.
        self.channels.setdefault(key, Channel(topic, name, encoding, how, content))

    def _records(self, content: bytes, *, cut: bool) -> Iterator[RawMessage]:
        for kind, body in _records_of(content, cut=cut):
            if kind == _MESSAGE:
                if len(body) < _MESSAGE_HEAD.size:
                    raise ChunkError("a message without its time")
                key, _, log_ns, _ = _MESSAGE_HEAD.unpack_from(body)
                if key not in self.channels:
                    raise ChunkError("a message of a channel that is not there")
                yield key, log_ns, body[_MESSAGE_HEAD.size :]
            elif kind == _SCHEMA:
                self._take_schema(Fields(body))
            elif kind == _CHANNEL:
                self._take_channel(Fields(body))

    def _record_at(self, file: BinaryIO, place: int, end: int) -> tuple[int, int, int]:
        """A record's kind, and where its content begins and ends, which may be beyond the file."""
        kind, length = _RECORD.unpack(read_exactly(file, place, _RECORD.size))
        start = place + _RECORD.size
        return kind, start, start + length


def _records_of(content: bytes, *, cut: bool = False) -> Iterator[tuple[int, memoryview]]:
    """The records in the content of a chunk."""
    view, place, size = memoryview(content), 0, len(content)
    while place < size:
        start = place + _RECORD.size
        if start > size:
            if cut:
                return
            raise ChunkError("a record beyond the end of its chunk")
        kind, length = _RECORD.unpack_from(content, place)
        place = start + length
        if place > size:
            if cut:
                return
            raise ChunkError("a record beyond the end of its chunk")
        yield kind, view[start:place]
