# SPDX-License-Identifier: Apache-2.0
"""Which pose belongs to which scan of a folder: by stamp where there are stamps, else by order.

Nothing is guessed: by order, the counts must be equal; by stamp, a pose must be within the
tolerance. By the numbers in the names of the scans where the poses are numbered, or where a part of
a sequence is left of the scans. In a folder, poses and times are looked for under the names below.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.at_times import PoseTrack
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory
from oddsmap.readers.options import FilePath, ReadOptions
from oddsmap.readers.pose_file import PoseFile, read_pose_file, read_times
from oddsmap.readers.stamp_words import kind_of_stamps, split_stamp_ns
from oddsmap.scans.note import Note

__all__ = [
    "POSE_NAMES",
    "TIMES_NAME",
    "PoseMatch",
    "find_poses",
    "match_poses",
    "natural_key",
    "sorted_by_name",
    "stated_poses",
]

POSE_NAMES = ("poses.txt", "poses_kitti.txt", "poses_tum.txt", "groundtruth.txt")
TIMES_NAME = "times.txt"

StampArray = npt.NDArray[np.int64]

_DECIMAL = re.compile(r"[0-9]+\.[0-9]+")
_NANOSECOND_DIGITS = 19


@dataclass(frozen=True, slots=True, eq=False)
class PoseMatch:
    """The pose of the sensor and the stamp for each scan, by number."""

    map_from_sensor: Callable[[int], Pose3]
    stamps_ns: StampArray | None
    notes: tuple[Note, ...] = ()
    track: PoseTrack | None = None
    """The poses over time, where they have stamps: those of the body, as they stand in the file."""

    def stamp_ns(self, i: int) -> int | None:
        """The stamp of a scan [ns]."""
        return None if self.stamps_ns is None else int(self.stamps_ns[i])


def find_poses(folder: Path) -> FilePath | None:
    """The file of poses in a folder.

    Raises:
        InputError: there are several.
    """
    found = [folder / name for name in POSE_NAMES if (folder / name).is_file()]
    if len(found) > 1:
        names = " and ".join(path.name for path in found)
        raise InputError(f"{folder}: poses in {names}: say which with --poses (poses=)")
    return found[0] if found else None


def match_poses(
    path: str,
    names: Sequence[str],
    poses: FilePath | Trajectory | PoseFile,
    times: FilePath | None,
    options: ReadOptions,
    *,
    stamps_ns: StampArray | None = None,
) -> PoseMatch:
    """Match poses to scans.

    Args:
        path: what messages start with.
        names: file name of each scan.
        poses: the poses, or their file.
        times: a file with the stamp of each scan, or of each pose.
        options: extrinsics and tolerance.
        stamps_ns: stamp of each scan [ns] where the log itself has them, shape (n,).

    Raises:
        InputError: counts that do not fit, or a file that cannot be read.
    """
    n = len(names)
    file = poses if isinstance(poses, PoseFile) else stated_poses(poses, options)
    trajectory, rows = file.trajectory, _rows_of_scans(names, file)
    read = None if times is None else read_times(times)
    stamps = stamps_ns
    if read is not None and len(read) == n:
        stamps = read
    elif stamps is None:
        stamps = stamps_from_names(path, names)
    if read is not None and len(read) != n:
        of_poses = len(read) == len(trajectory) and trajectory.stamps_ns is None
        if not of_poses or (stamps is None and rows is None):
            raise InputError(
                f"{path}: {os.fspath(times or '')} has {len(read)} times for {n} scans: "
                "give one time for each scan"
            )
        trajectory = trajectory.with_stamps(read)
    if trajectory.stamps_ns is not None and stamps is not None:
        scan_stamps = stamps
        return PoseMatch(
            lambda i: options.sensor_pose(trajectory.at(int(scan_stamps[i]), options.tolerance_ns)),
            stamps,
            file.notes,
            PoseTrack(trajectory),
        )
    if rows is not None:
        return _by_number(names, file, rows, trajectory, stamps, options)
    return _by_order(path, file, n, stamps, options)


def stated_poses(
    poses: FilePath | Trajectory, options: ReadOptions, *, globe_does: bool = False
) -> PoseFile:
    """The poses that the caller gives, or those of the file; `globe_does` as in `read_pose_file`.

    Raises:
        InputError: a file that cannot be read, or without rotations where they are needed.
    """
    if isinstance(poses, Trajectory):
        return PoseFile(poses)
    file = read_pose_file(poses, positions_do=options.points_in == "map", globe_does=globe_does)
    mounted = options.body_from_sensor
    if not file.oriented and mounted is not None and mounted.translation.any():
        raise InputError(
            f"{os.fspath(poses)}: positions without rotations do not say where a sensor beside "
            "them was: leave body_from_sensor (--body-from-sensor) out, or give whole poses"
        )
    return file


def _by_number(
    names: Sequence[str],
    file: PoseFile,
    rows: list[int | None],
    trajectory: Trajectory,
    stamps: StampArray | None,
    options: ReadOptions,
) -> PoseMatch:
    """The pose of the number that a scan has in its name."""
    notes = file.notes
    if file.numbers is None:
        text = (
            f"{len(names)} of {len(trajectory)} poses are used: those of the numbers in the names "
            "of the scans, of which 0 is the first"
        )
        notes = (*notes, Note(text, code="pose.by_number", severity="warning"))
    if stamps is None and trajectory.stamps_ns is not None and None not in rows:
        stamps = trajectory.stamps_ns[[row for row in rows if row is not None]]

    def pose_of(i: int) -> Pose3:
        row = rows[i]
        if row is None:
            raise NoPoseError(
                f"{trajectory.path}: no pose of the number of {names[i]}: "
                "leave this scan out, or use --skip-bad (skip_bad=True)"
            )
        return options.sensor_pose(trajectory[row])

    return PoseMatch(pose_of, stamps, notes)


def _by_order(
    path: str, file: PoseFile, n: int, stamps: StampArray | None, options: ReadOptions
) -> PoseMatch:
    """One pose for each scan."""
    trajectory, notes = file.trajectory, file.notes
    stamped = trajectory.stamps_ns is not None
    if len(trajectory) != n:
        hint = (
            "give one time for each scan with times="
            if stamped
            else "scans and poses without stamps match one to one"
        )
        raise InputError(
            f"{path}: {n} scans and {len(trajectory)} poses in {trajectory.path}: {hint}"
        )
    if stamped:
        text = "the scans have no stamps: poses are taken in their order, one per scan"
        notes = (*notes, Note(text, code="pose.by_order", severity="warning"))
    own = trajectory.stamps_ns if stamps is None else stamps
    return PoseMatch(
        lambda i: options.sensor_pose(trajectory[i]),
        own,
        notes,
        None if own is None else PoseTrack(trajectory.with_stamps(own)),
    )


def _rows_of_scans(names: Sequence[str], file: PoseFile) -> list[int | None] | None:
    """Which pose each scan has by the number that is its name; None where order decides.

    Poses that are numbered are of the scans of these numbers. Of poses that are not, there must be
    more than scans, as where a part of a sequence was copied, and one for each number.
    """
    stems = [name.split(".", 1)[0] for name in names]
    if not all(stem.isdecimal() and len(stem) <= 18 for stem in stems):
        return None
    numbers = [int(stem) for stem in stems]
    if file.numbers is not None:
        of_number = {number: row for row, number in enumerate(file.numbers)}
        return [of_number.get(number) for number in numbers]
    if file.trajectory.stamps_ns is not None or len(set(numbers)) != len(numbers):
        return None
    count = len(file.trajectory)
    return list(numbers) if len(numbers) < count and max(numbers) < count else None


def sorted_by_name(names: Sequence[str]) -> list[str]:
    """File names in the order of their times or numbers: scan2 before scan10, 9.25 before 9.5."""
    split = kind_of_stamps([_stem(name) for name in names]) == "split"
    return sorted(names, key=lambda name: natural_key(name, split=split))


def natural_key(name: str, *, split: bool = False) -> tuple[object, ...]:
    """Sort key by which scan2 comes before scan10, and 9.5 before 9.25 does not.

    Args:
        name: a file name.
        split: 9.5 is 9 seconds and 5 nanoseconds, and 9.25 comes after it.
    """
    stem = _stem(name)
    if _DECIMAL.fullmatch(stem):
        return (0, Decimal(split_stamp_ns(stem)) if split else Decimal(stem), name)
    parts = re.split(r"(\d+)", name)
    return (1, tuple(_part_key(part) for part in parts), name)


def stamps_from_names(path: str, names: Sequence[str]) -> StampArray | None:
    """Stamps [ns] of files that are named by them: seconds with a decimal point, 12.345.pcd.

    Whole numbers are not taken for times, 000012.pcd is the scan of number 12, unless all have the
    19 digits of nanoseconds since 1970.

    Raises:
        InputError: it cannot be told whether fractions or nanoseconds follow the point.
    """
    stems = [_stem(name) for name in names]
    if all(stem.isdecimal() and len(stem) == _NANOSECOND_DIGITS for stem in stems):
        return _as_stamps([int(stem) for stem in stems])
    if not all(_DECIMAL.fullmatch(stem) for stem in stems):
        return None
    kind = kind_of_stamps(stems)
    if kind == "unclear":
        raise InputError(
            f"{path}: the names of the scans ({names[0]}) are decimal seconds, or seconds and "
            "nanoseconds without the zeros between: say the stamp of each with --times (times=)"
        )
    if kind == "split":
        return _as_stamps([split_stamp_ns(stem) for stem in stems])
    return _as_stamps([int(Decimal(stem).scaleb(9)) for stem in stems])


def _as_stamps(stamps: list[int]) -> StampArray | None:
    return np.array(stamps, np.int64) if max(stamps) < 2**63 else None


def _stem(name: str) -> str:
    return name.rsplit(".", 1)[0]


def _part_key(part: str) -> tuple[int, int, str]:
    """Digits as their number, before other text; Python refuses to read thousands of them."""
    return (0, int(part), "") if part.isdecimal() and len(part) < 1000 else (1, 0, part)
