# SPDX-License-Identifier: Apache-2.0
"""PTX, the text of Leica's scanners: one grid of points for each setup, with its pose.

A setup starts with its counts of columns and rows, the place of the scanner and its three axes, and
a 4 x 4 matrix by which points, as rows, are multiplied: its last row is the place of the scanner.
Then come columns x rows points, x y z intensity and perhaps a colour. `0 0 0` is no return.

Source: Leica Geosystems, Cyclone: the export format PTX.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.cloud_header import is_count
from oddsmap.readers.compression import Source
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.plain_text import is_number
from oddsmap.readers.sensor_track import pose_at
from oddsmap.readers.text_table import Row, parse_numbers, parse_table
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_ptx"]

# How many words the lines of a header have, and how many lines it has.
_WORDS = (1, 1, 3, 3, 3, 3, 4, 4, 4, 4)
_HEAD = len(_WORDS)
_ROW_WORDS = (3, 4, 6, 7)
# No scanner sees so far [m]: points that all are farther are not in its frame.
_FARTHEST_M = 5000.0
_SAME_PLACE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class _Setup:
    """Where the points of a setup are in the file, and its pose."""

    first_line: int
    count: int
    pose: Pose3
    place: FloatArray
    """Of the scanner, as the header says it beside the matrix [m], shape (3,)."""


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a PTX file."""
    lines = head[:4096].splitlines()[:_HEAD]
    words = [line.decode("ascii", "replace").split() for line in lines]
    return (
        [len(line) for line in words] == list(_WORDS)
        and all(is_count(line[0]) for line in words[:2])
        and all(is_number(word) for line in words for word in line)
    )


def open_ptx(source: Source, options: ReadOptions) -> LazyLog:
    """Open a PTX file.

    Raises:
        InputError: a header that says nothing usable, or fewer points than it promises.
    """
    options.refuse(source.path, "a PTX file", "poses", "times", "body_from_sensor", "camera")
    options.refuse(source.path, "a PTX file", "columns", "depth_scale", "points_in", "deskew")
    ends = _line_ends(source.content)
    setups = _find_setups(source, ends)
    notes: list[Note] = source.initial_notes()
    in_map = [_is_in_map(setup) for setup in setups]
    if options.origin is not None and any(
        not in_map[i] and not _is_identity(setup.pose) for i, setup in enumerate(setups)
    ):
        options.refuse(source.path, "a PTX file with poses", "origin")
    if any(in_map) and options.origin is None:
        text = "its matrix moves nothing: the points are taken for points in the map, seen from "
        text += "the place of the scanner"
        notes.append(Note(text, code="pose.viewpoint", severity="warning"))

    def read_scan(i: int) -> Scan:
        setup = setups[i]
        points = _read_points(source, ends, setup)
        missing = ~points.any(axis=1)
        pose = setup.pose
        if options.origin is not None or in_map[i]:
            origin = setup.place if options.origin is None else np.array(options.origin)
            pose = pose_at(origin)
            points = points - pose.translation
            points[missing] = 0.0
        elif _is_identity(pose):
            _check_near(source.path, points[~missing])
        return Scan.from_points(pose, points)

    return LazyLog(
        path=source.path,
        format="PTX scans",
        scan_count=len(setups),
        read_scan=read_scan,
        skip_bad=options.skip_bad,
        opening_notes=tuple(notes),
        opening_skipped=source.initial_skipped(),
    )


def _is_identity(pose: Pose3) -> bool:
    return not pose.translation.any() and bool((pose.rotation == np.eye(3)).all())


def _is_in_map(setup: _Setup) -> bool:
    """The matrix is the identity, and the scanner stood elsewhere."""
    return _is_identity(setup.pose) and bool(np.abs(setup.place).max() > _SAME_PLACE)


def _check_near(path: str, points: FloatArray) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        nearest = float(np.linalg.norm(points, axis=1).min(initial=np.inf))
    if len(points) and nearest > _FARTHEST_M:
        raise InputError(
            f"{path}: the header puts the scanner at 0 0 0, and its nearest point is "
            f"{nearest / 1e3:.4g} km away: the points are in the map already; say where the "
            "scanner stood with --origin X Y Z (origin=)"
        )


def _line_ends(content: bytes) -> npt.NDArray[np.int64]:
    """Where each line ends; the last one need not have an end of its own."""
    ends = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n"))
    return ends if content.endswith(b"\n") else np.append(ends, len(content))


def _find_setups(source: Source, ends: npt.NDArray[np.int64]) -> list[_Setup]:
    """The setups of a file, by their headers.

    Raises:
        InputError: a header that is none, or that promises more points than there are lines.
    """
    setups: list[_Setup] = []
    line = 0
    while line < len(ends):
        if not _text(source, ends, line, line + 1).strip():
            line += 1  # some programs leave an empty line between setups
            continue
        setup = _read_header(source, ends, line)
        if setup.first_line + setup.count > len(ends):
            raise InputError(
                f"{source.path}:{line + 1}: the header announces {setup.count} points, the file "
                f"has {max(0, len(ends) - setup.first_line)} more lines: copy the file again"
            )
        setups.append(setup)
        line = setup.first_line + setup.count
    if not any(setup.count for setup in setups):
        raise InputError(f"{source.path}: it holds no points")
    return setups


def _read_header(source: Source, ends: npt.NDArray[np.int64], line: int) -> _Setup:
    rows = []
    for i, words in enumerate(_WORDS):
        text = _text(source, ends, line + i, line + i + 1) if line + i < len(ends) else ""
        row = Row(f"{source.path}:{line + i + 1}", text.split())
        if len(row.words) != words:
            raise InputError(
                f"{row.where}: {len(row.words)} words where line {i + 1} of a PTX header has "
                f"{words}: copy the file again"
            )
        rows.append(row)
    for row in rows[:2]:
        if not is_count(row.words[0]):
            raise InputError(f"{row.where}: {row.words[0][:40]!r} is no count of points")
    place = np.array(parse_numbers(rows[2], rows[2].words))
    matrix = np.array([parse_numbers(row, row.words) for row in rows[6:]])
    try:
        pose = Pose3.from_matrix(matrix.T)
    except InputError as error:
        raise InputError(f"{rows[6].where}: {error}") from None
    count = int(rows[0].words[0]) * int(rows[1].words[0])
    setup = _Setup(line + _HEAD, count, pose, place)
    near = np.allclose(pose.translation, place, rtol=1e-6, atol=_SAME_PLACE)
    if not near and not _is_identity(pose):
        raise InputError(
            f"{rows[2].where}: the scanner is at {' '.join(rows[2].words)[:60]}, and its matrix "
            f"moves it to {' '.join(rows[9].words[:3])[:60]}: write the file again"
        )
    return setup


def _text(source: Source, ends: npt.NDArray[np.int64], first: int, last: int) -> str:
    """Lines `first` to `last` - 1."""
    start = int(ends[first - 1]) + 1 if first else 0
    return source.content[start : int(ends[last - 1])].decode("ascii", "replace")


def _read_points(source: Source, ends: npt.NDArray[np.int64], setup: _Setup) -> FloatArray:
    if not setup.count:
        return np.empty((0, 3))
    first, last = setup.first_line, setup.first_line + setup.count
    columns = len(_text(source, ends, first, first + 1).split())
    if columns not in _ROW_WORDS:
        raise InputError(
            f"{source.path}:{first + 1}: {columns} values: a point of PTX has 3, 4, 6 or 7"
        )
    lines = _text(source, ends, first, last).split("\n")
    numbers = list(range(first + 1, last + 1))
    return parse_table(source.path, lines, numbers, columns)[:, :3].copy()
