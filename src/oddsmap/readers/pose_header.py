# SPDX-License-Identifier: Apache-2.0
"""Columns of poses that a header names, in the spellings of the programs that write them.

TUM and EuRoC, `rostopic echo -p` and exports of `nav_msgs` by pandas (`pose.pose.position.x`,
`field.header.stamp`, `header.stamp.secs`), PlotJuggler (`/odom/pose/pose/position/x`), survey
(`easting`, `northing`), the plane (`x y theta`) and `NavSatFix` (`latitude`, `longitude`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from oddsmap.errors import InputError

__all__ = ["PoseColumns", "PoseKind", "columns_by_name"]

PoseKind = Literal["rigid", "planar", "position", "globe"]
"""What the numbers of a pose are: with a rotation; x y and an angle; without a rotation; latitude,
longitude and height."""

_XYZ, _QUATERNION, _GLOBE = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("lat", "lon", "alt")

_IN = r"(?:.*[._/])?"  # fields of messages, and topics before them
_PLACE = rf"(?:t_?|p_?|.*position[._/]?|{_IN}pos[._]?|.*trans(?:lation)?[._/]?|p_rs_r_|utm_?)?"
_NAMES = {
    rf"{_IN}(?:header[._/])?stamp[._/]?secs?": "secs",
    rf"{_IN}(?:header[._/])?stamp[._/]?(?:nsecs?|nanosecs?)": "nsecs",
    rf"{_IN}header[._/]stamp": "stamp",
    r"(?:rosbag)?(?:t|times?|(?:time_?)?stamp|gps_?time|tow|u)(?:_?(?:s|secs?|seconds|ms|us|ns))?"
    r"|secs?|seconds|utime|usecs?": "t",
    rf"{_PLACE}x(?:_m)?|easting": "x",
    rf"{_PLACE}y(?:_m)?|northing": "y",
    rf"{_PLACE}z(?:_m)?": "z",
    rf"{_IN}(?:theta|yaw)(?:_rad)?": "yaw",
    rf"{_IN}(?:theta|yaw)_deg(?:rees)?": "yaw_deg",
    rf"{_IN}(?:roll|pitch|heading)(?:_rad|_deg)?": "tilt",
    rf"{_IN}lat(?:itude)?": "lat",
    rf"{_IN}(?:lon|lng|long|longitude)": "lon",
    rf"{_IN}(?:alt|altitude|height|ele|elevation)": "alt",
}  # fmt: skip
_PATTERNS = [(re.compile(pattern), key) for pattern, key in _NAMES.items()]
_ROTATION = re.compile(
    r"(?:q_?|.*orientation[._/]?|.*rotation[._/]?|.*quat(?:ernion)?[._/]?|q_rs_)([xyzw])"
)
_EXPONENT = {"ms": 6, "us": 3, "ns": 0, "utime": 3, "usec": 3, "usecs": 3}
_METRES = ("m", "metre", "metres", "meter", "meters", "-")
_ANGLES = {"": False, "rad": False, "radians": False, "deg": True, "degrees": True, "°": True}
_TIMES = {"s": 9, "sec": 9, "secs": 9, "seconds": 9, "ms": 6, "us": 3, "µs": 3, "ns": 0}
_UNIT = re.compile(r"\s*[\[(](.*?)[\])]\s*$")


@dataclass(frozen=True, slots=True)
class PoseColumns:
    """Places in a row.

    Args:
        count: how many numbers a row has.
        pose: by `kind`: 12 or 16 places of a matrix, row-major, or 7 of x y z qx qy qz qw; x y yaw
            or x y z yaw; x y z; latitude, longitude and, where there is one, height.
        stamp: place of the stamp, or None.
        index: place of the number of the scan, or None.
        exponent: what power of ten of nanoseconds a stamp is in: 9, seconds, or as the header says.
        doubt: what was assumed, in words; empty where nothing was.
        nsecs: place of the nanoseconds where `stamp` is that of whole seconds, or None.
        kind: what the pose is.
        degrees: the angle of a planar pose is in degrees.
        named: a header names the columns, so that others may hold anything, texts among it.
        said: what the header says that is worth repeating; empty where nothing is.
    """

    count: int
    pose: tuple[int, ...]
    stamp: int | None = None
    index: int | None = None
    exponent: int = 9
    doubt: str = ""
    nsecs: int | None = None
    kind: PoseKind = "rigid"
    degrees: bool = False
    named: bool = False
    said: str = ""


def columns_by_name(header: Sequence[str], count: int) -> PoseColumns | None:
    """The places that a header gives.

    Args:
        header: the names, with units in brackets.
        count: how many words a row has.

    Returns:
        None where the header names no whole pose, or one twice.

    Raises:
        InputError: a unit that is not read.
    """
    places: dict[str, int] = {}
    units: dict[str, str] = {}
    names: dict[str, str] = {}
    for place, name in enumerate(header):
        unit = _UNIT.search(name)
        plain = _UNIT.sub("", name).strip().strip("\"'").lower().lstrip("%_./ ")
        key = _key(plain)
        if key is None:
            continue
        if key in places and key != "tilt":
            return None
        places[key] = place
        units[key] = unit[1].strip().lower() if unit else ""
        names[key] = plain
    if len(header) > count:
        return None
    found = _pose(places, units)
    if found is None:
        return None
    kind, pose, degrees = found
    if kind != "rigid" and len(header) != count:
        return None  # words of a comment
    for key in _XYZ:
        if units.get(key) and units[key] not in _METRES:
            raise InputError(f"{names[key]} is in {units[key][:20]}: write positions in metres")
    stamp, nsecs, exponent = _stamp(places, units, names)
    if stamp is None and kind == "rigid" and 0 not in places.values():
        said = f"the header names no stamp, and {header[0][:40]!r} is not known as one"
        return PoseColumns(count, pose, named=True, doubt=said)
    return PoseColumns(
        count,
        pose,
        stamp=stamp,
        exponent=exponent,
        nsecs=nsecs,
        kind=kind,
        degrees=degrees,
        named=True,
        said=_order(places) if kind == "rigid" else "",
    )


def _key(plain: str) -> str | None:
    if rotation := _ROTATION.fullmatch(plain):
        return "q" + rotation[1]
    return next((key for pattern, key in _PATTERNS if pattern.fullmatch(plain)), None)


def _pose(
    places: dict[str, int], units: dict[str, str]
) -> tuple[PoseKind, tuple[int, ...], bool] | None:
    """What the named columns hold of a pose: kind, places, and whether an angle is in degrees."""
    at = tuple(places[key] for key in _XYZ if key in places)
    if len(at) == 2 and "z" not in places and "alt" in places and "lat" not in places:
        at = (*at, places["alt"])
    turn = tuple(places[key] for key in _QUATERNION if key in places)
    if len(at) == 3 and len(turn) == 4:
        return "rigid", (*at, *turn), False
    if turn:
        return None
    angle = next((key for key in ("yaw", "yaw_deg") if key in places), None)
    flat = len(at) >= 2 and {"x", "y"} <= places.keys()
    if flat and angle is not None and "tilt" not in places:
        if units[angle] not in _ANGLES:
            raise InputError(f"{angle} is in {units[angle][:20]}: write it in rad or deg")
        degrees = angle == "yaw_deg" or _ANGLES[units[angle]]
        return "planar", (*at, places[angle]), degrees
    if len(at) == 3:
        return "position", at, False
    if {"lat", "lon"} <= places.keys():
        return "globe", tuple(places[key] for key in _GLOBE if key in places), False
    return None


def _stamp(
    places: dict[str, int], units: dict[str, str], names: dict[str, str]
) -> tuple[int | None, int | None, int]:
    """The place of the stamp, that of its nanoseconds, and the power of ten of its unit [ns].

    The stamp in the header of a message counts, not the time at which the message was written.
    """
    if {"secs", "nsecs"} <= places.keys():
        return places["secs"], places["nsecs"], 9
    key = next((key for key in ("stamp", "t") if key in places), None)
    if key is None:
        return None, None, 9
    unit, name = units[key], names[key]
    if unit:
        if unit not in _TIMES:
            raise InputError(f"{name} is in {unit[:20]}: write stamps in s, ms, us or ns")
        return places[key], None, _TIMES[unit]
    # `rostopic echo -p` writes all its times in nanoseconds.
    if name.startswith("field."):
        return places[key], None, 0
    found = re.search(r"(?:_|stamp|time|^t)(ms|us|ns)$|^(utime|usecs?)$", name)
    return places[key], None, _EXPONENT[found[1] or found[2]] if found else 9


def _order(places: dict[str, int]) -> str:
    """The order of a quaternion, in words, where it is not the usual one."""
    order = sorted(_QUATERNION, key=places.__getitem__)
    return "" if tuple(order) == _QUATERNION else f"its quaternions are {' '.join(order)}"
