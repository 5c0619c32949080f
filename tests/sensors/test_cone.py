# SPDX-License-Identifier: Apache-2.0
"""Wide beams: which cells, what weights, and which readings are left out."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap.sensors.cone
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.scan import Scan
from oddsmap.sensors.cone import ConeSensor
from tests.kit import ONE, Votes
from tests.naive.cones import cone_votes

angles = st.one_of(st.floats(0.5, 179.9), st.sampled_from([1.0, 30.0, 90.0, 120.0, 180.0]))
parts = st.one_of(st.just(0.0), st.just(1.0), st.floats(0.0, 1.0))
places = st.one_of(st.floats(-3.0, 3.0), st.sampled_from([0.0, 0.5, 1.0, -2.0]))
headings = st.one_of(
    st.floats(-math.pi, math.pi), st.sampled_from([0.0, math.pi / 2, math.pi, math.pi / 4])
)
readings = st.one_of(st.floats(0.0, 11.5, exclude_min=True), st.sampled_from([0.5, 4.0, math.inf]))


@st.composite
def sensors(draw: st.DrawFn) -> ConeSensor:
    return ConeSensor(
        cone_deg=draw(angles),
        range_max=12.0,
        hit_width=draw(st.one_of(st.just(0.0), st.floats(0.0, 4.0))),
        share_hit=draw(st.booleans()),
        angular_falloff=draw(parts),
        range_falloff=draw(parts),
        pass_falloff=draw(parts),
    )


def one_beam(pose: Pose2 | Pose3, axis: list[float], reading: float) -> Scan:
    return Scan(pose, np.array([axis]), np.array([reading]))


def listed(sensor: ConeSensor, scans: list[Scan], resolution: float = 1.0) -> list[Votes]:
    """The votes of each scan; no cell twice, as long as each scan has one beam."""
    found: list[Votes] = []
    for part in sensor.votes(scans, resolution)[0]:
        for begin, end in zip(part.offsets[:-1], part.offsets[1:], strict=True):
            cells = [tuple(map(int, cell)) for cell in part.index[begin:end]]
            assert len(set(cells)) == len(cells), "a cell is listed twice"
            votes = zip(part.hits[begin:end], part.passes[begin:end], strict=True)
            found.append(dict(zip(cells, ((int(h), int(p)) for h, p in votes), strict=True)))
    return found


def wanted(sensor: ConeSensor, scan: Scan, resolution: float = 1.0) -> Votes:
    rotation, origin = scan.map_from_sensor.rotation, scan.map_from_sensor.translation
    axis = np.zeros(len(origin))
    for column in range(len(origin)):
        axis += rotation[:, column] * scan.directions[0, column]
    reading = float(scan.ranges[0])
    hit = reading < (sensor.range_max or math.inf)
    reach = reading if hit else float(sensor.range_max or 0.0)
    start, end = origin / resolution, (origin + axis * reach) / resolution
    return cone_votes(
        sensor, resolution, start.tolist(), axis.tolist(), reach / resolution, end.tolist(), hit
    )


@given(sensors(), places, places, headings, readings)
def test_of_the_plane_as_by_the_rule(
    sensor: ConeSensor, x: float, y: float, heading: float, reading: float
) -> None:
    scan = one_beam(Pose2(x, y, 0.3), [math.cos(heading), math.sin(heading)], reading)
    want = wanted(sensor, scan)
    assert listed(sensor, [scan]) == [want]
    hits = sum(hit for hit, _ in want.values())
    assert not sensor.share_hit or hits == (ONE if reading < math.inf else 0)


@given(sensors(), places, headings, st.floats(-1.6, 1.6), st.floats(1e-3, 5.0))
def test_of_space_as_by_the_rule(
    sensor: ConeSensor, x: float, heading: float, up: float, reading: float
) -> None:
    across = math.cos(up)
    axis = [across * math.cos(heading), across * math.sin(heading), math.sin(up)]
    scan = one_beam(Pose3(np.array([x, 0.25, -x]), np.eye(3)), axis, reading)
    want = wanted(sensor, scan)
    assert listed(sensor, [scan]) == [want]
    assert not sensor.share_hit or sum(hit for hit, _ in want.values()) == ONE


@pytest.mark.parametrize("cone_deg", [0.01, 5.0, 40.0, 90.0, 180.0])
@pytest.mark.parametrize("at", [(0.0, 0.0), (0.5, 0.5), (0.0, 0.5), (3.0, -2.0)])
@pytest.mark.parametrize("axis", [(1, 0), (0, 1), (-1, 0), (0, -1), (0.6, 0.8), (-0.28, 0.96)])
def test_sensor_and_sides_on_the_lattice(
    cone_deg: float, at: tuple[float, float], axis: tuple[float, float]
) -> None:
    """Centres exactly on the sides of the cone and exactly at the limits of range."""
    for reading in (math.ulp(0.0), 0.5, 1.0, 7.5, 8.0, math.inf):  # exactly 0 is no reading
        sensor = ConeSensor(cone_deg=cone_deg, range_max=9.0, hit_width=2.0)
        flat = one_beam(Pose2(*at, 0.0), list(axis), reading)
        assert listed(sensor, [flat]) == [wanted(sensor, flat)]
        for turned in ([0.0, *axis], [*axis, 0.0], [axis[0], 0.0, axis[1]]):
            space = one_beam(Pose3(np.array([*at, at[0]]), np.eye(3)), turned, min(reading, 4.0))
            assert listed(sensor, [space]) == [wanted(sensor, space)]


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_in_metres(resolution: float) -> None:
    sensor = ConeSensor(cone_deg=25.0, range_max=2.0, hit_width=0.15, pass_falloff=0.5)
    rng = np.random.default_rng(5)
    for _ in range(30):
        x, y, theta, heading, reading = rng.uniform(-2.0, 2.0, 5)
        axis = [math.cos(heading), math.sin(heading)]
        scan = one_beam(Pose2(float(x), float(y), float(theta)), axis, abs(float(reading)))
        assert listed(sensor, [scan], resolution) == [wanted(sensor, scan, resolution)]


def test_a_cone_in_numbers() -> None:
    """A sensor in the middle of cell (0, 0) looks along x, 60 degrees wide, and reads 4 cells."""
    sensor = ConeSensor(cone_deg=60.0, range_max=9.0)
    votes = listed(sensor, [one_beam(Pose2(0.5, 0.5, 0.0), [1.0, 0.0], 4.0)])[0]
    free = {cell for cell, (_, passed) in votes.items() if passed == ONE}
    arc = {cell for cell, (hit, _) in votes.items() if hit > 0}
    assert free == {(0, 0), (1, 0), (2, -1), (2, 0), (2, 1), (3, -1), (3, 0), (3, 1)}
    assert arc == {(4, -2), (4, -1), (4, 0), (4, 1), (4, 2)}
    assert sum(hit for hit, _ in votes.values()) == ONE
    textbook = dataclasses.replace(sensor, share_hit=False)
    again = listed(textbook, [one_beam(Pose2(0.5, 0.5, 0.0), [1.0, 0.0], 4.0)])[0]
    assert {cell for cell, (hit, _) in again.items() if hit == ONE} == arc


def test_a_no_return_clears_and_marks_nothing() -> None:
    sensor = ConeSensor(cone_deg=60.0, range_max=4.0)
    votes = listed(sensor, [one_beam(Pose2(0.5, 0.5, 0.0), [1.0, 0.0], math.inf)])[0]
    assert set(votes) == {(0, 0), (1, 0), (2, -1), (2, 0), (2, 1), (3, -1), (3, 0), (3, 1)}
    assert set(votes.values()) == {(0, ONE)}
    near = dataclasses.replace(sensor, clear_range=2.0)
    votes = listed(near, [one_beam(Pose2(0.5, 0.5, 0.0), [1.0, 0.0], math.inf)])[0]
    assert set(votes) == {(0, 0), (1, 0)}


def test_falloffs() -> None:
    pose, axis = Pose2(0.5, 0.5, 0.0), [1.0, 0.0]
    base = ConeSensor(cone_deg=90.0, range_max=8.0, share_hit=False)

    def votes(**changes: float) -> Votes:
        return listed(dataclasses.replace(base, **changes), [one_beam(pose, axis, 4.0)])[0]  # type: ignore[arg-type]

    # (2, 1) is 26.57 degrees off the axis and 2.236 cells away, (4, 1) is on the arc.
    off = math.atan2(1, 2) / math.radians(45)
    assert votes()[2, 1] == (0, ONE)
    assert votes(angular_falloff=0.5)[2, 1] == (0, round(ONE * (1 - 0.5 * off**2)))
    assert votes(angular_falloff=1.0)[2, 0] == (0, ONE)
    assert votes(range_falloff=1.0)[2, 0] == (0, round(ONE * 0.75))
    assert votes(range_falloff=1.0)[4, 0] == (ONE // 2, 0)
    assert votes(pass_falloff=1.0)[2, 0] == (0, round(ONE * 0.75))
    assert votes(pass_falloff=1.0)[4, 0] == (ONE, 0)
    off = math.atan2(1, 4) / math.radians(45)
    assert votes(angular_falloff=1.0)[4, 1] == (round(ONE * (1 - off**2)), 0)


def test_a_narrow_cone_has_no_gaps() -> None:
    """From a corner, at a slant: the cells along the axis are all there."""
    sensor = ConeSensor(cone_deg=0.01, range_max=90.0)
    votes = listed(sensor, [one_beam(Pose2(0.0, 0.0, 0.0), [0.8, 0.6], 80.0)])[0]
    cells = sorted(votes)
    assert cells[0] == (0, 0)
    assert (64, 48) in votes
    steps = np.abs(np.diff(cells, axis=0)).sum(axis=1)
    assert steps.max() <= 2
    assert len(cells) >= 64


def test_room_grows_and_parts_are_whole_scans(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = ConeSensor(cone_deg=40.0, range_max=9.0)
    headings = np.linspace(0.0, 6.0, 12)
    axes = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    scans = [
        Scan(Pose2(float(i), 0.3, 0.0), axes[: i + 1], np.linspace(2.0, 8.0, 12)[: i + 1])
        for i in range(12)
    ]
    whole = list(sensor.votes(scans, 0.5)[0])
    assert len(whole) == 1
    monkeypatch.setattr(oddsmap.sensors.cone, "_ENTRIES", 64)
    pieces = [
        (part.index.copy(), part.hits.copy(), part.passes.copy(), np.diff(part.offsets), part.beams)
        for part in sensor.votes(scans, 0.5)[0]
    ]
    assert len(pieces) > 3
    assert sum(piece[4] for piece in pieces) == whole[0].beams == 78
    for column, name in enumerate(("index", "hits", "passes")):
        together = np.concatenate([np.asarray(piece[column]) for piece in pieces])
        np.testing.assert_array_equal(together, getattr(whole[0], name))
    np.testing.assert_array_equal(
        np.concatenate([piece[3] for piece in pieces]), np.diff(whole[0].offsets)
    )
    monkeypatch.setattr(oddsmap.sensors.cone, "_MAX_ENTRIES", 128)
    with pytest.raises(MapTooLargeError, match=r"cones of one scan hold over .* coarser") as caught:
        list(sensor.votes(scans, 0.1)[0])
    assert "\n" not in str(caught.value)


def test_what_is_left_out_is_counted() -> None:
    sensor = ConeSensor(cone_deg=20.0, range_min=0.5, range_max=5.0)
    axes = np.tile([1.0, 0.0], (7, 1))
    ranges = np.array([np.nan, -np.inf, 0.4, 5.0, 7.0, np.inf, 2.0])
    axes[6, 0] = np.nan
    scans = [
        Scan(Pose2(0.0, 0.0, 0.0), axes, ranges, trusted=True),
        Scan(Pose2(math.nan, 0.0, 0.0), axes, ranges, trusted=True),
        Scan(Pose2(1e300, 0.0, 0.0), axes, ranges, trusted=True),
        Scan(Pose2(0.0, 0.0, 0.0), axes[:1], ranges[:1], trusted=True),
        Scan(Pose2(0.0, 0.0, 0.0), axes[:0], ranges[:0], trusted=True),
    ]
    parts, skipped = sensor.votes(scans, 0.1)
    assert [(len(part.offsets) - 1, part.beams) for part in parts] == [(1, 1)]
    assert skipped == {
        "beam.nan": 3, "beam.below_range_min": 2, "beam.no_return": 2,
        "scan.nan_pose": 1, "scan.pose_too_far": 1, "scan.empty": 2,
    }  # fmt: skip


def test_filters_of_space_say_what_may_mark() -> None:
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    scan = Scan(Pose3(np.zeros(3), np.eye(3)), axes, np.array([2.0, 2.0, 0.4]))
    base = ConeSensor(cone_deg=20.0)
    changed = dataclasses.replace(
        base, mark_z_max=1.0, body_min=(-0.5, -0.5, -0.5), body_max=(0.5, 0.5, 0.5)
    )
    before, after = (next(sensor.votes([scan], 0.1)[0]) for sensor in (base, changed))
    assert sensor_hits(before) == 3 * ONE
    assert sensor_hits(after) == ONE
    assert changed.votes([scan], 0.1)[1] == {"hit.on_body": 1, "hit.outside_heights": 1}
    with pytest.raises(ConfigError, match="for 3D scans"):
        changed.votes([one_beam(Pose2(0.0, 0.0, 0.0), [1.0, 0.0], 1.0)], 0.1)


def sensor_hits(part: Any) -> int:
    return int(part.hits.sum())


@pytest.mark.parametrize(
    "filters",
    [{"mark_z_max": -50.0}, {"body_min": (-50.0, -50.0, -50.0), "body_max": (50.0, 50.0, 50.0)}],
)
def test_filters_never_say_what_may_clear(filters: dict[str, Any]) -> None:
    base = ConeSensor(cone_deg=30.0, range_max=12.0, hit_width=3.0, pass_falloff=0.5)
    scan = one_beam(Pose3(np.array([0.2, 0.4, 0.6]), np.eye(3)), [1.0, 0.0, 0.0], 6.3)
    (votes,) = listed(base, [scan])
    (filtered,) = listed(dataclasses.replace(base, **filters), [scan])
    assert any(hits for hits, _ in votes.values())
    assert filtered == {cell: vote for cell, vote in votes.items() if vote[0] == 0}
    start = scan.map_from_sensor.translation
    end = start + np.array([6.3, 0.0, 0.0])
    axis = [1.0, 0.0, 0.0]
    assert filtered == cone_votes(
        base, 1.0, start.tolist(), axis, 6.3, end.tolist(), hit=False, seen=True
    )


def test_what_does_not_fit_is_refused() -> None:
    sensor = ConeSensor(cone_deg=20.0)
    flat = one_beam(Pose2(0.0, 0.0, 0.0), [1.0, 0.0], 1.0)
    space = one_beam(Pose3(np.zeros(3), np.eye(3)), [1.0, 0.0, 0.0], 1.0)
    with pytest.raises(InputError, match="2D and 3D scans"):
        sensor.votes([flat, space], 0.1)
    with pytest.raises(MapTooLargeError, match=r"cone of 1e\+12 m is over .* range_max"):
        sensor.votes([one_beam(Pose2(0.0, 0.0, 0.0), [1.0, 0.0], 1e12)], 0.1)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"cone_deg": 0.0}, "up to 180 degrees, got 0.0"),
        ({"cone_deg": 181.0}, "up to 180 degrees, got 181.0"),
        ({"cone_deg": math.nan}, "got nan"),
        ({"cone_deg": 20.0, "range_max": -1.0}, r"sensor\.range_max is a length above 0 m"),
        ({"cone_deg": 20.0, "p_hit": 0.4}, r"sensor\.p_hit lies between"),
        ({"cone_deg": 20.0, "pass_falloff": 1.5}, r"sensor\.pass_falloff lies .* 1, got 1\.5"),
        ({"cone_deg": 20.0, "range_falloff": 0.5}, r"got 0\.5 without sensor\.range_max"),
        ({"cone_deg": 20.0, "p_random": 0.6, "p_dropout": 0.4}, r"got 0\.6 \+ 0\.4"),
        ({"cone_deg": 20.0, "sigma": 0.0}, r"sensor\.sigma is a length above"),
        ({"cone_deg": 20.0, "detection": 0.0}, r"sensor\.detection lies above 0"),
    ],
)
def test_bounds(fields: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        ConeSensor(**fields)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


def test_weights_fall_off_over_range_max_however_far_a_no_return_clears() -> None:
    base = ConeSensor(cone_deg=20.0, range_max=8.0, range_falloff=0.5)
    scan = one_beam(Pose2(0.5, 0.5, 0.0), [1.0, 0.0], 4.0)
    (want,) = listed(base, [scan])
    assert want[2, 0] == (0, round(ONE * (1.0 - 0.5 * 2.0 / 8.0)))
    for clear_range in (2.0, 8.0, 20.0):
        assert listed(dataclasses.replace(base, clear_range=clear_range), [scan]) == [want]
