# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build --auto`: the sensor is fitted to the logs themselves, and a posterior is advised.

narrow beams    the map first: nothing that is fitted changes a vote; then each of some scans is
predicted from its counts without those of that scan; calibrated view
wide beams      the sensor first, as `oddsmap calibrate` does; then a full map with it
"""

from __future__ import annotations

import dataclasses
from itertools import chain
from typing import TYPE_CHECKING, Any

from oddsmap.cli.fitted_sensor import facts_of_fit
from oddsmap.cli.progress import progress_of_fit

if TYPE_CHECKING:
    from oddsmap.cli.build_plan import BuildPlan
    from oddsmap.cli.opened_logs import OpenedLogs
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scoring.calibration import Calibration
    from oddsmap.sensors.beam import BeamSensor

__all__ = ["advised", "fit_first", "fit_to_map", "lines_of_auto"]


def fit_first(
    plan: BuildPlan, opened: OpenedLogs
) -> tuple[BuildPlan, OpenedLogs, dict[str, Any] | None]:
    """Fit a sensor before mapping, where a full map needs it; else all stays as it is.

    Returns:
        The plan, for the estimator that the beams need; the logs, with the sensor found; and what
        was fitted, None where that comes after mapping.

    Raises:
        OddsmapError: the logs are of several sensors, or of one that is not fitted, or the plan
            does not fit the estimator that the beams need.
    """
    from oddsmap.errors import ConfigError
    from oddsmap.scoring.calibration import calibrate

    config = opened.logs[0].config
    if any(part.config.sensor != config.sensor for part in opened.logs):
        raise ConfigError(
            "the logs say different things of their sensor, --auto fits one: set what differs with "
            "--config or --set, or map them one by one"
        )
    if config.sensor.kind not in ("beam", "cone"):
        raise ConfigError(
            f"--auto fits beams and cones, and this sensor is of kind {config.sensor.kind}, which "
            "sees cells one by one: leave it out"
        )
    if config.sensor.kind == "beam" and plan.estimator == "filter":
        if config.map.half_life is not None or config.map.half_life_scans is not None:
            raise ConfigError(
                "--auto predicts each scan from the counts of all others, and does not know them "
                "in a map that forgets (half-life): leave one of the two out"
            )
        return plan, opened, None
    plan = dataclasses.replace(plan, estimator="full-map")  # which checks the options for it
    with progress_of_fit(quiet=plan.quiet) as progress:
        found = calibrate(
            chain.from_iterable(part.log for part in opened.logs), config.map.resolution,
            sensor=config.sensor, settings=config.full_map, threads=plan.threads, progress=progress,
        )  # fmt: skip
    logs = [
        dataclasses.replace(part, config=dataclasses.replace(part.config, sensor=found.sensor))
        for part in opened.logs
    ]
    return plan, dataclasses.replace(opened, logs=logs), _facts(found, "full-map")


def fit_to_map(
    plan: BuildPlan, opened: OpenedLogs, grid: EvidenceMap, skipped: Any
) -> dict[str, Any]:
    """Fit the forward model to a map's counts, and set it in the map's configuration.

    Where the log says no range_max there is none to fit: the calibrated view needs it not.
    """
    from oddsmap.errors import InputError
    from oddsmap.sensors.beam import BeamSensor

    sensor = opened.logs[0].config.sensor
    if not isinstance(sensor, BeamSensor) or sensor.range_max is None:
        note = (
            "detection, p_random, p_dropout: kept, for a forward model needs sensor.range_max, "
            "which the log does not say (--range-max METRES)"
        )
        return {"posterior": "calibrated", "parameters": {}, "notes": [note]}
    try:
        found = _by_counts(plan, opened, grid, sensor, skipped)
    except InputError as error:
        note = f"detection, p_random, p_dropout: kept, for {error}"
        return {"posterior": "calibrated", "parameters": {}, "notes": [note]}
    grid.config = dataclasses.replace(grid.config, sensor=found.sensor)
    return _facts(found, "calibrated")


def _by_counts(
    plan: BuildPlan, opened: OpenedLogs, grid: EvidenceMap, sensor: BeamSensor, skipped: Any
) -> Calibration:
    from oddsmap.scoring.count_calibration import calibrate_by_counts

    with progress_of_fit(quiet=plan.quiet) as progress:
        return calibrate_by_counts(
            grid.calibrated(), chain.from_iterable(part.log for part in opened.logs), sensor,
            method=plan.method, progress=progress, skipped=skipped,
        )  # fmt: skip


def _facts(found: Calibration, posterior: str) -> dict[str, Any]:
    notes = list(found.notes)
    if posterior == "calibrated":
        notes.append("p_hit, p_miss: kept, for the calibrated view takes none")
    return {"posterior": posterior, **facts_of_fit(found), "notes": notes}


def lines_of_auto(facts: dict[str, Any]) -> list[str]:
    """What was fitted, what was not, and which posterior to take."""
    errors = facts.get("standard_errors", {})
    found = [
        f"{name} {value:.3g}"
        + (" (at its bound)" if errors[name] is None else f" +- {errors[name]:.1g}")
        for name, value in facts["parameters"].items()
    ]
    lines = [f"fitted   {', '.join(found)}"] if found else []
    lines += [f"note     {note}" for note in facts["notes"]]
    lines += [f"warning  {warning}" for warning in facts.get("warnings", ())]
    if not facts.get("converged", True):
        lines.append(f"NOT at rest after {facts['updates']} updates: oddsmap calibrate goes on")
    return lines


def advised(provenance: list[dict[str, Any]]) -> str | None:
    """The posterior that --auto has noted in a map; None where its parts do not agree on one."""
    noted = {entry.get("posterior") for entry in provenance if "source" in entry}
    return noted.pop() if len(noted) == 1 else None
