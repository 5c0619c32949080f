# SPDX-License-Identifier: Apache-2.0
"""`oddsmap subtract`: the evidence of maps and logs taken out of a map again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.logs_taken_out import LogsTakenOut
from oddsmap.cli.made_of_maps import (
    AnySensor,
    MadeMap,
    SavedMap,
    check_maps,
    combined,
    is_saved,
    write_map,
)
from oddsmap.cli.map_moves import Shifts, Transforms, moves_of
from oddsmap.cli.merge_doubts import doubts_of_difference
from oddsmap.cli.options import (
    Quiet,
    Threads,
    Verbose,
    force_option,
    json_option,
    thread_count,
)
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap

__all__ = ["HELP", "subtract"]

HELP = """Take the evidence of maps or logs out of a map again, exactly.

\b
  oddsmap subtract all.zarr tuesday.zarr -o rest.zarr
  oddsmap subtract all.zarr tuesday.log.gz -o rest.zarr
                                          what build A B made, without B
  oddsmap subtract town.zarr clouds/ --poses poses.txt -o rest.zarr

A log is mapped as it was when it was added, by the sensor model, the votes and the scans held out
that the map remembers; read it with the same options. A cell that has less than is to be taken
out of it is an error: then the evidence was never added, and nothing is written.
With --transform or --shift as in the merge, maps that were moved are taken out.
"""


@takes_log_options
def subtract(
    *,
    source: SavedMap,
    others: Annotated[
        list[Path],
        typer.Argument(metavar="OTHER...", help="What is to be taken out of it: maps, or logs."),
    ],
    output: MadeMap,
    transform: Transforms = None,
    shift: Shifts = None,
    log_options: LogOptions,
    threads: Threads = None,
    any_sensor: AnySensor = False,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Take the evidence of maps and logs out of another: see `HELP`."""
    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    maps = [source, *others]
    moves = moves_of(transform, shift, maps)
    logs = [path for path in others if path.exists() and not is_saved(path)]
    _check_options(logs, log_options, moved=bool(transform or shift))
    check_maps([*maps, *filter(None, log_options.files(*logs))], output, force=force)
    taken_out = LogsTakenOut(source, log_options, thread_count(threads), voice)
    unknown = 0

    def take_out(own: EvidenceMap, other: EvidenceMap) -> None:
        nonlocal unknown
        before = own.cell_count()
        own.subtract(other, any_sensor=any_sensor)
        unknown += before - own.cell_count()

    rest = combined(maps, voice, doubts_of_difference, take_out, moves, taken_out.map_log)
    taken_out.say_notes()
    said = f"left     of {source} without {', '.join(map(str, others))}"
    again = f"unknown  {unknown:,} cells again"
    facts = {
        "inputs": [str(path) for path in maps],
        "logs": taken_out.facts,
        "cells_unknown_again": unknown,
    }
    write_map(rest, output, said, facts, force=force, voice=voice, second=again)


def _check_options(logs: list[Path], options: LogOptions, *, moved: bool) -> None:
    """Refuse options that would not be looked at.

    Raises:
        ConfigError: there are some.
    """
    from oddsmap.errors import ConfigError

    if logs and moved:
        raise ConfigError(
            f"{logs[0]}: --transform and --shift move saved maps: build a map of the log, and "
            "subtract that"
        )
    if not logs and options != LogOptions():
        raise ConfigError("options of how a log is read need a log among what is taken out")
