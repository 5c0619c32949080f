# SPDX-License-Identifier: Apache-2.0
"""MCAP files of any profile, written by the package mcap."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

__all__ = ["PlainMcap", "write_json"]


class PlainMcap:
    """A file that is written message by message; topics are made when they are first used."""

    def __init__(
        self,
        path: Path,
        profile: str = "",
        compression: CompressionType = CompressionType.ZSTD,
        chunk_size: int | None = 1 << 20,
        crcs: bool = True,
    ) -> None:
        self._file = path.open("wb")
        self._writer = Writer(
            self._file,
            chunk_size=chunk_size or 0,
            compression=compression,
            use_chunking=chunk_size is not None,
            enable_crcs=crcs,
        )
        self._writer.start(profile=profile, library="tests")
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def channel(self, topic: str, kind: str, encoding: str, how: str, schema: bytes) -> None:
        """Announce a topic."""
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, how, schema)
        self._channels[topic] = self._writer.register_channel(topic, encoding, self._schemas[kind])

    def write(self, topic: str, log_ns: int, data: bytes) -> None:
        self._writer.add_message(self._channels[topic], log_ns, data, log_ns)

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()


def write_json(path: Path, said: Iterable[tuple[str, int, str, Any]], **how: Any) -> Path:
    """Messages as JSON: a topic, when each was written [ns], its type, and its values."""
    file = PlainMcap(path, **how)
    known = set()
    for topic, log_ns, kind, values in said:
        if topic not in known:
            known.add(topic)
            file.channel(topic, kind, "json", "jsonschema", b'{"type": "object"}')
        file.write(topic, log_ns, json.dumps(values).encode())
    file.close()
    return path
