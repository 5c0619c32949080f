# SPDX-License-Identifier: Apache-2.0
"""Which numbers of a row are its pose, its stamp, its number.

By the names in a header where there is one that names them all; else by their count. 9, 13 and 17
numbers are 8, 12 or 16 with one more at either end: rotations show which, or it is an error.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.readers.plain_text import is_number, to_number
from oddsmap.readers.text_table import Row

__all__ = ["PoseColumns", "find_columns"]

FloatArray = npt.NDArray[np.float64]

_KITTI, _MATRIX, _TUM = 12, 16, 8
_TOLERANCE = 1e-3

# A number this large is seconds since 1970, not the number of a scan.
_MAX_INDEX = 10**8

_STAMP = re.compile(r"t|times?|(time)?stamp|secs?|seconds|time_?stamp_?n?s?|time_?n?s")
_POSITION = re.compile(
    r"(?:t_?|p_?|.*position[._]?|pos[._]?|.*trans(?:lation)?[._]?|p_rs_r_)?([xyz])"
)
_ROTATION = re.compile(
    r"(?:q_?|.*orientation[._]?|.*rotation[._]?|.*quat(?:ernion)?[._]?|q_rs_)([xyzw])"
)
_UNIT = re.compile(r"\s*[\[(](.*?)[\])]\s*$")


@dataclass(frozen=True, slots=True)
class PoseColumns:
    """Places in a row.

    Args:
        count: how many numbers a row has.
        pose: 12 or 16 places of a matrix, row-major, or 7 of x y z qx qy qz qw.
        stamp: place of the stamp, or None.
        index: place of the number of the scan, or None.
        nanoseconds: stamps are whole nanoseconds, by the header.
        doubt: what was assumed, in words; empty where nothing was.
    """

    count: int
    pose: tuple[int, ...]
    stamp: int | None = None
    index: int | None = None
    nanoseconds: bool = False
    doubt: str = ""


def find_columns(rows: Sequence[Row], headers: Sequence[Sequence[str]]) -> PoseColumns:
    """Decide what the numbers of the rows are.

    Args:
        rows: at least one.
        headers: lines that may name the columns.

    Raises:
        InputError: it cannot be told.
    """
    count = len(rows[0].words)
    for header in reversed(headers):
        named = _by_names(header, count)
        if named is not None:
            return named
    if count == _KITTI:
        return PoseColumns(count, tuple(range(count)))
    if count == _TUM:
        return PoseColumns(count, tuple(range(1, count)), stamp=0)
    if count == _MATRIX:
        _check_matrices(rows)
        return PoseColumns(count, tuple(range(count)))
    found = _with_one_more(rows, count) if count in (_TUM + 1, _KITTI + 1, _MATRIX + 1) else None
    if found is not None:
        return found
    raise InputError(
        f"{rows[0].where}: {count} numbers: a pose has {_KITTI} (KITTI: 3 x 4, row-major) or "
        f"{_TUM} (TUM: t x y z qx qy qz qw); for others write a header that names the columns"
    )


def _by_names(header: Sequence[str], count: int) -> PoseColumns | None:
    """The places that a header gives; None where it does not name a whole pose."""
    places: dict[str, int] = {}
    nanoseconds = False
    for place, name in enumerate(header):
        unit = _UNIT.search(name)
        plain = _UNIT.sub("", name).strip().lower()
        if rotation := _ROTATION.fullmatch(plain):
            key = "q" + rotation[1]
        elif position := _POSITION.fullmatch(plain):
            key = position[1]
        elif _STAMP.fullmatch(plain):
            key = "t"
            nanoseconds = plain.endswith("ns") or (unit is not None and unit[1] == "ns")
        else:
            continue
        if key in places:
            return None
        places[key] = place
    wanted = [places.get(key) for key in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    pose = tuple(place for place in wanted if place is not None)
    if len(pose) != len(wanted) or len(header) > count:
        return None
    return PoseColumns(count, pose, stamp=places.get("t"), nanoseconds=nanoseconds)


def _with_one_more(rows: Sequence[Row], count: int) -> PoseColumns | None:
    """A pose with a number before or behind it, where the rotations leave one of the two."""
    if any(len(row.words) != count or not all(map(is_number, row.words)) for row in rows):
        return None
    table = np.array([[to_number(word) for word in row.words] for row in rows])
    if count == _TUM + 1:
        before, behind = _are_unit(table[:, 5:]), _are_unit(table[:, 4:8])
        pose, plain = tuple(range(2, count)), tuple(range(1, count - 1))
        indexed = _are_indices(rows)
        if before and indexed and not behind:
            doubt = "the first of 9 numbers is taken for the number of the pose and not used"
            return PoseColumns(count, pose, stamp=1, doubt=doubt)
        if behind and not (before and indexed):
            doubt = "the last of 9 numbers is not read"
            return PoseColumns(count, plain, stamp=0, doubt=doubt)
        return None
    rotations: Callable[[FloatArray], bool] = _are_rotations
    before, behind = rotations(table[:, 1:]), rotations(table[:, :-1])
    if before and not behind:
        pose = tuple(range(1, count))
        if _are_indices(rows):
            doubt = f"the first of {count} numbers is taken for the number of the scan"
            return PoseColumns(count, pose, index=0, doubt=doubt)
        doubt = f"the first of {count} numbers is taken for the stamp"
        return PoseColumns(count, pose, stamp=0, doubt=doubt)
    if behind and not before:
        doubt = f"the last of {count} numbers is not read"
        return PoseColumns(count, tuple(range(count - 1)), doubt=doubt)
    return None


def _are_indices(rows: Sequence[Row]) -> bool:
    """Whether the first words are whole numbers that grow, as those of scans do."""
    words = [row.words[0] for row in rows]
    if not all(word.isdecimal() and len(word) <= 9 for word in words):
        return False
    numbers = [int(word) for word in words]
    return numbers[-1] < _MAX_INDEX and all(np.diff(numbers) > 0)


def _are_unit(quaternions: FloatArray) -> bool:
    return bool((np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) <= _TOLERANCE).all())


def _are_rotations(matrices: FloatArray) -> bool:
    """Whether rows of 12 or 16 numbers are rigid motions, row-major."""
    if matrices.shape[1] == _MATRIX and not (matrices[:, 12:] == [0.0, 0.0, 0.0, 1.0]).all():
        return False
    r = matrices.reshape(len(matrices), -1, 4)[:, :3, :3]
    with np.errstate(all="ignore"):
        off = np.abs(r @ r.transpose(0, 2, 1) - np.eye(3))
    return bool((off <= _TOLERANCE).all())


def _check_matrices(rows: Sequence[Row]) -> None:
    """Raise InputError where 16 numbers are no matrix that ends with the row 0 0 0 1."""
    for row in rows:
        words = row.words
        if len(words) != _MATRIX or not all(map(is_number, words)):
            continue  # said where the row is read
        numbers = [to_number(word) for word in words]
        if numbers[12:] != [0.0, 0.0, 0.0, 1.0]:
            columns = numbers[3::4] == [0.0, 0.0, 0.0, 1.0]
            raise InputError(
                f"{row.where}: 16 numbers that do not end with 0 0 0 1: "
                + ("the matrix stands column by column: " if columns else "")
                + "write 4 x 4 matrices row by row"
            )
