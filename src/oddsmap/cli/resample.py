# SPDX-License-Identifier: Apache-2.0
"""`oddsmap resample`: a map of larger cells."""

from __future__ import annotations

from typing import Annotated

import typer

from oddsmap.cli.made_of_maps import MadeMap, SavedMap, check_maps, read_map, write_map
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "resample"]

HELP = """Make a map of larger cells, each with the evidence of those that lie in it.

\b
  oddsmap resample fine.zarr --resolution 0.2 -o coarse.zarr

The new resolution is a whole multiple of the map's; the sums are exact. A large
cell has more votes than one that was mapped at that resolution, where a scan or
a beam votes once for it: map the log again where probabilities matter.
"""


def resample(
    source: SavedMap,
    resolution: Annotated[
        float,
        typer.Option(
            "--resolution",
            metavar="METRES",
            help="Side of the new cells, a whole multiple of the map's.",
        ),
    ],
    output: MadeMap,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Make a map of larger cells: see `HELP`."""
    from oddsmap.errors import ConfigError, OddsmapError
    from oddsmap.evidence.arithmetic import factor_of
    from oddsmap.evidence.store import read_empty
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.note import Note

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    check_maps([source], output, force=force)
    own = read_empty(source, EvidenceMap).resolution
    try:
        if (factor := factor_of(own, resolution)) == 1:
            raise ConfigError(f"the map has cells of {own:g} m already")
        fine = read_map(source, voice)
        with working(f"adding up {source.name}", quiet=voice.still):
            coarse = fine.resample(resolution)
    except OddsmapError as error:
        raise type(error)(f"{source}: {error}") from None
    note = (
        f"a cell has the votes of {factor**fine.ndim} cells, hits and passes together, so its "
        "probability is more extreme than that of a cell mapped at this resolution"
    )
    voice.note(output, Note(note, code="map.resampled"))
    said = f"summed   cells of {own:g} m, {factor} along each side"
    facts = {"input": str(source), "resampled_from": own}
    write_map(coarse, output, said, facts, force=force, voice=voice)
