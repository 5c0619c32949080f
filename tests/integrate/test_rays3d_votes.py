# SPDX-License-Identifier: Apache-2.0
"""Space: what must not change a bit, and what is refused."""

from __future__ import annotations

import errno
import mmap
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap.integrate.threads
from oddsmap import BeamSensor, EvidenceMap, Scan, add_scans, build_map, load_map
from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.integrate.block_window import BlockWindow
from oddsmap.kernels.units import MAX_UNITS
from oddsmap.poses.pose import Pose3
from tests.kit import AS_FOUND, ONE, random_scans, votes_of
from tests.kit3d import random_space_scans

Kind = tuple[str, BeamSensor]
KINDS: list[Kind] = [
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
    scans: Iterable[Scan], kind: Kind, *, threads: int = 1, side: int | None = None
) -> EvidenceMap:
    evidence = EvidenceMap(0.25, ndim=3, votes=kind[0], sensor=kind[1], tile_side=side)
    add_scans(evidence, scans, threads=threads)
    return evidence


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.threads, "_BATCH_BEAMS", 100)


@given(seeds, kinds, st.randoms(use_true_random=False))
@settings(max_examples=15)
def test_order_of_scans(seed: int, kind: Kind, random: object) -> None:
    scans = random_space_scans(seed, 8)
    want = votes_of(mapped(scans, kind))
    assert len(want) > 100
    random.shuffle(scans)  # type: ignore[attr-defined]
    assert votes_of(mapped(scans, kind)) == want


@pytest.mark.parametrize("kind", KINDS)
def test_order_of_beams(kind: Kind) -> None:
    scan = random_space_scans(3, 1, beams=900)[0]
    order = np.random.default_rng(1).permutation(900)
    shuffled = Scan(scan.map_from_sensor, scan.directions[order], scan.ranges[order])
    assert votes_of(mapped([shuffled], kind)) == votes_of(mapped([scan], kind))


@given(seeds, kinds, st.sampled_from([1, 2, 4, 16]))
@settings(max_examples=15)
def test_tile_side(seed: int, kind: Kind, side: int) -> None:
    scans = random_space_scans(seed, 4)
    assert votes_of(mapped(scans, kind, side=side)) == votes_of(mapped(scans, kind, side=8))


@given(seeds, kinds, st.sampled_from([2, 3]))
@settings(max_examples=15, phases=AS_FOUND)
def test_threads(seed: int, kind: Kind, threads: int) -> None:
    scans = random_space_scans(seed, 20)
    assert votes_of(mapped(scans, kind, threads=threads)) == votes_of(mapped(scans, kind))


def test_threads_report_the_same_counts() -> None:
    scans = random_space_scans(1, 30)
    reports = []
    for threads in (1, 2, 3):
        report = add_scans(EvidenceMap(0.25, ndim=3), scans, threads=threads)
        reports.append((report.scans, report.beams, report.skipped))
    assert reports[0] == reports[1] == reports[2]
    assert reports[0][2]["beam.nan"] > 0


@given(seeds, kinds, st.integers(0, 8), st.sampled_from([2, 8, 16]))
@settings(max_examples=15)
def test_halves_add_up(seed: int, kind: Kind, cut: int, side: int) -> None:
    scans = random_space_scans(seed, 8)
    one, other = mapped(scans[:cut], kind), mapped(scans[cut:], kind, side=side)
    one.merge(other)
    assert votes_of(one) == votes_of(mapped(scans, kind))


@given(seeds, kinds)
@settings(max_examples=15)
def test_one_by_one_equals_all_at_once(seed: int, kind: Kind) -> None:
    scans = random_space_scans(seed, 8)
    single = mapped([], kind)
    for scan in scans:
        add_scans(single, [scan])
    assert votes_of(single) == votes_of(mapped(scans, kind))


@given(seeds, kinds)
@settings(max_examples=6)
def test_save_and_load_is_identity(
    tmp_path_factory: pytest.TempPathFactory, seed: int, kind: Kind
) -> None:
    path = tmp_path_factory.mktemp("maps") / "space.zarr"
    scans = random_space_scans(seed, 3)
    evidence = mapped(scans * 90, kind)  # more than 255 votes in a cell
    evidence.save(path)
    again = load_map(path)
    assert (again.ndim, again.config) == (3, evidence.config)
    assert votes_of(again) == votes_of(evidence)
    for one in (again, evidence):
        add_scans(one, random_space_scans(seed + 1, 2))
    assert votes_of(again) == votes_of(evidence)


shifts = st.tuples(*[st.integers(-(10**8), 10**8)] * 3)


@given(seeds, st.sampled_from(["scan", "beam"]), shifts)
@settings(max_examples=15)
def test_moving_the_world_by_whole_cells_moves_the_map(
    seed: int, votes: str, shift: tuple[int, int, int]
) -> None:
    # Directions, readings and places with few bits: positions stay exact 10^8 cells away.
    def scans(by: tuple[int, ...]) -> list[Scan]:
        return [
            Scan(
                Pose3(
                    np.round(scan.map_from_sensor.translation * 2.0**16) / 2.0**16
                    + np.array(by) * 0.25,
                    np.eye(3),
                ),
                np.round(scan.directions * 256) / 256,
                np.round(scan.ranges * 256) / 256,
                trusted=True,  # of few bits, they are no unit vectors
            )
            for scan in random_space_scans(seed, 3)
        ]

    kind = (votes, BeamSensor(range_max=5.0))
    here, there = votes_of(mapped(scans((0, 0, 0)), kind)), votes_of(mapped(scans(shift), kind))
    dx, dy, dz = shift
    assert there == {(x + dx, y + dy, z + dz): vote for (x, y, z), vote in here.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_more_than_255_scans(kind: Kind) -> None:
    scan = random_space_scans(7, 1)[0]
    once = votes_of(mapped([scan], kind))
    many = votes_of(mapped([scan] * 700, kind))
    assert many == {cell: (700 * hit, 700 * free) for cell, (hit, free) in once.items()}


@pytest.mark.parametrize("kind", KINDS)
def test_one_vote_a_scan(kind: Kind) -> None:
    votes = votes_of(mapped(random_space_scans(2, 1, beams=2000, reach=2.0), kind)).values()
    if kind[0] == "scan":
        whole = kind[1].fade == 0.0
        assert all(hit <= ONE and free <= ONE for hit, free in votes)
        assert all(free in (0, ONE) for _, free in votes) == whole
        assert all(hit == 0 or free == 0 for hit, free in votes)
    else:
        assert any(hit > ONE or free > ONE for hit, free in votes)
        assert any(hit > 0 and free > 0 for hit, free in votes)


def test_no_returns_only_clear() -> None:
    """+Inf clears up to clear_range, every cell but its last."""
    scan = Scan(
        Pose3(np.array([0.1, 0.1, 0.1]), np.eye(3)), np.eye(3), np.array([np.inf, np.inf, np.nan])
    )
    evidence = EvidenceMap(0.25, ndim=3, sensor=BeamSensor(clear_range=1.0))
    report = add_scans(evidence, [scan])
    assert (report.beams, report.skipped) == (2, Counter({"beam.nan": 1}))
    want = {(0, 0, 0)} | {(k, 0, 0) for k in range(4)} | {(0, k, 0) for k in range(4)}
    assert votes_of(evidence) == dict.fromkeys(want, (0, ONE))


@pytest.mark.parametrize("kind", KINDS)
def test_overflow_is_noticed(kind: Kind) -> None:
    scan = Scan(Pose3(np.full(3, 0.1), np.eye(3)), np.array([[1.0, 0.0, 0.0]]), np.array([1.0]))
    evidence = mapped([], kind)
    evidence.add_cells(
        np.array([[1, 0, 0]]), np.array([0]), np.array([MAX_UNITS - 256 * ONE], np.int64)
    )
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        add_scans(evidence, [scan] * 1000)


# ------------------------------------------------------------------------------- large scans


def cloud(*points: tuple[float, float, float], at: tuple[float, float, float]) -> Scan:
    return Scan.from_points(Pose3(np.array(at), np.eye(3)), np.array(points))


def test_a_scan_past_2_to_the_31_cells_is_the_sum_of_its_beams() -> None:
    """As small scans, each within the limit: the long codes change no bit."""
    points = [(150.0, 0.3, 0.1), (0.2, -120.0, 0.4), (0.1, 0.2, 20.0), (-60.0, 0.3, -0.2)]
    at = (500_000.37, 5_400_000.61, 20.2)
    sensor, votes = BeamSensor(), "beam"
    whole = EvidenceMap(0.05, ndim=3, votes=votes, sensor=sensor)
    add_scans(whole, [cloud(*points, at=at)])
    lo, hi = whole.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    assert np.prod(hi - lo) > 1 << 31
    parts = EvidenceMap(0.05, ndim=3, votes=votes, sensor=sensor)
    add_scans(parts, [cloud(point, at=at) for point in points])
    assert votes_of(whole) == votes_of(parts)


def one_line(scan: Scan, resolution: float) -> str:
    evidence = EvidenceMap(resolution, ndim=3)
    with pytest.raises(MapTooLargeError) as caught:
        add_scans(evidence, [scan])
    assert evidence.cell_count() == 0
    text = str(caught.value)
    assert "\n" not in text
    assert "use a coarser resolution" in text
    return text


def test_a_window_that_no_table_could_hold_is_refused() -> None:
    far = 3_000.0
    text = one_line(cloud((far, far, far), (-far, -far, -far), at=(0.0, 0.0, 0.0)), 0.01)
    assert "one scan spans 6000 x 6000 x 6000 m, 2.2e+17 cells of 0.01 m" in text
    assert "range_max where a reading is too long" in text


def test_a_sensor_far_from_its_points() -> None:
    """An origin 10^7 m off, by a wrong pose or viewpoint."""
    text = one_line(cloud((1e7, 3.0, 1.0), (1e7, 4.0, 2.0), at=(-1e7, 0.0, 0.0)), 0.1)
    assert text.startswith("one scan spans 1e+07 x ")


@pytest.mark.parametrize("reading", [1e6, 1e30, 1e308])
def test_an_absurd_reading_is_refused_before_anything_is_done(reading: float) -> None:
    one_line(cloud((1.0, 2.0, 3.0), (reading, 1.0, 0.0), at=(0.0, 0.0, 0.0)), 0.05)


def test_no_memory_for_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    evidence = EvidenceMap(0.05, ndim=3)
    add_scans(evidence, [cloud((1.0, 2.0, 3.0), at=(0.0, 0.0, 0.0))])  # compiles
    before, window = votes_of(evidence), BlockWindow(1, np.uint8, 3)
    monkeypatch.setattr(mmap, "mmap", none_left)
    with pytest.raises(MapTooLargeError, match=r"no memory for the 4\.0e\+06 blocks"):
        window.open(4_000_000)
    monkeypatch.undo()
    assert votes_of(evidence) == before


def test_an_odd_tile_side_is_refused() -> None:
    with pytest.raises(InputError, match="power of 2, got 5"):
        add_scans(EvidenceMap(0.1, ndim=3, tile_side=5), random_space_scans(0, 1))


def test_scans_of_the_plane_are_refused() -> None:
    with pytest.raises(InputError, match="2D scans cannot go into a 3D map"):
        add_scans(EvidenceMap(0.1, ndim=3), random_scans(0, 1))


# ------------------------------------------------------------------------------- real data


@pytest.mark.realdata
@pytest.mark.parametrize("name", ["lidar3d/hall_os0", "lidar3d/hku1_avia"])
def test_real_logs_by_one_thread_and_two(data_folder: Path, name: str) -> None:
    log = oddsmap.open_log(data_folder / name)
    one, two = (build_map(log, 0.4, threads=threads) for threads in (1, 2))
    assert one.report is not None
    assert two.report is not None
    assert (one.report.beams, one.report.skipped) == (two.report.beams, two.report.skipped)
    for ours, theirs in zip(one.cells(), two.cells(), strict=True):
        assert (ours == theirs).all()
