# SPDX-License-Identifier: Apache-2.0
"""Logs to a map on a cluster: chunks of scans, groups of shards, files.

chunks                  # chunk_task.py: mapped where they are read, parts written to the store
forms of the arrays     # stored_forms.py: the largest weight decides
groups of shards        # write_on_cluster.py: parts of all chunks added, each once, and written
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import NOTHING, Census
from oddsmap.integrate.add import facts_of, warn_of_no_returns
from oddsmap.plausibility.sample import Sample
from oddsmap.scale.chunk_task import Chunk, MappedChunk, PartRef, map_chunk
from oddsmap.scale.cluster import Cluster
from oddsmap.scale.cluster_output import ClusterOutput
from oddsmap.scale.log_source import LogHead, LogSource, put_together
from oddsmap.scale.shard_records import Index
from oddsmap.scale.write_on_cluster import write_on_cluster
from oddsmap.scans.found import Found
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor

__all__ = ["LogInput", "Mapped", "map_on_cluster"]

# Chunks for each thread of the cluster: the last ones to be done keep it waiting.
_CHUNKS_A_THREAD = 4
# Scans in a chunk: what is lost with a worker, and what its memory has to hold the map of.
_MOST_SCANS = 2000
# Beams in a chunk of a log that each worker reads once as a whole to open it, at least: mapping so
# many takes .3 s (of lasers) to 4 s (of a 3D lidar), opening a bag with 20,000 transforms 1 s.
_LEAST_BEAMS = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class LogInput:
    """A log, or a part of one, that goes into a map.

    Args:
        source: how to open it.
        head: what it says; its skipped, notes and bad lines are complete when it has been mapped.
        sensor: its sensor model.
        sample: filled with a look at some of its scans; None: not asked for.
    """

    source: LogSource
    head: LogHead
    sensor: Sensor
    sample: Sample | None = None


@dataclass(frozen=True, slots=True)
class Mapped:
    """What has been made.

    Args:
        report: what became of the scans of all logs; times are those of all workers together.
        census: what is in the map.
        bytes_of_parts: what workers gave to each other through the store.
        chunk_count: how many chunks there were.
        group_count: how many groups of shards.
        seconds: wall time of "mapping" chunks, and of adding up and "writing" groups [s].
    """

    report: Report
    census: Census
    bytes_of_parts: int
    chunk_count: int
    group_count: int
    seconds: dict[str, float]


def map_on_cluster(
    cluster: Cluster,
    output: ClusterOutput,
    inputs: Sequence[LogInput],
    empty: Evidence,
    *,
    method: str = "rays",
    chunk_scans: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Mapped:
    """Map logs; `empty` gets the provenance that the map has.

    Args:
        cluster: whose workers do it.
        output: where the map goes.
        inputs: the logs.
        empty: a map of the configuration, without evidence.
        method: as in `oddsmap.build_map`.
        chunk_scans: how many scans a chunk has; None: by the number of scans and workers.
        progress: called with the number of scans done so far.

    Raises:
        OddsmapError: a log cannot be mapped, the map cannot be written, or the cluster fails.
    """
    for each in inputs:
        for _ in warn_of_no_returns(list(each.head), each.sensor):
            pass
    in_all = sum(each.head.scan_count or 0 for each in inputs)
    ranges = [
        (each, first, past)
        for each in inputs
        for first, past in _ranges(each.head, in_all, cluster.threads, chunk_scans)
    ]
    chunks = [
        Chunk(
            number, each.source, each.head.scan_count, first, past, each.sensor, method, each.sample
        )
        for number, (each, first, past) in enumerate(ranges)
    ]
    started = time.perf_counter()
    mapped = _map_chunks(cluster, output, chunks, empty, progress)
    seconds = {"mapping": time.perf_counter() - started}
    report = _close_logs(cluster, inputs, chunks, mapped, empty, method)
    started = time.perf_counter()
    groups: dict[Index, list[PartRef]] = {}
    bounds = NOTHING
    for number in sorted(mapped):
        bounds = bounds.joined(mapped[number].votes).joined(mapped[number].lengths)
        for group, part in mapped[number].parts.items():
            groups.setdefault(group, []).append(part)
    census = write_on_cluster(cluster, output, groups, empty, bounds)
    seconds["writing"] = time.perf_counter() - started
    size = sum(part.length for parts in groups.values() for part in parts)
    return Mapped(report, census, size, len(chunks), len(groups), seconds)


def _ranges(
    head: LogHead, in_all: int, threads: int, chunk_scans: int | None
) -> Iterator[tuple[int, int | None]]:
    """First numbers of chunks, and the numbers after their last ones; all logs have `in_all`."""
    if not head.by_number or head.scan_count is None:
        yield 0, None
        return
    count = head.scan_count
    size = chunk_scans or _chunk_size(head, count, in_all, _CHUNKS_A_THREAD * threads)
    if size >= count:
        yield 0, None
        return
    for first in range(0, count, size):
        yield first, min(count, first + size)


def _chunk_size(head: LogHead, count: int, in_all: int, chunks: int) -> int:
    """How many scans a chunk of a log gets."""
    if not head.read_to_open:
        size = -(-count // chunks)
    else:
        # Each log in so many chunks would have each worker open each log.
        size = max(-(-in_all // chunks), -(-_LEAST_BEAMS // max(1, head.first_beams)))
        size = -(-count // max(1, count // size))  # none is left with a few scans
    return max(1, min(_MOST_SCANS, size))


def _map_chunks(
    cluster: Cluster,
    output: ClusterOutput,
    chunks: list[Chunk],
    empty: Evidence,
    progress: Callable[[int], None] | None,
) -> dict[int, MappedChunk]:
    futures = [
        cluster.submit(
            f"chunk-{output.parts}-{chunk.number}", map_chunk, chunk, empty, output.place,
            output.parts, about=_scans_of(chunk),
        )
        for chunk in chunks
    ]  # fmt: skip
    mapped: dict[int, MappedChunk] = {}
    done = 0
    for number, found in cluster.results(futures):
        mapped[number] = found
        cluster.forget([futures[number]])
        skipped = found.report.skipped.items()
        done += found.report.scans + sum(n for why, n in skipped if why.startswith("scan."))
        if progress is not None:
            progress(done)
    return mapped


def _scans_of(chunk: Chunk) -> str:
    """What a chunk is called in messages."""
    if chunk.past is None:
        return f"{chunk.source.path}: all scans"
    last = chunk.past - 1
    which = f"scan {last}" if chunk.first == last else f"scans {chunk.first} to {last}"
    return f"{chunk.source.path}: {which}"


def _close_logs(
    cluster: Cluster,
    inputs: Sequence[LogInput],
    chunks: list[Chunk],
    mapped: dict[int, MappedChunk],
    empty: Evidence,
    method: str,
) -> Report:
    """Note each log in the map's provenance, and in its head what reading it has shown."""
    total = Report()
    for each in inputs:
        own = [mapped[chunk.number] for chunk in chunks if chunk.source is each.source]
        end = own[0].end
        if end is None:
            found = [chunk.found for chunk in own if chunk.found != Found()]
            name = f"end-{each.source.token}-{each.source.part}"
            task = cluster.submit(name, put_together, each.source, found, about=each.head.path)
            ((_, end),) = cluster.results([task])
        each.head.skipped, each.head.notes, each.head.bad_lines = end
        report = Report()
        for chunk in own:
            report.include(chunk.report)
            if each.sample is not None and chunk.sample is not None:
                each.sample.include(chunk.sample)
        report.skipped = Counter(each.head.skipped) + report.skipped
        if report.scans == 0:
            reasons = ", ".join(f"{n} x {why}" for why, n in report.skipped.most_common())
            raise InputError(
                f"{each.head.path}: no usable scan ({reasons or 'there are none'}); nothing to map"
            )
        empty.record(
            each.head.path, scans=report.scans, beams=report.beams, skipped=dict(report.skipped),
            **facts_of(empty, each.sensor, method),
        )  # fmt: skip
        total.include(report)
    return total
