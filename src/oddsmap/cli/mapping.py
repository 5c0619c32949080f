# SPDX-License-Identifier: Apache-2.0
"""The work of `oddsmap build`: opened logs to a saved map, with either estimator."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.auto import fit_to_map
from oddsmap.cli.progress import progress_of_logs, progress_of_sweeps, working
from oddsmap.cli.summary import facts_of_building, facts_of_full_map

if TYPE_CHECKING:
    from oddsmap.cli.build_plan import BuildPlan
    from oddsmap.cli.opened_logs import OpenedLog, OpenedLogs
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.note import Note
    from oddsmap.scans.report import Report

__all__ = ["make_map"]

Made = tuple[dict[str, Any], "Report", "list[Note]"]
"""Remarks on a map, what became of its scans, and what to know of it."""


def make_map(plan: BuildPlan, opened: OpenedLogs) -> Made:
    """Make the map of a plan and save it.

    Raises:
        OddsmapError: the logs do not make one map, or it cannot be written.
    """
    if plan.append:
        return _added(plan, opened)
    make = _full_map if plan.estimator == "full-map" else _evidence_map
    return make(plan, opened)


def _evidence_map(plan: BuildPlan, opened: OpenedLogs) -> Made:
    """Map with the filter and save."""
    from oddsmap.cli.bounds_of_trust import facts_of_votes
    from oddsmap.limits import default_budget
    from oddsmap.posterior.count_pairs import TotalsWithPairs
    from oddsmap.scale.budgeted_map import BudgetedMap

    evidence = _empty_map(opened)
    # What --auto looks up lies all over the map.
    memory = None if plan.auto else plan.memory_bytes or default_budget()
    with BudgetedMap(evidence, plan.output, memory) as building:
        total = _fill(evidence, plan, opened)
        fitted = fit_to_map(plan, opened, evidence, total.skipped) if plan.auto else None
        _note_posterior(evidence.provenance, fitted)
        with working(f"saving {plan.output.name}", quiet=plan.quiet):
            totals = building.total(TotalsWithPairs)
            building.save(force=plan.force)
        facts = facts_of_building(building, totals, plan.output)
    facts["own_votes_predicted"] = facts_of_votes(evidence, totals.counter.pairs())
    return facts | ({} if fitted is None else {"auto": fitted}), total, []


def _added(plan: BuildPlan, opened: OpenedLogs) -> Made:
    """Map with the filter, by the settings of the map that is there, and add to that."""
    from oddsmap.cli.append_settings import empty_like
    from oddsmap.cli.appending import append_to

    saved = empty_like(plan.output)
    evidence = saved.like()
    total = _fill(evidence, plan, opened)
    facts, notes = append_to(saved, evidence, plan, opened)
    return facts, total, notes


def _fill(evidence: EvidenceMap, plan: BuildPlan, opened: OpenedLogs) -> Report:
    """Map all logs."""
    from oddsmap.integrate.add import add_log
    from oddsmap.scans.report import Report

    total = Report()
    counts = [part.log.scan_count for part in opened.logs]
    scans = None if None in counts else sum(count or 0 for count in counts)
    with progress_of_logs(scans, quiet=plan.quiet) as advance:
        for part in opened.logs:
            report = add_log(
                evidence,
                part.log,
                sensor=part.config.sensor,
                method=plan.method,
                threads=plan.threads,
                progress=advance(),
            )
            total.include(report)
    _note_held_out(evidence.provenance, opened.logs)
    return total


def _empty_map(opened: OpenedLogs) -> EvidenceMap:
    """The map to fill, by the configuration of the first log."""
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.integrate.add import ndim_of
    from oddsmap.integrate.forgetting import last_number, last_stamp

    config = opened.logs[0].config
    t_ref_ns = config.map.t_ref_ns
    if config.map.half_life is not None and t_ref_ns is None:
        t_ref_ns = max(last_stamp(part.log) for part in opened.logs)
    ref_scan = config.map.ref_scan
    if config.map.half_life_scans is not None and ref_scan is None:
        ref_scan = last_number(chain.from_iterable(part.log for part in opened.logs))
    return EvidenceMap(
        config.map.resolution,
        votes=config.map.votes,
        half_life=config.map.half_life,
        t_ref_ns=t_ref_ns,
        half_life_scans=config.map.half_life_scans,
        ref_scan=ref_scan,
        path_lengths=config.map.path_lengths,
        sensor=config.sensor,
        posterior=config.posterior,
        ndim=ndim_of(next(iter(opened.logs[0].log), None)),
    )


def _full_map(plan: BuildPlan, opened: OpenedLogs) -> Made:
    """Estimate the whole map and save."""
    from oddsmap.errors import ConfigError
    from oddsmap.full_map.estimator import FullMapEstimator

    config = opened.logs[0].config
    if any(part.config.sensor != config.sensor for part in opened.logs):
        raise ConfigError(
            "the logs say different things of their sensor, a full map takes one: set what "
            "differs with --config or --set, or map them one by one"
        )
    estimator = FullMapEstimator(config, threads=plan.threads)
    with working("reading", quiet=plan.quiet) as say:
        for part in opened.logs:
            say(f"reading {Path(part.log.path).name}")
            estimator.add_log(part.log)
    with progress_of_sweeps(config.full_map.sweeps, quiet=plan.quiet) as advance:
        full_map = estimator.estimate(advance)
    _note_held_out(full_map.provenance, opened.logs)
    _note_posterior(full_map.provenance, {"posterior": "full-map"} if plan.auto else None)
    with working(f"saving {plan.output.name}", quiet=plan.quiet):
        full_map.save(plan.output, force=plan.force)
    return facts_of_full_map(full_map, plan.output), estimator.report, []


def _note_posterior(provenance: list[dict[str, Any]], fitted: dict[str, Any] | None) -> None:
    """Note in a map, for each log, what --auto advises."""
    if fitted is not None:
        for entry in provenance:
            entry["posterior"] = fitted["posterior"]


def _note_held_out(provenance: list[dict[str, Any]], logs: list[OpenedLog]) -> None:
    """Note in a map which scans it has not seen: one entry per log."""
    from oddsmap.scans.split_log import PartOfLog

    for entry, part in zip(provenance, logs, strict=True):
        if isinstance(part.log, PartOfLog):
            entry["hold_out_every"] = part.log.every
            if part.log.run > 1:
                entry["hold_out_run"] = part.log.run
