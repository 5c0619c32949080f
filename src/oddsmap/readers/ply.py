# SPDX-License-Identifier: Apache-2.0
"""PLY, the polygon format: ascii and binary of both byte orders, vertices alone.

Properties x, y and z of the element `vertex` are floats of 4 or 8 bytes, and one of times is read
where there is one; other properties and elements (faces) are ignored. Lists within or before the
vertices, which no point cloud has, are refused. PLY holds no pose. Types may have the names of C or
of NumPy.

Source: Turk, The PLY polygon file format (1994).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.readers.cloud_header import header_lines, is_count
from oddsmap.readers.compression import Source
from oddsmap.readers.plain_text import split_lines, without_bom
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

__all__ = ["matches", "read_ply"]

_SIZES = {
    **{"char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2},
    **{"uint16": 2, "int": 4, "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4},
    **{"double": 8, "float64": 8},
    **{"i1": 1, "u1": 1, "i2": 2, "u2": 2, "i4": 4, "u4": 4, "f4": 4, "f8": 8},
}
_NUMPY = {
    **{"int": "i4", "int32": "i4", "i4": "i4", "uint": "u4", "uint32": "u4", "u4": "u4"},
    **{"float": "f4", "float32": "f4", "f4": "f4", "double": "f8", "float64": "f8", "f8": "f8"},
}
_FLOATS = ("float", "float32", "f4", "double", "float64", "f8")
_BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a PLY file."""
    first = head[:64].splitlines()[:1]
    return bool(first) and first[0].rstrip() == b"ply" and len(head) > len(first[0])


@dataclass(frozen=True, slots=True)
class _Element:
    """An element of the header: how many there are, and name and type of its properties."""

    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)

    def stride(self, path: str) -> int:
        """Bytes of one in a binary file."""
        if any(kind == "list" for _, kind in self.properties):
            raise InputError(
                f"{path}: a list in the PLY element `{self.name}`, at or before the vertices: "
                "write the points without it"
            )
        return sum(_SIZES[kind] for _, kind in self.properties)


def read_ply(source: Source) -> Cloud:
    """Read the vertices of a PLY file.

    Raises:
        InputError: a header that says nothing usable, or another count of points than it promises.
    """
    source = without_bom(source)
    encoding, elements, start, line_number = _read_header(source)
    path = source.path
    names = [element.name for element in elements]
    if names.count("vertex") != 1:
        raise InputError(f"{path}: {names.count('vertex')} PLY elements `vertex`: one is needed")
    place = names.index("vertex")
    vertex, earlier = elements[place], elements[:place]
    strides = [element.stride(path) for element in (*earlier, vertex)]
    columns = [_find_axis(path, axis, vertex) for axis in "xyz"]
    kinds = [kind for _, kind in vertex.properties]
    types = [f"{_BYTE_ORDERS[encoding]}f{_SIZES[kinds[i]]}" for i in columns]
    if encoding == "ascii":
        skip = sum(element.count for element in earlier)
        last = place == len(elements) - 1
        time = _find_time(vertex)
        points, times = _read_ascii(
            source, start, line_number, skip, vertex, columns, types, last, time
        )
        return Cloud(points, notes=_notes(elements), times=times)
    start += sum(e.count * stride for e, stride in zip(earlier, strides, strict=False))
    body = source.content[start:]
    if place < len(elements) - 1:
        body = body[: vertex.count * strides[-1]]
    offsets = [sum(_SIZES[kind] for kind in kinds[:i]) for i in columns]
    points = unpack_points(path, body, vertex.count, offsets, types, strides[-1])
    times = None
    if (i := _find_time(vertex)) is not None:
        kind = np.dtype(_BYTE_ORDERS[encoding] + _NUMPY[kinds[i]])
        offset = sum(_SIZES[each] for each in kinds[:i])
        times = unpack_column(body, vertex.count, offset, kind.str, strides[-1])
    return Cloud(points, notes=_notes(elements), times=times)


def _find_time(vertex: _Element) -> int | None:
    """The first property of times: a number of 4 or 8 bytes."""
    names = [name for name, _ in vertex.properties]
    for name in TIME_NAMES:
        if names.count(name) == 1 and vertex.properties[names.index(name)][1] in _NUMPY:
            return names.index(name)
    return None


def _notes(elements: list[_Element]) -> tuple[Note, ...]:
    """PCL writes the place of the sensor as a camera; programs for meshes, that of the observer."""
    if not any(name == "view_px" for element in elements for name, _ in element.properties):
        return ()
    text = "its element `camera` (view_px ...) is not taken for the pose of the sensor: give poses"
    return (Note(text, code="cloud.camera", severity="warning"),)


def _read_header(source: Source) -> tuple[str, list[_Element], int, int]:
    """Encoding, elements, first byte after the header and number of that line."""
    path = source.path
    encoding = ""
    elements: list[_Element] = []
    for number, words, end in header_lines(source):
        match words:
            case ["end_header"]:
                if encoding:
                    return encoding, elements, end, number + 1
                raise InputError(
                    f"{path}: the PLY header has no format line: check what wrote the file"
                )
            case ["format", name, _] if name in _BYTE_ORDERS:
                encoding = name
            case ["element", name, count] if is_count(count):
                elements.append(_Element(name, int(count)))
            case ["property", "list", _, _, name] if elements:
                elements[-1].properties.append((name, "list"))
            case ["property", kind, name] if elements and kind in _SIZES:
                elements[-1].properties.append((name, kind))
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case _:
                line = " ".join(words)[:60]
                raise InputError(f"{path}:{number}: {line!r} is not a line of a PLY header")
    raise InputError(f"{path}: the PLY header has no end_header: copy the file again")


def _find_axis(path: str, axis: str, vertex: _Element) -> int:
    names = [name for name, _ in vertex.properties]
    if axis not in names and axis.upper() in names:
        axis = axis.upper()
    if names.count(axis) != 1:
        raise InputError(
            f"{path}: PLY vertices with {names.count(axis)} x `{axis}` ({' '.join(names)[:60]}): "
            "a scan needs x, y and z once each"
        )
    i = names.index(axis)
    kind = vertex.properties[i][1]
    if kind not in _FLOATS:
        raise InputError(f"{path}: property `{axis}` is {kind}: it must be float or double")
    return i


def _read_ascii(
    source: Source,
    start: int,
    line_number: int,
    skip: int,
    vertex: _Element,
    columns: list[int],
    types: list[str],
    last: bool,
    time: int | None,
) -> tuple[FloatArray, FloatArray | None]:
    text = split_lines(source.content[start:].decode("utf-8-sig", "replace"))
    rows = [(n, line) for n, line in enumerate(text, start=line_number) if line.strip()][skip:]
    if not last:
        rows = rows[: vertex.count]
    check_size(source.path, vertex.count, len(rows))
    if not rows:
        return np.empty((0, 3)), None
    lines, numbers = [line for _, line in rows], [n for n, _ in rows]
    table = parse_table(source.path, lines, numbers, len(vertex.properties))
    return pick_columns(table, columns, types), None if time is None else table[:, time]
