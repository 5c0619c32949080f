# SPDX-License-Identifier: Apache-2.0
"""`oddsmap subtract`: the evidence of maps taken out of another again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from oddsmap.cli.made_of_maps import AnySensor, MadeMap, SavedMap, check_maps, combined, write_map
from oddsmap.cli.map_moves import Shifts, Transforms, moves_of
from oddsmap.cli.merge_doubts import doubts_of_difference
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "subtract"]

HELP = """Take the evidence of maps out of another again, exactly: what merge did, undone.

\b
  oddsmap subtract all.zarr tuesday.zarr -o rest.zarr

A cell that has less than is to be taken out of it is an error: then the evidence was never added.
With --transform or --shift as in the merge, maps that were moved are taken out.
"""


def subtract(
    source: SavedMap,
    others: Annotated[
        list[Path], typer.Argument(metavar="OTHER...", help="What is to be taken out of it.")
    ],
    output: MadeMap,
    transform: Transforms = None,
    shift: Shifts = None,
    any_sensor: AnySensor = False,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Take the evidence of maps out of another: see `HELP`."""
    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    maps = [source, *others]
    moves = moves_of(transform, shift, maps)
    check_maps(maps, output, force=force)
    rest = combined(
        maps,
        voice,
        doubts_of_difference,
        lambda own, other: own.subtract(other, any_sensor=any_sensor),
        moves,
    )
    said = f"left     of {source} without {', '.join(map(str, others))}"
    facts = {"inputs": [str(path) for path in maps]}
    write_map(rest, output, said, facts, force=force, voice=voice)
