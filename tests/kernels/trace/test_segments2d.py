# SPDX-License-Identifier: Apache-2.0
"""Kernels against exact rational arithmetic, cell by cell."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
import oddsmap.integrate.rays2d
from oddsmap.evidence_map import EvidenceMap
from oddsmap.kernels.trace import segments2d as segments
from oddsmap.sensors.beam import BeamSensor
from tests.kit import ONE, Votes, add_beams, fan_scan, votes_of
from tests.naive.beams import segments as naive_segments
from tests.naive.columns import passed
from tests.naive.mapping import Beam, Cell, Point, cell_of, corner_distance, crossed, map_scan

# Positions that meet borders and corners exactly, and ones that do not.
on_borders = st.integers(-48, 48).map(lambda k: k / 4)
anywhere = st.floats(-12.0, 12.0, allow_subnormal=False)
offsets = st.sampled_from([(0.0, 0.0), (-64.0, 32.0), (9_991_234.0, 108_456_789.0)])


@st.composite
def scans(
    draw: st.DrawFn, coordinate: st.SearchStrategy[float], width: float = 0.0
) -> tuple[Point, list[Beam]]:
    """A sensor and up to twelve beams, some of length zero, all in cells."""
    shift = draw(offsets)

    def point() -> Point:
        x, y = draw(st.tuples(coordinate, coordinate))
        return x + shift[0], y + shift[1]

    origin = point()
    beams: list[Beam] = []
    for _ in range(draw(st.integers(1, 12))):
        end = draw(st.one_of(st.just(origin), st.just(point()), st.just(point())))
        way = math.dist(origin, end)
        tip = end
        if width and way > 0:
            tip = (
                end[0] + (end[0] - origin[0]) / way * width,
                end[1] + (end[1] - origin[1]) / way * width,
            )
        beams.append((end, tip, draw(st.booleans())))
    return origin, beams


def oracle(origin: Point, beams: list[Beam], votes: str, share: bool = False) -> Votes:
    exact = map_scan(origin, beams, votes, share, passed)
    return {cell: (round(hit * ONE), round(free * ONE)) for cell, (hit, free) in exact.items()}


def near_corner(origin: Point, beams: list[Beam], cell: Cell) -> bool:
    ways = [(origin, end) for end, _, _ in beams] + [(end, tip) for end, tip, _ in beams]
    return min(corner_distance(a, b, cell) for a, b in ways) < 1e-3


def assert_same(
    got: Votes, want: Votes, origin: Point, beams: list[Beam], *, strict_hits: bool = True
) -> int:
    """Equal but for passes next to a corner; returns how many of those differ."""
    off = 0
    for cell in got.keys() | want.keys():
        mine, exact = got.get(cell, (0, 0)), want.get(cell, (0, 0))
        if mine == exact:
            continue
        assert len(cell) == 2
        assert near_corner(origin, beams, (cell[0], cell[1])), (cell, mine, exact)
        if strict_hits:
            assert mine[0] == exact[0], f"end cell {cell} differs"
        off += 1
    return off


@given(scans(on_borders), st.sampled_from(["scan", "beam"]), st.sampled_from([1, 3, 32]))
@settings(max_examples=200)
def test_ties_on_borders_and_corners_are_exact(
    scan: tuple[Point, list[Beam]], votes: str, side: int
) -> None:
    evidence = EvidenceMap(1.0, votes=votes, tile_side=side)
    add_beams(evidence, *scan)
    assert votes_of(evidence) == oracle(*scan, votes)


@given(scans(st.one_of(anywhere, on_borders)), st.sampled_from(["scan", "beam"]))
@settings(max_examples=200)
def test_passes_equal_the_oracle(scan: tuple[Point, list[Beam]], votes: str) -> None:
    evidence = EvidenceMap(0.5, votes=votes)
    add_beams(evidence, *scan)
    assert_same(votes_of(evidence), oracle(*scan, votes), *scan)


@given(scans(st.one_of(anywhere, on_borders), width=1.75), st.sampled_from(["scan", "beam"]))
@settings(max_examples=100)
def test_wide_hits_equal_the_oracle(scan: tuple[Point, list[Beam]], votes: str) -> None:
    evidence = EvidenceMap(1.0, votes=votes, sensor=BeamSensor(hit_width=1.75))
    add_beams(evidence, *scan)
    assert_same(votes_of(evidence), oracle(*scan, votes), *scan, strict_hits=False)


@given(
    st.tuples(anywhere, st.sampled_from([-0.75, 0.5])),
    st.integers(-4, 4),
    st.booleans(),
    st.booleans(),
)
@settings(max_examples=200)
def test_a_tip_on_a_border_gives_the_touched_cell_nothing(
    end: Point, way: int, upright: bool, share: bool
) -> None:
    """However the running sum of the way to the tip is rounded."""
    tip = (float(math.floor(end[0]) + way), end[1])
    if upright:
        end, tip = end[::-1], tip[::-1]
    beams = [(end, tip, True)]
    evidence = EvidenceMap(1.0, votes="beam", sensor=BeamSensor(hit_width=9.0, share_hit=share))
    add_beams(evidence, (0.25, 0.25), beams)
    got = {cell: hit for cell, (hit, _) in votes_of(evidence).items() if hit}
    want = {cell_of(end): Fraction(1)} if end == tip else crossed(end, tip)
    if share:
        assert got.keys() <= want.keys()
        for cell, part in want.items():
            assert abs(got.get(cell, 0) - float(part * ONE)) <= 1.0
        assert sum(got.values()) == ONE
    else:
        assert got == dict.fromkeys(want, ONE)


@given(scans(st.one_of(anywhere, on_borders), width=2.5), st.sampled_from(["scan", "beam"]))
@settings(max_examples=100)
def test_shared_hits(scan: tuple[Point, list[Beam]], votes: str) -> None:
    origin, beams = scan
    sensor = BeamSensor(hit_width=2.5, share_hit=True)
    whole = EvidenceMap(1.0, votes=votes, sensor=sensor)
    add_beams(whole, origin, beams)
    exact = map_scan(origin, beams, votes, True, passed)
    got = votes_of(whole)
    for cell in got.keys() | set(exact):
        want = float(exact[cell[0], cell[1]][0] * ONE) if cell in exact else 0.0
        slack = len(beams) if votes == "beam" else 1
        assert abs(got.get(cell, (0, 0))[0] - want) <= slack + 1e-3
    if votes == "beam":
        total = sum(hit for hit, _ in got.values())
        assert total == ONE * sum(hit for _, _, hit in beams)
    for end, tip, hit in beams:
        single = EvidenceMap(1.0, votes=votes, sensor=sensor)
        add_beams(single, origin, [(end, tip, hit)])
        assert sum(h for h, _ in votes_of(single).values()) == (ONE if hit else 0)


@given(
    scans(st.one_of(anywhere, on_borders), width=1.75),
    st.sampled_from([("scan", 0.0), ("beam", 0.0), ("scan", 1.75), ("beam", 1.75)]),
    st.sampled_from([1, 4, 5]),
    st.sampled_from([16, 100, 400]),
)
@settings(max_examples=150)
def test_blocks_change_no_bit(
    scan: tuple[Point, list[Beam]], kind: tuple[str, float], side: int, window: int
) -> None:
    origin, beams = scan
    if kind[1] == 0:
        beams = [(end, end, hit) for end, _, hit in beams]
    sensor = BeamSensor(hit_width=kind[1], share_hit=True)
    whole = EvidenceMap(1.0, votes=kind[0], sensor=sensor)
    add_beams(whole, origin, beams)
    cut = EvidenceMap(1.0, votes=kind[0], sensor=sensor, tile_side=side)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(oddsmap.integrate.rays2d, "_MARK_WINDOW", window)
        patch.setattr(oddsmap.integrate.rays2d, "_COUNT_WINDOW", window)
        patch.setattr(oddsmap.integrate.rays2d, "_WEIGHT_WINDOW", window)
        add_beams(cut, origin, beams)
    assert votes_of(cut) == votes_of(whole)


@st.composite
def fans(draw: st.DrawFn) -> tuple[Point, list[Beam]]:
    """Fine fans, as a LIDAR's: neighbours share most of their cells."""
    origin = draw(st.tuples(anywhere, anywhere))
    start, step = draw(st.floats(0.0, 7.0)), draw(st.floats(0.0005, 0.03))
    seed, smooth = draw(st.integers(0, 1000)), draw(st.booleans())
    rng = np.random.default_rng(seed)
    count = draw(st.integers(17, 200))
    lengths = rng.uniform(1.0, 90.0, count)
    if smooth:
        lengths = 50.0 + 20.0 * np.sin(np.arange(count) / 9.0)
    beams: list[Beam] = []
    for k, length in enumerate(lengths):
        angle = start + k * step
        end = (origin[0] + length * math.cos(angle), origin[1] + length * math.sin(angle))
        beams.append((end, end, True))
    return origin, beams


def skipped_slabs(origin: Point, beams: list[Beam]) -> int:
    """How many slabs the coarse-to-fine order of the kernel leaves out, of a fan."""
    table = np.zeros((len(beams), segments.COLUMNS), np.int64)
    for i, (end, _, _) in enumerate(beams):
        segments.set_up(*origin, *end, table, i)
    total = 0
    for half in (8, 4, 2, 1):
        for i in range(half, len(beams) - half, 2 * half):
            total += int(segments.saturated_slabs(table, i, i - half, i + half))
    return total


def test_the_skip_triggers_on_a_fan() -> None:
    origin = (0.3, 0.4)
    ends = [
        (0.3 + 80 * math.cos(0.3 + k * 0.004), 0.4 + 80 * math.sin(0.3 + k * 0.004))
        for k in range(65)
    ]
    # 65 beams of 0.004 rad: neighbours 8 beams apart are a cell apart after about 30 cells.
    assert skipped_slabs(origin, [(end, end, True) for end in ends]) > 0.5 * 60 * 64


@given(fans(), st.randoms(use_true_random=False))
@settings(max_examples=60)
def test_the_skip_changes_no_bit(scan: tuple[Point, list[Beam]], random: object) -> None:
    origin, beams = scan
    skipping, plain, mixed = (EvidenceMap(1.0) for _ in range(3))
    add_beams(skipping, origin, beams)
    add_beams(plain, origin, beams, marks=False)
    shuffled = list(beams)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    add_beams(mixed, origin, shuffled)
    assert votes_of(skipping) == votes_of(plain) == votes_of(mixed)


@given(fans())
@settings(max_examples=20)
def test_fans_equal_the_oracle(scan: tuple[Point, list[Beam]]) -> None:
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(1.0, votes=votes)
        add_beams(evidence, *scan)
        assert_same(votes_of(evidence), oracle(*scan, votes), *scan)


@pytest.mark.parametrize(
    ("start", "end", "want"),
    [
        ((0.5, 0.5), (3.5, 0.5), {(0, 0), (1, 0), (2, 0)}),
        ((0.5, 0.5), (3.0, 0.5), {(0, 0), (1, 0), (2, 0)}),
        ((3.5, 0.5), (1.0, 0.5), {(3, 0), (2, 0)}),
        ((0.0, 0.0), (3.0, 3.0), {(0, 0), (1, 1), (2, 2)}),
        ((3.0, 3.0), (0.0, 0.0), {(2, 2), (1, 1)}),
        ((0.0, 1.0), (3.0, 1.0), {(0, 1), (1, 1), (2, 1)}),
        ((1.0, 0.0), (1.0, -2.0), {(1, -1)}),
        ((0.25, 0.75), (0.25, 0.75), set()),
        # Level, a hair below a border: fixed point would round it into the next row.
        ((0.5, 1.0 - 2.0**-52), (3.5, 1.0 - 2.0**-52), {(0, 0), (1, 0), (2, 0)}),
        ((1.0 - 2.0**-52, 3.5), (1.0 - 2.0**-52, 0.5), {(0, 3), (0, 2), (0, 1)}),
        ((0.0, 2.0), (2.0, 0.0), {(0, 1), (1, 0)}),
    ],
)
def test_by_hand(start: Point, end: Point, want: set[Cell]) -> None:
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(1.0, votes=votes)
        add_beams(evidence, start, [(end, end, True)])
        expected = dict.fromkeys(want, (0, ONE)) | {cell_of(end): (ONE, 0)}
        assert votes_of(evidence) == expected


@given(scans(st.one_of(anywhere, on_borders)))
@settings(max_examples=50)
def test_the_two_oracles_agree(scan: tuple[Point, list[Beam]]) -> None:
    for end, _, _ in scan[1]:
        cells = crossed(scan[0], end)
        assert passed(scan[0], end) == (set() if scan[0] == end else set(cells))
        if scan[0] != end:
            assert sum(cells.values()) == 1


@pytest.mark.parametrize("votes", ["scan", "beam"])
@pytest.mark.parametrize(
    "end",
    [
        (100_000.3, 97.7),
        pytest.param((2_000_000.3, 97.7), marks=pytest.mark.slow),
        pytest.param((-96.2, -2_000_000.9), marks=pytest.mark.slow),
    ],
)
def test_the_longest_segment(votes: str, end: Point) -> None:
    """Beams of 2 million cells stay exact, near the limit of fixed point."""
    origin, beams = (0.37, 0.61), [(end, end, True)]
    evidence = EvidenceMap(1.0, votes=votes)
    add_beams(evidence, origin, beams)
    got, want = votes_of(evidence), oracle(origin, beams, votes)
    assert len(want) > 100_000
    # At most 1 in 100,000, and those next to a corner.
    assert assert_same(got, want, origin, beams) <= len(want) // 100_000


@pytest.mark.realdata
@pytest.mark.parametrize("votes", ["scan", "beam"])
def test_intel_equals_the_oracle(data_folder: Path, votes: str) -> None:
    log = oddsmap.open_log(data_folder / "laser2d" / "intel-corrected.log.gz")
    resolution, cells, differ = 0.05, 0, 0
    sensor = BeamSensor(range_max=40.0)
    for number, scan in enumerate(log):
        if number % 40:
            continue
        evidence = EvidenceMap(resolution, votes=votes, sensor=sensor)
        oddsmap.add_scans(evidence, [scan])
        x, y = (float(v) for v in scan.map_from_sensor.translation / resolution)
        beams: list[Beam] = []
        for end, _, hit in naive_segments(sensor, [scan]):
            point = (float(end[0] / resolution), float(end[1] / resolution))
            beams.append((point, point, hit))
        got, want = votes_of(evidence), oracle((x, y), beams, votes)
        assert len(want) > 100
        cells += len(want)
        differ += assert_same(got, want, (x, y), beams)
    assert cells > 30_000
    assert differ <= cells / 100_000


def test_scans_by_way_of_metres_equal_the_oracle() -> None:
    """The whole way, sensor model and division by the resolution included."""
    rng = np.random.default_rng(5)
    for votes in ("scan", "beam"):
        for offset in (0.0, 5.4e6):
            sensor = BeamSensor(range_max=7.0, clear_range=7.0)
            ranges = rng.uniform(0.0, 9.0, 90)
            ranges[::7] = np.inf
            scan = fan_scan(offset + 1.23, -offset - 0.77, 0.3, ranges, step=math.pi / 45)
            evidence = EvidenceMap(0.1, votes=votes, sensor=sensor)
            oddsmap.add_scans(evidence, [scan])
            beams: list[Beam] = []
            for end, _, hit in naive_segments(sensor, [scan]):
                point = (float(end[0] / 0.1), float(end[1] / 0.1))
                beams.append((point, point, hit))
            x, y = (float(v) for v in scan.map_from_sensor.translation / 0.1)
            off = assert_same(votes_of(evidence), oracle((x, y), beams, votes), (x, y), beams)
            assert off <= 1
