# SPDX-License-Identifier: Apache-2.0
"""`oddsmap clean`: points and maps without what moved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.options import (
    Quiet,
    Threads,
    Verbose,
    force_option,
    json_option,
    thread_count,
)
from oddsmap.cli.progress import progress_of_logs, progress_of_scans, working
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.cleaning.cleaner import Cleaner
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.map_files.point_cloud import LabelledPoints
    from oddsmap.scans.log import Log

__all__ = ["HELP", "clean"]

HELP = """Take what moved out of the points of a log, and out of its map.

\b
  oddsmap clean town/ --resolution 0.2 -o static.ply
  oddsmap clean town/ town.zarr -o static.ply -o static.zarr
                                          the log's map, as build made it
  oddsmap clean town/ town.zarr --all -o labelled.pcd
                                          all points, label 1: dynamic

A point is dynamic where most scans have seen through its cell, and no cell beside or above it
stands. Points on the ground stay. docs/moving-worlds.md says how well that works.
"""


@takes_log_options
def clean(
    *,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log file, or a folder of scans.")],
    grid: Annotated[
        Path | None,
        typer.Argument(metavar="[MAP]", help="The map of the log (.zarr); by default it is made."),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Points (.ply, .pcd, .las, .laz) or a map (.zarr) without what moved; required, "
            "and may be repeated.",
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(
            metavar="METRES", help="Side of a cell of the map that is made; by default that of MAP."
        ),
    ] = None,
    level: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            help="Of the credible interval of a cell's reflectivity; higher takes out less.",
        ),
    ] = 0.5,
    ground_margin: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Points up to this far above the ground stay; by default 0.6 of a cell.",
        ),
    ] = None,
    every_point: Annotated[
        bool,
        typer.Option("--all", help="Write all points, with label 1 where dynamic, 0 elsewhere."),
    ] = False,
    threads: Threads = None,
    log_options: LogOptions,
    force: Annotated[bool, force_option("existing files")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Take what moved out of a log and its map: see `HELP`."""
    from oddsmap.cleaning.cleaner import Cleaner

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    cloud, clean_map = _outputs(output or [], every_point=every_point)
    _check(log, grid, resolution, (cloud, clean_map), log_options, force=force)
    opened = log_options.open(log)
    evidence = _map_of(opened, grid, resolution, thread_count(threads), voice)
    with working("looking for the ground", quiet=voice.still):
        cleaner = Cleaner(evidence, level=level, ground_margin=ground_margin)
    facts: dict[str, Any] = {"log": str(log), "level": level}
    if evidence.ndim == 3:
        facts["ground_margin"] = cleaner.ground_margin
    if cloud is not None:
        facts |= _save_cloud(cleaner, opened, cloud, every_point, force=force, voice=voice)
    if clean_map is not None:
        facts |= _save_map(cleaner, clean_map, force=force, voice=voice)
    for note in opened.notes:
        voice.note(log, note)
    voice.facts(facts)
    _say(voice, facts)


def _outputs(output: list[Path], *, every_point: bool) -> tuple[Path | None, Path | None]:
    """The cloud and the map to write."""
    from oddsmap.cli.files import check_suffix
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.point_cloud import CLOUDS

    if not output:
        raise typer.BadParameter("say what to write, like static.ply", param_hint="-o")
    for path in output:
        check_suffix(
            path, (*CLOUDS, "", ".zarr"), "points are .ply, .pcd, .las or .laz, a map is .zarr"
        )
    clouds = [path for path in output if path.suffix.lower() in CLOUDS]
    maps = [path for path in output if path.suffix.lower() not in CLOUDS]
    if max(len(clouds), len(maps)) > 1:
        raise ConfigError(f"{output[-1]}: one file of points and one map can be written at once")
    if every_point and not clouds:
        raise ConfigError("--all is of points: give a .ply, .pcd, .las or .laz to write, too")
    return next(iter(clouds), None), next(iter(maps), None)


def _check(
    log: Path,
    grid: Path | None,
    resolution: float | None,
    outputs: tuple[Path | None, Path | None],
    log_options: LogOptions,
    *,
    force: bool,
) -> None:
    from oddsmap.cli.files import check_files, check_logs
    from oddsmap.errors import ConfigError

    if grid is None and resolution is None:
        raise typer.BadParameter(
            "without a map one is made, whose cells need a side, in metres, like --resolution 0.2",
            param_hint="--resolution",
        )
    if grid is not None and resolution is not None:
        raise ConfigError(f"--resolution is of a map that is made, and {grid} is there: leave one")
    check_logs([log])
    read = [log, grid, *log_options.files(log)]
    cloud, clean_map = outputs
    check_files(read, cloud, force=force)
    check_files(read, clean_map, force=force, is_map=True)


def _map_of(
    log: Log, grid: Path | None, resolution: float | None, threads: int, voice: Voice
) -> EvidenceMap:
    """The map that is given, or the one that the log makes."""
    from oddsmap.cli.made_of_maps import read_map
    from oddsmap.evidence_map import build_map

    if grid is not None:
        return read_map(grid, voice)
    with progress_of_logs(log.scan_count, quiet=voice.still) as advance:
        return build_map(log, resolution or 0.0, threads=threads, progress=advance())


def _save_cloud(
    cleaner: Cleaner, log: Log, path: Path, every_point: bool, *, force: bool, voice: Voice
) -> dict[str, Any]:
    from oddsmap.map_files.point_cloud import save_points

    count = {"points": 0, "dynamic": 0}

    def parts() -> Iterator[LabelledPoints]:
        for number, part in enumerate(cleaner.label(log)):
            count["points"] += len(part.points)
            count["dynamic"] += int(part.dynamic.sum())
            kept = part.dynamic | True if every_point else ~part.dynamic
            yield part.points[kept], part.dynamic[kept]
            progress(number + 1)

    with progress_of_scans("cleaning", log.scan_count, quiet=voice.still) as progress:
        written = save_points(parts(), path, labels=every_point, force=force)
    skipped = dict(cleaner.skipped)
    return {**count, "cloud": str(path), "points_written": written, "skipped": skipped}


def _save_map(cleaner: Cleaner, path: Path, *, force: bool, voice: Voice) -> dict[str, Any]:
    with working(f"cleaning {path.name}", quiet=voice.still):
        grid = cleaner.static_map()
        grid.save(path, force=force)
    said = grid.provenance[-1]
    return {"map": str(path), **{name: said[name] for name in ("cleaned_cells", "cleaned_hits")}}


def _say(voice: Voice, facts: dict[str, Any]) -> None:
    if "cloud" in facts:
        share = 100 * facts["dynamic"] / max(1, facts["points"])
        voice.say(f"points   {facts['points']:,}, {facts['dynamic']:,} dynamic ({share:.2g} %)")
        for reason, count in sorted(facts["skipped"].items()):
            voice.say(f"skipped  {count:,} x {reason}")
        voice.say(f"cloud    {facts['cloud']} ({facts['points_written']:,} points)")
    if "map" in facts:
        voice.say(
            f"map      {facts['map']} without {facts['cleaned_hits']:,.6g} hits of "
            f"{facts['cleaned_cells']:,} cells"
        )
