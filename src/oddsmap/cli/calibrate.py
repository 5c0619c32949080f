# SPDX-License-Identifier: Apache-2.0
"""`oddsmap calibrate`: the sensor's parameters from a log."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

import typer

from oddsmap.cli.fitted_sensor import facts_of_fit, lines_of_fit
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

__all__ = ["HELP", "calibrate"]

HELP = """Find the sensor model that explains a log best: rates, noise, width of the beams.

\b
  oddsmap calibrate sonar.npz --resolution 0.1 -o sensor.toml
  oddsmap build sonar.npz --resolution 0.1 --config sensor.toml \\
    --estimator full-map -o sonar.zarr

No ground truth is needed: each reading is predicted from the map of all others: wide beams by
messages, narrow ones by the map's hits and passes without those of their own scan. Standard errors
are of each parameter by itself, and take the model for true. oddsmap build --auto does this, too.
"""


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
    estimator: Annotated[
        Literal["filter", "full-map"] | None,
        typer.Option(
            help="The map that predicts: filter for narrow beams, full-map for wide ones, or for "
            "both. By default as the beams are."
        ),
    ] = None,
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
    from oddsmap.scoring.count_calibration import calibrate_narrow

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    layers = _read_layers(config, settings, resolution)
    check_suffix(output, (".toml",), "a sensor is written as TOML; give a name that ends in .toml")
    check_logs([log])
    check_files([log, *log_options.files(log)], output, force=force)
    opened = log_options.open(log)
    start = layers.resolve(opened)
    narrow = start.sensor.kind == "beam"
    chosen = estimator or (
        "filter" if narrow and "full_map" not in layers.sections() else "full-map"
    )
    with progress_of_fit(quiet=voice.still) as progress:
        if chosen == "filter":
            found = calibrate_narrow(
                opened,
                start.map.resolution,
                start.sensor,
                threads=thread_count(threads),
                noise_only=noise_only,
                progress=progress,
            )
        else:
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
    voice.facts({
        "log": str(log), "output": str(output), "estimator": chosen, **facts_of_fit(found)
    })  # fmt: skip
    for line in lines_of_fit(found):
        voice.say(line)
    more = " --estimator full-map" if chosen == "full-map" else ""
    voice.say(f"sensor      {output}")
    voice.say(
        f"next        oddsmap build {quote(str(log))} --resolution {start.map.resolution:g} "
        f"--config {quote(str(output))}{more}"
    )


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
