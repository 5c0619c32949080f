# SPDX-License-Identifier: Apache-2.0
"""Mapping on a Dask cluster, for logs that are too much for one machine."""

from __future__ import annotations

import os
import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import Census
from oddsmap.integrate.add import ndim_of
from oddsmap.scale.cluster import Cluster
from oddsmap.scale.cluster_output import check_output_place, cluster_output
from oddsmap.scale.log_source import (
    LogHead,
    LogSource,
    look_at,
    number_to_count_from,
    time_to_count_from,
)
from oddsmap.scale.on_cluster import LogInput, map_on_cluster
from oddsmap.scale.reaching import cluster_of
from oddsmap.scans.note import Note
from oddsmap.scans.report import Report
from oddsmap.sensors.registry import Sensor, sensor_of_log
from oddsmap.short_repr import short_repr

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Built", "build", "heads_of", "last_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Built:
    """What `build` has made.

    Args:
        output: where the map is.
        report: what became of the scans; times are those of all workers together [s].
        notes: what each log says of itself, by its path.
        census: what is in the map.
        chunk_count: how many chunks of scans were mapped.
        group_count: how many groups of shards had an owner.
        bytes_of_parts: what went through the store before it was added up.
        seconds: wall time of "mapping" chunks, and of adding up and "writing" groups [s].
    """

    output: str
    report: Report
    notes: Mapping[str, tuple[Note, ...]]
    census: Census
    chunk_count: int
    group_count: int
    bytes_of_parts: int
    seconds: Mapping[str, float]

    __repr__ = short_repr


def build(
    logs: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    resolution: float,
    *,
    output: str | os.PathLike[str],
    client: Client | str | None = None,
    sensor: Sensor | None = None,
    votes: str | None = None,
    half_life: float | None = None,
    t_ref_ns: int | None = None,
    half_life_scans: float | None = None,
    ref_scan: int | None = None,
    path_lengths: bool = False,
    method: str = "rays",
    reading: Mapping[str, Any] | None = None,
    workers: int | None = None,
    chunk_scans: int | None = None,
    force: bool = False,
    store_options: Mapping[str, Any] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Built:
    """Map logs on a Dask cluster; the map is that of one machine, bit for bit.

    Chunks of scans are mapped by the workers that read them, and what they find is added up by
    groups of shards. A worker may die at any moment: what it had is done again, and counted once.
    See docs/scale.md.

    Args:
        logs: paths as the workers see them: of one log, or of several.
        resolution: side of a cell [m].
        output: the map to write: a folder that all workers share, at the same path on each, or
            a URL that fsspec knows.
        client: of Dask; the address of a scheduler; "local" or None: processes of this machine.

    Other Args:
        sensor: the sensor model of all logs; by default what each says of its sensor.
        votes: as in `oddsmap.build_map`, as are half_life, t_ref_ns, half_life_scans, ref_scan,
            path_lengths and method.
        half_life: evidence of this age weighs half [s].
        t_ref_ns: the time at which it weighs 1 [ns]; default: that of the last scan of all logs,
            for which they are read twice.
        half_life_scans: after so many scans evidence weighs half.
        ref_scan: the number of the scan at which it weighs 1; default: that of the last scan.
        path_lengths: True: also keep the length of the beams inside each cell.
        method: how depth images free cells.
        reading: arguments of `oddsmap.open_log`, the same for all logs; paths as workers see them.
        workers: how many processes "local" starts; default: one for each core.
        chunk_scans: how many scans a chunk has; default: a fourth of what a worker gets, and no
            more than 2000. Logs that are read as a whole are one chunk.
        force: True if an existing map may be replaced; not at a URL.
        store_options: for fsspec: credentials and the like.
        progress: called with the number of scans done so far.

    Returns:
        What was used and skipped, and what is in the map. It is read with `oddsmap.load_map`.

    Raises:
        InputError: a log cannot be read by a worker, or has no usable scan; the cluster cannot be
            reached, has no workers, or one with other versions; or it fails.
        ConfigError: a parameter outside its range.
        MapTooLargeError: a chunk of it would not fit in a worker's memory.
        OutputError: the map exists and `force` is False, or cannot be written.

    Source:
        Dask: https://distributed.dask.org
    """
    paths = [logs] if isinstance(logs, str | os.PathLike) else list(logs)
    _check(paths, workers, chunk_scans)
    if sensor is not None or votes is not None:
        Evidence(resolution, sensor=sensor, votes=votes, path_lengths=path_lengths)  # its checks
    check_output_place(output, force=force, options=store_options)
    with cluster_of(client, workers or _cores()) as cluster:
        sources = sources_of(paths, reading or {})
        heads = heads_of(cluster, sources)
        if sensor is None:
            inputs = [
                LogInput(part, head, sensor_of_log(head, first=head.first))
                for part, head in parts_of_heads(sources, heads)
            ]
        else:
            inputs = [
                LogInput(source, head, sensor) for source, head in zip(sources, heads, strict=True)
            ]
        of_logs = [each.source for each in inputs]
        if half_life is not None and t_ref_ns is None:
            t_ref_ns = last_of(cluster, of_logs, stamps=True)
        if half_life_scans is not None and ref_scan is None:
            ref_scan = last_of(cluster, of_logs, stamps=False)
        empty = Evidence(
            resolution, votes=votes, half_life=half_life, t_ref_ns=t_ref_ns,
            half_life_scans=half_life_scans, ref_scan=ref_scan, path_lengths=path_lengths,
            sensor=inputs[0].sensor, ndim=ndim_of(inputs[0].head.first),
        )  # fmt: skip
        with cluster_output(output, force=force, options=store_options) as place:
            cluster.check_place(place.place, place.parts)
            made = map_on_cluster(
                cluster, place, inputs, empty, method=method, chunk_scans=chunk_scans,
                progress=progress,
            )  # fmt: skip
    return Built(
        output=os.fspath(output),
        report=made.report,
        notes={each.head.path: tuple(each.head.notes) for each in inputs},
        census=made.census,
        chunk_count=made.chunk_count,
        group_count=made.group_count,
        bytes_of_parts=made.bytes_of_parts,
        seconds=made.seconds,
    )


def _check(paths: list[Any], workers: int | None, chunk_scans: int | None) -> None:
    if not paths:
        raise InputError("logs: give the path of one at least")
    for path in paths:
        if not isinstance(path, str | os.PathLike):
            raise InputError(
                f"logs are given as paths, which the workers open, got a {type(path).__name__}: "
                "oddsmap.build_map takes logs that are open"
            )
    for name, value in (("workers", workers), ("chunk_scans", chunk_scans)):
        if value is not None and value < 1:
            raise ConfigError(f"{name}: at least 1 is needed, got {value}")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def sources_of(
    paths: Iterable[str | os.PathLike[str]], reading: Mapping[str, Any]
) -> list[LogSource]:
    """How to open each log, in this run."""
    run = uuid.uuid4().hex[:12]
    return [
        LogSource(f"{run}-{number}", os.fspath(path), reading) for number, path in enumerate(paths)
    ]


def heads_of(cluster: Cluster, sources: list[LogSource]) -> list[LogHead]:
    """What logs say of themselves, asked for on the workers."""
    tasks = [
        cluster.submit(f"look-{source.token}", look_at, source, about=source.path)
        for source in sources
    ]
    return [head for _, head in sorted(cluster.results(tasks), key=lambda each: each[0])]


def parts_of_heads(
    sources: list[LogSource], heads: list[LogHead]
) -> Iterable[tuple[LogSource, LogHead]]:
    """The parts of logs whose sensors state the same each."""
    for source, head in zip(sources, heads, strict=True):
        if not head.inner:
            yield source, head
        for number, part in enumerate(head.inner):
            yield LogSource(source.token, source.path, source.reading, number), part


def last_of(cluster: Cluster, sources: list[LogSource], *, stamps: bool) -> int:
    """The latest stamp [ns], or the highest number, of all scans, asked for on the workers."""
    run = uuid.uuid4().hex[:12]
    if stamps:
        tasks = [
            cluster.submit(f"last-{run}-{number}", time_to_count_from, source, about=source.path)
            for number, source in enumerate(sources)
        ]
    else:
        tasks = [cluster.submit(f"last-{run}", number_to_count_from, sources)]
    return max(int(found) for _, found in cluster.results(tasks))
