# SPDX-License-Identifier: Apache-2.0
"""`oddsmap crop`: the part of a map that lies in a box."""

from __future__ import annotations

from typing import Annotated

import typer

from oddsmap.cli.made_of_maps import MadeMap, SavedMap, check_maps, write_map
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "crop"]

HELP = """Keep the part of a map that lies in a box of metres; only that part is read.

\b
  oddsmap crop site.zarr --box "0 0 40 25" -o hall.zarr
  oddsmap crop town.zarr --box "-20 -20 0 20 20 3" -o street.zarr
                                          3D: x y z of two corners

A cell belongs to the box if its centre does: boxes side by side share none.
"""


def crop(
    source: SavedMap,
    box: Annotated[
        str,
        typer.Option(
            metavar="'X0 Y0 X1 Y1'",
            help="Lowest and highest corner [metres]; of a 3D map six numbers, x y z of each.",
        ),
    ],
    output: MadeMap,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Keep the part of a map that lies in a box: see `HELP`."""
    from oddsmap.cli.map_regions import corners_of, read_part

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    lo, hi = corners_of(box)
    check_maps([source], output, force=force)
    with working(f"reading {source.name}", quiet=voice.still):
        part = read_part(source, box=box)
    said = f"cropped  {' x '.join(f'{b - a:g}' for a, b in zip(lo, hi, strict=True))} metres"
    write_map(part, output, said, {"input": str(source)}, force=force, voice=voice)
