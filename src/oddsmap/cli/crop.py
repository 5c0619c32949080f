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
    from oddsmap.cell_index import box_cells
    from oddsmap.errors import InputError
    from oddsmap.evidence.store import read_empty
    from oddsmap.evidence_map import EvidenceMap, load_map

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    lo, hi = _corners(box)
    check_maps([source], output, force=force)
    like = read_empty(source, EvidenceMap)
    if len(lo) != like.ndim:
        raise InputError(
            f"{source}: is a {like.ndim}D map, whose box has {2 * like.ndim} numbers; --box has "
            f"{2 * len(lo)}"
        )
    first, past = box_cells(lo, hi, like.resolution, like.ndim)
    with working(f"reading {source.name}", quiet=voice.still):
        part = load_map(source, lo=first, hi=past)
    if part.cell_count() == 0:
        raise InputError(
            f"{source}: no evidence in the box {box}; oddsmap info says how far the map reaches"
        )
    said = f"cropped  {' x '.join(f'{b - a:g}' for a, b in zip(lo, hi, strict=True))} metres"
    write_map(part, output, said, {"input": str(source)}, force=force, voice=voice)


def _corners(box: str) -> tuple[list[float], list[float]]:
    """The two corners that --box says.

    Raises:
        ConfigError: it is no four or six numbers, or the corners are not in order.
    """
    from oddsmap.errors import ConfigError

    try:
        numbers = [float(word) for word in box.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) not in (4, 6):
        raise ConfigError(
            f'--box {box}: four numbers [metres] are needed, as in --box "0 0 40 25" (x0 y0 x1 '
            "y1), or six for a 3D map (x0 y0 z0 x1 y1 z1)"
        )
    lo, hi = numbers[: len(numbers) // 2], numbers[len(numbers) // 2 :]
    if not all(a < b for a, b in zip(lo, hi, strict=True)):
        raise ConfigError(f"--box {box}: the lowest corner comes first, then the highest")
    return lo, hi
