# SPDX-License-Identifier: Apache-2.0
"""`oddsmap score`: how well a map predicts readings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.doubts import doubt_of_sensor
from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.options import (
    Quiet,
    Settings,
    Verbose,
    config_option,
    force_option,
    json_option,
)
from oddsmap.cli.picture_options import PICTURES
from oddsmap.cli.progress import progress_of_scans, working
from oddsmap.cli.setting_layers import read_layers
from oddsmap.cli.views import check_view, view_of
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.config.config import Config
    from oddsmap.posterior.belief import Belief

__all__ = ["HELP", "score"]

HELP = """Score a map by readings that it has not seen: no ground truth is needed.

\b
  oddsmap build sonar.npz --resolution 0.1 --hold-out 0.1 -o sonar.zarr
  oddsmap score sonar.zarr sonar.npz --held-out
  oddsmap score sonar.zarr second_run.npz --plot reliability.png --json
  oddsmap build intel.log.gz --resolution 0.05 --hold-out 0.1 --blocks \\
    -o intel.zarr
  oddsmap score intel.zarr intel.log.gz --held-out --truth surveyed.yaml

Each reading is predicted from the map under the forward sensor model: by default the map's own.
Under narrow beams it is also looked at whether the cells' probabilities are true: how many of the
beams that enter a cell hit it, by what several ways to count predict. --truth asks the same of
p(occupied), by a map that is known to be right.
"""

_TOO_GOOD = (
    "the map was made from this log: scores are too good (build with --hold-out 0.1 and score with "
    "--held-out)"
)


@takes_log_options
def score(
    *,
    grid: Annotated[Path, typer.Argument(metavar="MAP", help="A saved map.")],
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The readings to predict.")],
    held_out: Annotated[
        bool, typer.Option("--held-out", help="Only the scans that `build --hold-out` kept back.")
    ] = False,
    truth: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP",
            help="Score occupancy by this map, too: a saved map, the .yaml of a ROS map, or an "
            "OctoMap, of the same frame; by default none.",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png|pdf|svg", help="Draw the reliability curve; by default no picture."
        ),
    ] = None,
    posterior: Annotated[
        str,
        typer.Option(metavar="NAME", help="Which view of the map: log-odds or calibrated."),
    ] = "log-odds",
    log_options: LogOptions,
    config: Annotated[Path | None, config_option("another sensor model, section sensor")] = None,
    settings: Settings = None,
    force: Annotated[bool, force_option("an existing picture")] = False,
    as_json: Annotated[bool, json_option("the scores")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Score a map: see `HELP`."""
    from oddsmap.cli import scored_beams, scored_occupancy, scored_reflection
    from oddsmap.cli.files import check_files, check_logs, check_suffix
    from oddsmap.scans.note import Note
    from oddsmap.scans.split_log import hold_out

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    check_view(posterior)
    layers = read_layers(config, settings)
    layers.check_sections("score", "sensor")
    layers.check_values()
    if plot is not None:
        check_suffix(plot, PICTURES, "a picture must have a name that ends in .png, .pdf or .svg")
    check_logs([log])
    check_files([grid, log, truth, *log_options.files(log)], plot, force=force)
    with working(f"loading {grid.name}", quiet=voice.still):
        belief, stored, provenance = _load(grid, posterior)
    whole = log_options.open(log)
    every, run = _held_out_of(provenance, grid, log) if held_out else (None, 1)
    part = whole if every is None else hold_out(whole, every, run)[1]
    sensor = layers.resolve_above(stored, whole).sensor
    with progress_of_scans("scoring", part.scan_count, quiet=voice.still) as progress:
        scores = scored_beams.score(belief, part, sensor, plot=plot, progress=progress)
    with working("comparing hits and passes", quiet=voice.still):
        hits = scored_reflection.score(belief, part, sensor)
        cells = None if truth is None else scored_occupancy.score(belief, truth, voice)
    if plot is not None and not isinstance(scores, str):
        scored_beams.draw(scores, plot, grid, force=force)
    if any(entry.get("source") == log.name for entry in provenance):
        if not held_out:
            too_good = Note(_TOO_GOOD, code="score.own_log", severity="warning")
            voice.note(log, too_good, err=True)
    elif doubt := doubt_of_sensor(whole, sensor, layers):
        voice.note(log, doubt, err=True)
    voice.facts({
        "map": str(grid), "log": str(log), "posterior": posterior, "held_out_every": every,
        "held_out_run": None if every is None else run, **scored_beams.facts(scores),
        **scored_reflection.facts(hits), **scored_occupancy.facts(cells),
    })  # fmt: skip
    for line in scored_beams.lines(scores):
        voice.say(line)
    for line in scored_reflection.lines(hits, posterior):
        voice.say(line)
    for line in scored_occupancy.lines(cells, posterior):
        voice.say(line)


def _load(path: Path, posterior: str) -> tuple[Belief, Config, list[dict[str, Any]]]:
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map

    if is_full_map(path):
        if posterior != "log-odds":
            raise ConfigError(
                f"{path}: a full map has no counts, which --posterior {posterior} is fitted to"
            )
        full_map = load_full_map(path)
        return full_map, full_map.config, full_map.provenance
    evidence = load_map(path)
    return view_of(evidence, posterior), evidence.config, evidence.provenance


def _held_out_of(provenance: list[dict[str, Any]], grid: Path, log: Path) -> tuple[int, int]:
    """Which run of scans was held out of the map, and how many scans are a run."""
    from oddsmap.errors import InputError

    of_log = [entry for entry in provenance if entry.get("source") == log.name]
    kept = {
        (entry["hold_out_every"], entry.get("hold_out_run", 1))
        for entry in of_log
        if "hold_out_every" in entry
    }
    if len(kept) != 1 or not all("hold_out_every" in entry for entry in of_log):
        scans = "different scans" if len(kept) > 1 else "no scan"
        raise InputError(
            f"{grid}: {scans} of {log.name} held out; build it with --hold-out 0.1, or score "
            "another log without --held-out"
        )
    every, run = kept.pop()
    return int(every), int(run)
