# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap build` says while it works and when it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.full_map.full_map import FullMap
    from oddsmap.scans.log import Log

__all__ = ["facts_of", "facts_of_full_map", "progress_of_logs", "progress_of_sweeps", "say"]


@contextmanager
def progress_of_logs(
    total: int, *, quiet: bool
) -> Iterator[Callable[[Log], Callable[[int], None]]]:
    """A bar on stderr; gives a function that makes the callback for one log."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    shown = not quiet and console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=not shown) as bar:
        # The first run compiles for some seconds before the first scan is done.
        task = bar.add_task("getting ready (compiles once a machine)", total=total)
        done_before = 0

        def advance(log: Log) -> Callable[[int], None]:
            nonlocal done_before
            before, done_before = done_before, done_before + len(log)
            return lambda done: bar.update(task, description="mapping", completed=before + done)

        yield advance


@contextmanager
def progress_of_sweeps(most: int, *, quiet: bool) -> Iterator[Callable[[int, float], None]]:
    """A bar on stderr; gives the callback for a sweep's number and residual."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    shown = not quiet and console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=not shown) as bar:
        task = bar.add_task("getting ready (compiles once a machine)", total=most)
        yield lambda sweep, residual: bar.update(
            task, description=f"sweeping, messages still move by {residual:.2g}", completed=sweep
        )


def facts_of(evidence: EvidenceMap, output: Path) -> dict[str, Any]:
    """What there is to say of an evidence map that has been saved."""
    from oddsmap.kernels.units import ONE

    _, hits, passes = evidence.cells()
    return {
        "output": str(output),
        "resolution": evidence.resolution,
        "votes": evidence.votes,
        "hits": int(hits.sum()) / ONE,
        "passes": int(passes.sum()) / ONE,
        **_extent(len(hits), evidence, output),
    }


def facts_of_full_map(full_map: FullMap, output: Path) -> dict[str, Any]:
    """What there is to say of a full map that has been saved; it has no hits and passes."""
    return {
        "output": str(output),
        "resolution": full_map.resolution,
        "estimator": "full-map",
        "method": full_map.method,
        "sweeps": full_map.sweeps,
        "residual": full_map.residual,
        "converged": full_map.converged,
        "hits": None,
        "passes": None,
        **_extent(full_map.cell_count, full_map, output),
    }


def _extent(known: int, grid: EvidenceMap | FullMap, output: Path) -> dict[str, Any]:
    return {
        "cells_known": known,
        "area_m2" if grid.ndim == 2 else "volume_m3": round(known * grid.resolution**grid.ndim, 3),
        "bytes_in_memory": grid.nbytes,
        "bytes_on_disk": sum(file.stat().st_size for file in output.rglob("*") if file.is_file()),
    }


def say(facts: dict[str, Any]) -> None:
    """Say in words what `oddsmap build` has done."""
    tell = typer.echo
    tell(f"used     {facts['scans']:,} scans, {facts['beams']:,} beams")
    if "held_out" in facts:
        tell(f"held out {facts['held_out']:,} scans (oddsmap score MAP LOG --held-out)")
    for reason, count in sorted(facts["skipped"].items()):
        tell(f"skipped  {count:,} x {reason}{_WHY.get(reason, '')}")
    flat = "area_m2" in facts
    seen = f"{facts['area_m2']:,.1f} square" if flat else f"{facts['volume_m3']:,.1f} cubic"
    tell(f"seen     {seen} metres in {facts['cells_known']:,} cells of {facts['resolution']:g} m")
    tell(
        f"time     {facts['read_s']:.2f} s reading, {facts['integrate_s']:.2f} s mapping "
        f"({facts['threads']} threads), {facts['compile_s']:.2f} s getting ready"
    )
    if "sweeps" in facts:
        moving, unit, more = _MOVING[facts["method"]]
        rest = "at rest" if facts["converged"] else f"NOT at rest: more {more} may be needed"
        residual = f"{facts['residual']:.2g}{unit}"
        tell(f"sweeps   {facts['sweeps']}, {moving} {rest} (residual {residual})")
    output = facts["output"]
    tell(f"map      {output} ({facts['bytes_on_disk'] / 1000:,.0f} kB)")
    stem = Path(output).with_suffix("")
    if flat:
        tell(f"next     oddsmap export {output} {stem}.png    (or {stem}.yaml for ROS)")
    else:
        tell(f"next     oddsmap export {output} {stem}.ply    (or .bt; .png with --z-min, --z-max)")


# Of each method of a full map: what moves, the unit of its residual, and what gives it more time.
_MOVING = {
    "sum-product": ("messages", " nats", "--sweeps"),
    "gibbs": ("marginals", "", "full_map.samples"),
    "map": ("cells", "", "sweeps"),
}

_WHY = {
    "beam.no_return": " (cleared nothing: a fault looks the same; --clear-range M lets them clear)",
    "beam.nan": " (no information)",
    "beam.below_range_min": " (no information)",
    "scan.forgotten": " (so old that they weigh nothing: map.half_life)",
    "vote.underflow": " (weights too old to count in a cell: map.half_life)",
    "length.underflow": " (lengths too old to count in a cell: map.half_life)",
}
