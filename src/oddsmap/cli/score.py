# SPDX-License-Identifier: Apache-2.0
"""`oddsmap score`: how well a map predicts readings."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.settings import (
    Layers,
    check_sections,
    read_camera,
    read_extrinsics,
    setting_layers,
)

if TYPE_CHECKING:
    from oddsmap.config.config import Config
    from oddsmap.posterior.belief import Belief
    from oddsmap.scans.log import Log
    from oddsmap.scoring.held_out import LogScores
    from oddsmap.sensors.registry import Sensor

__all__ = ["HELP", "score"]

HELP = """Score a map by readings that it has not seen: no ground truth is needed.

\b
  oddsmap build sonar.npz --resolution 0.1 --hold-out 0.1 -o sonar.zarr
  oddsmap score sonar.zarr sonar.npz --held-out
  oddsmap score sonar.zarr second_run.npz --plot reliability.png --json

Each reading is predicted from the map under the forward sensor model: by default the map's own.
"""

# Calibration may find another width than a log writes of its sensor; it is no such factor.
_ANOTHER_WIDTH = 1.5


def score(
    grid: Annotated[Path, typer.Argument(metavar="MAP", help="A saved map.")],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The readings to predict.")],
    held_out: Annotated[
        bool, typer.Option("--held-out", help="Only the scans that `build --hold-out` kept back.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png", help="Draw the reliability curve.")
    ] = None,
    poses: Annotated[
        Path | None, typer.Option(metavar="FILE", help="KITTI or TUM poses of a folder of scans.")
    ] = None,
    times: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Stamps of a folder of scans, in seconds.")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(metavar="S", help="How far a pose may be from a scan's stamp.")
    ] = 0.02,
    extrinsics: Annotated[
        str | None,
        typer.Option("--body-from-sensor", metavar="'X Y Z QX QY QZ QW'", help="As for build."),
    ] = None,
    intrinsics: Annotated[
        str | None, typer.Option("--camera", metavar="'FX FY CX CY W H'", help="As for build.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Another sensor model: section sensor.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Any field; may be repeated."),
    ] = None,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Use the readable part of a damaged file.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing picture.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the scores as one JSON object.")
    ] = False,
) -> None:
    """Score a map: see `HELP`."""
    from oddsmap.atomic_write import check_output
    from oddsmap.errors import ConfigError
    from oddsmap.readers import open_log
    from oddsmap.scans.split_log import hold_out
    from oddsmap.scoring.held_out import score_map

    if plot is not None:
        if plot.suffix.lower() != ".png":
            raise ConfigError(f"{plot}: a picture is named .png; give a name that ends in .png")
        check_output(plot, force=force)
    belief, stored, provenance = _load(grid)
    whole = open_log(
        log,
        poses=poses,
        times=times,
        tolerance_s=tolerance,
        body_from_sensor=read_extrinsics(extrinsics),
        camera=read_camera(intrinsics),
        skip_bad=skip_bad,
    )
    every = _held_out_of(provenance, grid, log) if held_out else None
    part = whole if every is None else hold_out(whole, every)[1]
    layers = setting_layers(config, {}, settings or [])
    check_sections(layers, "score", "sensor")
    sensor = _settled(stored, whole, layers).sensor
    scores = score_map(belief, part, sensor)
    facts = {"map": str(grid), "log": str(log), "held_out_every": every, **_facts(scores)}
    if plot is not None:
        from oddsmap.scoring.picture import save_reliability_png

        save_reliability_png(
            scores.reliability, plot, title=f"{grid.name}, {scores.beams:,} beams", force=force
        )
    known = any(entry.get("source") == log.name for entry in provenance)
    doubt = None if known else _of_another_sensor(whole, sensor, layers)
    if doubt is not None:
        typer.echo(f"{log}: {doubt}", err=True)
    if known and not held_out:
        typer.echo(
            f"{log}: the map was made from this log: scores are too good (build with --hold-out "
            "0.1 and score with --held-out)",
            err=True,
        )
    if as_json:
        typer.echo(json.dumps(facts))
    else:
        _say(scores)


def _load(path: Path) -> tuple[Belief, Config, list[dict[str, Any]]]:
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map

    if is_full_map(path):
        full_map = load_full_map(path)
        return full_map, full_map.config, full_map.provenance
    evidence = load_map(path)
    return evidence.log_odds(), evidence.config, evidence.provenance


def _held_out_of(provenance: list[dict[str, Any]], grid: Path, log: Path) -> int:
    from oddsmap.errors import InputError

    of_log = [entry for entry in provenance if entry.get("source") == log.name]
    kept = {entry["hold_out_every"] for entry in of_log if "hold_out_every" in entry}
    if len(kept) != 1 or not all("hold_out_every" in entry for entry in of_log):
        said = "different scans" if len(kept) > 1 else "no scan"
        raise InputError(
            f"{grid}: {said} of {log.name} held out; build it with --hold-out 0.1, or score "
            "another log without --held-out"
        )
    return int(kept.pop())


def _of_another_sensor(log: Log, sensor: Sensor, layers: Layers) -> str | None:
    """What to say where a log's beams are not as wide as they are predicted, and nobody asked."""
    from oddsmap.sensors.registry import stated_of_sensor

    asked = {name for _, values in layers for name in values.get("sensor", {})}
    said = stated_of_sensor(log)
    theirs, ours = said.get("cone_deg", 0.0), getattr(sensor, "cone_deg", 0.0)
    if said["kind"] == sensor.kind:
        narrow, wide = sorted((theirs, ours))
        if "cone_deg" in asked or wide <= _ANOTHER_WIDTH * narrow:
            return None
    elif "kind" in asked:
        return None
    words = [
        f"{width:g} degrees wide (sensor.kind {kind})" if width else f"narrow (sensor.kind {kind})"
        for kind, width in ((said["kind"], theirs), (sensor.kind, ours))
    ]
    return (
        f"by what it says of its sensor its beams are {words[0]}, those of the map's sensor are "
        f"{words[1]}: they were scored as the latter (--set sensor.kind, sensor.cone_deg)"
    )


def _settled(stored: Config, log: Log, layers: Layers) -> Config:
    """The map's configuration, with what the user says of the sensor."""
    from oddsmap.config.config import resolve
    from oddsmap.sensors.registry import stated_of_sensor

    kinds = [values["sensor"]["kind"] for _, values in layers if "kind" in values.get("sensor", {})]
    base = stored.to_dict()
    if kinds and kinds[-1] != stored.sensor.kind:
        base["sensor"] = stated_of_sensor(log, kinds[-1])
    return resolve(("map", base), *layers)


def _facts(scores: LogScores) -> dict[str, Any]:
    curve = scores.reliability
    return {
        "scans": scores.scans,
        "beams": scores.beams,
        "no_returns": scores.no_returns,
        "skipped": dict(scores.skipped),
        "log_likelihood": scores.log_likelihood,
        "prior_log_likelihood": scores.prior_log_likelihood,
        "constant_log_likelihood": scores.constant_log_likelihood,
        "constant": scores.constant,
        "ece": scores.ece,
        "ece_of_bins": scores.ece_of_bins,
        "reliability": [
            {
                "count": int(n),
                "predicted": None if math.isnan(p) else float(p),
                "happened": None if math.isnan(r) else float(r),
            }
            for n, p, r in zip(curve.count, curve.mean_predicted, curve.rate, strict=True)
        ],
    }


def _say(scores: LogScores) -> None:
    say = typer.echo
    say(f"scored    {scores.scans:,} scans, {scores.beams:,} beams, {scores.no_returns:,} of them "
        "no-returns")  # fmt: skip
    for reason, count in sorted(scores.skipped.items()):
        say(f"skipped   {count:,} x {reason}")
    say(f"map       {scores.log_likelihood:+.3f} nats a beam (mean log likelihood)")
    say(f"constant  {scores.constant_log_likelihood:+.3f} with p = {scores.constant:.2g} in every "
        "cell, the best there is")  # fmt: skip
    say(f"prior     {scores.prior_log_likelihood:+.3f} with the map's prior in every cell")
    say(f"ECE       {scores.ece:.4f} of beam ends, {scores.ece_of_bins:.4f} with all bins alike")
    say("          predicted  happened  predictions")
    curve = scores.reliability
    for n, p, r in zip(curve.count, curve.mean_predicted, curve.rate, strict=True):
        if n:
            say(f"          {p:9.3f}  {r:8.3f}  {n:11,}")
