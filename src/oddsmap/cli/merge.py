# SPDX-License-Identifier: Apache-2.0
"""`oddsmap merge`: the evidence of maps added up."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from oddsmap.cli.made_of_maps import AnySensor, MadeMap, check_maps, combined, write_map
from oddsmap.cli.map_moves import Shifts, Transforms, moves_of
from oddsmap.cli.merge_doubts import doubts_of_sum
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "merge"]

HELP = """Add up the evidence of maps, exactly and in any order.

\b
  oddsmap merge monday.zarr tuesday.zarr -o both.zarr
  oddsmap merge run*.zarr -o all.zarr --json
  oddsmap merge a.zarr b.zarr --transform "12 -3.5 1.570796" -o ab.zarr
                                          x y yaw of the frame of b.zarr in
                                          that of a.zarr
  oddsmap merge a.zarr b.zarr c.zarr --shift "4 0" --shift "0 9" -o abc.zarr

Of maps made with the same settings the sum is to the bit the map of all their
logs. Maps of another resolution, kind of votes, half-life or kind of sensor are
refused, with what to do. That maps share a frame cannot be seen from them: it
is up to you. Where they do not, the maps after the first are brought into its
frame: exactly by quarter turns with shifts of whole cells, else by the nearest
cell, and a warning says what that costs.
"""


def merge(
    maps: Annotated[
        list[Path], typer.Argument(metavar="MAP MAP...", help="Two or more saved maps (.zarr).")
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
    """Add up the evidence of maps: see `HELP`."""
    from oddsmap.errors import ConfigError

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    if len(maps) < 2:
        raise ConfigError(f"{maps[0]}: one map alone has nothing to be added to; give two or more")
    moves = moves_of(transform, shift, maps)
    check_maps(maps, output, force=force)
    total = combined(
        maps,
        voice,
        doubts_of_sum,
        lambda own, other: own.merge(other, any_sensor=any_sensor),
        moves,
    )
    said = f"merged   {len(maps)} maps"
    if any(moves):
        said += f", in the frame of {maps[0]}"
    facts = {"inputs": [str(path) for path in maps]}
    write_map(total, output, said, facts, force=force, voice=voice)
