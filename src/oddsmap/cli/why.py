# SPDX-License-Identifier: Apache-2.0
"""`oddsmap why`: which scans and beams voted on a cell."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.made_of_maps import SavedMap, read_map
from oddsmap.cli.options import (
    Quiet,
    Verbose,
    json_option,
)
from oddsmap.cli.progress import progress_of_scans
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.witnesses.why import Explanation, ScanVote

__all__ = ["HELP", "why"]

HELP = """Say which scans and beams of a log voted on the cell at a point.

\b
  oddsmap why hall.zarr hall.log.gz 3.04 -1.2
  oddsmap why town.zarr clouds/ 12.5 3 0.8 --poses poses.txt
                                          3D: X Y Z
  oddsmap why hall.zarr hall.log.gz 3.04 -1.2 --json

Scans and beams are counted from 0. Read the log as oddsmap build did, with the same options: the
sensor model and what was held out are the map's. That the scans add up to what the map has is
checked, and said where they do not.
"""

# More beams than these are counted, not listed.
_LISTED = 6


@takes_log_options
def why(
    *,
    source: SavedMap,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="The log that it was made of.")],
    point: Annotated[
        list[str], typer.Argument(metavar="X Y [Z]", help="A point in the map frame [metres].")
    ],
    log_options: LogOptions,
    as_json: Annotated[bool, json_option("the votes")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Say which scans and beams voted on a cell: see `HELP`."""
    from oddsmap.cli.files import check_files, check_logs
    from oddsmap.errors import ConfigError
    from oddsmap.witnesses.why import why as explain

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    place = _point(point)
    check_logs([log])
    check_files([source, log, *log_options.files(log)], force=False)
    grid = read_map(source, voice)
    if len(place) != grid.ndim:
        raise ConfigError(
            f"{source}: is a {grid.ndim}D map, whose points have {grid.ndim} numbers; got "
            f"{' '.join(point)}"
        )
    opened = log_options.open(log)
    with progress_of_scans("asking", opened.scan_count, quiet=voice.still) as progress:
        found = explain(grid, opened, place, progress=progress)
    view = grid.log_odds()
    for note in found.notes:
        voice.note(log, note, err=True)
    voice.facts({"map": str(source), "log": str(log), "point": place, **_facts(found, view)})
    _say(voice, found, view)


def _point(words: list[str]) -> list[float]:
    """The point that is named.

    Raises:
        ConfigError: no two or three numbers.
    """
    from oddsmap.errors import ConfigError

    try:
        place = [float(word) for word in words]
    except ValueError:
        place = []
    if len(place) not in (2, 3) or not all(map(math.isfinite, place)):
        # Words that begin with a dash come here, too, so that numbers below 0 can be written.
        raise ConfigError(
            f"a point is X Y, or X Y Z in 3D [metres], got {' '.join(words)}; oddsmap why -h lists "
            "the options"
        )
    return place


def _known(found: Explanation, view: LogOdds) -> tuple[float, str]:
    """The cell's probability and its state in words."""
    from oddsmap.odds import State

    there = view.states_at([found.centre])
    return float(there.probability[0]), State(int(there.state[0])).name.lower()


def _facts(found: Explanation, view: LogOdds) -> dict[str, Any]:
    probability, state = _known(found, view)
    return {
        "cell": found.cell.tolist(),
        "centre": found.centre.tolist(),
        "probability": probability,
        "state": state,
        "looked_at": found.looked_at,
        "hits": found.hits,
        "passes": found.passes,
        "map_hits": found.map_hits,
        "map_passes": found.map_passes,
        "complete": found.complete,
        "scans": [
            {
                "index": vote.index,
                "stamp_ns": vote.stamp_ns,
                "sensor_id": vote.sensor_id,
                "hits": vote.hits,
                "passes": vote.passes,
                "beams": vote.beams.tolist(),
                "ranges": [r if math.isfinite(r) else None for r in vote.ranges.tolist()],
                "beam_hits": vote.beam_hits.tolist(),
                "beam_passes": vote.beam_passes.tolist(),
            }
            for vote in found.scans
        ],
    }


def _say(voice: Voice, found: Explanation, view: LogOdds) -> None:
    say = voice.say
    probability, state = _known(found, view)
    centre = " ".join(f"{x:.10g}" for x in found.centre)
    say(f"cell      {' '.join(map(str, found.cell.tolist()))}, its centre at {centre} metres")
    say(f"map       {found.map_hits:g} hits, {found.map_passes:g} passes: {state}, "
        f"p = {probability:.3g}")  # fmt: skip
    same = "" if found.complete else ", which is not what the map has"
    say(f"log       {len(found.scans):,} of {found.looked_at:,} scans voted: {found.hits:g} hits, "
        f"{found.passes:g} passes{same}")  # fmt: skip
    if found.scans:
        say(f"{'scan':>8}  {'time [s]':>20}  {'hits':>7}  {'passes':>7}  beams, range [m]")
    for vote in found.scans:
        stamp = "-" if vote.stamp_ns is None else f"{vote.stamp_ns / 1e9:.6f}"
        say(f"{vote.index:8}  {stamp:>20}  {vote.hits:7.4g}  {vote.passes:7.4g}  {_beams(vote)}")


def _beams(vote: ScanVote) -> str:
    """Beams in words, those that hit first: "88 hit 3.042, 89 passed on to 7.1"."""
    hit = vote.beam_hits > 0.0
    order = [*(~hit).argsort(kind="stable")]
    words = [
        f"{vote.beams[i]} {'hit' if hit[i] else 'passed,'} {vote.ranges[i]:.4g}"
        for i in order[:_LISTED]
    ]
    more = len(order) - len(words)
    name = f" ({vote.sensor_id})" if vote.sensor_id else ""
    return ", ".join(words) + (f" and {more} more" if more else "") + name
