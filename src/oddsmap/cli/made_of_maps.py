# SPDX-License-Identifier: Apache-2.0
"""What the commands that make a map of saved maps share: checks, reading, writing, words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.map_moves import moved
from oddsmap.cli.progress import working

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.poses.pose import Pose
    from oddsmap.scans.note import Note

__all__ = [
    "AnySensor",
    "MadeMap",
    "SavedMap",
    "check_maps",
    "combined",
    "is_saved",
    "read_map",
    "write_map",
]

SavedMap = Annotated[Path, typer.Argument(metavar="MAP", help="A saved map (.zarr).")]

MadeMap = Annotated[
    Path, typer.Option("-o", "--output", metavar="OUT.zarr", help="The map to write, a folder.")
]

AnySensor = Annotated[
    bool,
    typer.Option(
        "--any-sensor",
        help="Also maps of another kind of sensor; the first map's sensor model weighs all.",
    ),
]


def check_maps(inputs: Sequence[Path], output: Path, *, force: bool) -> None:
    """Check what is to be read and written.

    Raises:
        OddsmapError: see `oddsmap.cli.files`; or a map is given twice.
    """
    from oddsmap.cli.files import check_files, check_suffix
    from oddsmap.errors import ConfigError

    check_suffix(output, ("", ".zarr"), "a map is a Zarr folder, by custom NAME.zarr")
    seen: set[Path] = set()
    for path in inputs:
        if path.resolve() in seen:
            raise ConfigError(f"{path}: is given twice; its evidence would count twice")
        seen.add(path.resolve())
    check_files(inputs, output, force=force, is_map=True)


def is_saved(path: Path) -> bool:
    """Whether a path is a saved map, of which kind ever, and no log."""
    from oddsmap.map_files.zarr_snapshot import settled

    return (settled(path) / "zarr.json").is_file()


def read_map(path: Path, voice: Voice) -> EvidenceMap:
    """Read a saved map, showing that something goes on."""
    from oddsmap.evidence_map import load_map

    with working(f"reading {path.name}", quiet=voice.still):
        return load_map(path)


def combined(
    maps: list[Path],
    voice: Voice,
    doubts: Callable[[EvidenceMap, EvidenceMap], Iterator[Note]],
    combine: Callable[[EvidenceMap, EvidenceMap], None],
    moves: Sequence[Pose | None] | None = None,
    map_log: Callable[[EvidenceMap, Path], EvidenceMap] | None = None,
) -> EvidenceMap:
    """The first map with the others added or taken out, one in memory at a time beside it.

    Args:
        maps: saved maps; the others may be logs where `map_log` is given.
        voice: says what is doubtful.
        doubts: of the first map, as far as it is combined, and of the next.
        combine: changes the first map.
        moves: where the frame of each of the others lies in the first's; None: they are one.
        map_log: the evidence of a log, as the first map has it.

    Raises:
        OddsmapError: two do not fit; both are named.
    """
    from oddsmap.errors import OddsmapError

    first, *others = maps
    total = read_map(first, voice)
    for path, move in zip(others, moves or [None] * len(others), strict=True):
        found: list[Note] = []
        if map_log is not None and not is_saved(path):
            other = map_log(total, path)
        else:
            other, found = moved(path, read_map(path, voice), move, voice)
        found += doubts(total, other)
        try:
            combine(total, other)
        except OddsmapError as error:
            raise type(error)(f"{path} and {first}: {error}") from None
        for doubt in found:
            voice.note(path, doubt)
    return total


def write_map(
    grid: EvidenceMap,
    output: Path,
    first: str,
    facts: dict[str, Any],
    *,
    force: bool,
    voice: Voice,
    second: str | None = None,
) -> None:
    """Save a map and say what it is.

    Args:
        grid: the map.
        output: the folder to write.
        first: the first line of what is said.
        facts: the same for programs.
        force: whether to replace an existing map.
        voice: says it.
        second: another line of it.
    """
    from oddsmap.cli.summary import facts_of, lines_of_map

    with working(f"saving {output.name}", quiet=voice.still):
        grid.save(output, force=force)
    facts = {**facts_of(grid, output), **facts}
    voice.facts(facts)
    voice.say(first)
    if second is not None:
        voice.say(second)
    for line in lines_of_map(facts):
        voice.say(line)
