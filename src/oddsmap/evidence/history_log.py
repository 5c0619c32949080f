# SPDX-License-Identifier: Apache-2.0
"""The commits of a map with a history: what is noted with each, and which is meant."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, date, datetime, timedelta
from typing import Any, NamedTuple

from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.map_files.icechunk_repository import CommitRecord

__all__ = [
    "ADDED",
    "SUBTRACTED",
    "MapCommit",
    "commit_of",
    "note_of",
    "place_in",
    "provenance_of",
    "said_of",
]

ADDED, SUBTRACTED = "added", "subtracted"

_NOTE = "oddsmap"


class MapCommit(NamedTuple):
    """One state of a map, and what made it."""

    id: str
    """By which `MapHistory.load` finds it."""
    time: datetime
    """When it was made, in UTC."""
    message: str
    """What was said with it."""
    done: str
    """ "added" or "subtracted"; empty where another program made it."""
    sources: list[str]
    """The logs that came or went, by the names of their files."""


def note_of(done: str, evidence: Evidence) -> dict[str, Any]:
    """What is noted with a commit: what was done, and where the evidence came from."""
    # As text: numbers come back as they were, whatever is made of tables in between.
    return {_NOTE: json.dumps({"done": done, "provenance": evidence.provenance})}


def said_of(note: Mapping[str, Any]) -> str:
    """A message for a commit that the caller gave none."""
    done, provenance = _read(note)
    return f"{done} {', '.join(_sources(provenance)) or 'a map'}"


def commit_of(record: CommitRecord) -> MapCommit:
    """A commit as people see it."""
    done, provenance = _read(record.facts)
    return MapCommit(record.id, record.time, record.message, done, _sources(provenance))


def provenance_of(like: Evidence, records: list[CommitRecord]) -> list[dict[str, Any]]:
    """What merging and subtracting in turn leave.

    Args:
        like: any map of the same settings.
        records: the commits, the newest first.
    """
    total, other = like.like(), like.like()
    for record in reversed(records):
        done, other.provenance = _read(record.facts)
        if done == SUBTRACTED:
            total.subtract(other)
        else:
            total.merge(other)
    return total.provenance


def place_in(records: list[CommitRecord], at: str | date | None, name: str) -> int:
    """Which commit is meant: see `MapHistory.load`.

    Args:
        records: all, the newest first.
        at: an id or how it begins, a date or a time; None: the newest.
        name: of the repository, for messages.

    Raises:
        InputError: there is none, or there are several.
    """
    if not records:
        raise InputError(f"{name}: there is no map in it yet: add one first")
    if at is None:
        return 0
    until = _end_of(at)
    if until is None:
        found = [i for i, each in enumerate(records) if each.id.startswith(str(at).upper())]
        if len(found) != 1 or not at:
            what = "is how several ids of commits begin" if found else "is no id of a commit"
            raise InputError(
                f"{name}: {at!r} {what}, and no date or time like 2026-11-24 or "
                "2026-11-24T18:00+01:00"
            )
        return found[0]
    for i, each in enumerate(records):
        if each.time < until:
            return i
    raise InputError(
        f"{name}: holds nothing from {at} or before; its first commit is of "
        f"{records[-1].time:%Y-%m-%dT%H:%M:%S}Z"
    )


def _end_of(at: str | date) -> datetime | None:
    """The first moment after a date or time; None where it is none of these."""
    if isinstance(at, str):
        try:
            at = date.fromisoformat(at) if len(at) == len("2026-11-24") else _time_of(at)
        except ValueError:
            return None
    if not isinstance(at, datetime):
        midnight = datetime(at.year, at.month, at.day, tzinfo=UTC)
        return midnight + timedelta(days=1)
    # Commits know microseconds.
    return (at if at.tzinfo else at.replace(tzinfo=UTC)) + timedelta(microseconds=1)


def _time_of(at: str) -> datetime:
    if "-" not in at:
        raise ValueError  # an id of digits alone may look like a date
    return datetime.fromisoformat(at)


def _read(facts: Mapping[str, Any]) -> tuple[str, list[dict[str, Any]]]:
    """What was done, and the provenance of the evidence; nothing for other programs' commits."""
    note = json.loads(facts.get(_NOTE, "{}"))
    return note.get("done", ""), note.get("provenance", [])


def _sources(provenance: list[dict[str, Any]]) -> list[str]:
    return [str(entry["source"]) for entry in provenance if entry.get("source")]
