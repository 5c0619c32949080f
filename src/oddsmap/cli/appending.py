# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build --append`: logs mapped by the settings of a saved map, and added to it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.progress import working

if TYPE_CHECKING:
    from oddsmap.cli.build_plan import BuildPlan
    from oddsmap.cli.opened_logs import OpenedLogs
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.note import Note

__all__ = ["append_to", "lines_of_append"]


def append_to(
    saved: EvidenceMap, evidence: EvidenceMap, plan: BuildPlan, opened: OpenedLogs
) -> tuple[dict[str, Any], list[Note]]:
    """Add what was mapped to a saved map.

    Args:
        saved: what it says of itself.
        evidence: what is added.
        plan: names the map.
        opened: the logs.

    Returns:
        What there is to say of it, and what to know.

    Raises:
        OddsmapError: see `append_map`.
    """
    from oddsmap.cli.merge_doubts import doubts_of_sum
    from oddsmap.kernels.units import ONE

    census = evidence.census()
    with working(f"adding to {plan.output.name}", quiet=plan.quiet) as say:
        waiting = partial(say, f"waiting for another run that adds to {plan.output.name}")
        did = _add(evidence, plan.output, waiting)
    facts = {
        "output": str(plan.output),
        "resolution": saved.resolution,
        "votes": saved.votes,
        "ndim": saved.ndim,
        "hits_added": census.hits / ONE,
        "passes_added": census.passes / ONE,
        "cells_reached": census.cells,
        **did,
        "bytes_on_disk": sum(f.stat().st_size for f in plan.output.rglob("*") if f.is_file()),
    }
    decided = plan.layers.fields("sensor")
    return facts, [*doubts_of_sum(saved, evidence), *_differences(saved, opened, decided)]


def _add(evidence: EvidenceMap, output: Path, waiting: Callable[[], None]) -> dict[str, Any]:
    """Add to a saved map, or commit to one with a history; returns what was done."""
    from oddsmap.cli.files import HISTORY
    from oddsmap.evidence.append import append_map
    from oddsmap.evidence_map import EvidenceMap

    if output.suffix.lower() != HISTORY:
        did = append_map(evidence, output, waiting=waiting)
        return {f"append_{name}": value for name, value in did._asdict().items()}
    commit = EvidenceMap.history(output).add(evidence, waiting=waiting)
    return {"commit": commit.id, "commit_time": commit.time.isoformat()}


def _differences(saved: EvidenceMap, opened: OpenedLogs, decided: set[str]) -> list[Note]:
    """In what logs were mapped in another way than the map, or than without it."""
    from oddsmap.scans.note import Note
    from oddsmap.scans.split_log import PartOfLog
    from oddsmap.sensors.registry import settings_of

    found = []
    for part in opened.logs:
        own, theirs = settings_of(saved.sensor), settings_of(part.config.sensor)
        differ = [
            f"sensor.{name} is {theirs[name]} for {Path(part.log.path).name}, {own[name]} in the "
            "map's settings"
            for name in theirs
            if theirs[name] != own[name]
        ]
        if differ:
            found.append(Note("; ".join(differ), code="append.sensor"))
        used = theirs.get("range_max")
        if used is not None and "range_max" not in {*part.log.sensor, *decided}:
            found.append(
                Note(
                    f"{Path(part.log.path).name} says no range_max: it is mapped with the {used:g} "
                    "m of the map's settings, and would have none in a map of its own",
                    code="append.range_max",
                )
            )
        held = any("hold_out_every" in entry for entry in saved.provenance)
        if held and not isinstance(part.log, PartOfLog):
            found.append(
                Note(
                    f"of {Path(part.log.path).name} no scan is kept back, of other logs of the map "
                    "some are (--hold-out)",
                    code="append.hold_out",
                )
            )
    return found


def lines_of_append(facts: dict[str, Any]) -> tuple[str, list[str]]:
    """What was added, and where to, in words."""
    where = f"map      {facts['output']} ({facts['bytes_on_disk'] / 1000:,.0f} kB)"
    if "commit" in facts:
        added = f"added    votes to {facts['cells_reached']:,} cells"
        return added, [f"commit   {facts['commit']} (oddsmap history {facts['output']})", where]
    new = facts["append_cells_new"]
    size = new * facts["resolution"] ** facts["ndim"]
    unit = "square" if facts["ndim"] == 2 else "cubic"
    added = (
        f"added    votes to {facts['cells_reached']:,} cells, of which {new:,} are new "
        f"({size:,.1f} {unit} metres)"
    )
    kept, how = facts["append_shards_kept"], "left as they are"
    if facts["append_rewritten"]:
        how = f"written anew, for {facts['append_rewritten']}"
    elif facts["append_copied"]:
        how = "copied, for this file system makes no hard links"
    rest = f", the other {kept:,} {how}" if kept else ", which are all"
    shards = f"shards   {facts['append_shards_written']:,} reached{rest}"
    return added, [shards, where]
