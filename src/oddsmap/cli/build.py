# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build`: logs to a map."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from oddsmap.cli.settings import (
    SENSORS,
    Layer,
    check_estimator,
    check_width,
    cores,
    doubts,
    names_of,
    read_camera,
    read_extrinsics,
    resolved,
    sensor_name,
    setting_layers,
)
from oddsmap.cli.summary import (
    facts_of,
    facts_of_full_map,
    progress_of_logs,
    progress_of_sweeps,
    say,
)

if TYPE_CHECKING:
    from oddsmap.config.config import Config
    from oddsmap.scans.log import Log
    from oddsmap.scans.report import Report

__all__ = ["HELP", "build"]

HELP = """Map one or more logs: of the plane or of space, as their scans are.

\b
  oddsmap build intel.log.gz --resolution 0.05 -o intel.zarr
  oddsmap build run.log --resolution 0.1 --range-max 30 --clear-range 10 -o run.zarr
  oddsmap build run.log --config lidar.toml --set sensor.hit_width=0.1 -o run.zarr --json
  oddsmap build sonar.npz --resolution 0.1 --estimator full-map -o sonar.zarr
  oddsmap build sonar.npz --resolution 0.1 --hold-out 0.1 -o sonar.zarr   (see oddsmap score)
  oddsmap build clouds/ --poses poses.txt --resolution 0.1 --set sensor.mark_z_min=0.2 -o hall.zarr
"""


def build(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="A log file, or a folder of scans.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="MAP.zarr")],
    resolution: Annotated[
        float | None, typer.Option(metavar="M", help="Side of a cell in metres.")
    ] = None,
    votes: Annotated[
        Literal["scan", "beam"] | None,
        typer.Option(help="scan: one vote a cell and scan; beam: every beam."),
    ] = None,
    clear_range: Annotated[
        float | None, typer.Option(metavar="M", help="How far a beam without return clears.")
    ] = None,
    range_max: Annotated[
        float | None, typer.Option(metavar="M", help="Readings from here on are no returns.")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Default: all cores. Changes no bit.")
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="lidar2d, lidar3d, depth, sonar, tof or overhead."),
    ] = None,
    method: Annotated[
        Literal["rays", "projective"],
        typer.Option(help="How depth images clear; projective is faster and approximate."),
    ] = "rays",
    estimator: Annotated[
        Literal["filter", "full-map"],
        typer.Option(help="filter: cell by cell; full-map: all cells together, for wide beams."),
    ] = "filter",
    sweeps: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="full-map: the most sweeps, 40.")
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
        typer.Option("--body-from-sensor", metavar="'X Y Z QX QY QZ QW'", help="Where it sits."),
    ] = None,
    intrinsics: Annotated[
        str | None,
        typer.Option("--camera", metavar="'FX FY CX CY W H'", help="Of depth images [pixels]."),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Sections map, sensor, full_map...")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Any field; may be repeated."),
    ] = None,
    hold_out: Annotated[
        float | None,
        typer.Option("--hold-out", metavar="F", help="Keep this share of scans back, to score by."),
    ] = None,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Use the readable part of a damaged file.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing map.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the summary as one JSON object.")
    ] = False,
) -> None:
    """Map one or more logs: see `HELP`."""
    from oddsmap.atomic_write import check_output
    from oddsmap.errors import ConfigError
    from oddsmap.readers import open_log
    from oddsmap.scans.split_log import every_of
    from oddsmap.scans.split_log import hold_out as without_every

    if sensor is not None and sensor not in SENSORS:
        raise ConfigError(f"--sensor {sensor}: not available, known are {', '.join(SENSORS)}")
    if votes is not None and estimator == "full-map":
        raise ConfigError("--votes belongs to --estimator filter: a full map counts no votes")
    if sweeps is not None and estimator != "full-map":
        raise ConfigError("--sweeps belongs to --estimator full-map")
    if output.suffix not in ("", ".zarr"):
        raise ConfigError(
            f"{output}: a map is a Zarr folder, by custom NAME.zarr; oddsmap export makes "
            f'{output.suffix} of it; got the suffix "{output.suffix}"'
        )
    check_output(output, force=force)
    flags: Layer = {"map": {"resolution": resolution, "votes": votes}}
    flags["sensor"] = {"range_max": range_max, "clear_range": clear_range}
    flags["full_map"] = {"sweeps": sweeps}
    if sensor is not None:
        flags["sensor"]["kind"] = SENSORS[sensor]
    layers = setting_layers(config, flags, settings or [])
    check_estimator(layers, estimator)
    if not any("resolution" in values.get("map", {}) for _, values in layers):
        raise typer.BadParameter("a map needs one, in metres", param_hint="--resolution")

    started = time.perf_counter()
    opened = [
        open_log(
            path,
            poses=poses,
            times=times,
            tolerance_s=tolerance,
            body_from_sensor=read_extrinsics(extrinsics),
            camera=read_camera(intrinsics),
            skip_bad=skip_bad,
        )
        for path in logs
    ]
    read_s = time.perf_counter() - started
    for log in opened:
        check_width(log, sensor)
    configs = [resolved(layers, log) for log in opened]
    kinds = {sensor_name(log, settled) for log, settled in zip(opened, configs, strict=True)}
    if len(kinds) > 1 or (sensor is not None and sensor not in names_of(min(kinds))):
        raise ConfigError(
            f"{logs[0]}: the logs are of {' and '.join(sorted(kinds))}"
            + (f", --sensor says {sensor}" if sensor else ", one map takes one kind")
        )
    if method == "projective" and kinds != {"depth"}:
        raise ConfigError(
            f"{logs[0]}: --method projective is for depth images, the scans are {min(kinds)}"
        )
    held_out = 0
    if hold_out is not None:
        every = every_of(hold_out)
        held_out = sum(len(log) // every for log in opened)
        opened = [without_every(log, every)[0] for log in opened]
    make = _full_map if estimator == "full-map" else _evidence_map
    facts, report = make(
        opened, configs, output,
        method=method, threads=threads or cores(), quiet=as_json, force=force,
    )  # fmt: skip
    facts |= {"scans": report.scans, "beams": report.beams, "skipped": dict(report.skipped)}
    if hold_out is not None:
        facts["held_out"] = held_out
    facts |= {"read_s": round(read_s + report.read_s, 6), "threads": threads or cores()}
    facts |= {"integrate_s": round(report.integrate_s, 6), "compile_s": round(report.compile_s, 6)}
    for log, settled in zip(opened, configs, strict=True):
        for note in (*log.notes, *doubts(log, settled)):
            typer.echo(f"{log.path}: {note}", err=as_json)
    if as_json:
        typer.echo(json.dumps(facts))
    else:
        say(facts)


def _evidence_map(
    logs: list[Log],
    configs: list[Config],
    output: Path,
    *,
    method: str,
    threads: int,
    quiet: bool,
    force: bool,
) -> tuple[dict[str, Any], Report]:
    """Map with the filter and save; returns what there is to say of it."""
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.integrate.add import add_log
    from oddsmap.integrate.forgetting import last_stamp
    from oddsmap.scans.report import Report

    first = configs[0]
    t_ref_ns = first.map.t_ref_ns
    if first.map.half_life is not None and t_ref_ns is None:
        t_ref_ns = max(last_stamp(log) for log in logs)
    evidence = EvidenceMap(
        first.map.resolution,
        votes=first.map.votes,
        half_life=first.map.half_life,
        t_ref_ns=t_ref_ns,
        path_lengths=first.map.path_lengths,
        sensor=first.sensor,
        posterior=first.posterior,
        ndim=3 if sensor_name(logs[0], first) in ("lidar3d", "depth", "tof") else 2,
    )
    total = Report()
    with progress_of_logs(sum(len(log) for log in logs), quiet=quiet) as advance:
        for log, settled in zip(logs, configs, strict=True):
            report = add_log(
                evidence,
                log,
                sensor=settled.sensor,
                method=method,
                threads=threads,
                progress=advance(log),
            )
            total.add(report.scans, report.beams, report.skipped)
            total.integrate_s += report.integrate_s
            total.compile_s += report.compile_s
            total.read_s += report.read_s
    _note_held_out(evidence.provenance, logs)
    evidence.save(output, force=force)
    return facts_of(evidence, output), total


def _full_map(
    logs: list[Log],
    configs: list[Config],
    output: Path,
    *,
    method: str,
    threads: int,
    quiet: bool,
    force: bool,
) -> tuple[dict[str, Any], Report]:
    """Estimate the whole map and save; returns what there is to say of it."""
    from oddsmap.errors import ConfigError
    from oddsmap.full_map.estimator import FullMapEstimator

    if method != "rays":
        raise ConfigError(f"--method {method} belongs to --estimator filter")
    if any(settled.sensor != configs[0].sensor for settled in configs):
        raise ConfigError(
            "the logs say different things of their sensor, a full map takes one: set what "
            "differs with --config or --set, or map them one by one"
        )
    estimator = FullMapEstimator(configs[0], threads=threads)
    for log in logs:
        estimator.add_log(log)
    with progress_of_sweeps(configs[0].full_map.sweeps, quiet=quiet) as advance:
        full_map = estimator.estimate(advance)
    _note_held_out(full_map.provenance, logs)
    full_map.save(output, force=force)
    return facts_of_full_map(full_map, output), estimator.report


def _note_held_out(provenance: list[dict[str, Any]], logs: list[Log]) -> None:
    """Note in a map which scans it has not seen: one entry a log."""
    from oddsmap.scans.split_log import PartOfLog

    for entry, log in zip(provenance, logs, strict=True):
        if isinstance(log, PartOfLog):
            entry["hold_out_every"] = log.every
