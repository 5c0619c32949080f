# SPDX-License-Identifier: Apache-2.0
"""`--transform` and `--shift`: where the frames of maps lie in that of the first."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.poses.pose import Pose
    from oddsmap.scans.note import Note

__all__ = ["Shifts", "Transforms", "moved", "moves_of"]

Transforms = Annotated[
    list[str] | None,
    typer.Option(
        "--transform",
        metavar="'X Y YAW'",
        help="Where the frame of the maps after the first lies in the first's [metres, radians], "
        "or X Y Z QX QY QZ QW; for all, or may be repeated, once a map in their order; by default "
        "their frames are one.",
    ),
]

Shifts = Annotated[
    list[str] | None,
    typer.Option(
        "--shift",
        metavar="'X Y [Z]'",
        help="Likewise without a turn [metres]; may be repeated as --transform.",
    ),
]


def moves_of(
    transforms: Sequence[str] | None, shifts: Sequence[str] | None, maps: Sequence[Path]
) -> list[Pose | None]:
    """How each map after the first is to be moved, as the options say; None: it stays.

    Raises:
        ConfigError: both options are given, neither once nor once a map, or what they say is no
            pose.
    """
    from oddsmap.errors import ConfigError

    others = len(maps) - 1
    if not transforms and not shifts:
        return [None] * others
    if transforms and shifts:
        raise ConfigError(
            "--transform and --shift do not say together which map each is for: write a shift as a "
            'transform without a turn, --transform "x y 0"'
        )
    option, given = ("--transform", transforms) if transforms else ("--shift", shifts or [])
    if len(given) not in (1, others):
        raise ConfigError(
            f"{option} is given {len(given)} times, and the maps after the first, whose frame "
            f"stands, are {others}: once for all, or once for each in their order (0 where one "
            "stays)"
        )
    read = _transform if transforms else _shift
    poses: list[Pose | None] = [read(text) for text in given]
    return poses if len(poses) == others else poses * others


def _transform(text: str) -> Pose:
    from oddsmap.errors import ConfigError, InputError
    from oddsmap.poses.pose import Pose2, Pose3

    numbers = _numbers(text)
    if len(numbers) == 3:
        return Pose2(*numbers)
    if len(numbers) != 7:
        raise ConfigError(
            f'--transform "{text}": needs the numbers x y yaw [metres, radians], or in space x y z '
            "qx qy qz qw"
        )
    try:
        return Pose3.from_quaternion_xyzw(numbers[:3], numbers[3:])
    except InputError as error:
        raise ConfigError(f'--transform "{text}": {error}') from None


def _shift(text: str) -> Pose:
    import numpy as np

    from oddsmap.errors import ConfigError
    from oddsmap.poses.pose import Pose2, Pose3

    numbers = _numbers(text)
    if len(numbers) == 2:
        return Pose2(numbers[0], numbers[1], 0.0)
    if len(numbers) != 3:
        raise ConfigError(f'--shift "{text}": needs the numbers x y [metres], or in space x y z')
    return Pose3(np.array(numbers), np.eye(3))


def _numbers(text: str) -> list[float]:
    """The finite numbers of a text; none where it has others."""
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def moved(
    path: Path, grid: EvidenceMap, pose: Pose | None, voice: Voice
) -> tuple[EvidenceMap, list[Note]]:
    """A map in the first one's frame, and what to know of it.

    Args:
        path: where it is from.
        grid: the map.
        pose: of its frame in the first map's; None: they are one.
        voice: shows that something goes on.

    Raises:
        OddsmapError: it cannot be moved so; the map is named.
    """
    from oddsmap.cli.progress import working
    from oddsmap.errors import OddsmapError
    from oddsmap.scans.note import Note

    if pose is None:
        return grid, []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            with working(f"moving {path.name}", quiet=voice.still):
                grid = grid.transformed(pose)
        except OddsmapError as error:
            raise type(error)(f"{path}: {error}") from None
    doubts = [
        Note(str(doubt.message), code="merge.between_cells", severity="warning") for doubt in caught
    ]
    return grid, doubts
