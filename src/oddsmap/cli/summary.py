# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap build` and other commands say of the map that they made."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from oddsmap.cli.appending import lines_of_append
from oddsmap.cli.auto import lines_of_auto
from oddsmap.cli.bounds_of_trust import trust_line

if TYPE_CHECKING:
    from oddsmap.evidence.saved_totals import SavedTotals
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.full_map.full_map import FullMap
    from oddsmap.scale.budgeted_map import BudgetedMap

__all__ = ["facts_of", "facts_of_building", "facts_of_full_map", "lines", "lines_of_map"]


def facts_of(evidence: EvidenceMap, output: Path) -> dict[str, Any]:
    """What there is to say of an evidence map that has been saved."""
    from oddsmap.kernels.units import ONE

    census = evidence.census()
    return {
        "output": str(output),
        "resolution": evidence.resolution,
        "votes": evidence.votes,
        "hits": census.hits / ONE,
        "passes": census.passes / ONE,
        **_extent(census.cells, evidence, evidence.nbytes, output),
    }


def facts_of_building(
    building: BudgetedMap[EvidenceMap], totals: SavedTotals, output: Path
) -> dict[str, Any]:
    """What there is to say of a map that was built within a budget of memory, and saved."""
    from oddsmap.kernels.units import ONE

    evidence, count = building.evidence, building.spill_count
    spilled = {"spilled": {"times": count, "bytes": building.spilled_bytes}} if count else {}
    return {
        "output": str(output),
        "resolution": evidence.resolution,
        "votes": evidence.votes,
        "hits": totals.hits / ONE,
        "passes": totals.passes / ONE,
        **_extent(totals.cells, evidence, building.most_bytes, output),
        **spilled,
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
        **_extent(full_map.cell_count, full_map, full_map.nbytes, output),
    }


def _extent(known: int, grid: EvidenceMap | FullMap, nbytes: int, output: Path) -> dict[str, Any]:
    return {
        "cells_known": known,
        "area_m2" if grid.ndim == 2 else "volume_m3": round(known * grid.resolution**grid.ndim, 3),
        "bytes_in_memory": nbytes,
        "bytes_on_disk": sum(file.stat().st_size for file in output.rglob("*") if file.is_file()),
    }


def lines(facts: dict[str, Any]) -> Iterator[str]:
    """What `oddsmap build` has done, in words."""
    yield (f"used     {facts['scans']:,} scans, {facts['beams']:,} beams")
    if facts.get("held_out") is not None:
        yield (f"held out {facts['held_out']:,} scans (oddsmap score MAP LOG --held-out)")
    for reason, count in sorted(facts["skipped"].items()):
        yield (f"skipped  {count:,} x {reason}{_WHY.get(reason, '')}")
    if "append_cells_new" in facts or "commit" in facts:
        seen, where = lines_of_append(facts)
    else:
        seen, *where = lines_of_map(facts)
    yield seen
    who = f"{facts['threads']} threads"
    if "workers" in facts:
        who = f"{facts['workers']} workers together"
    yield (
        f"time     {facts['read_s']:.2f} s reading, {facts['integrate_s']:.2f} s mapping "
        f"({who}), {facts['compile_s']:.2f} s getting ready"
    )
    if "spilled" in facts:
        times, size = facts["spilled"]["times"], facts["spilled"]["bytes"]
        yield (
            f"memory   full {times:,} times (--memory): {size / 1e6:,.0f} MB of partial sums were "
            "kept on the disk meanwhile"
        )
    if "sweeps" in facts:
        moving, unit, more = _MOVING[facts["method"]]
        state = "at rest" if facts["converged"] else f"NOT at rest: more {more} may be needed"
        residual = f"{facts['residual']:.2g}{unit}"
        yield (f"sweeps   {facts['sweeps']}, {moving} {state} (residual {residual})")
    auto = facts.get("auto")
    if auto is not None:
        yield from lines_of_auto(auto)
        yield f"take     the {auto['posterior']} posterior: {_POSTERIOR[auto['posterior']]}"
    elif doubt := trust_line(facts.get("own_votes_predicted")):
        yield f"trust    {doubt}"
    yield from where


def lines_of_map(facts: dict[str, Any]) -> Iterator[str]:
    """How much a saved map knows, where it is, and what to do next."""
    flat, posterior = "area_m2" in facts, (facts.get("auto") or {}).get("posterior")
    seen = f"{facts['area_m2']:,.1f} square" if flat else f"{facts['volume_m3']:,.1f} cubic"
    yield (f"seen     {seen} metres in {facts['cells_known']:,} cells of {facts['resolution']:g} m")
    output = facts["output"]
    size = facts["bytes_on_disk"]
    if size is None:  # at a URL, from where the other commands do not read
        yield f"map      {output}"
        return
    yield (f"map      {output} ({size / 1000:,.0f} kB)")
    picture = Path(output).with_suffix(".png" if flat else ".ply")
    others = "or .yaml for ROS" if flat else "or .bt; .png with --z-min, --z-max"
    as_advised = " --posterior calibrated" if posterior == "calibrated" else ""
    yield f"next     oddsmap export {quote(output)} {quote(str(picture))}{as_advised}    ({others})"


# Of each method of a full map: what moves, the unit of its residual, and what gives it more time.
_MOVING = {
    "sum-product": ("messages", " nats", "--sweeps"),
    "gibbs": ("marginals", "", "full_map.samples"),
    "map": ("cells", "", "sweeps"),
}

# What to add to export and score, where --auto advises a posterior.
_POSTERIOR = {
    "calibrated": "--posterior calibrated of oddsmap export and score",
    "full-map": "the one that a full map has",
}

_WHY = {
    "beam.no_return": " (cleared nothing: a fault looks the same; --clear-range M lets them clear)",
    "beam.nan": " (no information)",
    "beam.outside_angles": " (neither mark nor clear: sensor.angle_min and angle_max)",
    "beam.below_range_min": " (no information)",
    "beam.zero_range": " (a range of 0 is no reading)",
    "scan.forgotten": " (so old that they weigh nothing: map.half_life, half_life_scans)",
    "vote.underflow": " (weights too old to count in a cell: map.half_life, half_life_scans)",
    "length.underflow": " (lengths too old to count in a cell: map.half_life, half_life_scans)",
}
