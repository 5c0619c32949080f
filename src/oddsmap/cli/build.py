# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build`: logs to a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from oddsmap.cli.auto import fit_first
from oddsmap.cli.build_plan import BuildPlan, MapSettings
from oddsmap.cli.dask_mapping import make_map_on_cluster, open_on_cluster, workers_of
from oddsmap.cli.doubts import doubt_of_estimator, doubts_of_settings
from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.mapping import make_map
from oddsmap.cli.opened_logs import open_logs
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
from oddsmap.cli.sensor_names import complete_sensor
from oddsmap.cli.setting_fields import set_fields
from oddsmap.cli.summary import lines
from oddsmap.cli.voice import Voice
from oddsmap.errors import OddsmapError

if TYPE_CHECKING:
    from oddsmap.cli.opened_logs import OpenedLog, OpenedLogs
    from oddsmap.scans.report import Report

__all__ = ["HELP", "build"]

HELP = """Map one or more logs: in 2D or 3D, as their scans are.

\b
  oddsmap build intel.log.gz --resolution 0.05 -o intel.zarr
  oddsmap build tuesday.log -o hall.zarr --append   (what building both makes)
  oddsmap build run.log --resolution 0.1 --range-max 30 --clear-range 10 \\
    -o run.zarr
  oddsmap build run.log --config lidar.toml --set sensor.hit_width=0.1 \\
    -o run.zarr --json
  oddsmap build clouds/ --poses poses.txt --resolution 0.1 \\
    --set sensor.mark_z_min=0.2 -o hall.zarr
  oddsmap build sonar.npz --resolution 0.1 --estimator full-map -o sonar.zarr
  oddsmap build intel.log.gz --resolution 0.05 --auto -o intel.zarr
                                                    (sensor fitted to the log)
  oddsmap build town/ --resolution 0.1 --memory 4GB -o town.zarr
                                                    (maps larger than memory)
  oddsmap build sonar.npz --resolution 0.1 --hold-out 0.1 -o sonar.zarr
                                                    (see oddsmap score)
  oddsmap build drives/*.bag --resolution 0.1 --dask tcp://10.0.0.1:8786 \\
    -o s3://maps/city.zarr                          (see docs/scale.md)

Reads {formats}: by their content, whatever they are called. docs/formats.md says what each needs.
"""


@takes_log_options
def build(
    *,
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="A log file, or a folder of scans.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="MAP.zarr", help="The map to write, a folder.")
    ],
    append: Annotated[
        bool,
        typer.Option(
            "--append",
            help="Add the logs to the map that is there, exactly; its settings stand.",
        ),
    ] = False,
    resolution: Resolution = None,
    votes: Annotated[
        Literal["scan", "beam"] | None,
        typer.Option(
            help="scan: one vote per cell and scan; beam: every beam. By default scan, and beam "
            "for sonar and tof."
        ),
    ] = None,
    half_life_scans: Annotated[
        float | None,
        typer.Option(
            metavar="SCANS",
            help="After so many scans evidence weighs half, where things move; by default it never "
            "fades.",
        ),
    ] = None,
    clear_range: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="How far a beam without return clears; by default one that says so by +Inf up to "
            "range-max, and others not at all.",
        ),
    ] = None,
    range_max: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Readings from here on are no returns; by default as the log says.",
        ),
    ] = None,
    threads: Threads = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="{sensors}; by default as the log says.",
            autocompletion=complete_sensor,
        ),
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
        int | None,
        typer.Option(metavar="N", min=1, help="full-map: the most sweeps, by default 40."),
    ] = None,
    log_options: LogOptions,
    config: Annotated[
        Path | None, config_option("sections map, sensor, posterior and full_map")
    ] = None,
    settings: Settings = None,
    hold_out: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Keep this share of scans back, to score by: 0.1 is each tenth; by default none.",
        ),
    ] = None,
    auto: Annotated[
        bool,
        typer.Option(
            "--auto",
            help="Fit the sensor to the log itself, take a full map for wide beams, and note in "
            "the map which posterior to use.",
        ),
    ] = False,
    blocks: Annotated[
        bool,
        typer.Option(
            "--blocks",
            help="With --hold-out: keep whole runs of scans back, a hundredth of the log each, so "
            "that their neighbours do not tell what they see.",
        ),
    ] = False,
    memory: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="What the map may take in memory, as 4GB; beyond it parts wait on the disk. By "
            "default half of what is free.",
        ),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local",
            help="Let the workers of a Dask cluster read and map the logs: the same bits. local: "
            "as many processes here as --threads says; by default none.",
        ),
    ] = None,
    chunk_scans: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="With --dask: scans that a worker takes at a time, by default a fourth of its "
            "share, up to 2000.",
        ),
    ] = None,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Map one or more logs: see `HELP`."""
    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    plan = BuildPlan(
        logs=logs,
        log_options=log_options,
        output=output,
        force=force,
        append=append,
        settings=MapSettings(
            resolution=resolution,
            votes=votes,
            half_life_scans=half_life_scans,
            sensor=sensor,
            range_max=range_max,
            clear_range=clear_range,
            sweeps=sweeps,
            config=config,
            settings=settings,
        ),
        estimator=estimator,
        method=method,
        threads=thread_count(threads),
        hold_out=hold_out,
        blocks=blocks,
        auto=auto,
        memory=memory,
        quiet=voice.still,
        dask=dask,
        chunk_scans=chunk_scans,
    )
    fitted = None
    with workers_of(plan) as cluster:
        on_cluster = None if cluster is None else open_on_cluster(plan, cluster)
        opened = open_logs(plan) if on_cluster is None else on_cluster.opened
        try:
            if auto:
                plan, opened, fitted = fit_first(plan, opened)
            if on_cluster is None:
                facts, report, notes = make_map(plan, opened)
            else:
                (facts, report), notes = make_map_on_cluster(plan, on_cluster), []
        except OddsmapError:
            # What looks odd in a log may be why it makes no map.
            _say_doubts(opened, voice, err=True)
            raise
    facts |= _facts_of_work(plan, opened, report)
    facts |= {} if fitted is None else {"auto": fitted}
    for part in opened.logs:
        for note in (*part.log.notes, *doubts_of_settings(part.log, part.config)):
            voice.note(part.log.path, note)
        _details(voice, part)
    doubt = doubt_of_estimator(plan.layers, opened.logs[0].config, plan.estimator)
    if doubt is not None:
        voice.note(plan.settings.config or "--set", doubt)
    _say_doubts(opened, voice)
    for note in notes:
        voice.note(plan.output, note)
    voice.facts(facts)
    for line in lines(facts):
        voice.say(line)


def _details(voice: Voice, part: OpenedLog) -> None:
    """Bad lines of a log, and the settings that are not the defaults."""
    for bad in getattr(part.log, "bad_lines", ()):
        voice.detail(f"{part.log.path}:{bad.number}: {bad.message}")
    if voice.verbose:
        for setting, value in set_fields(part.config.to_dict()).items():
            voice.detail(f"{part.log.path}: {setting} = {value}")


def _say_doubts(opened: OpenedLogs, voice: Voice, *, err: bool = False) -> None:
    """Say what looks odd in the scans that were mapped, as far as they were read."""
    from oddsmap.plausibility.doubts import doubts_of_sample

    for part in opened.logs:
        for doubt in doubts_of_sample(part.sample):
            voice.note(part.log.path, doubt, err=err)


def _facts_of_work(plan: BuildPlan, opened: OpenedLogs, report: Report) -> dict[str, Any]:
    """How a map was made, apart from the map itself."""
    return {
        "scans": report.scans,
        "beams": report.beams,
        "skipped": dict(report.skipped),
        **({} if plan.hold_out is None else {"held_out": opened.held_out}),
        "read_s": round(opened.read_s + report.read_s, 6),
        "threads": plan.threads,
        "integrate_s": round(report.integrate_s, 6),
        "compile_s": round(report.compile_s, 6),
    }
