# SPDX-License-Identifier: Apache-2.0
"""LAS, LAZ and COPC: points in chunks, and what their header says of their coordinates.

Source: ASPRS, LAS Specification 1.4 - R15; decoded by laspy and lazrs.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.decoding import decoding
from oddsmap.errors import InputError, as_line
from oddsmap.readers.extras import needs_extra
from oddsmap.readers.las_sizes import check_sizes

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["LasFacts", "LasPoints", "las_crs", "las_facts", "matches", "read_las_points"]

# Points that are decoded at once: 20 MB.
_CHUNK = 500_000
_FAULT, _ADVICE = "the LAS file cannot be read", "copy or write it again"
_LOW_NOISE, _HIGH_NOISE = 7, 18

_MODEL_KEY, _UNIT_KEY, _GEOGRAPHIC = 1024, 3076, 2
_FEET = {9002: "feet", 9003: "US survey feet"}
_WKT_UNIT = re.compile(r'(?:LENGTH)?UNIT\["([^"]{1,60})",\s*([0-9.eE+-]{1,40})')


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a LAS or LAZ file."""
    return head.startswith(b"LASF")


@dataclass(frozen=True, slots=True, eq=False)
class LasPoints:
    """Some points of a file.

    Args:
        points: in the coordinates of the file, shape (n, 3).
        times_s: their GPS times [s], shape (n,).
        left_out: how many more were marked as withheld, or classified as noise.
    """

    points: FloatArray
    times_s: FloatArray
    left_out: int


@dataclass(frozen=True, slots=True)
class LasFacts:
    """What a header says.

    Args:
        count: how many points.
        timed: they have GPS times.
        lo: smallest coordinates by the header, of which nothing is sure.
        hi: largest ones.
        geographic: the coordinates are degrees.
        unit: the unit of lengths where it is not metres, for people.
    """

    count: int
    timed: bool
    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    geographic: bool
    unit: str


def las_facts(path: str) -> LasFacts:
    """Read a header.

    Raises:
        InputError: it cannot be read, or laspy is missing.
    """
    with _Opened(path) as reader, _decoding(path):
        header = reader.header
        geographic, unit = _coordinates(header.vlrs)
        if not geographic and not unit:
            unit = _unit_by_number(header)
        return LasFacts(
            count=int(header.point_count),
            timed="gps_time" in set(header.point_format.dimension_names),
            lo=tuple(float(v) for v in header.mins),  # type: ignore[arg-type]
            hi=tuple(float(v) for v in header.maxs),  # type: ignore[arg-type]
            geographic=geographic,
            unit=unit,
        )


def las_crs(path: str) -> Any:
    """The coordinates of a file as pyproj has them.

    Raises:
        InputError: its header does not say them, or pyproj is missing.
    """
    with needs_extra(path, "geo"):
        import pyproj  # noqa: F401 - laspy imports it
    with _Opened(path) as reader, _decoding(path):
        crs = reader.header.parse_crs()
    if crs is None:
        raise InputError(
            f"{path}: its header does not say in which coordinates it is, so that a track of GPS "
            "cannot be placed in it: project the track to these coordinates (t x y z)"
        )
    return crs


def read_las_points(path: str) -> Iterator[LasPoints]:
    """Read the points of a file in its order, some at a time.

    Raises:
        InputError: the file is damaged, or holds fewer points than its header says.
    """
    with _Opened(path) as reader:
        count, seen = int(reader.header.point_count), 0
        while seen < count:
            with _decoding(path):
                record = reader.read_points(min(_CHUNK, count - seen))
                found = len(record)
                part = _part(record)
            if not found:
                break
            seen += found
            yield part
        if seen != count:
            raise InputError(
                f"{path}: the header promises {count} points, the file holds {seen}: {_ADVICE}"
            )


@contextmanager
def _decoding(path: str) -> Iterator[None]:
    """`decoding`, also where the decoder panics, which is no `Exception` to Python."""
    try:
        with decoding(path, _FAULT, _ADVICE):
            yield
    except BaseException as error:
        if type(error).__name__ != "PanicException":
            raise
        raise InputError(f"{path}: {_FAULT} ({as_line(str(error), 100)}): {_ADVICE}") from None


class _Opened:
    """A file as laspy reads it."""

    def __init__(self, path: str) -> None:
        with needs_extra(path, "survey"):
            import laspy
            import lazrs  # noqa: F401 - laspy imports it when it meets a LAZ file
        check_sizes(path)
        with _decoding(path):
            # Without threads of its own, which would hang in a process that was forked.
            self._reader = laspy.open(path, laz_backend=laspy.LazBackend.Lazrs)

    def __enter__(self) -> Any:
        return self._reader

    def __exit__(self, *_: object) -> None:
        self._reader.close()


def _part(record: Any) -> LasPoints:
    points = np.stack([np.asarray(record[axis], np.float64) for axis in "xyz"], axis=1)
    timed = "gps_time" in set(record.point_format.dimension_names)
    times = np.asarray(record["gps_time"], np.float64) if timed else np.zeros(len(points))
    kept = _kept(record)
    return LasPoints(points[kept], times[kept], int(len(kept) - np.count_nonzero(kept)))


def _kept(record: Any) -> npt.NDArray[np.bool_]:
    """Which points their producer has not taken back."""
    kind = np.asarray(record["classification"])
    kept = (kind != _LOW_NOISE) & (kind != _HIGH_NOISE)
    if "withheld" in set(record.point_format.dimension_names):
        kept &= np.asarray(record["withheld"]) == 0
    return np.asarray(kept, np.bool_)


def _unit_by_number(header: Any) -> str:
    """The unit of coordinates that have a number (EPSG), where pyproj is there to look it up."""
    try:
        crs = header.parse_crs()
        unit = "" if crs is None else str(crs.axis_info[0].unit_name)
    except Exception:  # what cannot be looked up is not known
        return ""
    return "" if unit in ("metre", "unknown") else unit


def _coordinates(records: Sequence[Any]) -> tuple[bool, str]:
    """Whether coordinates are degrees, and the unit of lengths where it is not metres."""
    geographic, unit = False, ""
    for record in records:
        for key in getattr(record, "geo_keys", ()):
            if key.id == _MODEL_KEY and key.value_offset == _GEOGRAPHIC:
                geographic = True
            if key.id == _UNIT_KEY:
                unit = unit or _FEET.get(key.value_offset, "")
        text = str(getattr(record, "string", ""))
        if text.startswith(("GEOGCS", "GEOGCRS")):
            geographic = True
        for name, metres in _WKT_UNIT.findall(text):
            if "deg" not in name.lower() and "grad" not in name.lower():
                unit = unit or ("" if float(metres) == 1.0 else name)
                break
    return geographic, unit
