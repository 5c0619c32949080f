# SPDX-License-Identifier: Apache-2.0
"""What must not change a bit, and what is counted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap.integrate.threads
from oddsmap import BeamSensor, EvidenceMap, Pose2, Scan, add_scans, build_map
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.kernels.units import MAX_UNITS
from oddsmap.poses.pose import Pose3
from tests.kit import AS_FOUND, ONE, Votes, fan_scan, random_scans, votes_of

KINDS = [
    ("scan", BeamSensor(range_max=5.0)),
    ("beam", BeamSensor(range_max=5.0)),
    ("scan", BeamSensor(range_max=5.0, hit_width=0.4, share_hit=True)),
    ("beam", BeamSensor(range_max=5.0, hit_width=0.4, share_hit=True)),
    ("scan", BeamSensor(range_max=5.0, hit_width=0.4)),
    ("scan", BeamSensor(range_max=5.0, sigma=0.1, fade=0.5)),
    ("beam", BeamSensor(range_max=5.0, sigma=0.1, fade=0.5)),
]
kinds = st.sampled_from(KINDS)
seeds = st.integers(0, 10_000)


def mapped(
    scans: Iterable[Scan],
    kind: tuple[str, BeamSensor],
    *,
    threads: int = 1,
    side: int | None = None,
) -> EvidenceMap:
    evidence = EvidenceMap(0.125, votes=kind[0], sensor=kind[1], tile_side=side)
    add_scans(evidence, scans, threads=threads)
    return evidence


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.threads, "_BATCH_BEAMS", 100)


@given(seeds, kinds, st.randoms(use_true_random=False))
@settings(max_examples=20)
def test_order_of_scans(seed: int, kind: tuple[str, BeamSensor], random: object) -> None:
    scans = random_scans(seed, 12)
    want = votes_of(mapped(scans, kind))
    assert len(want) > 100
    random.shuffle(scans)  # type: ignore[attr-defined]
    assert votes_of(mapped(scans, kind)) == want


@pytest.mark.parametrize("kind", KINDS)
def test_order_of_beams(kind: tuple[str, BeamSensor]) -> None:
    scan = random_scans(3, 1, beams=300)[0]
    order = np.random.default_rng(1).permutation(300)
    mixed = Scan(scan.map_from_sensor, scan.directions[order], scan.ranges[order])
    assert votes_of(mapped([mixed], kind)) == votes_of(mapped([scan], kind))


@given(seeds, kinds, st.sampled_from([5, 8, 16, 64, 100]))
@settings(max_examples=20)
def test_tile_side(seed: int, kind: tuple[str, BeamSensor], side: int) -> None:
    scans = random_scans(seed, 6)
    assert votes_of(mapped(scans, kind, side=side)) == votes_of(mapped(scans, kind, side=32))


@given(seeds, kinds, st.sampled_from([2, 3]))
@settings(max_examples=15, phases=AS_FOUND)
def test_threads(seed: int, kind: tuple[str, BeamSensor], threads: int) -> None:
    scans = random_scans(seed, 40)
    want = mapped(scans, kind)
    got = mapped(scans, kind, threads=threads)
    assert votes_of(got) == votes_of(want)


def test_threads_report_the_same_counts() -> None:
    scans = random_scans(1, 40)
    reports = []
    for threads in (1, 2, 3):
        evidence = EvidenceMap(0.125, sensor=BeamSensor())
        done: list[int] = []
        report = add_scans(evidence, scans, threads=threads, progress=done.append)
        assert done == sorted(done)
        assert done[-1] == len(scans)
        reports.append((report.scans, report.beams, report.skipped))
    assert reports[0] == reports[1] == reports[2]
    assert reports[0][2]["beam.nan"] > 0


@given(seeds, kinds, st.integers(0, 12), st.sampled_from([5, 16, 32]))
@settings(max_examples=20)
def test_halves_add_up(seed: int, kind: tuple[str, BeamSensor], cut: int, side: int) -> None:
    scans = random_scans(seed, 12)
    whole = mapped(scans, kind)
    one, other = mapped(scans[:cut], kind), mapped(scans[cut:], kind, side=side)
    one.merge(other)
    assert votes_of(one) == votes_of(whole)


@given(seeds, kinds)
@settings(max_examples=20)
def test_one_by_one_equals_all_at_once(seed: int, kind: tuple[str, BeamSensor]) -> None:
    scans = random_scans(seed, 12)
    single = EvidenceMap(0.125, votes=kind[0], sensor=kind[1])
    for scan in scans:
        add_scans(single, [scan])
    assert votes_of(single) == votes_of(mapped(scans, kind))


@given(seeds, kinds, st.tuples(st.integers(-(10**8), 10**8), st.integers(-(10**8), 10**8)))
@settings(max_examples=20)
def test_moving_the_world_by_whole_cells_moves_the_map(
    seed: int, kind: tuple[str, BeamSensor], shift: tuple[int, int]
) -> None:
    def snap(value: float) -> float:
        return round(value * 2.0**16) / 2.0**16

    # Directions and readings with few bits: positions stay exact 10^8 cells away.
    def scans(dx: int, dy: int) -> list[Scan]:
        return [
            Scan(
                Pose2(
                    snap(scan.map_from_sensor.x) + dx * 0.125,
                    snap(scan.map_from_sensor.y) + dy * 0.125,
                    0.0,
                ),
                np.round(scan.directions * 256) / 256,
                np.round(scan.ranges * 256) / 256,
                trusted=True,
            )
            for scan in random_scans(seed, 4)
            if isinstance(scan.map_from_sensor, Pose2)
        ]

    # The tips of wide hits need more bits than that: leave the width out.
    sensor = BeamSensor(range_max=5.0)
    here = votes_of(mapped(scans(0, 0), (kind[0], sensor)))
    there = votes_of(mapped(scans(*shift), (kind[0], sensor)))
    assert there == {(x + shift[0], y + shift[1]): vote for (x, y), vote in here.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_more_than_255_scans(kind: tuple[str, BeamSensor]) -> None:
    scan = random_scans(7, 1)[0]
    once = votes_of(mapped([scan], kind))
    many = votes_of(mapped([scan] * 700, kind))
    assert many == {cell: (700 * hit, 700 * free) for cell, (hit, free) in once.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_one_vote_a_scan(kind: tuple[str, BeamSensor]) -> None:
    votes = votes_of(mapped(random_scans(2, 1, beams=400), kind)).values()
    if kind[0] == "scan":
        whole = kind[1].fade == 0.0
        assert all(hit <= ONE and free <= ONE for hit, free in votes)
        assert all(free in (0, ONE) for _, free in votes) == whole
        assert all(hit == 0 or free == 0 for hit, free in votes)
    else:
        assert any(hit > ONE or free > ONE for hit, free in votes)
        assert any(hit > 0 and free > 0 for hit, free in votes)


def test_report_and_provenance() -> None:
    scans = [
        fan_scan(0.0, 0.0, 0.0, [1.0, math.nan, math.inf, 0.05, -math.inf]),
        fan_scan(math.nan, 0.0, 0.0, [1.0, 1.0]),
        fan_scan(0.0, 0.0, 0.0, [math.nan]),
        fan_scan(1e300, 0.0, 0.0, [1.0]),
    ]
    evidence = build_map(scans, 0.1, sensor=BeamSensor(range_min=0.1))
    report = evidence.report
    assert report is not None
    assert (report.scans, report.beams) == (1, 1)
    assert report.skipped == Counter(
        {
            "beam.nan": 2,
            "beam.no_return": 1,
            "beam.below_range_min": 2,
            "scan.nan_pose": 1,
            "scan.empty": 1,
            "scan.pose_too_far": 1,
        }
    )
    (entry,) = evidence.provenance
    assert entry["skipped"] == dict(report.skipped)
    assert (entry["scans"], entry["beams"], entry["source"]) == (1, 1, None)
    assert report.integrate_s > 0.0


@pytest.mark.parametrize(
    "scans",
    [[], [fan_scan(math.nan, 0.0, 0.0, [1.0])], [fan_scan(0.0, 0.0, 0.0, [math.nan])]],
)
def test_no_usable_scan(scans: Sequence[Scan]) -> None:
    with pytest.raises(InputError, match="no usable scan"):
        build_map(scans, 0.1)


def test_what_the_log_says_of_its_sensor() -> None:
    class Log(list[Scan]):
        def __init__(self, *scans: Scan) -> None:
            super().__init__(scans)
            self.sensor = {"range_max": 2.0, "range_min": 0.5, "angle_step": 0.01}
            self.skipped = Counter({"line.short": 3})
            self.path = "/somewhere/hall.log"

    scans = Log(fan_scan(0.0, 0.0, 0.0, [0.2, 1.0, 3.0]))
    evidence = build_map(scans, 0.1)
    assert evidence.sensor == BeamSensor(range_max=2.0, range_min=0.5)
    assert evidence.report is not None
    assert evidence.report.skipped == Counter(
        {"line.short": 3, "beam.no_return": 1, "beam.below_range_min": 1}
    )
    assert evidence.provenance[0]["source"] == "hall.log"
    assert build_map(scans, 0.1, sensor=BeamSensor()).sensor == BeamSensor()


def test_plane_and_space_do_not_mix() -> None:
    scan = Scan(Pose3(np.zeros(3), np.eye(3)), np.array([[1.0, 0.0, 0.0]]), np.array([1.0]))
    with pytest.raises(InputError, match="into a 2D map"):
        add_scans(EvidenceMap(0.1), [scan])
    with pytest.raises(InputError, match="2D and 3D scans"):
        build_map([scan, fan_scan(0.0, 0.0, 0.0, [1.0])], 0.1)
    assert build_map([scan], 0.1).ndim == 3


@pytest.mark.parametrize("direction", [math.nan, math.inf])
def test_directions_that_are_no_numbers(direction: float) -> None:
    scan = Scan(Pose2(0.0, 0.0, 0.0), np.array([[1.0, 0.0], [direction, 0.0]]), np.ones(2))
    report = add_scans(EvidenceMap(0.1), [scan])
    assert (report.beams, report.skipped) == (1, Counter({"beam.nan": 1}))


@pytest.mark.parametrize("reading", [1e6, 1e30, 1e308])
def test_an_absurd_reading_is_refused_before_anything_is_done(reading: float) -> None:
    evidence = EvidenceMap(0.05)
    with pytest.raises(MapTooLargeError, match="range_max"):
        add_scans(evidence, [fan_scan(0.0, 0.0, 0.0, [1.0, 2.0, reading])])
    assert evidence.cell_count() == 0


def test_threads_below_one() -> None:
    with pytest.raises(ConfigError, match="threads"):
        build_map([], 0.1, threads=0)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_in_a_log_comes_through(threads: int) -> None:
    def log() -> Iterable[Scan]:
        yield from random_scans(0, 20)
        raise InputError("hall.log:812: broken")

    with pytest.raises(InputError, match=r"hall\.log:812"):
        build_map(log(), 0.1, threads=threads)


@pytest.mark.parametrize("kind", KINDS)
def test_overflow_is_noticed(kind: tuple[str, BeamSensor]) -> None:
    scan = fan_scan(0.0, 0.0, 0.0, [1.0])
    evidence = EvidenceMap(0.125, votes=kind[0], sensor=kind[1])
    evidence.add_cells(
        np.array([[1, 0]]), np.array([0]), np.array([MAX_UNITS - 256 * ONE], np.int64)
    )
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        add_scans(evidence, [scan] * 1000)


def test_a_sensor_of_its_own() -> None:
    scan = fan_scan(0.0, 0.0, 0.0, [1.0, 3.0])
    evidence = EvidenceMap(0.125)
    add_scans(evidence, [scan], sensor=BeamSensor(range_max=2.0))
    want: Votes = votes_of(build_map([scan], 0.125, sensor=BeamSensor(range_max=2.0)))
    assert votes_of(evidence) == want


def test_far_from_the_origin() -> None:
    """UTM: 5 million metres away, at 1/8 m, the map is the same."""
    near = build_map([fan_scan(0.3, 0.2, 0.1, np.full(90, 4.3))], 0.125)
    far = build_map([fan_scan(500_000.3, 5_400_000.2, 0.1, np.full(90, 4.3))], 0.125)
    lo, hi = far.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    shift = np.array([4_000_000, 43_200_000])
    near_lo, near_hi = near.bounds() or (None, None)
    assert (lo - shift == near_lo).all()
    assert (hi - shift == near_hi).all()
    assert abs(far.cell_count() - near.cell_count()) <= 2


def test_progress_counts_skipped_scans_of_all_batches() -> None:
    # A scan of 100 beams is a batch of its own here.
    lost, used = (fan_scan(x, 0.0, 0.0, np.ones(100)) for x in (math.nan, 0.5))
    told: list[int] = []
    add_scans(EvidenceMap(0.125), [lost, used, lost, lost, used], progress=told.append)
    assert told == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    "sensor",
    [BeamSensor(sigma=1e300), BeamSensor(hit_width=1e9), BeamSensor(hit_width=0.1, fade=1e9)],
)
def test_a_return_spread_over_all_of_space_is_refused(sensor: BeamSensor) -> None:
    message = (
        r"a return would be spread over .* m, .* cells of 0\.1 m: set smaller sensor\.hit_width"
    )
    with pytest.raises(ConfigError, match=message):
        build_map([fan_scan(0.0, 0.0, 0.0, [1.0, 2.0])], 0.1, sensor=sensor)
