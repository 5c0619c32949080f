# SPDX-License-Identifier: Apache-2.0
"""LAS, LAZ and COPC: joined to a trajectory on GPS time."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, ConfigError, open_log
from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.evidence_map import build_map
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers import las, las_points
from oddsmap.readers.gps_time import clock_offset_ns
from oddsmap.readers.sensor_track import SensorTrack

laspy = pytest.importorskip("laspy")

START, UTM = 245_000.0, np.array([448_000.0, 5_412_000.0, 0.0])
HIGH = UTM + np.array([0.0, 0.0, 50.0])


def write_las(
    path: Path, points: FloatArray, times: FloatArray | None, form: int = 1, **more: Any
) -> Path:
    header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, 0.001)
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    if times is not None:
        data.gps_time = times
    for name, values in more.items():
        data[name] = values
    data.write(path)
    return path


def flight(count: int = 400, seconds: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Points on the ground below a sensor that flies along x at 10 m/s, 50 m up."""
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0.0, seconds, count)) + START
    points = np.stack([10.0 * (times - START), rng.uniform(-20, 20, count), np.zeros(count)], 1)
    return np.round(points, 3) + UTM, times


def track(path: Path, first: float = START, seconds: float = 2.0, name: str = "GPSTime") -> Path:
    rows = [f"{name},x,y,z"]
    for i in range(round(seconds) * 4 + 5):
        t = i / 4 - 0.5
        rows.append(f"{first + t:.3f},{UTM[0] + 10 * t:.3f},{UTM[1]:.3f},{UTM[2] + 50:.3f}")
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize(("name", "form"), [("a.las", 1), ("a.laz", 1), ("a.laz", 6)])
def test_rays_start_where_the_sensor_was(tmp_path: Path, name: str, form: int) -> None:
    """All points come back, each with the place of the sensor at its own time."""
    points, times = flight()
    log = open_log(write_las(tmp_path / name, points, times, form), poses=track(tmp_path / "t.csv"))
    scans = list(log)
    assert log.scan_count is None
    assert len(scans) == 20  # pieces of 0.1 s
    assert log.skipped == {}
    found, places, stamps = [], [], []
    for scan in scans:
        assert scan.beam_origins is not None
        assert scan.beam_times_ns is not None
        assert scan.measured_points is not None
        starts = scan.map_from_sensor.transform(scan.beam_origins)
        places.append(starts)
        found.append(starts + scan.measured_points)
        stamps.append(scan.beam_times_ns)
        assert np.ptp(scan.beam_times_ns) < 100_000_000
    np.testing.assert_allclose(np.concatenate(found), points, atol=1e-8)
    exact = [round(Decimal(time) * 10**9) for time in times.tolist()]
    assert np.concatenate(stamps).tolist() == exact
    expected = UTM + np.stack([10 * (times - START), 0 * times, 50 + 0 * times], axis=1)
    np.testing.assert_allclose(np.concatenate(places), expected, atol=1e-6)


def test_files_that_are_not_in_the_order_of_time_give_the_same_scans(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tiled files are not; chunks of any size change nothing either."""
    points, times = flight()
    poses = track(tmp_path / "t.csv")
    plain = write_las(tmp_path / "a.las", points, times)
    expected = list(open_log(plain, poses=poses))
    order = np.random.default_rng(1).permutation(len(points))
    mixed = write_las(tmp_path / "b.las", points[order], times[order])
    # Two lasers in one stream: late by less than a piece.
    late = np.argsort(times + np.random.default_rng(2).uniform(0, 0.09, len(times)))
    jittered = write_las(tmp_path / "c.las", points[late], times[late])
    for chunk in (500_000, 7):
        monkeypatch.setattr(las_points, "_CHUNK", chunk)
        for path in (plain, mixed, jittered):
            for scan, other in zip(open_log(path, poses=poses), expected, strict=True):
                np.testing.assert_array_equal(scan.measured_points, other.measured_points)
                np.testing.assert_array_equal(scan.beam_times_ns, other.beam_times_ns)
                np.testing.assert_array_equal(scan.beam_origins, other.beam_origins)
    monkeypatch.setattr(las, "memory_limit", lambda: 1000)
    open_log(plain, poses=poses)
    with pytest.raises(
        InputError, match=r"400 points are not in the order .* sort the file by GPS"
    ):
        open_log(mixed, poses=poses)


def test_pieces_are_given_out_before_the_file_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """What waits is a piece or two, however long the file is."""
    taken = 0

    def chunks() -> Iterator[tuple[Any, Any]]:
        nonlocal taken
        for i in range(100):
            taken += 1
            yield np.arange(10) * 10_000_000 + i * 100_000_000, np.zeros((10, 3))

    for i, (times, _) in enumerate(las._pieces(chunks(), in_order=True)):
        assert len(times) == 10
        assert taken <= i + 4


def test_nothing_is_extrapolated(tmp_path: Path) -> None:
    points, times = flight(seconds=4.0)
    path = write_las(tmp_path / "a.las", points, times)
    log = open_log(path, poses=track(tmp_path / "t.csv", seconds=2.0))
    used = sum(scan.size for scan in log)
    outside = int((times > START + 2.5).sum())  # track() goes on for half a second
    assert used == len(points) - outside > 0
    assert log.skipped == {"beam.no_pose": outside}
    again = sum(scan.size for scan in log)
    assert (again, log.skipped) == (used, {"beam.no_pose": outside})
    # Poses a quarter of a second apart, of which the nearer is within 0.05 s of a few points.
    few = open_log(path, poses=tmp_path / "t.csv", tolerance_s=0.05)
    assert 0 < sum(scan.size for scan in few) < 0.6 * used


def test_withheld_points_and_noise_are_left_out(tmp_path: Path) -> None:
    points, times = flight(100)
    kind, withheld = np.full(100, 2), np.zeros(100, np.uint8)
    kind[:3], kind[3:5], withheld[50:60] = 7, 18, 1
    path = write_las(tmp_path / "a.las", points, times, classification=kind, withheld=withheld)
    log = open_log(path, poses=track(tmp_path / "t.csv"))
    assert sum(scan.size for scan in log) == 85
    assert log.skipped == {"beam.withheld": 15}
    log = open_log(path, origin=HIGH)
    assert log.skipped == {"beam.withheld": 15}


def test_one_place(tmp_path: Path) -> None:
    """A scanner on a tripod: one scan, whatever the times are."""
    points, _ = flight(100)
    for times, form in ((None, 0), (np.zeros(100), 1)):
        path = write_las(tmp_path / "a.las", points, times, form)
        (scan,) = open_log(path, origin=HIGH)
        np.testing.assert_array_equal(scan.map_from_sensor.translation, HIGH)
        assert scan.measured_points is not None
        ends = scan.map_from_sensor.transform(scan.measured_points)
        np.testing.assert_allclose(ends, points, atol=1e-8)


def test_points_on_borders_of_cells_mark_the_cells_that_they_are_in(tmp_path: Path) -> None:
    """Of coordinates in centimetres a fifth lies on borders of 5 cm, far from 0 as in UTM.

    The sensor is below the points, nearer to 0, where doubles are finer.
    """
    rng = np.random.default_rng(8)
    hill = np.array([0.0, 0.0, 300.0])
    points = np.round(UTM + hill + rng.integers(0, 2000, (300, 3)) / 100.0, 2)
    times = START + np.sort(rng.uniform(0.0, 0.9, 300))
    path = write_las(tmp_path / "a.las", points, times)
    file = laspy.read(path)
    points = np.stack([file.x, file.y, file.z], axis=1)
    expected = {tuple(cell) for cell in np.floor(points / 0.05).astype(int).tolist()}
    body = track(tmp_path / "t.csv")
    body.write_text(body.read_text().replace(",50.000", ",50.0123"))
    for options in ({"poses": body}, {"origin": HIGH + 0.123}):
        grid = build_map(open_log(path, **options), 0.05, sensor=BeamSensor(), votes="beam")
        index, hits, _ = grid.cells()
        assert {tuple(cell) for cell in index[hits > 0].tolist()} == expected


def test_a_lever_arm(tmp_path: Path) -> None:
    points, times = flight()
    stamps = np.round((np.arange(10) / 4 - 0.25 + START) * 1e9).astype(np.int64)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    places = np.tile(HIGH, (10, 1))
    body = Trajectory(places, np.tile(turn, (10, 1, 1)), stamps)
    arm = Pose3(np.array([2.0, 0, 0]), np.eye(3))
    log = open_log(write_las(tmp_path / "a.las", points, times), poses=body, body_from_sensor=arm)
    np.testing.assert_allclose(
        next(iter(log)).map_from_sensor.translation, HIGH + np.array([0.0, 2.0, 0.0])
    )


WEEK, ADJUSTED = 604_800.0, 1e9
GPS = 2100 * WEEK + START  # April 2020


@pytest.mark.parametrize(
    ("of_points", "of_track", "words"),
    [
        (START, START, ""),
        (GPS, GPS, ""),
        (START, GPS, "the points have seconds of the GPS week and the trajectory GPS seconds"),
        (
            GPS - ADJUSTED,
            GPS,
            "the points have GPS seconds less 10^9 and the trajectory GPS seconds",
        ),
        (GPS - ADJUSTED, START, "and the trajectory seconds of the GPS week"),
        (START, GPS - ADJUSTED, "and the trajectory GPS seconds less 10^9"),
        (GPS, GPS - ADJUSTED, "the points have GPS seconds and the trajectory GPS seconds less"),
        (GPS, START, "the points have GPS seconds and the trajectory seconds of the GPS week"),
    ],
)
def test_clocks_of_gps(of_points: float, of_track: float, words: str) -> None:
    times, stamps = ((round(t * 1e9), round(t * 1e9) + 5 * 10**9) for t in (of_points, of_track))
    offset, note = clock_offset_ns("a.las", times, "t.csv", stamps)
    assert offset == round((of_track - of_points) * 1e9)
    assert words in (note or "")
    assert (note is None) == (of_points == of_track)


def test_clocks_that_do_not_meet() -> None:
    def span(first: float) -> tuple[int, int]:
        return round(first * 1e9), round((first + 5) * 1e9)

    with pytest.raises(InputError, match=r"they overlap in no clock of GPS: say what to add"):
        clock_offset_ns("a.las", span(START), "t.csv", span(START + 100))
    unix = GPS + 315_964_800 - 18
    for of_points in (GPS, GPS - ADJUSTED):
        offset = round(unix - of_points)
        with pytest.raises(InputError, match=rf"Unix time is --clock-offset {offset}\)"):
            clock_offset_ns("a.las", span(of_points), "t.csv", span(unix))


def test_the_clock_may_be_said(tmp_path: Path) -> None:
    points, times = flight()
    path = write_las(tmp_path / "a.las", points, times)
    poses = track(tmp_path / "t.csv", 1_600_000_000.0)
    with pytest.raises(InputError, match="they overlap in no clock of GPS"):
        open_log(path, poses=poses)
    log = open_log(path, poses=poses, clock_offset_s=1_600_000_000.0 - START)
    assert sum(scan.size for scan in log) == len(points)


def test_what_cannot_be_joined_is_one_line(tmp_path: Path) -> None:
    points, times = flight(50)
    path = write_las(tmp_path / "a.las", points, times)
    poses = track(tmp_path / "t.csv")
    plain = tmp_path / "kitti.txt"
    plain.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    fixes = tmp_path / "gps.csv"
    fixes.write_text("time,latitude,longitude,altitude\n1,48,9,300\n")
    far = tmp_path / "far.csv"
    far.write_text("t,x,y,z\n245000,0,0,0\n245002,0,0,0\n")
    zero = write_las(tmp_path / "z.las", points, 0 * times)
    untimed = write_las(tmp_path / "u.las", points, None, 0)
    cases: list[tuple[Path, dict[str, Any], str]] = [
        (path, {}, "does not say where they were seen from: give the trajectory"),
        (zero, {"poses": poses}, "the GPS times of all its 50 points are 0"),
        (untimed, {"poses": poses}, r"have no GPS times .point format 0, 2 or 4"),
        (path, {"poses": plain}, "the poses have no stamps"),
        (path, {"poses": fixes}, "its header does not say in which coordinates"),
        (path, {"poses": far}, r"are 54\d\d km from the poses of .*far.csv"),
        (path, {"poses": poses, "points_in": "sensor"}, "leave points_in .* out"),
        (path, {"poses": poses, "times": poses}, "leave `times` out"),
        (path, {"origin": (0, 0, 0), "clock_offset_s": 1.0}, "leave `clock_offset_s` out"),
        (path, {"poses": poses, "body_from_sensor": Pose3(np.ones(3), np.eye(3))}, "rotations do"),
    ]
    for log, options, message in cases:
        with pytest.raises(InputError, match=message) as caught:
            open_log(log, **options)
        assert "\n" not in str(caught.value)
    for options, message in (
        ({"origin": (1, 2)}, "origin is three numbers"),
        ({"origin": (1, 2, np.nan)}, "origin is three numbers"),
        ({"origin": (1, 2, 3), "poses": poses}, "leave one out"),
        ({"origin": (1, 2, 3), "points_in": "sensor"}, "origin is for points in the map"),
    ):
        with pytest.raises(ConfigError, match=message):
            open_log(path, **options)


def test_a_file_cut_short_and_a_missing_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points, times = flight(50)
    path = write_las(tmp_path / "a.las", points, times)
    poses = track(tmp_path / "t.csv")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match=r"a\.las: .*copy or write it again"):
        list(open_log(path, poses=poses))
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(
        InputError, match=r'laspy reads such files: pip install "oddsmap\[survey\]"'
    ):
        open_log(path, poses=poses)


class TestTracks:
    stamps = np.array([30, 10, 20, 10], np.int64)
    places = np.array([[3.0, 0, 0], [1, 0, 0], [2, 5, 0], [1, 0, 0]])

    def of(self, tolerance: int = 10) -> SensorTrack:
        turns = np.tile(np.eye(3), (4, 1, 1))
        return SensorTrack.of(Trajectory(self.places, turns, self.stamps), None, tolerance)

    def test_between_two_poses(self) -> None:
        places, known = self.of().at(np.array([9, 10, 12, 20, 30, 31]))
        assert known.tolist() == [False, True, True, True, True, False]
        np.testing.assert_allclose(places[known, 0], [1.0, 1.2, 2.0, 3.0])

    def test_the_nearer_pose_must_be_near(self) -> None:
        assert self.of(3).at(np.arange(10, 21))[1].tolist() == [
            *[True] * 4, *[False] * 3, *[True] * 4
        ]  # fmt: skip

    def test_as_poses_are_looked_up_one_by_one(self) -> None:
        rng = np.random.default_rng(5)
        stamps = np.sort(rng.choice(10**6, 50, replace=False)) + 1_600_000_000 * 10**9
        path = Trajectory(rng.normal(size=(50, 3)), np.tile(np.eye(3), (50, 1, 1)), stamps)
        found, known = SensorTrack.of(path, None, 10**6).at(
            times := rng.integers(stamps[0], stamps[-1], 200)
        )
        assert known.all()
        for time, place in zip(times.tolist(), found, strict=True):
            np.testing.assert_allclose(place, path.at(time, 10**6).translation, atol=1e-9)

    def test_two_poses_of_one_time(self) -> None:
        turns = np.tile(np.eye(3), (2, 1, 1))
        twice = Trajectory(self.places[:2], turns, np.array([5, 5]))
        with pytest.raises(InputError, match="two different poses have the stamp"):
            SensorTrack.of(twice, None, 10)


@pytest.mark.realdata
class TestSurveys:
    def track_of(self, path: Path, points: FloatArray, times: FloatArray) -> Path:
        """A straight flight above the points, 700 m up."""
        rows = ["t,x,y,z"]
        for t in np.arange(np.floor(times.min()) - 1, np.ceil(times.max()) + 2):
            x, y = (np.polyval(np.polyfit(times, points[:, i], 1), t) for i in (0, 1))
            rows.append(f"{t:.3f},{x:.3f},{y:.3f},2300")
        path.write_text("\n".join(rows))
        return path

    def test_autzen(self, tmp_path: Path, data_folder: Path) -> None:
        path = data_folder / "survey" / "autzen_trim.laz"
        file = laspy.read(path)
        points = np.stack([file.x, file.y, file.z], axis=1)
        log = open_log(path, poses=self.track_of(tmp_path / "t.csv", points, file.gps_time))
        assert "its coordinates are in feet" in log.notes[0]
        scans = list(log)
        assert sum(scan.size for scan in scans) == 110_000
        assert len(scans) == 67
        ends = [
            scan.map_from_sensor.transform(scan.beam_origins + scan.measured_points)
            for scan in scans
            if scan.beam_origins is not None
            if scan.measured_points is not None
        ]
        np.testing.assert_allclose(np.concatenate(ends), points, atol=1e-6)
        grid = build_map(scans[:2], 5.0, sensor=BeamSensor())
        assert grid.cell_count() > 10_000

    def test_copc_is_not_in_the_order_of_time(self, tmp_path: Path, data_folder: Path) -> None:
        path = data_folder / "survey" / "simple.copc.laz"
        file = laspy.read(path)
        points = np.stack([file.x, file.y, file.z], axis=1)
        log = open_log(path, poses=self.track_of(tmp_path / "t.csv", points, file.gps_time))
        scans = list(log)
        assert sum(scan.size for scan in scans) == 1065
        stamps = np.concatenate([scan.beam_times_ns for scan in scans])
        assert (np.diff(stamps) >= 0).all()
        assert all(a < b for a, b in pairwise(scan.stamp_ns or 0 for scan in scans))

    def test_times_of_zero(self, tmp_path: Path, data_folder: Path) -> None:
        path, poses = data_folder / "survey" / "simple1_4.las", track(tmp_path / "t.csv")
        with pytest.raises(InputError, match="the GPS times of all its 22600 points are 0"):
            open_log(path, poses=poses)
