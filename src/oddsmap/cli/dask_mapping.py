# SPDX-License-Identifier: Apache-2.0
"""The work of `oddsmap build --dask`: workers open the logs, map them and write the map."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.opened_logs import OpenedLogs, checked_logs
from oddsmap.cli.progress import progress_of_scans, working

if TYPE_CHECKING:
    from oddsmap.cli.build_plan import BuildPlan
    from oddsmap.evidence.evidence import Evidence
    from oddsmap.scale.cluster import Cluster
    from oddsmap.scale.log_source import LogSource
    from oddsmap.scale.on_cluster import Mapped
    from oddsmap.scans.report import Report

__all__ = ["ClusterLogs", "make_map_on_cluster", "open_on_cluster", "workers_of"]


@dataclass(frozen=True, slots=True)
class ClusterLogs:
    """Logs that workers have opened.

    Args:
        cluster: the workers.
        opened: what the logs say, and with which configuration each is mapped.
        sources: how each is opened.
    """

    cluster: Cluster
    opened: OpenedLogs
    sources: list[LogSource]


@contextmanager
def workers_of(plan: BuildPlan) -> Iterator[Cluster | None]:
    """The workers of a plan, which end with the block where they were started for it.

    Raises:
        InputError: they cannot be reached, or cannot do the work.
    """
    if plan.dask is None:
        yield None
        return
    from oddsmap.scale.reaching import cluster_of

    many = f"{plan.threads} process{'' if plan.threads == 1 else 'es'}"
    what = f"starting {many}" if plan.dask == "local" else f"reaching {plan.dask}"
    reached = cluster_of(plan.dask, plan.threads)
    with working(what, compiles=False, quiet=plan.quiet):
        cluster = reached.__enter__()
    try:
        yield cluster
    finally:
        reached.__exit__(None, None, None)


def open_on_cluster(plan: BuildPlan, cluster: Cluster) -> ClusterLogs:
    """Let workers open the logs of a plan, and check that they make one map.

    Raises:
        OddsmapError: a log cannot be read, or does not fit the plan or the other logs.
    """
    import time

    from oddsmap.scale.dask_build import heads_of, parts_of_heads, sources_of

    started = time.perf_counter()
    sources = sources_of(plan.logs, plan.log_options.arguments())
    with working("reading", compiles=False, quiet=plan.quiet):
        parts = list(parts_of_heads(sources, heads_of(cluster, sources)))
    read_s = time.perf_counter() - started
    opened = checked_logs(plan, [head for _, head in parts], read_s)
    return ClusterLogs(cluster, opened, [source for source, _ in parts])


def make_map_on_cluster(plan: BuildPlan, logs: ClusterLogs) -> tuple[dict[str, Any], Report]:
    """Make the map of a plan.

    Raises:
        OddsmapError: the logs do not make one map, it cannot be written, or the cluster fails.
    """
    from oddsmap.scale.cluster_output import cluster_output
    from oddsmap.scale.on_cluster import LogInput, map_on_cluster

    cluster, opened = logs.cluster, logs.opened
    empty = _empty_map(logs)
    inputs = [
        # A sample is filled where the log that is watched is no log that is left alone.
        LogInput(source, part.head, part.config.sensor, part.sample if part.is_watched else None)
        for source, part in zip(logs.sources, opened.logs, strict=True)
    ]
    counts = [part.log.scan_count for part in opened.logs]
    total = None if None in counts else sum(count or 0 for count in counts)
    with (
        progress_of_scans("mapping", total, compiles=False, quiet=plan.quiet) as progress,
        cluster_output(plan.target, force=plan.force) as output,
    ):
        cluster.check_place(output.place, output.parts)
        made = map_on_cluster(
            cluster, output, inputs, empty, method=plan.method, chunk_scans=plan.chunk_scans,
            progress=progress,
        )  # fmt: skip
    return _facts(plan, cluster, empty, made), made.report


def _empty_map(logs: ClusterLogs) -> Evidence:
    """The map to fill, by the configuration of the first log."""
    from oddsmap.evidence.evidence import Evidence
    from oddsmap.integrate.add import ndim_of
    from oddsmap.scale.dask_build import last_of

    first = logs.opened.logs[0]
    config = first.config
    t_ref_ns, ref_scan = config.map.t_ref_ns, config.map.ref_scan
    if config.map.half_life is not None and t_ref_ns is None:
        t_ref_ns = last_of(logs.cluster, logs.sources, stamps=True)
    if config.map.half_life_scans is not None and ref_scan is None:
        ref_scan = last_of(logs.cluster, logs.sources, stamps=False)
    return Evidence(
        config.map.resolution,
        votes=config.map.votes,
        half_life=config.map.half_life,
        t_ref_ns=t_ref_ns,
        half_life_scans=config.map.half_life_scans,
        ref_scan=ref_scan,
        path_lengths=config.map.path_lengths,
        sensor=config.sensor,
        posterior=config.posterior,
        ndim=ndim_of(next(iter(first.log), None)),
    )


def _facts(plan: BuildPlan, cluster: Cluster, empty: Evidence, made: Mapped) -> dict[str, Any]:
    """What there is to say of the map; what takes reading it, where it lies on this machine."""
    from oddsmap.cli.bounds_of_trust import facts_of_votes
    from oddsmap.evidence.saved_totals import read_totals
    from oddsmap.kernels.units import ONE
    from oddsmap.posterior.count_pairs import TotalsWithPairs

    size, votes = None, None
    if plan.url is None:
        path = Path(plan.target)
        size = sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
        if empty.sensor.kind == "beam":
            votes = facts_of_votes(empty, read_totals(path, TotalsWithPairs).counter.pairs())
    census, d = made.census, empty.ndim
    return {
        "output": plan.target,
        "resolution": empty.resolution,
        "votes": empty.votes,
        "hits": census.hits / ONE,
        "passes": census.passes / ONE,
        "cells_known": census.cells,
        "area_m2" if d == 2 else "volume_m3": round(census.cells * empty.resolution**d, 3),
        "bytes_in_memory": None,
        "bytes_on_disk": size,
        "own_votes_predicted": votes,
        "workers": cluster.threads,
        "chunks": made.chunk_count,
        "bytes_of_parts": made.bytes_of_parts,
    }
