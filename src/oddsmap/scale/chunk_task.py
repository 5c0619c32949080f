# SPDX-License-Identifier: Apache-2.0
"""A chunk of scans, mapped where it is read; what becomes of it is written under its own name."""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import dataclass
from typing import NamedTuple

from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import NOTHING, Census
from oddsmap.integrate.add import add_scans
from oddsmap.plausibility.sample import Sample
from oddsmap.scale.answers import answering, worker_name
from oddsmap.scale.log_source import LogEnd, LogSource, end_of, opened, what_was_found
from oddsmap.scale.map_places import Place
from oddsmap.scale.marked_place import check_marked
from oddsmap.scale.shard_records import Index, packed_groups
from oddsmap.scans.found import Found
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor

__all__ = ["Chunk", "MappedChunk", "PartRef", "Weights", "map_chunk"]


@dataclass(frozen=True, slots=True)
class Chunk:
    """Scans that follow each other in a log.

    Args:
        number: of the chunk, among all of the run.
        source: of the log.
        scan_count: how many scans the log has, as far as that is known.
        first: number of the first scan.
        past: number after the last one; None: all scans of the log.
        sensor: the sensor model.
        method: as in `oddsmap.build_map`.
        sample: an empty one, to be filled; None: nobody looks at the scans.
    """

    number: int
    source: LogSource
    scan_count: int | None
    first: int
    past: int | None
    sensor: Sensor
    method: str
    sample: Sample | None


class Weights(NamedTuple):
    """What the type of an array depends on."""

    largest: int
    """The largest weight of one cell, in units of 1/65536 vote."""
    whole_votes: bool
    """Whether every weight is a number of whole votes."""

    @classmethod
    def of(cls, census: Census) -> Weights:
        """Those of what was counted."""
        return cls(census.largest, census.whole_votes)


class PartRef(NamedTuple):
    """Where there is a part of a group of shards, and what its arrays need."""

    name: str
    offset: int
    length: int
    votes: Weights
    lengths: Weights


class MappedChunk(NamedTuple):
    """What has become of a chunk."""

    number: int
    parts: dict[Index, PartRef]
    """By the place of the group, x first."""
    votes: Census
    """What is in all of them together."""
    lengths: Census
    report: Report
    found: Found
    end: LogEnd | None
    """Where the chunk is the whole log."""
    sample: Sample | None


@answering
def map_chunk(chunk: Chunk, empty: Evidence, place: Place, folder: str) -> MappedChunk:
    """A task: map a chunk.

    Whoever does it, and however often, gives the same parts. They are written under a name that
    holds their digest, so that what has been announced never changes.

    Args:
        chunk: the scans.
        empty: a map of the configuration of all.
        place: where parts go.
        folder: the beginning of their names.
    """
    check_marked(place, folder)
    log = opened(chunk.source)
    if log.scan_count != chunk.scan_count:
        raise InputError(
            f"{chunk.source.path}: has {log.scan_count} scans on worker {worker_name()}, and "
            f"{chunk.scan_count} on another: give all workers the same log, and let it be"
        )
    what_was_found(log)
    scans = iter(log) if chunk.past is None else log.between(chunk.first, chunk.past)
    if chunk.sample is not None:
        scans = chunk.sample.watch(scans, chunk.first)
    evidence = empty.like()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # said once, by who builds the map
        try:
            report = add_scans(evidence, scans, sensor=chunk.sensor, method=chunk.method)
        except MapTooLargeError as error:
            raise MapTooLargeError(f"{chunk.source.path}: {error}") from None
    groups = packed_groups(evidence)
    content = b"".join(group.content for group in groups.values())
    name = f"{folder}/{chunk.number}-{hashlib.sha256(content).hexdigest()[:24]}"
    if content:
        place.put(name, content)
    parts, at, votes, lengths = {}, 0, NOTHING, NOTHING
    for group, made in groups.items():
        weights = Weights.of(made.votes), Weights.of(made.lengths)
        parts[group] = PartRef(name, at, len(made.content), *weights)
        at += len(made.content)
        votes, lengths = votes.joined(made.votes), lengths.joined(made.lengths)
    end = end_of(log) if chunk.past is None else None
    found = what_was_found(log)
    return MappedChunk(chunk.number, parts, votes, lengths, report, found, end, chunk.sample)
