# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, version 2.0.

Source: http://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import BinaryIO

from oddsmap.errors import InputError
from oddsmap.recordings.chunked_file import Block, ChunkedFile, read_exactly
from oddsmap.recordings.container import Channel, ChunkError, RawMessage

__all__ = ["BagFile"]

MAGIC = b"#ROSBAG V2.0\n"
# Kinds of records.
_MESSAGE, _HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
# A header of more bytes than this is none: even those of connections hold a few names.
_LARGEST_HEADER = 1 << 20
# What of a chunk is read that does not say how much it holds; chunks are of 1 to 8 MB.
_LARGEST_OPEN = 1 << 26
# How much is looked through at a time for a chunk.
_PIECE = 1 << 20
# A field of the header of a chunk; and how many places with it are looked at in a damaged file.
_CHUNK_FIELD = b"\x04\0\0\0op=\x05"
_MOST_LOOKS = 20_000
_U32 = struct.Struct("<I")
_TWO_U32 = struct.Struct("<II")

_Fields = dict[bytes, bytes]


class BagFile(ChunkedFile):
    """A bag of ROS 1."""

    format = "ROS 1 bag"

    def _open(self, file: BinaryIO) -> None:
        self._looks = _MOST_LOOKS
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(
                f"{self.path}: a bag of another version than 2.0: convert it with rosbag of ROS 1"
            )
        head, _, place = _record_at(file, len(MAGIC), self._size)
        if _number(head, b"op") != _HEADER or head.get(b"encryptor"):
            raise ChunkError("the bag is encrypted, or has no header")
        index, chunks = _number(head, b"index_pos"), _number(head, b"chunk_count")
        if 0 < index <= self._size:
            try:
                self._read_index(file, index, _number(head, b"conn_count"), chunks)
                return
            except ChunkError:
                self.channels.clear()
        end = self._find_chunks(file, place)
        if index == 0:
            self._end_is_missing(end, "the recording was never closed: it has no index")
        elif index > self._size:
            self._end_is_missing(end, "the recording is cut", index - self._size)
        else:
            self._end_is_missing(end, "the recording is cut, or its index is damaged")
        self._scan(file)

    def _read_index(self, file: BinaryIO, place: int, connections: int, chunks: int) -> None:
        """The channels and blocks, by what stands behind the chunks.

        Raises:
            ChunkError: it is not whole.
        """
        total: Counter[int] = Counter()
        first, last = 1 << 63, -1
        for _ in range(connections):
            fields, data, place = _record_at(file, place, self._size)
            self._take_connection(fields, read_exactly(file, *data))
        found: list[Block] = []
        for _ in range(chunks):
            fields, data, place = _record_at(file, place, self._size)
            if _number(fields, b"op") != _CHUNK_INFO:
                raise ChunkError("an index with other records in it")
            content = read_exactly(file, *data)
            if len(content) != 8 * _number(fields, b"count"):
                raise ChunkError("an index of another length than it states")
            counts = dict(_TWO_U32.iter_unpack(content))
            if not counts.keys() <= self.channels.keys():
                raise ChunkError("an index of connections that are not there")
            at, span = _number(fields, b"chunk_pos"), None
            if counts:
                span = _time(fields, b"start_time"), _time(fields, b"end_time")
                first, last = min(first, span[0]), max(last, span[1])
            found.append(Block(at, 0, "", 0, counts=counts, span_ns=span))
            total.update(counts)
        behind = 0
        for block in sorted(found, key=lambda each: each.start):
            try:
                chunk = _chunk_at(file, block, self._size)
                if block.start < behind:
                    raise ChunkError("a chunk within another one")
                behind = chunk.start + chunk.length
                self._blocks.append(chunk)
            except ChunkError as error:
                self._lose(block, error)
        self.counts = dict(total)
        self.span_ns = (first, last) if total else None

    def _find_chunks(self, file: BinaryIO, place: int) -> int:
        """The blocks of a bag without an index; returns where what can be read ends."""
        while place < self._size:
            try:
                fields, data, after = _record_at(file, place, self._size, cut=True)
                if _number(fields, b"op") == _CHUNK:
                    block = _chunk_at(file, Block(place, 0, "", 0), self._size, cut=True)
                    if block.length == 0 < self._size - after:
                        self._blocks.append(_open_chunk(block, self._size - after))
                        return self._size
                    self._blocks.append(block)
                elif after > self._size:
                    return place
                elif _number(fields, b"op") == _CONNECTION:
                    self._take_connection(fields, read_exactly(file, *data))
            except ChunkError:
                found = self._next_chunk(file, place + 1)
                if found is None:
                    return place
                self._lose(Block(place, 0, "", 0), ChunkError("bytes that are no records"))
                after = found
            place = after
        return self._size

    def _next_chunk(self, file: BinaryIO, place: int) -> int | None:
        """Where the next chunk begins behind bytes that make no sense."""
        while place < self._size:
            piece = read_exactly(file, place, min(_PIECE, self._size - place))
            at = -1
            while (at := piece.find(_CHUNK_FIELD, at + 1)) >= 0 and self._looks > 0:
                self._looks -= 1
                # Fields come in any order: the header begins some bytes before, with its length.
                for start in range(max(0, at - 80), at - 3):
                    (length,) = _U32.unpack_from(piece, start)
                    if not at + len(_CHUNK_FIELD) <= start + 4 + length <= at + 100:
                        continue
                    with suppress(ChunkError):
                        fields, _, _ = _record_at(file, place + start, self._size, cut=True)
                        if {b"op", b"compression", b"size"} <= fields.keys():
                            return place + start
            place += max(1, len(piece) - 100)
        return None

    def _take_connection(self, fields: _Fields, content: bytes) -> None:
        said = _fields(content, 0, len(content))
        try:
            self.channels[_number(fields, b"conn")] = Channel(
                _topic_name(fields[b"topic"].decode()),
                said[b"type"].decode(),
                "ros1",
                "ros1msg",
                said[b"message_definition"],
                said[b"md5sum"].decode(),
            )
        except (KeyError, UnicodeDecodeError):
            raise ChunkError("a connection without a topic or type") from None

    def _records(self, content: bytes, *, cut: bool) -> Iterator[RawMessage]:
        place, size = 0, len(content)
        view = memoryview(content)
        while place < size:
            if size - place < 8:
                if cut:
                    return
                raise ChunkError("a record beyond the end of its chunk")
            (length,) = _U32.unpack_from(content, place)
            start = place + 4 + length + 4
            if start > size:
                if cut:
                    return
                raise ChunkError("a record beyond the end of its chunk")
            fields = _fields(content, place + 4, start - 4)
            place = start + _U32.unpack_from(content, start - 4)[0]
            if place > size:
                if cut:
                    return
                raise ChunkError("a record beyond the end of its chunk")
            kind = fields.get(b"op")
            if kind == b"\x02":
                key = _number(fields, b"conn")
                if key not in self.channels:
                    raise ChunkError("a message of a connection that is not there")
                yield key, _time(fields, b"time"), view[start:place]
            elif kind == b"\x07":
                if _number(fields, b"conn") not in self.channels:
                    self._take_connection(fields, content[start:place])
            else:
                raise ChunkError("a record of another kind in a chunk")


def _record_at(
    file: BinaryIO, place: int, size: int, *, cut: bool = False
) -> tuple[_Fields, tuple[int, int], int]:
    """The header of a record, where its data are and how many, and where the next one begins."""
    (length,) = _U32.unpack(read_exactly(file, place, 4))
    if length > _LARGEST_HEADER:
        raise ChunkError(f"a record with a header of {length} bytes")
    head = read_exactly(file, place + 4, length + 4)
    (count,) = _U32.unpack_from(head, length)
    start = place + 8 + length
    if start + count > size and not cut:
        raise ChunkError("a record beyond the end of the file")
    return _fields(head, 0, length), (start, count), start + count


def _chunk_at(file: BinaryIO, block: Block, size: int, *, cut: bool = False) -> Block:
    """A block with what the header of its chunk says."""
    fields, (start, length), end = _record_at(file, block.start, size, cut=cut)
    if _number(fields, b"op") != _CHUNK:
        raise ChunkError("no chunk where the index has one")
    return replace(
        block,
        start=start,
        length=min(length, size - start),
        compression=fields.get(b"compression", b"").decode("ascii", "replace"),
        size=_number(fields, b"size"),
        cut=end > size,
    )


def _open_chunk(block: Block, length: int) -> Block:
    """The chunk that was being written when the recorder was killed.

    It states the size 0, which is put right when it is closed, and goes on to the end of the file.
    """
    plain = block.compression == "none"
    return replace(block, length=length, size=length if plain else _LARGEST_OPEN, cut=True)


def _fields(content: bytes, place: int, end: int) -> _Fields:
    """The fields of a header, by name."""
    found: _Fields = {}
    while place < end:
        if end - place < 4:
            raise ChunkError("a header that makes no sense")
        (length,) = _U32.unpack_from(content, place)
        place += 4 + length
        if place > end:
            raise ChunkError("a header that makes no sense")
        name, equals, value = content[place - length : place].partition(b"=")
        if not equals:
            raise ChunkError("a header that makes no sense")
        found[name] = value
    return found


def _topic_name(name: str) -> str:
    """A topic without slashes that say nothing: /a/b for /a//b/, which ROS takes for the same."""
    return ("/" if name.startswith("/") else "") + "/".join(filter(None, name.split("/")))


def _number(fields: _Fields, name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) not in (1, 4, 8):
        raise ChunkError(f"a record without {name.decode()}")
    return int.from_bytes(value, "little")


def _time(fields: _Fields, name: bytes) -> int:
    value = fields.get(name, b"")
    if len(value) != 8:
        raise ChunkError(f"a record without {name.decode()}")
    seconds, rest = _TWO_U32.unpack(value)
    return int(seconds) * 10**9 + int(rest)
