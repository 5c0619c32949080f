# SPDX-License-Identifier: Apache-2.0
"""Tracks of GPS, by which points of LAS are joined to where the receiver was."""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import open_log
from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.gps_time import clock_offset_of_utc_ns
from oddsmap.readers.gps_track import is_gpx, places_in_map, read_gpx

laspy = pytest.importorskip("laspy")
pyproj = pytest.importorskip("pyproj")

UTM = 32632
# Noon of 1 April 2020 in UTC, in Unix time and on the clock of GPS, 18 leap seconds ahead.
NOON = datetime(2020, 4, 1, 12, tzinfo=UTC)
UNIX = NOON.timestamp()
GPS = UNIX - 315_964_800 + 18
PLACE = np.array([448_000.0, 5_412_000.0, 350.0])


def at(seconds: float) -> FloatArray:
    """Along x at 10 m/s."""
    return np.array([PLACE[0] + 10.0 * seconds, PLACE[1], PLACE[2]])


def fixes(count: int = 6) -> list[tuple[float, float, float]]:
    """Latitude, longitude, height each second."""
    back = pyproj.Transformer.from_crs(UTM, 4326, always_xy=True)
    places = [at(i) for i in range(count)]
    return [(*reversed(back.transform(*place[:2])), place[2]) for place in places]


def gpx(path: Path, change: Any = str) -> Path:
    rows = [
        f'<trkpt lat="{lat:.10f}" lon="{lon:.10f}"><ele>{height}</ele>'
        f"<time>{(NOON + timedelta(seconds=i)).isoformat().replace('+00:00', 'Z')}</time></trkpt>"
        for i, (lat, lon, height) in enumerate(fixes())
    ]
    head = '<?xml version="1.0"?>\n<gpx xmlns="http://www.topografix.com/GPX/1/1" version="1.1">'
    path.write_text(change(f"{head}<trk><trkseg>{''.join(rows)}</trkseg></trk></gpx>"))
    return path


def las(path: Path, first: float, crs: int | None = UTM) -> Path:
    """Points below the track, half a second after its start and later."""
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), PLACE
    if crs is not None:
        header.add_crs(pyproj.CRS(crs))
    data = laspy.LasData(header)
    times = np.array([0.5, 1.5, 2.5])
    points = np.array([at(t) - np.array([0.0, 3.0, 50.0]) for t in times])
    data.x, data.y, data.z = points.T
    data.gps_time = first + times
    data.write(path)
    return path


def check(log: Any) -> None:
    scans = list(log)
    assert log.skipped == {}
    places = [scan.map_from_sensor.translation for scan in scans]
    np.testing.assert_allclose(places, [at(t) for t in (0.5, 1.5, 2.5)], atol=1e-3)


@pytest.mark.parametrize("first", [GPS, GPS - 1e9, GPS % 604_800])
def test_gpx_and_points_of_any_clock_of_gps(tmp_path: Path, first: float) -> None:
    """UTC of GPX is taken to the clock of the points, leap seconds and all."""
    log = open_log(las(tmp_path / "a.las", first), poses=gpx(tmp_path / "t.gpx"))
    check(log)
    assert "positions of GPS" in log.notes[0]
    assert log.notes[0].severity == "warning"
    assert ("and its times are in UTC" in log.notes[-1]) == (first != GPS)


def test_navsatfix(tmp_path: Path) -> None:
    """As rostopic echo -p writes it; Unix time is asked about, since it may be of any clock."""
    names = "%time,field.header.stamp,field.latitude,field.longitude,field.altitude"
    rows = [
        f"9,{round(UNIX + i)}000000000,{lat:.10f},{lon:.10f},{height}"
        for i, (lat, lon, height) in enumerate(fixes())
    ]
    track, points = tmp_path / "fix.csv", las(tmp_path / "a.las", GPS)
    track.write_text("\n".join([names, *rows]) + "\n")
    with pytest.raises(InputError, match=r"Unix time is --clock-offset 315964782\)"):
        open_log(points, poses=track)
    check(open_log(points, poses=track, clock_offset_s=315_964_782.0))


def test_leap_seconds() -> None:
    for day, leaps in (((2005, 12, 31), 13), ((2006, 1, 1), 14), ((2012, 7, 1), 16),
                       ((2016, 12, 31), 17), ((2017, 1, 1), 18)):  # fmt: skip
        unix = round(datetime(*day, tzinfo=UTC).timestamp()) * 10**9
        gps = unix - (315_964_800 - leaps) * 10**9
        offset, note = clock_offset_of_utc_ns(
            "a.las", (gps, gps + 10**9), "t.gpx", (unix, unix + 10**9)
        )
        assert offset == unix - gps
        assert note is None


def test_what_a_track_does_not_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    track = gpx(tmp_path / "t.gpx")
    without = las(tmp_path / "w.las", GPS, crs=None)
    feet = las(tmp_path / "f.las", GPS, crs=2277)
    for path, message in (
        (without, "its header does not say in which coordinates it is"),
        (feet, r"coordinates are in US survey foot, and heights of GPS in metres"),
    ):
        with pytest.raises(InputError, match=message):
            open_log(path, poses=track)
    points = las(tmp_path / "a.las", GPS)
    for old, new, message in (
        ("<ele>350.0</ele>", "", r"point 1 of its tracks .* <ele> and <time> are needed"),
        ("2020-04-01T", "noon", r"point 1 of its tracks"),
        ("2020-04-01T", "0020-04-01T", r"is not of our time or height"),
        ("trkpt", "wpt", "no points of a track"),
        ("</gpx>", "", "the GPX file cannot be read"),
        ("<gpx", "<!DOCTYPE gpx><gpx", "XML with declarations of its own"),
    ):
        bad = gpx(tmp_path / "b.gpx", lambda text, old=old, new=new: text.replace(old, new))
        with pytest.raises(InputError, match=message) as caught:
            open_log(points, poses=bad)
        assert "\n" not in str(caught.value)
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(InputError, match=r'pip install "oddsmap\[geo\]"'):
        open_log(points, poses=track)


def test_tracks_as_they_are(tmp_path: Path) -> None:
    path = gpx(tmp_path / "t.gpx")
    assert is_gpx(path)
    assert not is_gpx(tmp_path / "gone.gpx")
    track = read_gpx(path)
    assert track.stamps_ns is not None
    assert track.stamps_ns[:2].tolist() == [round(UNIX) * 10**9, round(UNIX + 1) * 10**9]
    np.testing.assert_allclose(track.positions, fixes(), atol=1e-9)
    wrong = Trajectory(np.array([[91.0, 0, 0]]), np.eye(3)[None], np.array([0]))
    with pytest.raises(InputError, match="latitudes beyond 90"):
        places_in_map(wrong, pyproj.CRS(UTM), "a.las")
