# SPDX-License-Identifier: Apache-2.0
"""`oddsmap compare`: two maps beside each other, cell by cell."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.made_of_maps import SavedMap, read_map
from oddsmap.cli.merge_doubts import frames_differ, votes_differ
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.picture_options import PICTURES
from oddsmap.cli.progress import working
from oddsmap.cli.views import check_view, view_of
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from collections.abc import Iterator

    from oddsmap.posterior.comparison import Comparison
    from oddsmap.posterior.count_view import CountView

__all__ = ["HELP", "compare"]

HELP = """Compare two maps of one frame cell by cell: where they agree, what changed.

\b
  oddsmap compare monday.zarr tuesday.zarr
  oddsmap compare monday.zarr tuesday.zarr --plot changes.png
  oddsmap compare monday.zarr tuesday.zarr --posterior calibrated --json

States are those that each map decides by its own settings. Maps of two
resolutions are compared after oddsmap resample.
"""

_STATES = ("free", "undecided", "occupied")


def compare(
    first: SavedMap,
    second: Annotated[Path, typer.Argument(metavar="OTHER", help="The one to compare it with.")],
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png", help="Draw where 2D maps agree and differ; by default no picture."
        ),
    ] = None,
    posterior: Annotated[
        str,
        typer.Option(metavar="NAME", help="Which view of the maps: log-odds or calibrated."),
    ] = "log-odds",
    force: Annotated[bool, force_option("an existing picture")] = False,
    as_json: Annotated[bool, json_option("the comparison")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare two maps cell by cell: see `HELP`."""
    from oddsmap.cli.files import check_files, check_suffix
    from oddsmap.errors import InputError
    from oddsmap.posterior.comparison import compare as compare_views

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    check_view(posterior)
    if plot is not None:
        check_suffix(plot, PICTURES, "a picture must have a name that ends in .png, .pdf or .svg")
    check_files([first, second], plot, force=force)
    maps = read_map(first, voice), read_map(second, voice)
    for path, grid in zip((first, second), maps, strict=True):
        if grid.bounds() is None:
            raise InputError(f"{path}: has no known cell, so there is nothing to compare")
    views = view_of(maps[0], posterior), view_of(maps[1], posterior)
    try:
        with working("comparing", quiet=voice.still):
            found = compare_views(*views)
        if plot is not None:
            with working(f"drawing {plot.name}", quiet=voice.still):
                _draw(*views, (first.name, second.name), plot, force=force)
    except InputError as error:
        raise InputError(f"{first} and {second}: {error}") from None
    for note in _notes(found, *views):
        voice.note(second, note)
    voice.facts({
        "first": str(first), "second": str(second), "posterior": posterior, **_facts(found)
    })  # fmt: skip
    for line in _lines(found):
        voice.say(line)
    if plot is not None:
        voice.say(f"picture  {plot}")


def _draw(
    first: CountView, second: CountView, names: tuple[str, str], plot: Path, *, force: bool
) -> None:
    from oddsmap.plot.comparison import save_kinds
    from oddsmap.posterior.comparison import kinds_in_plane

    plane, side = kinds_in_plane(first, second), first.resolution
    x, y = (float(i) * side for i in plane.first_cell)
    kinds = (
        "unknown", "free", "undecided in one", f"{names[0]} alone", f"{names[1]} alone", "occupied",
        "occupied, then free", "free, then occupied",
    )  # fmt: skip
    save_kinds(plane.kinds, plot, resolution=side, origin=(x, y), names=kinds, force=force)


def _notes(found: Comparison, first: CountView, second: CountView) -> Iterator[str]:
    """What to know: maps that do not meet, and why log odds may differ in the same world."""
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.scans.note import Note

    pairs: dict[str, tuple[object, ...]] = {}
    if isinstance(first, LogOdds) and isinstance(second, LogOdds):
        # A calibrated view takes none of them: its prior is fitted to the map, like all of it.
        pairs = {
            "sensor.p_hit": (first.p_hit, second.p_hit),
            "sensor.p_miss": (first.p_miss, second.p_miss),
            "posterior.prior": (first.prior, second.prior),
        }
    pairs |= {
        "posterior.free": (first.thresholds.free, second.thresholds.free),
        "posterior.occupied": (first.thresholds.occupied, second.thresholds.occupied),
        "map.votes": (first.evidence.votes, second.evidence.votes),
        "map.half_life": tuple(view.evidence.config.map.half_life for view in (first, second)),
        "map.half_life_scans": tuple(
            view.evidence.config.map.half_life_scans for view in (first, second)
        ),
    }
    differ = [
        f"{name} is {b}, and {a} in the first map" for name, (a, b) in pairs.items() if a != b
    ]
    if differ:
        settings = "; ".join(differ) + ": states may differ for that alone"
        yield Note(settings, code="compare.settings")
    if not found.both:
        apart = "no cell is known in both maps: they are of other places, or of other frames"
        yield Note(apart, code="compare.apart", severity="warning")
    if said := votes_differ(first.evidence, second.evidence):
        yield Note(said, code="compare.resampled", severity="warning")
    if said := frames_differ(first.evidence, second.evidence):
        yield Note(said, code="compare.rotated", severity="warning")


def _facts(found: Comparison) -> dict[str, Any]:
    return {
        "cells_known_in_both": found.both,
        "agreement": _number(found.agreement),
        "decided_in_both": found.decided,
        "decided_agreement": _number(found.decided_agreement),
        "free_to_occupied": found.new,
        "occupied_to_free": found.gone,
        "states": {
            before: dict(zip(_STATES, map(int, row), strict=True))
            for before, row in zip(_STATES, found.states, strict=True)
        },
        "first_alone": found.first_alone,
        "second_alone": found.second_alone,
        "log_odds_mean": _number(found.mean),
        "log_odds_rms": _number(found.rms),
        "log_odds_largest": _number(found.largest),
    }


def _lines(found: Comparison) -> Iterator[str]:
    yield f"both     {found.both:,} cells known in both"
    if found.both:
        yield f"agree    {found.agreement:.2%} have the same state"
        if found.decided:
            yield (
                f"decided  {found.decided:,} are free or occupied in both, "
                f"{found.decided_agreement:.2%} of them the same"
            )
        yield f"changed  {found.new:,} free, then occupied; {found.gone:,} occupied, then free"
        yield (
            f"log odds second less first: mean {found.mean:+.3g}, rms {found.rms:.3g}, largest "
            f"{found.largest:.3g}"
        )
    yield (
        f"alone    {found.first_alone:,} cells known in the first alone, {found.second_alone:,} in "
        "the second"
    )


def _number(value: float) -> float | None:
    """As JSON takes it, which has no NaN."""
    return None if math.isnan(value) else value
