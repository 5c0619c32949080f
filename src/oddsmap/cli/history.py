# SPDX-License-Identifier: Apache-2.0
"""`oddsmap history`: a map that is kept with all that it was, in an Icechunk repository."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.made_of_maps import AnySensor, check_maps, read_map, write_map
from oddsmap.cli.options import Quiet, Verbose, force_option, json_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.evidence.history_log import MapCommit
    from oddsmap.evidence.map_history import MapHistory
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.note import Note

__all__ = ["HELP", "history"]

HELP = """Keep a map with all that it was: each addition is a commit.

\b
  oddsmap history city.icechunk --add monday.zarr -m "first drive"
  oddsmap build tuesday.log -o city.icechunk --append
                                          a log, by the map's settings
  oddsmap history city.icechunk                   what was done, newest first
  oddsmap history city.icechunk --at 2026-11-24 -o then.zarr
                                          the map as it was that evening
  oddsmap history city.icechunk --subtract monday.zarr
                                          taken out; --at still has it

The first addition makes the Icechunk repository, with the map's settings. Any number of processes
may add at the same time: each addition is there as a whole or not at all, and the sum is exact.
Needs the extra: pip install "oddsmap[icechunk]".
"""


def history(
    place: Annotated[
        Path, typer.Argument(metavar="REPOSITORY", help="The repository, a folder (.icechunk).")
    ],
    add: Annotated[
        Path | None,
        typer.Option(metavar="MAP.zarr", help="Add a saved map, as one commit [default: none]."),
    ] = None,
    subtract: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP.zarr", help="Take a saved map out again, as one commit [default: none]."
        ),
    ] = None,
    message: Annotated[
        str | None,
        typer.Option(
            "-m", "--message", help="What to say with the commit [default: the names of the logs]."
        ),
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="WHEN",
            help="The state to write: a date (to its end) or time, in UTC where it has no offset, "
            "or a commit's id or how it begins [default: the newest].",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT.zarr",
            help="Write a state as a saved map, a folder [default: none; commits are listed].",
        ),
    ] = None,
    any_sensor: AnySensor = False,
    force: Annotated[bool, force_option("an existing map")] = False,
    as_json: Annotated[bool, json_option("what is said")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Keep a map with all that it was: see `HELP`."""
    from oddsmap.evidence_map import EvidenceMap

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    changed = add or subtract
    _check(add, subtract, output, committed=bool(message or any_sensor), at=at, force=force)
    kept = EvidenceMap.history(place)
    if output is not None:
        check_maps([], output, force=force)
        with working(f"reading {place.name}", quiet=voice.still):
            commit = kept.commit(at)
            grid = kept.load(commit.id)
        facts = {"input": str(place), **_facts(commit)}
        write_map(grid, output, _line(commit), facts, force=force, voice=voice)
    elif changed is not None:
        commit = _committed(
            kept, changed, message, voice, any_sensor=any_sensor, out=changed == subtract
        )
        voice.facts({"output": str(place), "input": str(changed), **_facts(commit)})
        voice.say(_line(commit))
    else:
        commits = kept.log()
        voice.facts({"input": str(place), "commits": [_facts(each) for each in commits]})
        for commit in commits:
            voice.say(_line(commit))


def _check(
    add: Path | None,
    subtract: Path | None,
    output: Path | None,
    *,
    committed: bool,
    at: str | None,
    force: bool,
) -> None:
    """Refuse options that do not go together, or would not be looked at.

    Raises:
        OddsmapError: there are some, or the map is not there.
    """
    from oddsmap.cli.files import check_files
    from oddsmap.errors import ConfigError

    if sum(each is not None for each in (add, subtract, output)) > 1:
        raise ConfigError("--add, --subtract and -o are one step each: give them one by one")
    if (at is not None or force) and output is None:
        raise ConfigError("--at and --force are for the map that -o writes: give -o OUT.zarr")
    if committed and add is None and subtract is None:
        raise ConfigError("-m and --any-sensor are for what --add or --subtract commits")
    check_files([add, subtract], force=False)


def _committed(
    kept: MapHistory[EvidenceMap],
    source: Path,
    message: str | None,
    voice: Voice,
    *,
    any_sensor: bool,
    out: bool,
) -> MapCommit:
    from oddsmap.cli.merge_doubts import doubts_of_difference, doubts_of_sum
    from oddsmap.errors import InputError

    grid = read_map(source, voice)
    do, doubts = (kept.subtract, doubts_of_difference) if out else (kept.add, doubts_of_sum)
    found: list[Note] = []
    with suppress(InputError):  # there is no map yet; what else it may be committing says, too
        found += doubts(kept.like(), grid)
    with working(f"committing to {kept.name}", quiet=voice.still) as say:
        try:
            commit = do(
                grid,
                message,
                any_sensor=any_sensor,
                waiting=lambda: say(f"waiting for another run that commits to {kept.name}"),
            )
        except InputError as error:
            raise InputError(f"{source} and {error}") from None
    for doubt in found:
        voice.note(source, doubt)
    return commit


def _facts(commit: MapCommit) -> dict[str, Any]:
    return {**commit._asdict(), "time": commit.time.isoformat()}


def _line(commit: MapCommit) -> str:
    return f"{commit.id}  {commit.time:%Y-%m-%d %H:%M:%SZ}  {' '.join(commit.message.split())}"
