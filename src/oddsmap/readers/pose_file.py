# SPDX-License-Identifier: Apache-2.0
"""Pose files: KITTI (12 numbers per row: 3 x 4, row-major) and TUM (`t x y z qx qy qz qw`).

Also 4 x 4 matrices, rows with one number more, and columns that a header names
(`pose_columns.py`), separated by blanks, commas or semicolons (`number_rows.py`). A pose that
cannot be used is an error with its line: a file of poses with one row left out would match the
wrong scans.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, DecimalException

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.number_rows import read_number_rows
from oddsmap.readers.plain_text import is_number, to_number
from oddsmap.readers.pose_columns import find_columns
from oddsmap.readers.pose_header import PoseColumns
from oddsmap.readers.stamp_words import MAX_STAMP_NS, kind_of_stamps, split_stamp_ns
from oddsmap.readers.text_table import Row, parse_numbers, parse_stamp_ns
from oddsmap.scans.note import Note

__all__ = ["PoseFile", "read_pose_file", "read_pose_matrix", "read_times", "read_trajectory"]

StampArray = npt.NDArray[np.int64]

# So many digits are nanoseconds since 1970 (from 2001 on), and never seconds.
_NANOSECOND_DIGITS = 19


@dataclass(frozen=True, slots=True)
class PoseFile:
    """What a file of poses holds.

    Args:
        trajectory: the poses.
        numbers: which scan each pose is of, where the rows are numbered.
        notes: what was assumed.
        oriented: the poses have rotations; where there are none, they are the identity.
        globe: positions are latitude and longitude [deg] and height [m].
    """

    trajectory: Trajectory
    numbers: tuple[int, ...] | None = None
    notes: tuple[Note, ...] = ()
    oriented: bool = True
    globe: bool = False


def read_trajectory(
    path: str | os.PathLike[str], *, times: str | os.PathLike[str] | None = None
) -> Trajectory:
    """Read a pose file: the trajectory of `read_pose_file`."""
    return read_pose_file(path, times=times).trajectory


def read_pose_file(
    path: str | os.PathLike[str],
    *,
    times: str | os.PathLike[str] | None = None,
    positions_do: bool = False,
    globe_does: bool = False,
) -> PoseFile:
    """Read a pose file.

    Args:
        path: KITTI or TUM poses.
        times: stamps of KITTI poses, one number of seconds per row; None: they have no stamps.
        positions_do: poses without a rotation will do, since points are in the map already.
        globe_does: so will latitudes, longitudes and heights, as they stand in the file.

    Raises:
        InputError: a row with another count of numbers, NaN, a quaternion that is not of unit
            length, a scaled or left-handed rotation, or another count of times than of poses; or
            poses without a rotation where that does not do.
    """
    name = os.fspath(path)
    table = read_number_rows(path)
    rows = table.rows
    if not rows:
        raise InputError(f"{name}: no poses: check how the file was written")
    columns = find_columns(rows, table.headers)
    _check_kind(name, columns, positions_do, globe_does)
    poses = [_read_pose(row, columns) for row in rows]
    trajectory = Trajectory(
        positions=np.array([pose.translation for pose in poses]),
        rotations=np.array([pose.rotation for pose in poses]),
        path=name,
    )
    notes: list[Note] = []
    if columns.said:
        notes.append(Note(f"{name}: {columns.said}", code="pose.columns"))
    oriented = columns.kind not in ("position", "globe")
    if not oriented:
        text = f"{name}: positions without rotations"
        notes.append(Note(text, code="pose.positions"))
    if columns.kind == "planar" and columns.named and not columns.degrees:
        _doubt_angles(name, [to_number(row.words[columns.pose[-1]]) for row in rows], notes)
    if columns.doubt:
        text = f"{name}: {columns.doubt}"
        notes.append(Note(text, code="pose.columns", severity="warning"))
    if columns.stamp is not None:
        if times is not None:
            raise InputError(f"{name}: has stamps of its own (TUM): leave {os.fspath(times)} out")
        words = [row.words[columns.stamp] for row in rows]
        if columns.nsecs is not None:
            stamps = _read_two_words(rows, columns.stamp, columns.nsecs)
        else:
            stamps = _read_stamps(rows, words, notes, columns.exponent)
        return PoseFile(
            trajectory.with_stamps(stamps),
            notes=tuple(notes),
            oriented=oriented,
            globe=columns.kind == "globe",
        )
    place = columns.index
    numbers = None if place is None else tuple(int(row.words[place]) for row in rows)
    if times is None:
        return PoseFile(trajectory, numbers, tuple(notes), oriented)
    stamps = read_times(times)
    if len(stamps) != len(poses):
        raise InputError(
            f"{os.fspath(times)}: {len(stamps)} times for the {len(poses)} poses of {name}: "
            "give the times of these poses"
        )
    return PoseFile(trajectory.with_stamps(stamps), numbers, tuple(notes), oriented)


def read_times(path: str | os.PathLike[str]) -> npt.NDArray[np.int64]:
    """Read a file of one time in seconds per row; returns nanoseconds, shape (n,).

    Raises:
        InputError: a row that is not one number, or no row at all.
    """
    rows = read_number_rows(path).rows
    if not rows:
        raise InputError(f"{os.fspath(path)}: no times: check how the file was written")
    for row in rows:
        if len(row.words) != 1:
            raise InputError(
                f"{row.where}: {len(row.words)} values: a row of times is one number of seconds"
            )
    return _read_stamps(rows, [row.words[0] for row in rows], [], 9)


def read_pose_matrix(path: str | os.PathLike[str]) -> Pose3:
    """Read a file that holds one pose as a 4 x 4 or 3 x 4 matrix.

    Raises:
        InputError: another count of numbers, NaN, or a scaled or left-handed rotation.
    """
    rows = read_number_rows(path).rows
    numbers = [number for row in rows for number in parse_numbers(row, row.words)]
    try:
        return Pose3.from_matrix(numbers)
    except InputError as error:
        raise InputError(f"{os.fspath(path)}: {error}") from None


def _read_pose(row: Row, columns: PoseColumns) -> Pose3:
    if len(row.words) != columns.count:
        raise InputError(
            f"{row.where}: {len(row.words)} numbers where the first pose has {columns.count}: "
            "check how the file was written"
        )
    if not columns.named:
        parse_numbers(row, row.words)
    pose = parse_numbers(row, [row.words[place] for place in columns.pose])
    if columns.kind in ("position", "globe"):
        return Pose3(np.array(pose), np.eye(3))
    if columns.kind == "planar":
        *place, angle = pose
        return _planar_pose(place, math.radians(angle) if columns.degrees else angle)
    try:
        if len(pose) == 7:
            return Pose3.from_quaternion_xyzw(pose[:3], pose[3:])
        return Pose3.from_matrix(pose)
    except InputError as error:
        raise InputError(f"{row.where}: {error}") from None


def _planar_pose(place: list[float], yaw: float) -> Pose3:
    """A pose in the plane, at z = 0 where there is none."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Pose3(np.array([*place, 0.0][:3]), turn)


def _doubt_angles(name: str, angles: list[float], notes: list[Note]) -> None:
    """Radians beyond a full turn come of turns that were counted; degrees look the same."""
    largest = max(map(abs, angles))
    if largest > 2 * math.pi + 0.1:
        text = f"{name}: angles of up to {largest:.4g} are taken for radians: if they are degrees, "
        text += "say so in the header, as theta [deg]"
        notes.append(Note(text, code="pose.degrees", severity="warning"))


def _check_kind(name: str, columns: PoseColumns, positions_do: bool, globe_does: bool) -> None:
    """Refuse what is no pose: a sensor that is somewhere looks somewhere, too."""
    if columns.kind == "globe" and not (globe_does and len(columns.pose) == 3):
        raise InputError(
            f"{name}: latitudes and longitudes, without rotations: a fix of GPS does not say where "
            "the sensor looks, which does only for LAS, and with heights; give poses in metres "
            "(x y z qx qy qz qw)"
        )
    if columns.kind == "position" and not positions_do:
        raise InputError(
            f"{name}: the columns are positions, x y z, without rotations (qx qy qz qw or theta), "
            "which do only for points that are in the map already (--points-in map, LAS): give "
            "whole poses"
        )


def _read_two_words(rows: Sequence[Row], seconds: int, nanoseconds: int) -> StampArray:
    """Stamps that are two whole numbers."""
    stamps = []
    for row in rows:
        words = row.words[seconds], row.words[nanoseconds]
        whole = all(word.isdecimal() and len(word) <= 10 for word in words)
        if not whole or int(words[0]) > MAX_STAMP_NS // 10**9 - 10:
            raise InputError(
                f"{row.where}: {' '.join(words)[:40]!r} is no stamp of seconds and nanoseconds"
            )
        stamps.append(int(words[0]) * 10**9 + int(words[1]))
    return np.array(stamps, np.int64)


def _read_stamps(
    rows: Sequence[Row], words: Sequence[str], notes: list[Note], exponent: int
) -> StampArray:
    """The stamps [ns] of rows: decimal seconds, unless all say that they are something else."""
    if exponent == 0 or all(len(w) == _NANOSECOND_DIGITS and w.isdecimal() for w in words):
        bad = next((i for i, w in enumerate(words) if not _fits_nanoseconds(w)), None)
        if bad is None:
            return np.array([int(word) for word in words], np.int64)
        raise InputError(
            f"{rows[bad].where}: {words[bad][:40]!r} is not a whole number of nanoseconds"
        )
    if exponent < 9:
        words = [_in_seconds(word, exponent) for word in words]
    elif kind_of_stamps(words) == "split":
        stamps = [split_stamp_ns(word) for word in words]
        if max(stamps) <= MAX_STAMP_NS:
            text = f"{rows[0].where.rpartition(':')[0]}: stamps are seconds.nanoseconds without"
            text += " the zeros between"
            notes.append(Note(text, code="stamp.split", severity="warning"))
            return np.array(stamps, np.int64)
    return np.array(
        [parse_stamp_ns(row, word) for row, word in zip(rows, words, strict=True)], np.int64
    )


def _in_seconds(word: str, exponent: int) -> str:
    """A stamp in 10^exponent nanoseconds, in seconds; what is no number is left, to be refused."""
    try:
        return str(Decimal(word).scaleb(exponent - 9)) if is_number(word) else word
    except DecimalException:
        return word


def _fits_nanoseconds(word: str) -> bool:
    return word.isdecimal() and len(word) <= _NANOSECOND_DIGITS and int(word) <= MAX_STAMP_NS
