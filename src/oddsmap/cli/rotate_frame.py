# SPDX-License-Identifier: Apache-2.0
"""`oddsmap rotate-frame`: a map with other axes."""

from __future__ import annotations

from typing import Annotated

import typer

from oddsmap.cli.made_of_maps import MadeMap, SavedMap, check_maps, read_map, write_map
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "rotate_frame"]

HELP = """Turn a map by quarter turns, so that its axes point elsewhere; exactly.

\b
  oddsmap rotate-frame chess.zarr --up=-y -o level.zarr
                                          y points down: -y is to point up
  oddsmap rotate-frame chess.zarr --axes "z -x -y" -o level.zarr
                                          a camera's frame (x right, y down,
                                          z forward) to x forward, z up
  oddsmap rotate-frame hall.zarr --axes "y -x" -o turned.zarr

--axes names the old axis that each new one is, in order. With --up x stays, or y
where x is to point up. Cells go to whole cells: turning back gives the same map.
"""


def rotate_frame(
    source: SavedMap,
    output: MadeMap,
    up: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS",
            help="The axis that is to point up, such as -y; by default as --axes says.",
        ),
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(
            metavar="'X Y Z'", help="The old axis that each new one is; by default as --up says."
        ),
    ] = None,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Turn a map by quarter turns: see `HELP`."""
    from oddsmap.errors import ConfigError, OddsmapError
    from oddsmap.evidence.store import read_empty
    from oddsmap.evidence_map import EvidenceMap

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    if (up is None) == (axes is None):
        raise ConfigError('say which way with one of the two: --up=-y, or --axes "z -x -y"')
    check_maps([source], output, force=force)
    try:
        read_empty(source, EvidenceMap).rotated(axes, up=up)  # refuses before anything is read
        grid = read_map(source, voice)
        with working(f"turning {source.name}", quiet=voice.still):
            turned = grid.rotated(axes, up=up)
    except OddsmapError as error:
        raise type(error)(f"{source}: {error}") from None
    new = str(turned.provenance[-1]["rotated"])
    facts = {"input": str(source), "rotated": new}
    names = ", ".join(f"{name} was {old}" for name, old in zip("xyz", new.split(), strict=False))
    write_map(turned, output, f"turned   {names}", facts, force=force, voice=voice)
