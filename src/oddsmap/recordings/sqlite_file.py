# SPDX-License-Identifier: Apache-2.0
"""SQLite files of ROS 2 (`.db3`).

Source: https://github.com/ros2/rosbag2, rosbag2_storage_sqlite3
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from oddsmap.errors import InputError
from oddsmap.recordings.container import FIRST_PLACE, Channel, PlacedMessage, megabytes
from oddsmap.recordings.recording import Damage
from oddsmap.recordings.sqlite_pages import SqlitePages

__all__ = ["SqliteFile"]

MAGIC = b"SQLite format 3\0"


class SqliteFile:
    """A `.db3`; satisfies `Container`.

    Args:
        place: the file.
        skip_bad: read what there is of a damaged file, in place of raising.
        name: what messages call it, where that is not `place`.

    Raises:
        InputError: it is damaged, or holds no messages of ROS 2.
    """

    format = "ROS 2 SQLite file"

    def __init__(self, place: str, *, skip_bad: bool = False, name: str | None = None) -> None:
        self.path = path = name or place
        self._place = place
        self._skip_bad = skip_bad
        self._damage: Damage | None = None
        self._pages: SqlitePages | None = None
        self._rows_are_numbered = True
        self.channels: Mapping[int, Channel] = {}
        self.counts: Mapping[int, int] = {}
        self.span_ns: tuple[int, int] | None = None
        try:
            self._look_beside()
            missing = SqlitePages(place).missing
            if missing > 0:
                size = Path(place).stat().st_size
                self._salvage(f"the recording is cut after {megabytes(size)}", missing)
                return
            with closing(self._connect()) as base:
                self._read_tables(base)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._salvage(f"the recording is damaged ({error})", 0)

    @property
    def damage(self) -> Sequence[Damage]:
        """What is missing."""
        return [self._damage] if self._damage else []

    @property
    def has_places(self) -> bool:
        """Not where it is damaged, for SQLite gives other rows than its pages hold."""
        return self._pages is None and self._rows_are_numbered

    def raw(self, wanted: Collection[int], start: int = FIRST_PLACE) -> Iterator[PlacedMessage]:
        """The messages of some channels; a place is the number of a row."""
        keys = set(wanted)
        last = start - 1
        if self._pages is None:
            try:
                for row, key, log_ns, data in self._rows(keys, start):
                    last = row
                    yield key, log_ns, data, row
                return
            except sqlite3.Error as error:
                self._salvage(f"the recording is damaged ({error})", 0)
        pages = self._pages or SqlitePages(self._place)
        for row, key, log_ns, data in pages.messages():
            if key in keys and row > last:
                yield key, log_ns, data, row

    def _rows(self, keys: set[int], start: int) -> Iterator[tuple[int, int, int, bytes]]:
        listed = ",".join(str(int(key)) for key in keys) or "NULL"
        later = "" if start == FIRST_PLACE else f"id >= {int(start)} AND "
        with closing(self._connect()) as base:
            yield from base.execute(
                "SELECT id, topic_id, timestamp, data FROM messages "  # noqa: S608 - integers
                f"WHERE {later}topic_id IN ({listed}) ORDER BY id"
            )

    def _connect(self) -> sqlite3.Connection:
        """The file as it is: nothing is written, and nothing beside it is looked at."""
        address = Path(self._place).absolute().as_uri()
        # A generator may be closed by another thread than that which ran it.
        base = sqlite3.connect(f"{address}?immutable=1", uri=True, check_same_thread=False)
        base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, Path(self._place).stat().st_size + 1_000_000)
        base.execute("PRAGMA trusted_schema = OFF")
        return base

    def _look_beside(self) -> None:
        """Say where a recorder that was killed has left messages in a file beside."""
        for suffix, what in (("-wal", "holds its last messages"), ("-journal", "would undo some")):
            beside = Path(f"{self._place}{suffix}")
            if not beside.is_file() or beside.stat().st_size == 0:
                continue
            why = f"the recording was never closed: {beside.name} {what}"
            if not self._skip_bad:
                raise InputError(
                    f"{self.path}: {why}: open a copy of both with sqlite3, which puts them "
                    "together, or read the file alone with --skip-bad (skip_bad=True)"
                )
            self._damage = Damage(why)

    def _read_tables(self, base: sqlite3.Connection) -> None:
        # Views and tables of extensions can compute for ever.
        names = {
            name
            for (name,) in base.execute(
                "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
            )
        }
        if not {"topics", "messages"} <= names:
            raise InputError(
                f"{self.path}: an SQLite file without topics and messages: it is no recording"
            )
        schemas = {}
        if "message_definitions" in names:
            schemas = _schemas_of(
                base.execute(
                    "SELECT topic_type, encoding, encoded_message_definition FROM "
                    "message_definitions"
                )
            )
        columns = [row[1] for row in base.execute("PRAGMA table_info(topics)")]
        hashed = "type_description_hash" if "type_description_hash" in columns else "''"
        topics = base.execute(
            f"SELECT id, name, type, serialization_format, {hashed} FROM topics"  # noqa: S608
        )
        self.channels = _channels_of(topics, schemas)
        counts: dict[int, int] = {}
        first, last, unnumbered = 1 << 63, -1, 0
        for key, count, start, end, others in base.execute(
            "SELECT topic_id, count(*), min(timestamp), max(timestamp), "
            "sum(typeof(id) <> 'integer') FROM messages GROUP BY topic_id"
        ):
            if key not in self.channels or not isinstance(start, int) or not isinstance(end, int):
                raise sqlite3.DatabaseError("messages of no topic, or without a time")
            counts[key] = count
            unnumbered += others
            first, last = min(first, start), max(last, end)
        self.counts = counts
        self.span_ns = (first, last) if counts else None
        self._rows_are_numbered = unnumbered == 0

    def _salvage(self, why: str, missing: int) -> None:
        """Read what there is from the pages themselves, which SQLite refuses to do."""
        if not self._skip_bad:
            raise InputError(
                f"{self.path}: {why}: copy the recording again, or read what there is of it with "
                "--skip-bad (skip_bad=True)"
            )
        more = f", {megabytes(missing)} are missing" if missing else ""
        self._damage = Damage(f"{why}{more}")
        if self._pages is not None:
            return
        self._pages = pages = SqlitePages(self._place)
        rows = pages.table("message_definitions")
        schemas = _schemas_of(row[1:4] for row in rows if len(row) > 3)
        rows = pages.table("topics")
        topics = ((*row[:4], row[5] if len(row) > 5 else "") for row in rows if len(row) > 3)
        self.channels = _channels_of(topics, schemas)
        counts: dict[int, int] = {}
        first, last = 1 << 63, -1
        for _, key, log_ns, _ in pages.messages(contents=False):
            counts[key] = counts.get(key, 0) + 1
            first, last = min(first, log_ns), max(last, log_ns)
        self.counts = {key: count for key, count in counts.items() if key in self.channels}
        self.span_ns = (first, last) if counts else None
        if not self.channels:
            raise InputError(f"{self.path}: {why}: nothing of it can be read")


def _schemas_of(rows: Any) -> dict[str, tuple[str, bytes]]:
    """How each type is described, and its description."""
    return {
        str(name): (str(encoding), str(text).encode("utf-8", "replace"))
        for name, encoding, text in rows
    }


def _channels_of(rows: Any, schemas: Mapping[str, tuple[str, bytes]]) -> dict[int, Channel]:
    channels = {}
    for key, topic, kind, encoding, digest in rows:
        if isinstance(key, int) and isinstance(topic, str) and isinstance(kind, str):
            how, text = schemas.get(kind, ("", b""))
            channels[key] = Channel(topic, kind, str(encoding), how, text, str(digest or ""))
    return channels
