# SPDX-License-Identifier: Apache-2.0
"""`oddsmap calibrate`: the sensor's parameters from a log."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.settings import (
    Layer,
    check_sections,
    cores,
    read_camera,
    read_extrinsics,
    resolved,
    setting_layers,
)

if TYPE_CHECKING:
    from oddsmap.scoring.calibration import Calibration

__all__ = ["HELP", "calibrate"]

HELP = """Find the sensor model that explains a log best: rates, noise, width of the beams.

\b
  oddsmap calibrate sonar.npz --resolution 0.1 -o sensor.toml
  oddsmap build sonar.npz --resolution 0.1 --config sensor.toml --estimator full-map -o sonar.zarr

No ground truth is needed: each reading is predicted from the map of all others. Standard errors
are of each parameter by itself, and take the model for true.
"""

_UNITS = {"cone_deg": "deg", "sigma": "m"}


def calibrate(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log file, or a folder of scans.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SENSOR.toml")],
    resolution: Annotated[
        float | None, typer.Option(metavar="M", help="Side of a cell in metres.")
    ] = None,
    noise_only: Annotated[
        bool,
        typer.Option("--noise-only", help="Leave cone_deg and detection as they are; faster."),
    ] = False,
    threads: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Default: all cores. Changes no bit.")
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
        Path | None, typer.Option(metavar="FILE.toml", help="Where to start: section sensor.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Any field; may be repeated."),
    ] = None,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Use the readable part of a damaged file.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as one JSON object.")
    ] = False,
) -> None:
    """Calibrate the sensor: see `HELP`."""
    from oddsmap.atomic_write import atomic_output, check_output
    from oddsmap.errors import ConfigError
    from oddsmap.readers import open_log
    from oddsmap.scoring.calibration import calibrate as calibrate_sensor

    if output.suffix.lower() != ".toml":
        raise ConfigError(f"{output}: a sensor is written as TOML; give a name that ends in .toml")
    check_output(output, force=force)
    flags: Layer = {"map": {"resolution": resolution}}
    layers = setting_layers(config, flags, settings or [])
    check_sections(layers, "calibrate", "map", "sensor", "full_map")
    if not any("resolution" in values.get("map", {}) for _, values in layers):
        raise typer.BadParameter("calibration needs one, in metres", param_hint="--resolution")
    opened = open_log(
        log,
        poses=poses,
        times=times,
        tolerance_s=tolerance,
        body_from_sensor=read_extrinsics(extrinsics),
        camera=read_camera(intrinsics),
        skip_bad=skip_bad,
    )
    settled = resolved(layers, opened)
    with _status(quiet=as_json) as tell:
        found = calibrate_sensor(
            opened,
            settled.map.resolution,
            sensor=settled.sensor,
            settings=settled.full_map,
            threads=threads or cores(),
            noise_only=noise_only,
            progress=tell,
        )
    with atomic_output(output, force=force) as part:
        part.write_text(f"# From {log.name}, by oddsmap calibrate.\n{found.to_toml()}", "utf-8")
    for note in found.notes:
        typer.echo(f"{log}: {note}", err=as_json)
    if as_json:
        typer.echo(json.dumps({"log": str(log), "output": str(output), **_facts(found)}))
    else:
        _say(found, output)


@contextmanager
def _status(*, quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A line on stderr that changes; gives the callback for it."""
    from rich.console import Console

    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    with console.status("getting ready (compiles once a machine)") as status:
        yield lambda what, value: status.update(f"fitting {what}: {value:+.4f} nats a beam")


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
    }


def _say(found: Calibration, output: Path) -> None:
    say = typer.echo
    say(f"used        {found.scans:,} scans, {found.beams:,} beams")
    for reason, count in sorted(found.skipped.items()):
        say(f"skipped     {count:,} x {reason}")
    for name, value in found.values.items():
        error = found.errors[name]
        sure = "at its bound" if math.isnan(error) else f"+- {error:.2g}"
        say(f"{name:<11} {value:.4g} {sure} {_UNITS.get(name, '')}".rstrip())
    say(f"likelihood  {found.log_likelihood:+.4f} nats a beam, each predicted without itself")
    if not found.converged:
        say(f"NOT at rest after {found.updates} updates: start from this file to go on (--config)")
    say(f"sensor      {output}")
    say(f"next        oddsmap build LOG --resolution M --config {output} --estimator full-map")
