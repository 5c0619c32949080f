# SPDX-License-Identifier: Apache-2.0
"""Containers that are chunks of messages one after the other: bags of ROS 1, and MCAP.

A closed file has an index at its end, by which its chunks are found. Of one that was never closed,
or was cut, the chunks follow each other up to where it ends.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from oddsmap.errors import InputError
from oddsmap.recordings.chunk_content import chunk_content
from oddsmap.recordings.container import (
    FIRST_PLACE,
    Channel,
    ChunkError,
    PlacedMessage,
    RawMessage,
    megabytes,
)
from oddsmap.recordings.recording import Damage

__all__ = ["Block", "ChunkedFile", "read_exactly"]


@dataclass(frozen=True, slots=True)
class Block:
    """Messages that are read in one go: those of a chunk.

    Args:
        start: where its bytes are in the file.
        length: how many they are.
        compression: of them; "" where there is none.
        size: of the content [bytes].
        crc: of the content; 0 where there is none.
        counts: messages of each channel; None where that is not known before it is read.
        span_ns: when the first and the last were written [ns], where that is known.
        cut: its end is missing.
    """

    start: int
    length: int
    compression: str
    size: int
    crc: int = 0
    counts: Mapping[int, int] | None = None
    span_ns: tuple[int, int] | None = None
    cut: bool = False


class ChunkedFile(ABC):
    """A file of chunks; satisfies `Container`.

    Args:
        place: the file.
        skip_bad: read what there is of a damaged file, in place of raising.
        name: what messages call it, where that is not `place`.

    Raises:
        InputError: it is damaged, or nothing of it can be read.
    """

    format: str
    has_places = True

    def __init__(self, place: str, *, skip_bad: bool = False, name: str | None = None) -> None:
        self.path = path = name or place
        self._place = place
        self._skip_bad = skip_bad
        self.channels: dict[int, Channel] = {}
        self.counts: Mapping[int, int] = {}
        self.span_ns: tuple[int, int] | None = None
        self._blocks: list[Block] = []
        self._missing: Damage | None = None
        self._lost: dict[int, Damage] = {}
        try:
            with Path(place).open("rb") as file:
                self._size = os.fstat(file.fileno()).st_size
                try:
                    self._open(file)
                except ChunkError as error:
                    raise InputError(f"{path}: {error}: copy the recording again") from None
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None

    @property
    def damage(self) -> Sequence[Damage]:
        """What is missing: the end, and chunks that could not be read so far."""
        return [*self._lost.values(), *([self._missing] if self._missing else [])]

    def raw(self, wanted: Collection[int], start: int = FIRST_PLACE) -> Iterator[PlacedMessage]:
        """The messages of some channels; a place is the number of a block."""
        keys = set(wanted)
        with Path(self._place).open("rb") as file:
            for place, block in enumerate(self._blocks):
                if place < start:
                    continue
                if block.counts is not None and keys.isdisjoint(block.counts):
                    continue
                try:
                    found = [
                        (*each, place) for each in self._messages_of(file, block) if each[0] in keys
                    ]
                except ChunkError as error:
                    self._lose(block, error)
                    continue
                yield from found

    @abstractmethod
    def _open(self, file: BinaryIO) -> None:
        """Find channels, counts, the span and the blocks.

        Raises:
            ChunkError: nothing can be read.
            InputError: the file is damaged, and that is not to be skipped.
        """

    @abstractmethod
    def _records(self, content: bytes, *, cut: bool) -> Iterator[RawMessage]:
        """The messages of a block; channels that stand among them are added to `channels`.

        Args:
            content: of the block, decompressed.
            cut: its end is missing: stop at the record that is not whole.

        Raises:
            ChunkError: a record makes no sense.
        """

    def _scan(self, file: BinaryIO) -> None:
        """Read all blocks to learn what an index would say; those that cannot be read go."""
        total: Counter[int] = Counter()
        blocks = []
        first, last = 1 << 63, -1
        for block in self._blocks:
            counts: Counter[int] = Counter()
            start, end = 1 << 63, -1
            try:
                for key, log_ns, _ in self._messages_of(file, block):
                    counts[key] += 1
                    start, end = min(start, log_ns), max(end, log_ns)
            except ChunkError as error:
                self._lose(block, error)
                continue
            if not counts:
                continue
            total.update(counts)
            first, last = min(first, start), max(last, end)
            blocks.append(replace(block, counts=dict(counts), span_ns=(start, end)))
        self._blocks = blocks
        self.counts = dict(total)
        self.span_ns = (first, last) if total else None

    def _messages_of(self, file: BinaryIO, block: Block) -> list[RawMessage]:
        data = read_exactly(file, block.start, block.length)
        content = chunk_content(data, block.compression, block.size, block.crc, cut=block.cut)
        if not block.cut:
            return list(self._records(content, cut=False))
        found: list[RawMessage] = []
        with suppress(ChunkError):  # what was being written when it ended may be anything
            found.extend(self._records(content, cut=True))
        return found

    def _lose(self, block: Block, error: ChunkError) -> None:
        """A block is lost: said once, however often the file is read."""
        text = f"{error} after {megabytes(block.start)}"
        if not self._skip_bad:
            raise InputError(
                f"{self.path}: {text}: copy the recording again, or read the rest of it with "
                "--skip-bad (skip_bad=True)"
            )
        messages = None if block.counts is None else sum(block.counts.values())
        span = block.span_ns
        seconds = None if span is None else (span[1] - span[0]) / 1e9
        self._lost[block.start] = Damage(text, messages, seconds)

    def _end_is_missing(self, place: int, why: str, at_least: int = 0) -> None:
        """The file has no end, or an index that makes no sense.

        Args:
            place: where the part ends that can be read [bytes].
            why: in words.
            at_least: how many bytes are known to be missing.
        """
        if not self._skip_bad:
            raise InputError(
                f"{self.path}: {why} after {megabytes(place)}: copy the recording again, or read "
                "what there is of it with --skip-bad (skip_bad=True)"
            )
        more = f", at least {megabytes(at_least)} are missing" if at_least > 0 else ""
        self._missing = Damage(f"{why} after {megabytes(place)}{more}")


def read_exactly(file: BinaryIO, start: int, length: int) -> bytes:
    """Bytes of a file.

    Raises:
        ChunkError: it ends before.
    """
    end = file.seek(0, os.SEEK_END)
    if length < 0 or not 0 <= start <= end - length:
        raise ChunkError(f"the file ends after {megabytes(end)}, within a record")
    file.seek(start)
    return file.read(length)
