# SPDX-License-Identifier: Apache-2.0
"""`oddsmap calibrate`: the sensor's parameters from a log."""

from __future__ import annotations

import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.options import (
    Quiet,
    Resolution,
    Settings,
    Threads,
    Verbose,
    config_option,
    force_option,
    json_option,
    thread_count,
)
from oddsmap.cli.progress import progress_of_fit
from oddsmap.cli.setting_layers import SettingLayers, read_layers
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.scoring.calibration import Calibration
    from oddsmap.scoring.mirrors import Mirrors

__all__ = ["HELP", "calibrate"]

HELP = """Find the sensor model that explains a log best: rates, noise, width of the beams.

\b
  oddsmap calibrate sonar.npz --resolution 0.1 -o sensor.toml
  oddsmap build sonar.npz --resolution 0.1 --config sensor.toml \\
    --estimator full-map -o sonar.zarr

No ground truth is needed: each reading is predicted from the map of all others. Standard errors
are of each parameter by itself, and take the model for true.
"""

_UNITS = {"cone_deg": "deg", "sigma": "m"}


@takes_log_options
def calibrate(
    *,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log file, or a folder of scans.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="SENSOR.toml", help="The settings to write.")
    ],
    resolution: Resolution = None,
    noise_only: Annotated[
        bool,
        typer.Option("--noise-only", help="Leave cone_deg and detection as they are; faster."),
    ] = False,
    threads: Threads = None,
    log_options: LogOptions,
    config: Annotated[Path | None, config_option("where to start, section sensor")] = None,
    settings: Settings = None,
    force: Annotated[bool, force_option("an existing file")] = False,
    as_json: Annotated[bool, json_option("the result")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate the sensor: see `HELP`."""
    from oddsmap.atomic_write import atomic_output
    from oddsmap.cli.files import check_files, check_logs, check_suffix
    from oddsmap.scoring.calibration import calibrate as calibrate_sensor

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    layers = _read_layers(config, settings, resolution)
    check_suffix(output, (".toml",), "a sensor is written as TOML; give a name that ends in .toml")
    check_logs([log])
    check_files([log, *log_options.files(log)], output, force=force)
    opened = log_options.open(log)
    start = layers.resolve(opened)
    with progress_of_fit(quiet=voice.still) as progress:
        found = calibrate_sensor(
            opened,
            start.map.resolution,
            sensor=start.sensor,
            settings=start.full_map,
            threads=thread_count(threads),
            noise_only=noise_only,
            progress=progress,
        )
    with atomic_output(output, force=force) as part:
        part.write_text(f"# From {log.name}, by oddsmap calibrate.\n{found.to_toml()}", "utf-8")
    for note in found.notes:
        voice.note(log, note)
    for warning in found.warnings:
        voice.note(log, f"warning: {warning}")
    voice.facts({"log": str(log), "output": str(output), **_facts(found)})
    _say(voice, found, output)


def _read_layers(
    config: Path | None, settings: list[str] | None, resolution: float | None
) -> SettingLayers:
    layers = read_layers(config, settings, {"map": {"resolution": resolution}})
    layers.check_sections("calibrate", "map", "sensor", "full_map")
    if "resolution" not in layers.fields("map"):
        raise typer.BadParameter(
            "calibration needs one, in metres, like --resolution 0.1", param_hint="--resolution"
        )
    layers.check_values()
    return layers


def _facts(found: Calibration) -> dict[str, Any]:
    return {
        "scans": found.scans,
        "beams": found.beams,
        "skipped": dict(found.skipped),
        "parameters": found.values,
        "standard_errors": {
            name: None if math.isnan(error) else error for name, error in found.errors.items()
        },
        "edge": found.edge,
        "log_likelihood": found.log_likelihood,
        "updates": found.updates,
        "converged": found.converged,
        "notes": list(found.notes),
        "warnings": list(found.warnings),
        "mirrors": None if found.mirrors is None else _statistics(found.mirrors),
    }


def _statistics(mirrors: Mirrors) -> dict[str, float | None]:
    shares = {name: getattr(mirrors, name) for name in ("correlation", "head_on", "aslant")}
    return {name: None if math.isnan(share) else share for name, share in shares.items()}


def _say(voice: Voice, found: Calibration, output: Path) -> None:
    say = voice.say
    say(f"used        {found.scans:,} scans, {found.beams:,} beams")
    for reason, count in sorted(found.skipped.items()):
        say(f"skipped     {count:,} x {reason}")
    for name, value in found.values.items():
        error = found.errors[name]
        sure = "at its bound" if math.isnan(error) else f"+- {error:.2g}"
        say(f"{name:<11} {value:.4g} {sure} {_UNITS.get(name, '')}".rstrip())
    say(f"likelihood  {found.log_likelihood:+.4f} nats per beam, each predicted without itself")
    if not found.converged:
        say(f"NOT at rest after {found.updates} updates: start from this file to go on (--config)")
    say(f"sensor      {output}")
    written = quote(str(output))
    say(f"next        oddsmap build LOG --resolution M --config {written} --estimator full-map")
