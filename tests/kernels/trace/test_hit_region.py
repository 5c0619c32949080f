# SPDX-License-Identifier: Apache-2.0
"""Spread hits, fading passes and path lengths against exact crossings, 2D and 3D."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import BeamSensor, EvidenceMap, Pose2, Scan, add_scans
from oddsmap.integrate.path_lengths import LengthIntegrator
from oddsmap.integrate.to_cells import to_cells
from oddsmap.kernels.trace.hit_region import walk
from oddsmap.sensors.segments import Segments
from tests.kit import ONE, add_beams, votes_of
from tests.kit3d import add_rays
from tests.naive import spread
from tests.naive.mapping import corner_distance
from tests.naive.mapping3d import Cell, Point, crossed, edge_distance

on_borders = st.integers(-24, 24).map(lambda k: k / 4)
anywhere = st.floats(-6.0, 6.0, allow_subnormal=False)
lengths = st.one_of(st.floats(0.0, 12.0), st.integers(0, 24).map(lambda k: k / 2))
quarters = st.integers(0, 7).map(lambda k: k * math.pi / 4)
angles = st.one_of(quarters, st.floats(0.0, 2 * math.pi))
shifts = st.sampled_from([0.0, -64.0, 9_991_234.0])


@dataclass(frozen=True)
class ScanInCells:
    """One scan, all in cells."""

    origin: Point
    beams: list[spread.Beam]
    fades: list[Point]


def sensors() -> st.SearchStrategy[BeamSensor]:
    """Hits of one cell, of a width, whole and shared, and spread; passes that fade or not."""
    fade = st.sampled_from([0.0, 0.5, 1.75, 6.0])
    wide = st.builds(
        BeamSensor, hit_width=st.sampled_from([0.0, 1.75]), share_hit=st.booleans(), fade=fade
    )
    sigma, k = st.sampled_from([0.1, 0.4, 1.0]), st.sampled_from([1.0, 3.0])
    return wide | st.builds(BeamSensor, sigma=sigma, spread=k, fade=fade)


@st.composite
def scans(draw: st.DrawFn, sensor: BeamSensor, d: int) -> ScanInCells:
    """As `cut_beams` makes them of readings."""
    shift = draw(shifts)
    coordinates = [draw(st.one_of(anywhere, on_borders)) + shift for _ in range(d)]
    origin: Point = tuple(coordinates)
    beams: list[spread.Beam] = []
    fades: list[Point] = []
    for _ in range(draw(st.integers(1, 6))):
        heading, climb, reach = draw(angles), draw(angles) if d == 3 else 0.0, draw(lengths)
        level = math.cos(climb)
        way = (level * math.cos(heading), level * math.sin(heading), math.sin(climb))[:d]
        way = tuple(0.0 if abs(w) < 1e-15 else w for w in way)

        def along(far: float, way: Point = way) -> Point:
            return tuple(x + far * w for x, w in zip(origin, way, strict=True))

        # A no-return does not fade: that has a test of its own.
        kinds = ["hit", "filtered"] if sensor.fade > 0.0 else ["hit", "filtered", "no return"]
        kind = draw(st.sampled_from(kinds))
        if kind == "no return":
            end = tip = start = along(reach)
        else:
            near = max(reach - sensor.half_width, 0.0)
            end, start = along(near), along(max(near - sensor.fade, 0.0))
            tip = along(reach + sensor.half_width) if sensor.half_width > 0.0 else end
        beams.append((end, tip, kind == "hit"))
        fades.append(start)
    return ScanInCells(origin, beams, fades)


def near_edge(scan: ScanInCells, cell: Cell, d: int) -> bool:
    ways = [(scan.origin, end) for end, _, _ in scan.beams]
    ways += [(end, tip) for end, tip, _ in scan.beams]
    if d == 3:
        return min(edge_distance(a, b, cell) for a, b in ways) < 1e-6
    flat = [((a[0], a[1]), (b[0], b[1])) for a, b in ways]
    return min(corner_distance(a, b, (cell[0], cell[1])) for a, b in flat) < 1e-3


def mapped(sensor: BeamSensor, scan: ScanInCells, votes: str, d: int) -> EvidenceMap:
    evidence = EvidenceMap(1.0, votes=votes, sensor=sensor, ndim=d)
    if d == 3:
        add_rays(evidence, scan.origin, scan.beams, fades=scan.fades)
    else:
        beams = [((e[0], e[1]), (t[0], t[1]), hit) for e, t, hit in scan.beams]
        fades = [(f[0], f[1]) for f in scan.fades]
        add_beams(evidence, (scan.origin[0], scan.origin[1]), beams, fades=fades)
    return evidence


@pytest.mark.parametrize("d", [2, 3])
@given(st.data(), sensors(), st.sampled_from(["scan", "beam"]))
@settings(max_examples=150)
def test_votes_equal_the_oracle(
    d: int, data: st.DataObject, sensor: BeamSensor, votes: str
) -> None:
    scan = data.draw(scans(sensor, d))
    got = votes_of(mapped(sensor, scan, votes, d))
    want = spread.map_scan(
        scan.origin, scan.beams, votes, half_width=sensor.half_width, sigma=sensor.sigma,
        share=sensor.share_hit, fade=sensor.fade,
    )  # fmt: skip
    # Each beam's weight is rounded, at a place that is itself rounded.
    slack = 1.01 * len(scan.beams) if votes == "beam" else 1.01
    for cell in got.keys() | want.keys():
        mine, exact = got.get(cell, (0, 0)), want.get(cell, (0.0, 0.0))
        # A hit that rounds to none lets the passes speak.
        tiny = votes == "scan" and mine[0] == 0 < exact[0] < 1.0 / ONE
        for weight, right in zip(mine[: 1 if tiny else 2], exact, strict=False):
            if abs(weight - right * ONE) > slack:
                assert near_edge(scan, cell, d), (cell, mine, exact)
    if votes == "beam" and (sensor.share_hit or sensor.sigma > 0.0):
        assert sum(hits for hits, _ in got.values()) == ONE * sum(hit for *_, hit in scan.beams)


@pytest.mark.parametrize("d", [2, 3])
@given(st.data(), sensors())
@settings(max_examples=60)
def test_one_spread_hit_is_one_hit(d: int, data: st.DataObject, sensor: BeamSensor) -> None:
    scan = data.draw(scans(sensor, d))
    for beam, fade in zip(scan.beams, scan.fades, strict=True):
        for votes in ("scan", "beam"):
            single = ScanInCells(scan.origin, [beam], [fade])
            hits = [hit for hit, _ in votes_of(mapped(sensor, single, votes, d)).values()]
            if sensor.share_hit or sensor.sigma > 0.0:
                assert sum(hits) == (ONE if beam[2] else 0)
            else:
                assert set(hits) <= {0, ONE}


@pytest.mark.parametrize("d", [2, 3])
@given(st.data())
@settings(max_examples=100)
def test_lengths_equal_the_oracle(d: int, data: st.DataObject) -> None:
    scan = data.draw(scans(BeamSensor(), d))
    ends = [end for end, _, _ in scan.beams]
    want = spread.lengths(scan.origin, ends)
    got = lengths_of(scan.origin, ends)
    for cell in got.keys() | want.keys():
        if abs(got.get(cell, 0) - want.get(cell, 0.0) * ONE) > 1.01 * len(ends):
            assert near_edge(scan, cell, d)
    total = sum(math.dist(scan.origin, end) for end in ends)
    assert abs(sum(got.values()) / ONE - total) <= len(got) * len(ends) / ONE + 1e-6


def lengths_of(origin: Point, ends: list[Point]) -> dict[Cell, int]:
    """Of beams in cells, in units of 1/65536 of a cell's side."""
    points = np.array(ends, np.float64)
    segments = Segments(
        origins=np.array([origin]),
        bundles=np.array([0, 1]),
        offsets=np.array([0, len(points)]),
        ends=points,
        tips=points,
        fades=points,
        hit=np.ones(len(points), np.bool_),
    )
    evidence = EvidenceMap(1.0, votes="beam", ndim=len(origin), path_lengths=True)
    assert evidence.lengths is not None
    cells = to_cells(segments, 1.0, evidence.tiles.side, 1 << 50)
    integrator = LengthIntegrator(evidence.lengths, threading.Lock(), 1.0, np.zeros(1, np.int64))
    integrator.add(cells, ONE)
    index, units = evidence.cell_lengths()
    return {tuple(map(int, cell)): int(n) for cell, n in zip(index, units, strict=True)}


# ------------------------------------------------------------------------------- by hand


def along_x(sensor: BeamSensor, start: float, *readings: float, votes: str = "beam") -> EvidenceMap:
    """Beams along the x axis, cells of 1 m, row 0."""
    scan = Scan(Pose2(start, 0.5, 0.0), np.tile([1.0, 0.0], (len(readings), 1)), np.array(readings))
    evidence = EvidenceMap(1.0, votes=votes, sensor=sensor)
    add_scans(evidence, [scan])
    return evidence


def row(evidence: EvidenceMap, cells: int) -> tuple[list[float], list[float]]:
    hits, passes = evidence.region((0, 0), (cells, 1))
    return hits[0].tolist(), passes[0].tolist()


def test_passes_fade() -> None:
    """From 4 m on the weight falls over 4 m; the return is at 8.5 m, in cell 8."""
    hits, passes = row(along_x(BeamSensor(fade=4.0), 0.5, 8.0), 10)
    # Fades from 4.5 to 8.5: cell 4 is half before that, and has 1 - 1/16 on the rest.
    want = [1.0, 1.0, 1.0, 1.0, 0.5 + 0.5 * 15 / 16, 0.75, 0.5, 0.25, 0.0, 0.0]
    assert np.allclose(passes, want, atol=1.0 / ONE)
    assert hits == [0.0] * 8 + [1.0, 0.0]


def test_a_fade_longer_than_the_beam() -> None:
    _, passes = row(along_x(BeamSensor(fade=10.0), 0.0, 2.5), 4)
    assert np.allclose(passes, [0.2, 0.1, 0.0, 0.0], atol=1.0 / ONE)


def test_a_fade_from_a_border() -> None:
    """Forwards and backwards: the cell before the border is whole."""
    _, passes = row(along_x(BeamSensor(fade=2.0), 0.5, 4.5), 6)
    assert np.allclose(passes, [1.0, 1.0, 1.0, 0.75, 0.25, 0.0], atol=1.0 / ONE)
    scan = Scan(Pose2(5.5, 0.5, 0.0), np.array([[-1.0, 0.0]]), np.array([4.5]))
    back = EvidenceMap(1.0, votes="beam", sensor=BeamSensor(fade=2.0))
    add_scans(back, [scan])
    hits, passes = row(back, 6)
    # The return is on the border of cell 1, which has it.
    assert np.allclose(passes, [0.0, 0.0, 0.75, 1.0, 1.0, 1.0], atol=1.0 / ONE)
    assert hits == [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]


def test_no_returns_do_not_fade() -> None:
    sensor = BeamSensor(fade=3.0, clear_range=4.5)
    _, passes = row(along_x(sensor, 0.5, math.inf), 6)
    assert passes == [1.0, 1.0, 1.0, 1.0, 1.0, 0.0]


def test_a_spread_hit_is_a_cut_off_normal_distribution() -> None:
    sensor = BeamSensor(sigma=0.5, spread=3.0)
    hits, passes = row(along_x(sensor, 0.5, 5.2), 9)

    def mass(low: float, high: float) -> float:
        cumulated = [math.erf((x - 5.7) / 0.5 / math.sqrt(2.0)) for x in (low, high, 4.2, 7.2)]
        return (cumulated[1] - cumulated[0]) / (cumulated[3] - cumulated[2])

    want = [0.0] * 4 + [mass(4.2, 5.0), mass(5.0, 6.0), mass(6.0, 7.0), mass(7.0, 7.2), 0.0]
    assert np.allclose(hits, want, atol=1.0 / ONE)
    assert sum(hits) == 1.0
    assert passes == [1.0] * 4 + [0.0] * 5


def test_a_hit_is_cut_off_at_the_sensor() -> None:
    hits, passes = row(along_x(BeamSensor(sigma=1.0), 0.25, 0.5), 5)
    cumulated = [math.erf((x - 0.75) / math.sqrt(2.0)) for x in (0.25, 1.0, 2.0, 3.0, 3.75)]
    want = np.diff(cumulated) / (cumulated[-1] - cumulated[0])
    assert np.allclose(hits, [*want, 0.0], atol=1.0 / ONE)
    assert sum(hits) == 1.0
    assert passes == [0.0] * 5


def test_a_narrow_spread_in_one_cell_is_a_whole_hit() -> None:
    spread_hit, plain = (
        along_x(sensor, 0.5, 5.0, votes="scan") for sensor in (BeamSensor(sigma=0.01), BeamSensor())
    )
    assert votes_of(spread_hit) == votes_of(plain)


@pytest.mark.parametrize(
    ("start", "stop"),
    [
        ((0.0, 0.5), (-1e-310, 3.5)),
        ((-1e-310, 0.5), (1e-310, 3.25)),
        ((0.5, 0.0, 0.5), (3.5, -5e-324, 0.25)),
    ],
)
def test_a_walk_along_a_border_by_next_to_nothing(start: Point, stop: Point) -> None:
    """1 / (the way along that axis) is infinite."""
    cells, left = np.zeros((20, len(start)), np.int64), np.zeros(20)
    count = walk(np.array(start), np.array(stop), cells, left)
    got = {tuple(map(int, cell)): part for cell, part in zip(cells, left[:count], strict=False)}
    want = crossed(start, stop)
    assert got.keys() == want.keys()
    assert np.diff(left[:count], prepend=0.0) == pytest.approx([float(want[c]) for c in got])
