# SPDX-License-Identifier: Apache-2.0
"""Rays through space against exact rational arithmetic, cell by cell."""

from __future__ import annotations

import math
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import oddsmap
import oddsmap.integrate.block_window
import oddsmap.integrate.rays3d
from oddsmap.evidence_map import EvidenceMap
from oddsmap.integrate.block_window import BlockWindow
from oddsmap.kernels.vote.rays3d import BIN_COLUMNS, BIN_COUNT, sort_rays
from oddsmap.poses.pose import Pose3
from oddsmap.scans.measurement import ranges_of
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from tests.kit import ONE, votes_of
from tests.kit3d import add_rays, assert_same, dense_fan, exact_votes
from tests.naive.beams import segments as naive_segments
from tests.naive.mapping3d import Beam, Cell, Point, cell_of, crossed, map_scan

# Positions that meet faces, edges and corners exactly, and ones that do not.
on_borders = st.one_of(
    st.integers(-10, 10).map(float), st.integers(-40, 40).map(lambda quarters: quarters / 4)
)
anywhere = st.floats(-10.0, 10.0, allow_subnormal=False)
mixed = st.one_of(anywhere, on_borders)
UTM = (9_991_234.0, 108_456_789.0, 12_345.0)
offsets = st.sampled_from([(0.0, 0.0, 0.0), (-64.0, 32.0, -8.0), UTM])
# Along an axis, along the diagonal of a face, along that of a cell.
diagonals = st.tuples(*[st.sampled_from([-1, 0, 1])] * 3)
kinds_of_votes = st.sampled_from(["scan", "beam"])
sides = st.sampled_from([2, 4, 8, 16])


@st.composite
def scans(
    draw: st.DrawFn, coordinate: st.SearchStrategy[float], width: float = 0.0
) -> tuple[Point, list[Beam]]:
    """A sensor and up to ten beams, some of length zero, all in cells."""
    shift = draw(offsets)

    def point() -> Point:
        place = draw(st.tuples(coordinate, coordinate, coordinate))
        return tuple(x + dx for x, dx in zip(place, shift, strict=True))

    origin = point()
    beams: list[Beam] = []
    for _ in range(draw(st.integers(1, 10))):
        if draw(st.booleans()):
            end = point()
        else:
            length, way = draw(coordinate), draw(diagonals)
            end = tuple(x + length * d for x, d in zip(origin, way, strict=True))
        far = math.dist(origin, end)
        tip = end
        if width and far > 0:
            tip = tuple(e + (e - o) / far * width for o, e in zip(origin, end, strict=True))
        beams.append((end, tip, draw(st.booleans())))
    return origin, beams


@given(scans(on_borders), kinds_of_votes, sides)
@settings(max_examples=200)
def test_ties_on_faces_edges_and_corners_are_exact(
    scan: tuple[Point, list[Beam]], votes: str, side: int
) -> None:
    evidence = EvidenceMap(1.0, ndim=3, votes=votes, tile_side=side)
    add_rays(evidence, *scan)
    assert votes_of(evidence) == exact_votes(*scan, votes)


@given(scans(mixed), kinds_of_votes, sides)
@settings(max_examples=150)
def test_passes_equal_the_oracle(scan: tuple[Point, list[Beam]], votes: str, side: int) -> None:
    evidence = EvidenceMap(0.5, ndim=3, votes=votes, tile_side=side)
    add_rays(evidence, *scan)
    assert_same(votes_of(evidence), exact_votes(*scan, votes), *scan)


@given(scans(mixed), kinds_of_votes)
@settings(max_examples=60)
def test_long_codes_change_no_bit(scan: tuple[Point, list[Beam]], votes: str) -> None:
    """Those of windows past 2^31 cells, forced upon small ones."""
    short, long = (EvidenceMap(1.0, ndim=3, votes=votes) for _ in range(2))
    add_rays(short, *scan)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(oddsmap.integrate.rays3d, "_SHORT_CODES", 0)
        add_rays(long, *scan)
    assert votes_of(long) == votes_of(short)


@given(scans(mixed, width=1.75), kinds_of_votes, sides)
@settings(max_examples=60)
def test_wide_hits_equal_the_oracle(scan: tuple[Point, list[Beam]], votes: str, side: int) -> None:
    sensor = BeamSensor(hit_width=1.75)
    evidence = EvidenceMap(1.0, ndim=3, votes=votes, sensor=sensor, tile_side=side)
    add_rays(evidence, *scan)
    assert_same(votes_of(evidence), exact_votes(*scan, votes), *scan, strict_hits=False)


@given(scans(mixed, width=2.5), kinds_of_votes)
@settings(max_examples=60)
def test_shared_hits(scan: tuple[Point, list[Beam]], votes: str) -> None:
    origin, beams = scan
    sensor = BeamSensor(hit_width=2.5, share_hit=True)
    evidence = EvidenceMap(1.0, ndim=3, votes=votes, sensor=sensor)
    add_rays(evidence, origin, beams)
    got, want = votes_of(evidence), map_scan(origin, beams, votes, True)
    slack = len(beams) if votes == "beam" else 1
    for cell in got.keys() | want.keys():
        exact = float(want[cell][0] * ONE) if cell in want else 0.0
        assert abs(got.get(cell, (0, 0))[0] - exact) <= slack + 1e-3
    if votes == "beam":
        assert sum(h for h, _ in got.values()) == ONE * sum(hit for _, _, hit in beams)
    for beam in beams:
        single = evidence.like()
        add_rays(single, origin, [beam])
        assert sum(h for h, _ in votes_of(single).values()) == (ONE if beam[2] else 0)


# ------------------------------------------------------------------------------- by hand


@pytest.mark.parametrize(
    ("start", "end", "want"),
    [
        ((0.5, 0.5, 0.5), (3.5, 0.5, 0.5), {(0, 0, 0), (1, 0, 0), (2, 0, 0)}),
        ((0.5, 0.5, 0.5), (3.0, 0.5, 0.5), {(0, 0, 0), (1, 0, 0), (2, 0, 0)}),
        ((0.5, 0.5, 3.5), (0.5, 0.5, 1.0), {(0, 0, 3), (0, 0, 2)}),
        # Through corners and through edges: the cells of the diagonal alone.
        ((0.0, 0.0, 0.0), (3.0, 3.0, 3.0), {(0, 0, 0), (1, 1, 1), (2, 2, 2)}),
        ((3.0, 3.0, 3.0), (0.0, 0.0, 0.0), {(2, 2, 2), (1, 1, 1)}),
        ((0.0, 0.5, 2.0), (2.0, 0.5, 0.0), {(0, 0, 1), (1, 0, 0)}),
        # In a face, along an edge: its owner alone.
        ((0.0, 1.0, 0.5), (2.5, 1.0, 0.5), {(0, 1, 0), (1, 1, 0)}),
        ((1.0, 2.0, 0.0), (1.0, 2.0, -2.0), {(1, 2, -1)}),
        ((0.25, 0.75, 0.5), (0.25, 0.75, 0.5), set()),
        # Both other axes change within one slab: the cell between is the one met first.
        ((0.5, 0.9, 0.6), (1.5, 1.3, 1.1), {(0, 0, 0), (0, 1, 0), (1, 1, 0)}),
        ((0.5, 0.6, 0.9), (1.5, 1.1, 1.3), {(0, 0, 0), (0, 0, 1), (1, 0, 1)}),
        # Level, a hair below a face.
        (
            (0.5, 1.0 - 2.0**-52, 0.5),
            (3.5, 1.0 - 2.0**-52, 0.5),
            {(0, 0, 0), (1, 0, 0), (2, 0, 0)},
        ),
        # Nearly level, nearer to a face than what counts as a touch, and never there.
        (
            (0.5, 1.0 - 2.0**-40, 0.5),
            (3.5, 1.0 - 2.0**-40 + 2.0**-50, 0.5),
            {(0, 0, 0), (1, 0, 0), (2, 0, 0)},
        ),
        # From a face, and below it by less than places in a window can tell.
        (
            (0.5, 1.0, 0.5),
            (3.5, 1.0 - 2.0**-53, 0.5),
            {(0, 0, 0), (1, 0, 0), (2, 0, 0)},
        ),
        (
            (-9.5, -1.0, 7.5),
            (-12.5, -1.0 - 2.0**-52, 7.5),
            {(-10, -2, 7), (-11, -2, 7), (-12, -2, 7)},
        ),
    ],
)
@pytest.mark.parametrize("turn", [0, 1, 2])
def test_by_hand(start: Point, end: Point, want: set[Cell], turn: int) -> None:
    def turned(place: tuple[float, ...]) -> tuple[float, ...]:
        return place[turn:] + place[:turn]

    cells = {cell[turn:] + cell[:turn] for cell in want}
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(1.0, ndim=3, votes=votes)
        add_rays(evidence, turned(start), [(turned(end), turned(end), True)])
        expected = dict.fromkeys(cells, (0, ONE)) | {cell_of(turned(end)): (ONE, 0)}
        assert votes_of(evidence) == expected


def test_all_signs_of_all_diagonals() -> None:
    """26 rays from a corner, from the middle of a face and from that of a cell."""
    for origin in ((0.0, 0.0, 0.0), (5.0, -7.5, 3.5), (0.5, 0.5, 0.5), (-16.0, 8.0, 0.5)):
        for step in product((-1, 0, 1), repeat=3):
            end = tuple(x + 5.5 * d for x, d in zip(origin, step, strict=True))
            for hit in (False, True):
                evidence = EvidenceMap(1.0, ndim=3)
                add_rays(evidence, origin, [(end, end, hit)])
                assert votes_of(evidence) == exact_votes(origin, [(end, end, hit)], "scan")


@pytest.mark.parametrize("hair", [1e-14, 1e-12, 1e-9, 1e-6])
def test_a_hair_off_a_face(hair: float) -> None:
    """A sensor on a corner, and beams that leave its faces by next to nothing."""
    origin = (30.0, 0.0, 0.0)
    beams: list[Beam] = []
    for k in range(40):
        angle = k * math.pi / 20
        x, y = 30.0 + 20.0 * math.cos(angle), 20.0 * math.sin(angle)
        end = (x, y, hair * (1 if k % 2 else -1))
        beams.append((end, end, k % 3 > 0))
        end = (30.0 + hair * (k - 20), 0.25 + k / 2, -hair)
        beams.append((end, end, True))
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(1.0, ndim=3, votes=votes)
        add_rays(evidence, origin, beams)
        want = exact_votes(origin, beams, votes)
        assert_same(votes_of(evidence), want, origin, beams)
        assert len(want) > 500


TINY = 2.0**-60


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_hair_before_a_border_is_before_it(axis: int) -> None:
    """Start and end points 2^-60 cell from a border keep their cells and their last slab."""
    level = (0.3, 0.4, 0.6)
    for start in (-TINY, 0.0, TINY, -4.5, 4.5):
        for stop in (-TINY, 0.0, TINY, 3.5, -3.5):
            for lean in (0.0, 0.9):
                origin, end = list(level), [x + lean * abs(stop - start) / 5 for x in level]
                origin[axis], end[axis] = start, stop
                here, there = tuple(origin), tuple(end)
                for votes in ("scan", "beam"):
                    evidence = EvidenceMap(1.0, ndim=3, votes=votes)
                    add_rays(evidence, here, [(there, there, True)] * 40)
                    assert votes_of(evidence) == exact_votes(
                        here, [(there, there, True)] * 40, votes
                    )


@pytest.mark.parametrize("end", [(1e-310, 0.0, 0.0), (-2e-309, 1e-310, 0.0), (0.0, 0.0, -5e-324)])
def test_rays_of_next_to_no_length(end: Point) -> None:
    """Of which 1 / length is infinite."""
    origin: Point = (0.0, 0.0, 0.0)
    bins, spans = np.zeros(1, np.int32), np.zeros((BIN_COUNT, BIN_COLUMNS))
    sort_rays(np.array([origin]), np.zeros(1, np.int64), np.array([end]), bins, spans)
    assert (np.abs(spans[bins[0]]) <= 1.0).all()
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(1.0, ndim=3, votes=votes)
        add_rays(evidence, origin, [(end, end, True)])
        assert votes_of(evidence) == exact_votes(origin, [(end, end, True)], votes)


@st.composite
def near_borders(draw: st.DrawFn) -> float:
    """A border, or next to nothing beside one."""
    hair = draw(st.sampled_from([0.0, 1.0, -1.0, 3.0])) * 2.0 ** -draw(st.integers(20, 53))
    return draw(st.integers(-12, 12)) + hair


ALONG_AN_EDGE = (-21.0, -8.0 + 2.0**-44, 1.0 - 2.0**-50)


@given(scans(near_borders()))
@example(((-22.0, 1.0, 1.0), [(ALONG_AN_EDGE, ALONG_AN_EDGE, True)]))
@settings(max_examples=100)
def test_the_side_of_tiles_changes_no_bit(scan: tuple[Point, list[Beam]]) -> None:
    """Wherever rays touch edges, or nearly do."""
    for votes in ("scan", "beam"):
        one, *others = (EvidenceMap(1.0, ndim=3, votes=votes, tile_side=k) for k in (2, 8, 32))
        add_rays(one, *scan)
        for other in others:
            add_rays(other, *scan)
            assert votes_of(other) == votes_of(one)


# ------------------------------------------------------------------------------- saturation


def fan_beams(seed: int, count: int, origin: Point) -> list[Beam]:
    rng = np.random.default_rng(seed)
    ends = dense_fan(seed, count) + np.array(origin)
    points = [tuple(float(x) for x in end) for end in ends]
    return [(p, p, bool(h)) for p, h in zip(points, rng.random(count) < 0.9, strict=True)]


def test_the_skip_happens() -> None:
    integrator = add_rays(
        EvidenceMap(1.0, ndim=3), (0.3, 0.4, 0.5), fan_beams(0, 8000, (0.3, 0.4, 0.5))
    )
    done = integrator._done
    assert (done > 0).sum() > 500
    assert done.max() > 5


@pytest.mark.parametrize("origin", [(0.3, 0.4, 0.5), (0.0, 0.0, 0.0), (-40.0, 12.5, 7.0), UTM])
@pytest.mark.parametrize("count", [1, 16, 17, 18, 33, 300, 6000])
def test_the_skip_changes_no_bit(origin: Point, count: int) -> None:
    """Against the kernel that goes through every ray whole, and for rays in another order."""
    beams = fan_beams(count, count, origin)
    skipping, whole, shuffled = (EvidenceMap(1.0, ndim=3) for _ in range(3))
    add_rays(skipping, origin, beams)
    add_rays(whole, origin, beams, skip=False)
    order = np.random.default_rng(count).permutation(count)
    add_rays(shuffled, origin, [beams[k] for k in order])
    assert votes_of(skipping) == votes_of(whole) == votes_of(shuffled)


@pytest.mark.parametrize("far", [4, 8, 12, 20])
@pytest.mark.parametrize("start", [0.0, 0.5, 0.75])
def test_the_skip_is_exact_where_everything_ties(far: int, start: float) -> None:
    """To every corner of a cube's cells: rays along axes, diagonals and edges, all saturated."""
    steps = np.arange(-far, far + 1, 1 if far < 12 else 2, dtype=np.float64)
    cube = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    ends = cube[np.abs(cube).max(axis=1) == far] + start
    origin: Point = (start,) * 3
    beams: list[Beam] = [
        ((float(x), float(y), float(z)),) * 2 + (k % 5 > 0,) for k, (x, y, z) in enumerate(ends)
    ]
    skipping, whole = (EvidenceMap(1.0, ndim=3) for _ in range(2))
    done = add_rays(skipping, origin, beams)._done
    add_rays(whole, origin, beams, skip=False)
    assert done.max() > 0
    assert votes_of(skipping) == votes_of(whole)
    if far == 4:
        assert votes_of(skipping) == exact_votes(origin, beams, "scan")


@given(st.integers(0, 10_000), st.tuples(anywhere, anywhere, anywhere), st.integers(18, 250))
@settings(max_examples=8)
def test_fans_equal_the_oracle(seed: int, origin: Point, count: int) -> None:
    beams = fan_beams(seed, count, origin)
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(1.0, ndim=3, votes=votes)
        add_rays(evidence, origin, beams)
        assert_same(votes_of(evidence), exact_votes(origin, beams, votes), origin, beams)


# ------------------------------------------------------------------------------- resuming


@pytest.mark.parametrize("side", [2, 4, 8])
@pytest.mark.parametrize("votes", ["scan", "beam"])
def test_growing_in_the_middle_of_a_scan_changes_no_bit(
    votes: str, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    origin = (0.3, 0.4, 0.5)
    beams = fan_beams(5, 700, origin)
    roomy, cramped = (EvidenceMap(1.0, ndim=3, votes=votes, tile_side=side) for _ in range(2))
    add_rays(roomy, origin, beams)
    rooms: list[int] = []
    grow = BlockWindow.grow

    def grow_a_little(self: BlockWindow, more: int) -> None:
        grow(self, min(more, 1))
        # Not twice as much each time: what is given back is taken from the end, and unused.
        room = min(len(self.used), (rooms[-1] if rooms else 0) + 150)
        self.used = self.used[:room].copy()
        rooms.append(room)

    monkeypatch.setattr(oddsmap.integrate.block_window, "_FIRST_BLOCKS", 0)
    monkeypatch.setattr(BlockWindow, "grow", grow_a_little)
    add_rays(cramped, origin, beams)
    assert len(rooms) >= 8
    assert votes_of(cramped) == votes_of(roomy)


# ------------------------------------------------------------------------------- large windows


def test_a_window_of_more_than_2_to_the_31_cells() -> None:
    """A few beams at 0.01 m, one of them of 220 m: 7 x 10^10 cells of window."""
    resolution = 2.0**-7
    passed = cache(crossed)
    origin = (0.37, 0.61, 0.2)
    ends = [
        (28_000.3, 11.7, 300.4),
        (-96.2, -3_000.9, -100.5),
        (3_000.5, 3_000.25, 0.125),
        (-3.0, 5.0, 2.0),
    ]
    beams: list[Beam] = [(end, end, k != 1) for k, end in enumerate(ends)]
    for votes in ("scan", "beam"):
        evidence = EvidenceMap(resolution, ndim=3, votes=votes)
        add_rays(evidence, origin, beams)
        exact = map_scan(origin, beams, votes, passed=passed)
        want = {cell: (round(hit * ONE), round(free * ONE)) for cell, (hit, free) in exact.items()}
        assert len(want) > 35_000
        off = assert_same(votes_of(evidence), want, origin, beams)
        assert off <= len(want) // 100_000 + 1


# ------------------------------------------------------------------------------- real data


def assert_real_scan_is_exact(
    scan: Scan, resolution: float, thin: int, votes: str, sensor: BeamSensor
) -> tuple[int, int]:
    few = Scan(scan.map_from_sensor, scan.directions[::thin], scan.ranges[::thin])
    evidence = EvidenceMap(resolution, ndim=3, votes=votes, sensor=sensor)
    oddsmap.add_scans(evidence, [few])
    origin = tuple(float(x) for x in scan.map_from_sensor.translation / resolution)
    beams: list[Beam] = []
    for end, _, hit in naive_segments(sensor, [few]):
        point = tuple(float(x) for x in end / resolution)
        beams.append((point, point, hit))
    want = exact_votes(origin, beams, votes)
    return len(want), assert_same(votes_of(evidence), want, origin, beams)


@pytest.mark.realdata
@pytest.mark.parametrize("votes", ["scan", "beam"])
@pytest.mark.parametrize(
    ("name", "numbers", "resolution", "thin", "least"),
    [
        ("lidar3d/hall_os0", (0, 11, 29), 0.2, 100, 10_000),
        ("lidar3d/hku1_avia", (0, 50, 104), 0.2, 20, 10_000),
        ("rgbd/7scenes", (0, 40, 83), 0.05, 2003, 1_000),
    ],
)
def test_real_scans_equal_the_oracle(
    data_folder: Path,
    name: str,
    numbers: tuple[int, ...],
    resolution: float,
    thin: int,
    least: int,
    votes: str,
) -> None:
    cells = differ = 0
    sensor = BeamSensor()
    for number, measurement in enumerate(oddsmap.open_log(data_folder / name)):
        if number in numbers:
            (scan,) = ranges_of([measurement])
            assert isinstance(scan.map_from_sensor, Pose3)
            more, off = assert_real_scan_is_exact(scan, resolution, thin, votes, sensor)
            cells, differ = cells + more, differ + off
    assert cells > least
    assert differ <= cells // 100_000 + 1
