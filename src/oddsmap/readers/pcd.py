# SPDX-License-Identifier: Apache-2.0
"""PCD, the format of the Point Cloud Library: `ascii`, `binary` and `binary_compressed`.

Fields x, y and z are floats of 4 or 8 bytes, anywhere among the others, of which a field of times
is read and the rest ignored. A text of a 4-byte field is rounded to 4 bytes. VIEWPOINT is the pose
of the sensor (x y z qw qx qy qz). PCL before 1.9 fills binary files with zeros to a whole page of
memory.

Source: https://pointclouds.org/documentation/tutorials/pcd_file_format.html
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.cloud_header import MAX_DIGITS, HeaderLine, header_lines, is_count
from oddsmap.readers.compression import Source
from oddsmap.readers.lzf import decompress
from oddsmap.readers.plain_text import split_lines, to_number, without_bom
from oddsmap.readers.point_cloud import (
    Cloud,
    check_size,
    pick_columns,
    unpack_column,
    unpack_points,
)
from oddsmap.readers.text_table import parse_table
from oddsmap.scans.beam_times import TIME_NAMES
from oddsmap.scans.note import Note

__all__ = ["matches", "read_pcd", "read_viewpoint", "viewpoint_pose"]

_FIRST_WORDS = (b"VERSION", b"FIELDS", b"COLUMNS")
_IDENTITY = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a PCD file."""
    for line in head[:4096].splitlines():
        if line.strip() and not line.startswith(b"#"):
            return line.split()[0] in _FIRST_WORDS
    return False


@dataclass(frozen=True, slots=True)
class _Header:
    """What a PCD header says; x, y and z by their place in a record."""

    offsets: list[int]
    columns: list[int]
    types: list[str]
    stride: int
    column_count: int
    point_count: int
    viewpoint: tuple[float, ...]
    encoding: str
    body_start: int
    body_line: int
    time: tuple[int, int, str] | None = None
    """The field of times: its first byte in a record, its column and its type."""


def read_pcd(source: Source) -> Cloud:
    """Read a PCD file.

    Raises:
        InputError: a header that says nothing usable, or another count of points than it promises.
    """
    source = without_bom(source)
    header = _read_header(source)
    body = source.content[header.body_start :]
    notes: tuple[Note, ...] = ()
    times: npt.NDArray[Any] | None = None
    if header.encoding == "ascii":
        points, times = _read_ascii(source.path, body, header)
    elif header.encoding == "binary":
        body, notes = _without_padding(body, header.point_count * header.stride)
        points = unpack_points(
            source.path, body, header.point_count, header.offsets, header.types, header.stride
        )
        if header.time is not None:
            offset, _, kind = header.time
            times = unpack_column(body, header.point_count, offset, kind, header.stride)
    else:
        points, times = _read_compressed(source.path, body, header)
    return Cloud(points, header.viewpoint, notes, times)


def read_viewpoint(source: Source) -> tuple[float, ...]:
    """The VIEWPOINT of a PCD file of which the header alone is at hand."""
    return _read_header(without_bom(source)).viewpoint


def viewpoint_pose(path: str, viewpoint: tuple[float, ...] | None) -> Pose3 | None:
    """VIEWPOINT as the pose of the sensor; None where it says nothing.

    Nothing is the identity, which is what programs write that know no pose, and seven zeros.
    """
    if viewpoint is None or viewpoint == _IDENTITY or not any(viewpoint):
        return None
    if not all(math.isfinite(value) for value in viewpoint):
        raise InputError(f"{path}: VIEWPOINT is not finite: give the poses in a file")
    qw, qx, qy, qz = viewpoint[3:]
    try:
        return Pose3.from_quaternion_xyzw(viewpoint[:3], (qx, qy, qz, qw))
    except InputError as error:
        raise InputError(f"{path}: VIEWPOINT (x y z qw qx qy qz): {error}") from None


def _read_header(source: Source) -> _Header:
    path = source.path
    entries: dict[str, list[str]] = {}
    last = HeaderLine(0, [], 0)
    for last in header_lines(source):
        words = last.words
        if words and not words[0].startswith("#"):
            entries["FIELDS" if words[0] == "COLUMNS" else words[0]] = words[1:]
        if "DATA" in entries:
            break
    else:
        raise InputError(f"{path}: the PCD header has no DATA line: copy it again")
    for name in ("FIELDS", "SIZE", "TYPE"):
        if name not in entries:
            raise InputError(f"{path}: the PCD header has no {name} line: check what wrote it")
    # X, Y and Z as some programs write them, where x, y and z do not stand beside them.
    names = [
        name.lower() if name in ("X", "Y", "Z") and name.lower() not in entries["FIELDS"] else name
        for name in entries["FIELDS"]
    ]
    sizes = _integers(path, "SIZE", entries["SIZE"], len(names))
    counts = _integers(path, "COUNT", entries.get("COUNT", ["1"] * len(names)), len(names))
    kinds = entries["TYPE"]
    if len(kinds) != len(names):
        raise InputError(f"{path}: TYPE has {len(kinds)} values for {len(names)} FIELDS")
    encoding = " ".join(entries["DATA"]).lower()
    if encoding not in ("ascii", "binary", "binary_compressed"):
        raise InputError(
            f"{path}: DATA {encoding[:20]!r} is unknown: write ascii, binary or binary_compressed"
        )
    places = [_find_axis(path, axis, names, kinds, sizes, counts) for axis in "xyz"]
    offsets = [sum(s * c for s, c in zip(sizes[:i], counts[:i], strict=True)) for i in places]
    return _Header(
        offsets=offsets,
        columns=[sum(counts[:i]) for i in places],
        types=[f"<f{sizes[i]}" for i in places],
        stride=sum(s * c for s, c in zip(sizes, counts, strict=True)),
        column_count=sum(counts),
        point_count=_point_count(path, entries),
        viewpoint=_viewpoint(path, entries.get("VIEWPOINT")),
        encoding=encoding,
        body_start=last.end,
        body_line=last.number + 1,
        time=_find_time(names, kinds, sizes, counts),
    )


def _integers(path: str, name: str, words: list[str], count: int) -> list[int]:
    if len(words) != count:
        raise InputError(f"{path}: {name} has {len(words)} values for {count} FIELDS")
    if not all(is_count(word) for word in words):
        raise InputError(
            f"{path}: {name} {' '.join(words)[:60]!r}: whole numbers are expected, "
            f"of up to {MAX_DIGITS} digits"
        )
    return [int(word) for word in words]


def _find_axis(
    path: str, axis: str, names: list[str], kinds: list[str], sizes: list[int], counts: list[int]
) -> int:
    if names.count(axis) != 1:
        raise InputError(
            f"{path}: FIELDS {' '.join(names)[:60]} has {names.count(axis)} x `{axis}`: "
            "a scan needs x, y and z once each"
        )
    i = names.index(axis)
    if kinds[i] != "F" or sizes[i] not in (4, 8) or counts[i] != 1:
        raise InputError(
            f"{path}: field `{axis}` has TYPE {kinds[i][:20]} SIZE {sizes[i]} COUNT {counts[i]}: "
            "it must be one float of 4 or 8 bytes"
        )
    return i


def _find_time(
    names: list[str], kinds: list[str], sizes: list[int], counts: list[int]
) -> tuple[int, int, str] | None:
    """The first field of times that is one number; what is odd in it is left alone, as others."""
    for name in TIME_NAMES:
        if names.count(name) != 1:
            continue
        i = names.index(name)
        code = {"F": "f", "U": "u", "I": "i"}.get(kinds[i])
        if code is None or counts[i] != 1 or sizes[i] not in (4, 8):
            continue
        offset = sum(s * c for s, c in zip(sizes[:i], counts[:i], strict=True))
        return offset, sum(counts[:i]), f"<{code}{sizes[i]}"
    return None


def _point_count(path: str, entries: dict[str, list[str]]) -> int:
    counts = {
        name: _integers(path, name, entries[name], 1)[0]
        for name in ("WIDTH", "HEIGHT", "POINTS")
        if name in entries
    }
    if "WIDTH" not in counts and "POINTS" not in counts:
        raise InputError(
            f"{path}: the PCD header has neither WIDTH nor POINTS: check what wrote it"
        )
    if "WIDTH" not in counts:
        return counts["POINTS"]
    size = counts["WIDTH"] * counts.get("HEIGHT", 1)
    if counts.get("POINTS", size) != size:
        raise InputError(
            f"{path}: POINTS {counts['POINTS']}, but WIDTH x HEIGHT is {size}: check what wrote it"
        )
    return size


def _viewpoint(path: str, words: list[str] | None) -> tuple[float, ...]:
    if words is None:
        return _IDENTITY
    try:
        values = tuple(to_number(word) for word in words)
    except ValueError:
        values = ()
    if len(values) != 7:
        raise InputError(
            f"{path}: VIEWPOINT {' '.join(words)[:60]!r}: seven numbers are expected, "
            "x y z qw qx qy qz"
        )
    return values


_Points = tuple[FloatArray, npt.NDArray[Any] | None]
"""Points and their times."""


def _read_ascii(path: str, body: bytes, header: _Header) -> _Points:
    lines = split_lines(body.decode("utf-8-sig", "replace"))
    numbers = [n for n, line in enumerate(lines, start=header.body_line) if line.strip()]
    lines = [line for line in lines if line.strip()]
    check_size(path, header.point_count, len(lines))
    if not lines:  # then nothing bounds the count of columns, which NumPy may not take
        return np.empty((0, 3)), None
    table = parse_table(path, lines, numbers, header.column_count)
    times = None if header.time is None else table[:, header.time[1]]
    return pick_columns(table, header.columns, header.types), times


def _without_padding(body: bytes, wanted: int) -> tuple[bytes, tuple[Note, ...]]:
    """The records of a file of which all that follows them is zeros."""
    tail = body[wanted:]
    if not tail or any(tail):
        return body, ()
    text = f"{len(tail)} zero bytes after the last point were left out: PCL before 1.9 adds them"
    return body[:wanted], (Note(text, code="cloud.padding"),)


def _read_compressed(path: str, body: bytes, header: _Header) -> _Points:
    """Fields one after another (all x, then all y, ...), compressed as a whole."""
    wanted = header.point_count * header.stride
    if wanted == 0:
        return np.empty((0, 3)), None
    packed, size = struct.unpack_from("<II", body) if len(body) >= 8 else (0, 0)
    if size != wanted:
        raise InputError(
            f"{path}: the header promises {header.point_count} points of {header.stride} bytes, "
            f"the file holds {size} bytes of them ({size // header.stride} points): copy or write "
            "the file again"
        )
    if len(body) - 8 < packed:
        raise InputError(
            f"{path}: the header announces {packed} compressed bytes, the file holds "
            f"{len(body) - 8}: copy the file again"
        )
    try:
        content = decompress(body[8 : 8 + packed], size)
    except ValueError as error:
        raise InputError(
            f"{path}: corrupt compressed points ({error}): copy the file again"
        ) from None
    points = np.empty((header.point_count, 3))
    with np.errstate(invalid="ignore"):  # a signalling NaN, which some bytes are
        for axis, (offset, kind) in enumerate(zip(header.offsets, header.types, strict=True)):
            start = offset * header.point_count
            points[:, axis] = np.frombuffer(content, kind, header.point_count, start)
    if header.time is None:
        return points, None
    offset, _, kind = header.time
    return points, np.frombuffer(content, kind, header.point_count, offset * header.point_count)
