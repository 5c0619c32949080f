# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build`: logs to a map."""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

if TYPE_CHECKING:
    from oddsmap.config import Config
    from oddsmap.evidence import EvidenceMap
    from oddsmap.poses import Pose3
    from oddsmap.scan import Log
    from oddsmap.sensors.depth_camera import PinholeCamera

__all__ = ["HELP", "build"]

HELP = """Map one or more logs: of the plane or of space, as their scans are.

\b
  oddsmap build intel.log.gz --resolution 0.05 -o intel.zarr
  oddsmap build run.log --resolution 0.1 --range-max 30 --clear-range 10 -o run.zarr
  oddsmap build run.log --config lidar.toml --set sensor.hit_width=0.1 -o run.zarr --json
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
        str | None, typer.Option(metavar="NAME", help="lidar2d, lidar3d or depth: checked.")
    ] = None,
    method: Annotated[
        Literal["rays", "projective"],
        typer.Option(help="How depth images clear; projective is faster and approximate."),
    ] = "rays",
    estimator: Annotated[
        Literal["filter", "full-map"], typer.Option(help="full-map: not available yet.")
    ] = "filter",
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
        Path | None, typer.Option(metavar="FILE.toml", help="Sections map, sensor, posterior.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Any field; may be repeated."),
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
    from oddsmap.atomic import check_output
    from oddsmap.errors import ConfigError
    from oddsmap.evidence import EvidenceMap
    from oddsmap.integrate import Report, add_log
    from oddsmap.readers import open_log

    if estimator != "filter":
        raise ConfigError(f'--estimator {estimator}: not available, this version has "filter"')
    if sensor is not None and sensor not in SENSORS:
        raise ConfigError(f"--sensor {sensor}: not available, known are {', '.join(SENSORS)}")
    check_output(output, force=force)
    flags = {"map": {"resolution": resolution, "votes": votes}}
    flags["sensor"] = {"range_max": range_max, "clear_range": clear_range}
    layers = _layers(config, flags, settings or [])
    if not any("resolution" in values.get("map", {}) for _, values in layers):
        raise typer.BadParameter("a map needs one, in metres", param_hint="--resolution")
    _resolved(layers, {})  # a mistake in the settings shows before a long log is read

    started = time.perf_counter()
    opened = [
        open_log(
            path,
            poses=poses,
            times=times,
            tolerance_s=tolerance,
            body_from_sensor=_extrinsics(extrinsics),
            camera=_camera(intrinsics),
            skip_bad=skip_bad,
        )
        for path in logs
    ]
    kinds = {_kind(log) for log in opened}
    if len(kinds) > 1 or (sensor is not None and sensor not in kinds):
        raise ConfigError(
            f"{logs[0]}: the logs are of {' and '.join(sorted(kinds))}"
            + (f", --sensor says {sensor}" if sensor else ", one map takes one kind")
        )
    if method == "projective" and kinds != {"depth"}:
        raise ConfigError(
            f"{logs[0]}: --method projective is for depth images, the scans are {min(kinds)}"
        )
    read_s = time.perf_counter() - started

    configs = [_resolved(layers, log.sensor) for log in opened]
    first = configs[0]
    evidence = EvidenceMap(
        first.map.resolution,
        votes=first.map.votes,
        sensor=first.sensor,
        posterior=first.posterior,
        ndim=2 if kinds == {"lidar2d"} else 3,
    )
    total = Report()
    workers = threads or _cores()
    with _progress(sum(len(log) for log in opened), quiet=as_json) as advance:
        for log, settled in zip(opened, configs, strict=True):
            report = add_log(
                evidence,
                log,
                sensor=settled.sensor,
                method=method,
                threads=workers,
                progress=advance(log),
            )
            total.add(report.scans, report.beams, report.skipped)
            total.integrate_s += report.integrate_s
            total.compile_s += report.compile_s
            read_s += report.read_s
    evidence.save(output, force=force)
    facts = _facts(evidence, total.skipped, output)
    facts |= {"scans": total.scans, "beams": total.beams, "read_s": round(read_s, 6)}
    facts |= {"integrate_s": round(total.integrate_s, 6), "compile_s": round(total.compile_s, 6)}
    facts |= {"threads": workers}
    for log, settled in zip(opened, configs, strict=True):
        for note in (*log.notes, *_doubts(log, settled)):
            typer.echo(f"{log.path}: {note}", err=as_json)
    if as_json:
        typer.echo(json.dumps(facts))
    else:
        _say(facts)


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


SENSORS = ("lidar2d", "lidar3d", "depth")


def _kind(log: Log) -> str:
    if hasattr(log, "depth_scans"):
        return "depth"
    first = next(iter(log), None)
    return "lidar2d" if first is None or first.directions.shape[1] == 2 else "lidar3d"


def _doubts(log: Log, settled: Config) -> list[str]:
    """What a person should know of settings that do not fit the log."""
    said, given = log.sensor.get("range_max"), settled.sensor.range_max
    if said is None or given is None or given <= said:
        return []
    return [
        f"range_max {given:g} is above the {said:g} m that this log writes where nothing was seen: "
        "such readings now count as obstacles"
    ]


def _numbers(option: str, text: str, names: str) -> list[float]:
    from oddsmap.errors import ConfigError

    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != len(names.split()):
        raise ConfigError(f'{option} "{text}": needs the numbers {names}')
    return numbers


def _extrinsics(text: str | None) -> Pose3 | None:
    from oddsmap.poses import Pose3

    if text is None:
        return None
    numbers = _numbers("--body-from-sensor", text, "x y z qx qy qz qw")
    return Pose3.from_quaternion_xyzw(numbers[:3], numbers[3:])


def _camera(text: str | None) -> PinholeCamera | None:
    from oddsmap.sensors.depth_camera import PinholeCamera

    if text is None:
        return None
    fx, fy, cx, cy, width, height = _numbers("--camera", text, "fx fy cx cy width height")
    return PinholeCamera(fx, fy, cx, cy, int(width), int(height))


Layers = list[tuple[str, dict[str, dict[str, Any]]]]


def _layers(config: Path | None, flags: dict[str, dict[str, Any]], settings: list[str]) -> Layers:
    # The strongest last: the file, the options by name, --set.
    from oddsmap.config import parse_setting, read_toml

    layers: Layers = []
    if config is not None:
        layers.append((str(config), read_toml(config)))
    for section, fields in flags.items():
        given = {name: value for name, value in fields.items() if value is not None}
        layers.append(("options", {section: given}))
    for text in settings:
        section, name, value = parse_setting(text)
        layers.append((f"--set {text}", {section: {name: value}}))
    return layers


def _resolved(layers: Layers, said: Any) -> Config:
    from oddsmap.config import resolve
    from oddsmap.integrate import SENSOR_SAYS

    known = {name: said[name] for name in SENSOR_SAYS if name in said}
    return resolve(("log", {"sensor": known}), *layers)


@contextmanager
def _progress(total: int, *, quiet: bool) -> Iterator[Callable[[Log], Callable[[int], None]]]:
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


def _facts(evidence: EvidenceMap, skipped: Counter[str], output: Path) -> dict[str, Any]:
    from oddsmap.kernels.tiles import ONE

    _, hits, passes = evidence.cells()
    known = len(hits)
    return {
        "output": str(output),
        "resolution": evidence.resolution,
        "votes": evidence.votes,
        "hits": int(hits.sum()) / ONE,
        "passes": int(passes.sum()) / ONE,
        "cells_known": known,
        "area_m2" if evidence.ndim == 2 else "volume_m3": round(
            known * evidence.resolution**evidence.ndim, 3
        ),
        "skipped": dict(skipped),
        "bytes_in_memory": evidence.nbytes,
        "bytes_on_disk": sum(file.stat().st_size for file in output.rglob("*") if file.is_file()),
    }


def _say(facts: dict[str, Any]) -> None:
    say = typer.echo
    say(f"used     {facts['scans']:,} scans, {facts['beams']:,} beams")
    for reason, count in sorted(facts["skipped"].items()):
        say(f"skipped  {count:,} x {reason}{_WHY.get(reason, '')}")
    flat = "area_m2" in facts
    seen = f"{facts['area_m2']:,.1f} square" if flat else f"{facts['volume_m3']:,.1f} cubic"
    say(f"seen     {seen} metres in {facts['cells_known']:,} cells of {facts['resolution']:g} m")
    say(
        f"time     {facts['read_s']:.2f} s reading, {facts['integrate_s']:.2f} s mapping "
        f"({facts['threads']} threads), {facts['compile_s']:.2f} s getting ready"
    )
    output = facts["output"]
    say(f"map      {output} ({facts['bytes_on_disk'] / 1000:,.0f} kB)")
    stem = Path(output).with_suffix("")
    if flat:
        say(f"next     oddsmap export {output} {stem}.png    (or {stem}.yaml for ROS)")
    else:
        say(f"next     oddsmap export {output} {stem}.ply    (or .bt; .png with --z-min, --z-max)")


_WHY = {
    "beam.no_return": " (cleared nothing: a fault looks the same; --clear-range M lets them clear)",
    "beam.nan": " (no information)",
    "beam.below_range_min": " (no information)",
}
