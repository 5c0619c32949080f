# SPDX-License-Identifier: Apache-2.0
"""Sorting readings: rule 3 of docs, and bit for bit the readable version."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import BeamSensor, Pose2, Pose3, Scan, build_map
from oddsmap.errors import ConfigError, InputError
from oddsmap.odds import logit
from tests.kit import fan_scan
from tests.naive import beams as naive

INF, NAN = math.inf, math.nan


def what_becomes(
    sensor: BeamSensor, *readings: float
) -> tuple[list[tuple[float, bool]], Counter[str]]:
    """(how far along the x axis, hit?) of each usable reading, and the skipped."""
    scan = Scan(Pose2(0.0, 0.0, 0.0), np.tile([1.0, 0.0], (len(readings), 1)), np.array(readings))
    segments, skipped = sensor.segments([scan])
    far = [float(end) for end in segments.ends[:, 0]]
    return list(zip(far, segments.hit.tolist(), strict=True)), skipped


@pytest.mark.parametrize(
    ("sensor", "reading", "want", "why"),
    [
        # An ordinary reading, below and above what is known of the sensor.
        (BeamSensor(), 2.0, (2.0, True), None),
        (BeamSensor(), 1e6, (1e6, True), None),
        (
            BeamSensor(range_max=5.0),
            math.nextafter(5.0, 0.0),
            (math.nextafter(5.0, 0.0), True),
            None,
        ),
        # +Inf: nothing seen.
        (BeamSensor(), INF, None, "beam.no_return"),
        (BeamSensor(range_max=5.0), INF, (5.0, False), None),
        (BeamSensor(range_max=5.0, clear_range=3.0), INF, (3.0, False), None),
        (BeamSensor(clear_range=3.0), INF, (3.0, False), None),
        # Finite at or above range_max: may as well be a fault.
        (BeamSensor(range_max=5.0), 5.0, None, "beam.no_return"),
        (BeamSensor(range_max=5.0), 81.83, None, "beam.no_return"),
        (BeamSensor(range_max=5.0, clear_range=3.0), 5.0, (3.0, False), None),
        (BeamSensor(range_max=5.0, clear_range=3.0), 81.83, (3.0, False), None),
        # A reading shorter than clear_range is a reading; so is one beyond it, below range_max.
        (BeamSensor(range_max=5.0, clear_range=3.0), 4.0, (4.0, True), None),
        (BeamSensor(clear_range=3.0), 4.0, (4.0, True), None),
        # No information.
        (BeamSensor(range_max=5.0, clear_range=3.0), -INF, None, "beam.below_range_min"),
        (BeamSensor(range_max=5.0, clear_range=3.0), NAN, None, "beam.nan"),
        (BeamSensor(), -0.001, None, "beam.below_range_min"),
        # What drivers write where there was no return: it neither marks nor clears.
        (BeamSensor(), 0.0, None, "beam.zero_range"),
        (BeamSensor(), -0.0, None, "beam.zero_range"),
        (BeamSensor(range_max=5.0, clear_range=3.0), 0.0, None, "beam.zero_range"),
        (BeamSensor(range_min=0.5), 0.0, None, "beam.below_range_min"),
        (BeamSensor(), math.nextafter(0.0, 1.0), (math.nextafter(0.0, 1.0), True), None),
        (BeamSensor(range_min=0.5), 0.4999, None, "beam.below_range_min"),
        (BeamSensor(range_min=0.5), 0.5, (0.5, True), None),
    ],
)
def test_each_kind_of_reading(
    sensor: BeamSensor, reading: float, want: tuple[float, bool] | None, why: str | None
) -> None:
    used, skipped = what_becomes(sensor, reading, 0.75)
    assert used == [pair for pair in (want, (0.75, True)) if pair is not None]
    assert skipped == Counter([why] if why else [])


def test_counts_by_reason() -> None:
    sensor = BeamSensor(range_min=0.5, range_max=5.0)
    used, skipped = what_becomes(sensor, NAN, NAN, -INF, 0.1, 0.2, 5.0, 6.0, 7.0, 8.0, INF, 1.0)
    assert used == [(5.0, False), (1.0, True)]
    assert skipped == {"beam.nan": 2, "beam.below_range_min": 3, "beam.no_return": 4}


def test_scans_without_use() -> None:
    scans = [
        fan_scan(NAN, 0.0, 0.0, [1.0]),
        fan_scan(0.0, 0.0, INF, [1.0, 2.0]),
        fan_scan(0.0, 0.0, 0.0, []),
        fan_scan(0.0, 0.0, 0.0, [NAN, NAN]),
        fan_scan(7.0, 0.0, 0.0, [1.0]),
        fan_scan(0.0, 0.0, 0.0, [INF]),
    ]
    segments, skipped = BeamSensor().segments(scans)
    assert skipped == {"scan.nan_pose": 2, "scan.empty": 3, "beam.nan": 2, "beam.no_return": 1}
    assert segments.origins.tolist() == [[7.0, 0.0]]
    assert segments.offsets.tolist() == [0, 1]
    assert segments.ends.tolist() == [[8.0, 0.0]]
    nothing, skipped = BeamSensor().segments([])
    assert len(nothing.origins) == len(nothing.ends) == 0
    assert nothing.offsets.tolist() == [0]
    assert skipped == {}


sensors = st.builds(
    BeamSensor,
    range_min=st.sampled_from([0.0, 0.3]),
    range_max=st.sampled_from([None, 4.0]),
    clear_range=st.sampled_from([None, 2.5, 4.0]),
    hit_width=st.sampled_from([0.0, 0.5]),
    fade=st.sampled_from([0.0, 0.7]),
) | st.builds(
    BeamSensor,
    range_max=st.sampled_from([None, 4.0]),
    sigma=st.sampled_from([0.05, 0.3]),
    spread=st.sampled_from([1.0, 3.0]),
    fade=st.sampled_from([0.0, 0.7]),
)
reading = st.one_of(
    st.floats(-1.0, 9.0), st.sampled_from([INF, -INF, NAN, 0.0, 0.2, 0.3, 4.0, 81.83, 1e300])
)


@given(st.data(), sensors, st.sampled_from([2, 3]), st.booleans())
def test_bit_for_bit(data: st.DataObject, sensor: BeamSensor, d: int, shared: bool) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 1000)))
    count = data.draw(st.integers(0, 8))
    directions = rng.normal(size=(count, d))
    scans = []
    for _ in range(data.draw(st.integers(1, 3))):
        if not shared:
            count = data.draw(st.integers(0, 8))
            directions = rng.normal(size=(count, d))
        ranges = np.array(data.draw(st.lists(reading, min_size=count, max_size=count)))
        pose: Pose2 | Pose3 = Pose2(*rng.normal(size=3) * 10)
        if d == 3:
            q = rng.normal(size=4)
            pose = Pose3.from_quaternion_xyzw(rng.normal(size=3) * 10, q / np.linalg.norm(q))
        scans.append(Scan(pose, directions, ranges, trusted=True))
    got, skipped = sensor.segments(scans)
    want = naive.segments(sensor, scans)
    fades = naive.fades(sensor, scans)
    assert [point.tobytes() for point in got.fades] == [point.tobytes() for point in fades]
    assert len(want) == len(got.ends) == len(got.tips) == len(got.hit) == got.offsets[-1]
    for k, (end, tip, hit) in enumerate(want):
        assert got.ends[k].tobytes() == end.tobytes()
        assert got.tips[k].tobytes() == tip.tobytes()
        assert got.hit[k] == hit
    counts: Counter[str] = Counter()
    for scan in scans:
        counts += naive.reach(sensor, scan.ranges)[2]
    empty = sum(not naive.segments(sensor, [scan]) for scan in scans)
    assert skipped == counts + Counter({"scan.empty": empty})
    usable = [scan for scan in scans if naive.segments(sensor, [scan])]
    assert got.origins.tolist() == [scan.map_from_sensor.translation.tolist() for scan in usable]
    assert np.diff(got.offsets).tolist() == [len(naive.segments(sensor, [s])) for s in usable]


def test_the_plane_and_space_do_not_mix() -> None:
    space = Scan(Pose3.from_matrix(np.eye(4)), np.array([[1.0, 0.0, 0.0]]), np.ones(1))
    with pytest.raises(InputError, match="2D and 3D scans"):
        BeamSensor().segments([space, fan_scan(0.0, 0.0, 0.0, [1.0])])


def test_scans_are_not_written_to() -> None:
    scan = fan_scan(1.0, 2.0, 3.0, [1.0, INF, NAN])
    scan.directions.setflags(write=False)
    scan.ranges.setflags(write=False)
    before = scan.ranges.copy()
    BeamSensor(range_max=3.0, hit_width=1.0).segments([scan, scan])
    assert np.array_equal(scan.ranges, before, equal_nan=True)


# The inverse sensor model, table 9.2.


def test_three_regions_at_prior_one_half() -> None:
    sensor = BeamSensor(hit_width=0.4, p_hit=0.8, p_miss=0.3)
    at = np.array([0.0, 1.79, 1.8, 2.0, 2.2, 2.21, 50.0])
    got = sensor.inverse_model(at, 2.0)
    assert np.allclose(got, [0.3, 0.3, 0.8, 0.8, 0.8, 0.5, 0.5], atol=1e-15)


@given(
    st.floats(0.001, 0.999),
    st.floats(0.51, 0.99),
    st.floats(0.01, 0.49),
    st.floats(0.0, 1.0),
)
def test_any_prior(prior: float, p_hit: float, p_miss: float, width: float) -> None:
    sensor = BeamSensor(hit_width=width, p_hit=p_hit, p_miss=p_miss)
    at = np.linspace(0.0, 9.0, 91)
    priors = np.linspace(prior, 0.5, 91)
    for given_prior in (prior, priors):
        base = np.broadcast_to(given_prior, at.shape)
        got = sensor.inverse_model(at, 4.0, given_prior)
        behind, before = at > 4.0 + width / 2, at < 4.0 - width / 2
        assert np.array_equal(got[behind], base[behind])  # the prior itself, to the bit
        for region, p in ((before, p_miss), (~before & ~behind, p_hit)):
            odds = p / (1 - p) * base / (1 - base)
            assert np.allclose(got[region], (odds / (1 + odds))[region], rtol=1e-12)
        assert (got[before] < base[before]).all()


def test_the_inverse_model_of_fading_passes() -> None:
    sensor = BeamSensor(fade=2.0, hit_width=1.0, p_hit=0.8, p_miss=0.2)
    at = np.array([0.0, 1.0, 1.5, 2.5, 3.4, 3.5, 4.5, 4.6])
    got = logit(sensor.inverse_model(at, 4.0)) / math.log(4.0)
    # From 1.5 to 3.5, where the occupied region begins.
    assert np.allclose(got, [-1.0, -1.0, -1.0, -0.5, -0.05, 1.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    "sensor",
    [
        BeamSensor(),
        BeamSensor(fade=1.3),
        BeamSensor(fade=9.0),
        BeamSensor(hit_width=0.9, fade=0.4),
        BeamSensor(hit_width=0.9, share_hit=True),
        BeamSensor(sigma=0.2),
        BeamSensor(sigma=0.5, spread=2.0, fade=1.7),
        BeamSensor(sigma=1.5, fade=1.0),
    ],
)
def test_the_inverse_model_is_what_a_map_of_one_beam_says(sensor: BeamSensor) -> None:
    """For cells of 0.25 m along the beam, from a sensor at the border of the first."""
    scan = Scan(Pose2(0.0, 0.1, 0.0), np.array([[1.0, 0.0]]), np.array([3.1]))
    for votes in ("scan", "beam"):
        view = build_map([scan], 0.25, sensor=sensor, votes=votes).log_odds(prior=0.3)
        got = view.probability(((0, 0), (40, 1)))[0]
        want = sensor.inverse_model((np.arange(40) + 0.5) * 0.25, 3.1, 0.3, cell=0.25)
        assert np.allclose(got, want, atol=1e-4)


def test_a_share_of_a_hit_needs_the_size_of_a_cell() -> None:
    with pytest.raises(ConfigError, match="give the side of a cell"):
        BeamSensor(sigma=0.1).inverse_model(1.0, 2.0)


def test_sigma_and_hit_width_exclude_each_other() -> None:
    with pytest.raises(ConfigError, match=r"set one to 0, got 0\.1 and 0\.2"):
        BeamSensor(sigma=0.1, hit_width=0.2)
    assert BeamSensor(sigma=0.1).half_width == pytest.approx(0.3)
    assert BeamSensor(hit_width=0.1).half_width == 0.05


def test_shapes_of_the_inverse_model() -> None:
    sensor = BeamSensor()
    assert sensor.inverse_model(1.0, 2.0).shape == ()
    assert sensor.inverse_model(np.ones((3, 4)), 2.0, np.full((3, 4), 0.1)).shape == (3, 4)


def test_logit() -> None:
    assert logit(0.5) == 0.0
    assert math.isclose(float(logit(0.7)), math.log(7 / 3))
    assert np.allclose(logit([0.2, 0.8]), [-math.log(4), math.log(4)])
    assert math.isclose(float(logit(1e-300)), math.log(1e-300))


@pytest.mark.parametrize(
    "name",
    [
        "range_min", "range_max", "clear_range", "hit_width", "sigma", "spread", "fade", "p_hit",
        "p_miss",
    ],
)  # fmt: skip
@pytest.mark.parametrize("value", [NAN, INF, -INF, -0.1])
def test_bounds(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"sensor.{name}"):
        BeamSensor(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("range_max", 0.0),
        ("clear_range", 0.0),
        ("spread", 0.0),
        ("p_hit", 0.5),
        ("p_hit", 1.0),
        ("p_miss", 0.5),
        ("p_miss", 0.0),
    ],
)
def test_limits_are_outside(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"sensor.{name}"):
        BeamSensor(**{name: value})  # type: ignore[arg-type]
