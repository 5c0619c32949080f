# SPDX-License-Identifier: Apache-2.0
"""Logs to a map on a cluster: chunks of scans, groups of shards, files.

chunks                  # chunk_task.py: mapped where they are read, parts written to the store
groups of shards        # group_tasks.py: parts of all chunks added, each once, and kept
type of the arrays      # known once all groups are: the largest weight decides
shards                  # group_tasks.py: written by those who keep them; the map's zarr.json last
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import attributes_of, extent_of, stored_arrays
from oddsmap.evidence.tiles import Census
from oddsmap.integrate.add import facts_of, warn_of_no_returns
from oddsmap.kernels.units import ONE
from oddsmap.map_files.zarr_folder import SHARD
from oddsmap.plausibility.sample import Sample
from oddsmap.scale.chunk_task import Chunk, MappedChunk, PartRef, map_chunk
from oddsmap.scale.cluster import Cluster
from oddsmap.scale.cluster_output import ClusterOutput
from oddsmap.scale.group_tasks import FAN_IN, Stored, add_group, totals_of, write_group
from oddsmap.scale.log_source import LogHead, LogSource, put_together
from oddsmap.scale.shard_records import Index
from oddsmap.scale.shard_sums import joint
from oddsmap.scans.found import Found
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor

__all__ = ["LogInput", "Mapped", "map_on_cluster"]

# Chunks for each thread of the cluster: the last ones to be done keep it waiting.
_CHUNKS_A_THREAD = 4
# Scans in a chunk: what is lost with a worker, and what its memory has to hold the map of.
_MOST_SCANS = 2000


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
        seconds: wall time of mapping chunks, of adding up groups, and of writing shards [s].
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
    chunks = [
        Chunk(0, each.source, each.head.scan_count, first, past, each.sensor, method, each.sample)
        for each in inputs
        for first, past in _ranges(each.head, cluster.threads, chunk_scans)
    ]
    started = time.perf_counter()
    mapped = _map_chunks(cluster, output, chunks, empty, progress)
    seconds = {"mapping": time.perf_counter() - started}
    report = _close_logs(cluster, inputs, chunks, mapped, empty, method)
    groups: dict[Index, list[PartRef]] = {}
    for number in sorted(mapped):
        for group, part in mapped[number].parts.items():
            groups.setdefault(group, []).append(part)
    census = _add_and_write(cluster, output, groups, empty, seconds)
    size = sum(part.length for parts in groups.values() for part in parts)
    return Mapped(report, census, size, len(chunks), len(groups), seconds)


def _ranges(
    head: LogHead, threads: int, chunk_scans: int | None
) -> Iterator[tuple[int, int | None]]:
    """First numbers of chunks, and the numbers after their last ones."""
    if not head.by_number or head.scan_count is None:
        yield 0, None
        return
    count = head.scan_count
    size = chunk_scans or max(1, min(_MOST_SCANS, -(-count // (_CHUNKS_A_THREAD * threads))))
    if size >= count:
        yield 0, None
        return
    for first in range(0, count, size):
        yield first, min(count, first + size)


def _map_chunks(
    cluster: Cluster,
    output: ClusterOutput,
    chunks: list[Chunk],
    empty: Evidence,
    progress: Callable[[int], None] | None,
) -> dict[int, MappedChunk]:
    for number, chunk in enumerate(chunks):
        object.__setattr__(chunk, "number", number)
    futures = [
        cluster.submit(
            f"chunk-{output.parts}-{chunk.number}", map_chunk, chunk, empty, output.place,
            output.parts,
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
            task = cluster.submit(f"end-{each.source.token}", put_together, each.source, found)
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


def _add_and_write(
    cluster: Cluster,
    output: ClusterOutput,
    groups: dict[Index, list[PartRef]],
    empty: Evidence,
    seconds: dict[str, float],
) -> Census:
    """Add up all groups, and write the map."""
    d, started = empty.ndim, time.perf_counter()
    sums = {group: _sum_of(cluster, output, group, parts, d) for group, parts in groups.items()}
    totals = [
        cluster.submit(f"total-{output.parts}-{_words(group)}", totals_of, future)
        for group, future in sums.items()
    ]
    none = Census(0, 0, 0, 0, True, None)
    votes, lengths = none, none
    for _, (of_votes, of_lengths) in cluster.results(totals):
        votes, lengths = joint(votes, of_votes), joint(lengths, of_lengths)
    seconds["adding"], started = time.perf_counter() - started, time.perf_counter()
    stored: dict[str, Stored] = {}
    lo, hi, first, shape = extent_of([votes, lengths], d)
    with output.new_map(shape) as folder:
        for texts, census in zip(stored_arrays(empty), (votes, lengths), strict=False):
            unit = ONE if census.whole_votes else 1
            dtype = np.min_scalar_type(census.largest // unit)
            for name, text in texts.items():
                folder.create(name, dtype, 0, {"description": text, "weight_unit": unit / ONE})
                stored[name] = Stored(dtype.name, unit)
        tasks = [
            cluster.submit(
                f"write-{output.parts}-{_words(group)}", write_group, future, stored,
                (first // SHARD[d]).tolist(), output.place, output.folder, output.parts,
            )
            for group, future in sums.items()
        ]  # fmt: skip
        written: dict[str, list[list[int]]] = {name: [] for name in stored}
        for _, files in cluster.results(tasks):
            for name, at in files:
                written[name].append(list(at))
        folder.seal(
            attributes_of(empty, first, lo, hi),
            written={name: sorted(places) for name, places in written.items()},
        )
    seconds["writing"] = time.perf_counter() - started
    return votes


def _sum_of(
    cluster: Cluster, output: ClusterOutput, group: Index, parts: list[PartRef], d: int
) -> Any:
    """The task that adds up a group: many parts go through others, a few at a time."""
    name = f"sum-{output.parts}-{_words(group)}"
    runs = [parts[begin : begin + FAN_IN] for begin in range(0, len(parts), FAN_IN)]
    level = [
        cluster.submit(f"{name}-0-{i}", add_group, output.place, run, (), d)
        for i, run in enumerate(runs)
    ]
    height = 0
    while len(level) > 1:
        height += 1
        level = [
            cluster.submit(
                f"{name}-{height}-{i}", add_group, output.place, (), level[i : i + FAN_IN], d
            )
            for i in range(0, len(level), FAN_IN)
        ]
    return level[0]


def _words(group: Index) -> str:
    return ",".join(map(str, group))
