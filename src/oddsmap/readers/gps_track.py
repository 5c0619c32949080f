# SPDX-License-Identifier: Apache-2.0
"""Tracks of GPS, latitudes and longitudes, as places in the coordinates of a map.

They say where a receiver was and not where it looked, so they do only for points that are in the
map already and whose coordinates are known: those of LAS.

Source: https://www.topografix.com/GPX/1/1/ (GPX 1.1)
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.decoding import decoding
from oddsmap.errors import InputError, shown
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.compression import open_source
from oddsmap.readers.extras import needs_extra
from oddsmap.readers.options import FilePath
from oddsmap.readers.plain_text import decode_text, to_number

__all__ = ["is_gpx", "places_in_map", "read_gpx"]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def is_gpx(path: FilePath) -> bool:
    """Whether a file is XML of GPX."""
    try:
        with open(path, "rb") as file:  # noqa: PTH123 - a path of any kind
            return b"<gpx" in file.read(2000)
    except OSError:
        return False


def read_gpx(path: FilePath) -> Trajectory:
    """The points of all tracks of a GPX file.

    Returns:
        Latitude and longitude [deg] and height [m] as positions, with times since 1970 (UTC).

    Raises:
        InputError: it cannot be read, or a point has no time or no height.
    """
    name = os.fspath(path)
    text = decode_text(name, open_source(path).content)
    if "<!" in text.replace("<!--", ""):
        raise InputError(f"{name}: XML with declarations of its own (<!...), which no GPX has")
    with decoding(name, "the GPX file cannot be read", "write it again"):
        root = Xml.fromstring(text)  # noqa: S314 - it declares nothing
    rows = [_point(name, number, node) for number, node in enumerate(_points(root), start=1)]
    if not rows:
        raise InputError(f"{name}: no points of a track (trkpt)")
    return Trajectory(
        positions=np.array([row[:3] for row in rows]),
        rotations=np.tile(np.eye(3), (len(rows), 1, 1)),
        stamps_ns=np.array([row[3] for row in rows], np.int64),
        path=name,
    )


def _points(root: Xml.Element) -> Iterator[Xml.Element]:
    return (node for node in root.iter() if _plain(node) == "trkpt")


def _plain(node: Xml.Element) -> str:
    """The name of a node without its namespace."""
    return str(node.tag).rpartition("}")[2]


def _point(name: str, number: int, node: Xml.Element) -> tuple[float, float, float, int]:
    texts = {_plain(child): (child.text or "").strip() for child in node}
    words = (node.get("lat", ""), node.get("lon", ""), texts.get("ele", ""))
    try:
        latitude, longitude, height = map(to_number, words)
        time = datetime.fromisoformat(texts.get("time", ""))
        since = (time if time.tzinfo else time.replace(tzinfo=UTC)) - _EPOCH
    except (ValueError, OverflowError):
        told = shown(" ".join((*words, texts.get("time", ""))))
        raise InputError(
            f"{name}: point {number} of its tracks ({told}): latitude, longitude, <ele> and <time> "
            "are needed"
        ) from None
    stamp = ((since.days * 86400 + since.seconds) * 10**6 + since.microseconds) * 1000
    if not -(2**62) < stamp < 2**62 or not np.isfinite(height):
        raise InputError(f"{name}: point {number} of its tracks is not of our time or height")
    return latitude, longitude, height, stamp


def places_in_map(track: Trajectory, crs: Any, where: str) -> Trajectory:
    """Latitudes and longitudes in the coordinates of a map; heights stay as they are.

    Args:
        track: positions are latitude and longitude [deg] and height [m].
        crs: the coordinates of the map, as pyproj has them.
        where: the file that has these coordinates, for messages.

    Raises:
        InputError: a position is none on the globe, or not within reach of the coordinates.
    """
    with needs_extra(where, "geo"):
        import pyproj
    latitude, longitude = track.positions[:, 0], track.positions[:, 1]
    if not ((np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 360.0)).all():
        raise InputError(f"{track.path}: latitudes beyond 90 or longitudes beyond 360 degrees")
    with decoding(where, "its coordinates cannot be used", "project the track yourself"):
        flat = pyproj.CRS(crs).to_2d()
        flat = flat.sub_crs_list[0] if flat.is_compound else flat
        way = pyproj.Transformer.from_crs("EPSG:4326", flat, always_xy=True)
        x, y = way.transform(longitude, latitude)
    places: FloatArray = np.stack([x, y, track.positions[:, 2]], axis=1)
    if not np.isfinite(places).all():
        raise InputError(f"{track.path}: not within reach of the coordinates of {where}")
    return Trajectory(places, track.rotations, track.stamps_ns, track.path)
