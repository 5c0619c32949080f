# SPDX-License-Identifier: Apache-2.0
"""Which numbers of a row are its pose, its stamp, its number.

By the names in a header where there is one that names them all; else by their count. 9, 13 and 17
numbers are 8, 12 or 16 with one more at either end: rotations show which, or it is an error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.readers.plain_text import is_number, to_number
from oddsmap.readers.pose_header import PoseColumns, columns_by_name
from oddsmap.readers.text_table import Row

__all__ = ["find_columns"]

FloatArray = npt.NDArray[np.float64]

_KITTI, _MATRIX, _TUM, _PLANAR = 12, 16, 8, 4
_TOLERANCE = 1e-3

# Angles from -pi to pi or from 0 to 2 pi, with some rounding.
_FULL_TURN = 6.3

# A number this large is seconds since 1970, not the number of a scan.
_MAX_INDEX = 10**8


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
        try:
            named = columns_by_name(header, count)
        except InputError as error:
            raise InputError(f"{rows[0].where.rpartition(':')[0]}: {error}") from None
        if named is not None:
            return named
    messages = _as_messages(rows)
    if messages is not None:
        return messages
    if count == _KITTI:
        return PoseColumns(count, tuple(range(count)))
    if count == _TUM:
        return PoseColumns(count, tuple(range(1, count)), stamp=0)
    if count == _MATRIX:
        _check_matrices(rows)
        return PoseColumns(count, tuple(range(count)))
    if count == _PLANAR and not any(len(header) == count for header in headers):
        return _planar(rows)
    found = _with_one_more(rows, count) if count in (_TUM + 1, _KITTI + 1, _MATRIX + 1) else None
    if found is not None:
        return found
    raise InputError(
        f"{rows[0].where}: {count} numbers: a pose has {_KITTI} (KITTI: 3 x 4, row-major) or "
        f"{_TUM} (TUM: t x y z qx qy qz qw); for others write a header that names the columns"
        + _seen(headers)
    )


def _as_messages(rows: Sequence[Row]) -> PoseColumns | None:
    """Messages of ROS as `ros2 topic echo --csv` writes them, without a header.

    Seconds, nanoseconds, one or two names of frames, position, quaternion, and what follows.
    """
    words = rows[0].words
    if len(words) < 2 or not all(word.isdecimal() for word in words[:2]):
        return None
    names = next((i for i, word in enumerate(words[2:]) if is_number(word)), 0)
    pose = tuple(range(2 + names, 9 + names))
    if not 1 <= names <= 2 or len(words) < pose[-1] + 1:
        return None
    turn = [[row.words[i] for i in pose[3:]] for row in rows if len(row.words) == len(words)]
    if not all(is_number(word) for row in turn for word in row):
        return None
    if not _are_unit(np.array([[to_number(word) for word in row] for row in turn])):
        return None
    said = "its columns are taken for those of ros2 topic echo --csv: sec nanosec frame, x y z, "
    said += "qx qy qz qw"
    return PoseColumns(len(words), pose, stamp=0, nsecs=1, named=True, said=said)


def _planar(rows: Sequence[Row]) -> PoseColumns:
    """Four numbers, t x y theta, where the last ones can be angles in radians.

    Raises:
        InputError: they cannot.
    """
    for row in rows:
        word = row.words[-1]
        if len(row.words) == _PLANAR and is_number(word) and abs(to_number(word)) > _FULL_TURN:
            raise InputError(
                f"{row.where}: 4 numbers, of which {word[:40]!r} is no angle in radians: write a "
                "header that names the columns, as t x y theta [deg]"
            )
    doubt = "4 numbers are taken for t x y theta [rad], the pose of a robot in the plane z = 0"
    return PoseColumns(_PLANAR, (1, 2, 3), stamp=0, kind="planar", doubt=doubt)


def _seen(headers: Sequence[Sequence[str]]) -> str:
    """What a header names that is not enough, in words."""
    if not headers or len(headers[-1]) < 3:
        return ""
    return f"; this one names {' '.join(headers[-1])[:120]}"


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
