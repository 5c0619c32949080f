# SPDX-License-Identifier: Apache-2.0
"""Recordings of robots that move while they scan: each beam at its own time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, EvidenceMap, Pose2, Pose3, Scan, add_scans, build_map, open_log
from oddsmap.errors import InputError
from tests.kit import votes_of
from tests.recordings.bags import Messages, Said

MS = 10**6
SECOND = 10**9
START = 1_700_000_000 * SECOND
EVERY = 1.25e-3  # between beams [s]
SENSOR = BeamSensor(range_max=30.0)


def yaw_at(time_ns: int) -> float:
    return 1.5 * (time_ns - START) / SECOND


def place_at(time_ns: int) -> tuple[float, float, float]:
    """At a constant speed: between poses there is nothing to round."""
    t = (time_ns - START) / SECOND
    return 2.0 * t, -0.5 * t, 0.0


def turning(
    messages: Messages, *, scans: int = 8, poses: int = 60, gap: int = 20 * MS, still: bool = False,
    every: float = EVERY, step: float = 0.1,
) -> list[Said]:  # fmt: skip
    """A robot that drives and turns at once, with a laser 0.2 m ahead of its middle."""
    rng = np.random.default_rng(0)
    fixed = messages.transform(START, "base", "laser", (0.2, 0.1, 0.3), 0.4)
    said: list[Said] = [("/tf_static", START, messages.tf(fixed))]
    for k in range(poses):
        now = START + k * gap
        where, yaw = ((1.23, 4.56, 0.0), 0.7) if still else (place_at(now), yaw_at(now))
        said.append(("/tf", now, messages.tf(messages.transform(now, "map", "base", where, yaw))))
    if still:  # at other times it moved, or its transform would be one for all time
        now = START - SECOND
        moved = messages.transform(now, "map", "base", (0.0, 0.0, 0.0), 0.0)
        said.append(("/tf", now, messages.tf(moved)))
    for k in range(scans):
        now = START + k * SECOND // 10 + 7 * MS
        ranges = rng.uniform(3.0, 5.0, 60)
        said.append(("/scan", now, messages.laser(now, "laser", ranges, 0.0, step, every)))
    return said


def one_by_one(log_path: Path, until: int) -> list[list[Scan]]:
    """Each beam as a scan of its own, from the pose at its own time; by scans."""
    found = []
    for scan in open_log(log_path, deskew=False):
        assert scan.stamp_ns is not None
        of_scan = []
        for i in range(scan.size):
            time = scan.stamp_ns + round(np.float32(EVERY) * np.float64(1e9) * i)
            if time > until:
                continue
            x, y, _ = place_at(time)
            body, mounted = Pose2(x, y, yaw_at(time)), Pose2(0.2, 0.1, 0.4)
            part = slice(i, i + 1)
            of_scan.append(Scan(body @ mounted, scan.directions[part], scan.ranges[part]))
        found.append(of_scan)
    return found


@pytest.mark.parametrize("votes", ["scan", "beam"])
def test_each_beam_starts_where_the_sensor_was(votes: str, tmp_path: Path) -> None:
    messages = Messages("bag")
    path = messages.write(tmp_path / "run", turning(messages))
    log = open_log(path)
    got = votes_of(build_map(log, 0.1, sensor=SENSOR, votes=votes))
    assert [(note.code, str(note)) for note in log.notes] == [
        ("log.deskewed", "beams are taken at their own times (deskewed): scans take 73.7 ms, "
         "poses come every 20 ms")
    ]  # fmt: skip
    want: dict[Any, Any] = {}
    for beams in one_by_one(path, START + 59 * 20 * MS):
        cells: dict[Any, Any] = {}
        for beam in beams:
            for cell, (hits, passes) in votes_of(build_map([beam], 0.1, sensor=SENSOR)).items():
                before = cells.get(cell, (0, 0))
                cells[cell] = before[0] + hits, before[1] + passes
        for cell, (hits, passes) in cells.items():
            if votes == "scan":  # one vote a cell, and hits go first
                hits, passes = min(hits, 65536), 0 if hits else min(passes, 65536)
            before = want.get(cell, (0, 0))
            want[cell] = before[0] + hits, before[1] + passes
    assert got == want
    assert got != votes_of(build_map(open_log(path, deskew=False), 0.1, sensor=SENSOR, votes=votes))


@pytest.mark.parametrize("container", ["bag", "mcap"])
def test_nothing_changes_where_the_robot_stands_still(container: str, tmp_path: Path) -> None:
    messages = Messages(container)
    path = messages.write(tmp_path / "run", turning(messages, still=True))
    moving, at_once = open_log(path), open_log(path, deskew=False)
    assert moving.notes[0].code == "log.deskewed"
    for one, other in zip(moving, at_once, strict=True):
        assert one.beam_origins is None
        np.testing.assert_array_equal(one.directions, other.directions)
        np.testing.assert_array_equal(
            one.map_from_sensor.translation, other.map_from_sensor.translation
        )
    grids = [build_map(log, 0.1, sensor=SENSOR) for log in (moving, at_once)]
    assert votes_of(grids[0]) == votes_of(grids[1])


def test_order_threads_and_tiles_change_no_bit(tmp_path: Path) -> None:
    messages = Messages("bag")
    log = open_log(messages.write(tmp_path / "run", turning(messages)))
    first = votes_of(build_map(log, 0.1, sensor=SENSOR))
    others = [votes_of(build_map(list(log)[::-1], 0.1, sensor=SENSOR, threads=3))]
    small = EvidenceMap(0.1, sensor=SENSOR, tile_side=8)
    add_scans(small, log)
    others.append(votes_of(small))
    assert all(other == first for other in others)


def test_beams_after_the_last_pose_are_left_out_and_counted(tmp_path: Path) -> None:
    messages = Messages("bag")
    path = messages.write(tmp_path / "run", turning(messages, scans=3, poses=12))  # to 220 ms
    log = open_log(path)
    scans = list(log)
    assert [scan.size for scan in scans] == [60, 60, 11]  # of 1.25 ms, from 207 ms on
    assert log.skipped == {"beam.no_pose": 49}
    assert log.notes[-1].code == "beam.no_pose"
    assert str(log.notes[-1]).startswith("49 beams were left out: ")
    assert [scan.size for scan in open_log(path, deskew=False)] == [60, 60, 60]


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"gap": 200 * MS}, "scans take 73.7 ms, but poses come every 200 ms"),
        ({"every": 0.004}, "they span 236 ms, and scans come every 100 ms"),
    ],
)
def test_what_speaks_against_it_is_said(more: dict[str, Any], why: str, tmp_path: Path) -> None:
    messages = Messages("bag")
    path = messages.write(tmp_path / "run", turning(messages, **more))
    log = open_log(path, tolerance_s=0.2)
    assert next(iter(log)).beam_origins is None
    assert log.notes[0].code == "log.not_deskewed"
    assert why in log.notes[0]
    told = open_log(path, tolerance_s=0.2, deskew=True)
    assert next(iter(told)).beam_origins is not None
    assert told.notes[0].code == "log.deskewed"


@pytest.mark.parametrize("every", [0.0, 1e-6])
def test_scans_without_times_or_next_to_none(every: float, tmp_path: Path) -> None:
    messages = Messages("bag")
    path = messages.write(tmp_path / "run", turning(messages, every=every))
    log = open_log(path)
    assert log.notes == ()
    assert next(iter(log)).beam_origins is None
    if every == 0.0:
        with pytest.raises(InputError, match="nothing says when each beam was taken"):
            open_log(path, deskew=True)


def cloud_of(
    rng: np.random.Generator, after: np.ndarray[Any, Any]
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    points = rng.uniform(-6, 6, (len(after), 3))
    table = np.zeros(len(after), [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("t", "<u4")])
    for axis, name in enumerate("xyz"):
        table[name] = points[:, axis]
    table["t"] = after
    return table, points


@pytest.mark.parametrize("votes", ["scan", "beam"])
def test_clouds_whose_rings_stand_one_after_the_other(votes: str, tmp_path: Path) -> None:
    """Times go up ring by ring; beams of one column share a time, and an origin."""
    messages, rng = Messages("mcap"), np.random.default_rng(2)
    after = np.tile(np.arange(16) * 6 * MS, 8)
    said = [each for each in turning(messages) if each[0] != "/scan"]
    said.append(("/points", START + 40 * MS, None))
    table, points = cloud_of(rng, after)
    stamp = START + 40 * MS
    said[-1] = ("/points", stamp, messages.cloud(stamp, "laser", table, rows=8))
    log = open_log(messages.write(tmp_path / "run", said))
    (scan,) = list(log)
    assert scan.beam_origins is not None
    assert len(np.unique(scan.beam_origins, axis=0)) == 16
    want: dict[Any, Any] = {}
    for point, late in zip(points, after.tolist(), strict=True):
        pose = pose_of_laser(stamp + late)
        beam = Scan.from_points(pose, point[None])
        for cell, (hits, passes) in votes_of(build_map([beam], 0.1)).items():
            before = want.get(cell, (0, 0))
            want[cell] = before[0] + hits, before[1] + passes
    if votes == "scan":
        want = {
            cell: (min(hits, 65536), 0 if hits else min(passes, 65536))
            for cell, (hits, passes) in want.items()
        }
    assert votes_of(build_map(log, 0.1, votes=votes)) == want


def pose_of_laser(time_ns: int) -> Pose3:
    def turned(at: tuple[float, float, float], yaw: float) -> Pose3:
        turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        return Pose3.from_quaternion_xyzw(at, turn)

    return turned(place_at(time_ns), yaw_at(time_ns)) @ turned((0.2, 0.1, 0.3), 0.4)


def test_a_file_of_poses_deskews_as_transforms_do(tmp_path: Path) -> None:
    messages = Messages("bag")
    said = [each for each in turning(messages) if each[0] != "/tf"]
    path = messages.write(tmp_path / "run", said)
    poses = tmp_path / "poses.txt"
    lines = []
    for k in range(60):
        now = START + k * 20 * MS
        pose, yaw = pose_of_laser(now), yaw_at(now) + 0.4
        x, y, z = pose.translation.tolist()
        turn = f"0 0 {math.sin(yaw / 2)!r} {math.cos(yaw / 2)!r}"
        lines.append(f"{now / 1e9:.9f} {x!r} {y!r} {z!r} {turn}\n")
    poses.write_text("".join(lines))
    log = open_log(path, poses=poses)
    assert log.notes[-1].code == "log.deskewed"
    for scan in log:
        assert scan.beam_origins is not None
        assert scan.beam_times_ns is not None
        for i in (0, 30, 59):
            at = pose_of_laser(int(scan.beam_times_ns[i])).translation[:2]
            found = scan.map_from_sensor.transform(scan.beam_origins)[i]
            np.testing.assert_allclose(found, at, atol=4e-5)  # it drives a curve


def test_deskewing_is_refused_where_nothing_has_times(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("FLASER 1 2.0 0 0 0 0 0 0 1.0 host 1.0\n")
    with pytest.raises(InputError, match="is not deskewed: leave `deskew` out"):
        open_log(path, deskew=True)
    assert len(open_log(path, deskew=False)) == 1


@pytest.mark.parametrize(
    ("late", "offset", "doubt"),
    [
        (1, 0.0, "1 ms after their stamps, and their last beams are 73.7 ms after them"),
        (-2, 0.0, "2 ms before their stamps, and their last beams are 73.7 ms after them"),
        (-7600, 0.0, "7.6 s before their stamps: by clocks that differ it cannot be told"),
        (1, -0.074, None),
        (80, 0.0, None),
        (0, 0.0, None),
    ],
)
def test_a_scan_is_not_written_before_its_last_beam(
    late: int, offset: float, doubt: str | None, tmp_path: Path
) -> None:
    """Some drivers stamp a scan when it is complete, and not with the time of its first beam."""
    messages = Messages("bag")
    said = [
        (topic, now + late * MS if topic == "/scan" else now, message)
        for topic, now, message in turning(messages)
    ]
    log = open_log(messages.write(tmp_path / "run", said), clock_offset_s=offset)
    note = next(each for each in log.notes if each.code.startswith("log."))
    assert note.code == ("log.not_deskewed" if doubt else "log.deskewed")
    assert f"scans were written {doubt}" in note or not doubt
    assert ("--clock-offset -0.0737" in note) == (late in (1, -2) and not offset)
