# SPDX-License-Identifier: Apache-2.0
"""The cells of cones against plain Python, and against rays and directions at will."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.kernels.trace.cone3d import RADIUS
from oddsmap.kernels.trace.cone_cells import LEAST_HALF_ANGLE, list_cells
from tests.naive import forward as naive

BIN, BIAS, REACH = 0.5, 0.05, 6.0
ROUNDING = 1e-6

Listed = dict[tuple[int, ...], tuple[int, float]]


def listed(
    origin: Sequence[float],
    axis: Sequence[float],
    half: float,
    *,
    reach: float = REACH,
    lo: Sequence[int] | None = None,
    shape: Sequence[int] | None = None,
    room: int = 20_000,
) -> Listed:
    """Cell -> bin and fraction, of one beam."""
    d = len(origin)
    first = np.floor(np.array(origin)).astype(np.int64) - 50 if lo is None else np.array(lo)
    counts = np.full(d, 101) if shape is None else np.array(shape)
    offsets = np.empty(2, np.int64)
    cells, bins = np.empty(room, np.int64), np.empty(room, np.int32)
    fractions = np.empty(room)
    done = list_cells(
        np.array([origin], np.float64), np.array([axis], np.float64), np.array([reach]), half,
        BIN, BIAS, first, counts, 0, offsets, cells, bins, fractions,
    )  # fmt: skip
    assert done == 1
    n = offsets[1]
    assert (np.diff(bins[:n]) >= 0).all(), "not sorted from near to far"
    index = np.stack(np.unravel_index(cells[:n], counts[::-1])[::-1], axis=1) + first
    found = {
        tuple(cell): (k, f)
        for cell, k, f in zip(
            index.tolist(), bins[:n].tolist(), fractions[:n].tolist(), strict=True
        )
    }
    assert len(found) == n, "a cell is listed twice"
    return found


def assert_same(got: Listed, fractions: dict[tuple[int, ...], float], origin: Sequence[float],
                tolerance: float, reach: float = REACH) -> None:  # fmt: skip
    """Equal but for cells at the very border of the cone, of the reach or of a bin."""
    for cell in got.keys() | fractions.keys():
        distance = naive.nearest(origin, cell) + BIAS
        k, fraction = got.get(cell, (-1, 0.0))
        if k < 0 and (fractions[cell] < tolerance or distance > reach - ROUNDING):
            continue
        assert fraction == pytest.approx(fractions.get(cell, 0.0), abs=tolerance), cell
        assert 0 < fraction <= 1
        assert distance <= reach + ROUNDING
        assert k in {int((distance + e) / BIN) for e in (-ROUNDING, 0.0, ROUNDING)}, cell


# Borders and corners on purpose, and any other place, but not within rounding of a border: there
# the sensor touches a cell that it sees under 180 degrees, or none of it.
place = st.one_of(
    st.integers(-8, 8).map(lambda i: i / 4), st.floats(-3, 3).map(lambda x: round(x, 6))
)
angle = st.one_of(st.integers(-8, 8).map(lambda i: i * math.pi / 8), st.floats(-3.2, 3.2))
half_angle = st.one_of(
    st.sampled_from([LEAST_HALF_ANGLE, 0.01, math.radians(12.5), math.pi / 4, math.pi / 2]),
    st.floats(1e-4, math.pi / 2),
)


@given(st.tuples(place, place), angle, half_angle)
def test_cells_of_the_plane(origin: tuple[float, float], turn: float, half: float) -> None:
    got = listed(origin, (math.cos(turn), math.sin(turn)), half)
    want = {
        cell: naive.plane_fraction(origin, turn, half, cell)
        for cell in naive.around(origin, REACH)
        if naive.nearest(origin, cell) + BIAS <= REACH
    }
    # 1e-9 of the thinnest cone, whose fractions are ratios of tiny angles.
    tolerance = 3e-6 + 1e-15 / half
    assert_same(got, {c: f for c, f in want.items() if f > 0}, origin, tolerance)


@pytest.mark.parametrize("half", [math.radians(12.5), math.pi / 2, 0.05])
def test_fractions_of_the_plane_by_counting_rays(half: float) -> None:
    origin, turn = (0.3, 0.62), 0.7
    got = listed(origin, (math.cos(turn), math.sin(turn)), half, reach=4.0)
    angles = np.arange(-math.pi, math.pi, 1e-3)
    inside = np.abs(np.remainder(angles - turn + math.pi, 2 * math.pi) - math.pi) <= half
    checked = 0
    for cell in naive.around(origin, 4.0):
        if naive.nearest(origin, cell) + BIAS > 4.0:
            continue
        met = np.array([naive.meets_ray(origin, float(a), cell) for a in angles])
        both = int(np.count_nonzero(met & inside))
        share = both / min(int(np.count_nonzero(met)), int(np.count_nonzero(inside)))
        assert got.get(cell, (0, 0.0))[1] == pytest.approx(share, abs=0.03), cell
        checked += int(both > 0)
    assert checked > 5


direction = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda v: math.hypot(*v) > 0.1
)
along_an_axis = st.sampled_from([(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)])


@settings(max_examples=30)
@given(st.tuples(place, place, place), st.one_of(direction, along_an_axis), half_angle)
def test_cells_of_space(
    origin: tuple[float, float, float], way: tuple[float, float, float], half: float
) -> None:
    axis = tuple(w / math.hypot(*way) for w in way)
    reach = 3.0
    got = listed(origin, axis, half, reach=reach)
    want = {}
    for cell in naive.around(origin, reach):
        if naive.nearest(origin, cell) + BIAS <= reach:
            mine = got.get(cell, (0, 0.0))[1]
            fraction = naive.space_fraction(origin, axis, half, cell, RADIUS)
            assert mine == pytest.approx(fraction, abs=2e-3), cell
            if fraction > 0:
                want[cell] = mine  # compared above, more loosely: strips only add up so well
    assert_same(got, want, origin, 2e-3, reach)


def meets_cube(
    directions: npt.NDArray[np.float64], centre: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Which rays from the origin meet the cube about a centre."""
    with np.errstate(divide="ignore"):
        one, other = (centre - 0.5) / directions, (centre + 0.5) / directions
    near = np.maximum(np.minimum(one, other).max(axis=1), 0.0)
    return np.asarray(near < np.maximum(one, other).min(axis=1))


@pytest.mark.parametrize(("degrees", "worst"), [(5.6, 0.03), (25.0, 0.025)])
def test_balls_stand_in_for_cubes(degrees: float, worst: float) -> None:
    """Solid angles by drawn directions: at the rim of the cone, hardly any bias."""
    rng = np.random.default_rng(4)
    half = math.radians(degrees) / 2
    errors = []
    for _ in range(25):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        origin = rng.random(3)
        cone_size = 2 * math.pi * (1 - math.cos(half))
        got = listed(origin.tolist(), axis.tolist(), half, reach=40.0, room=200_000)
        rim = [cell for cell, (_, f) in got.items() if 0.02 < f < 0.98]
        for i in rng.choice(len(rim), 12, replace=False):
            centre = np.array(rim[i]) + 0.5 - origin
            if np.linalg.norm(centre) < 2:
                continue
            radius = math.asin(math.sqrt(0.75) / float(np.linalg.norm(centre)))
            own = _cap(centre / np.linalg.norm(centre), radius, 20_000, rng)
            own_size = 2 * math.pi * (1 - math.cos(radius))
            met = meets_cube(own, centre)
            cell_size = float(np.mean(met)) * own_size
            both = float(np.mean(met & (own @ axis > math.cos(half)))) * own_size
            errors.append(got[rim[i]][1] - both / min(cell_size, cone_size))
    assert len(errors) > 200
    assert abs(np.mean(errors)) < 0.005
    assert np.mean(np.abs(errors)) < worst


def _cap(
    axis: npt.NDArray[np.float64], half: float, count: int, rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """Directions drawn evenly from a cap of the sphere."""
    z = 1 - rng.random(count) * (1 - math.cos(half))
    phi = 2 * math.pi * rng.random(count)
    aside = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    aside /= np.linalg.norm(aside)
    other = np.cross(axis, aside)
    ring = np.cos(phi)[:, None] * aside + np.sin(phi)[:, None] * other
    found: npt.NDArray[np.float64] = z[:, None] * axis + np.sqrt(1 - z * z)[:, None] * ring
    return found


def test_a_ray_and_a_cone_inside_one_cell() -> None:
    row = listed((0.5, 0.5), (1.0, 0.0), LEAST_HALF_ANGLE, reach=4.0)
    assert set(row) == {(1, 0), (2, 0), (3, 0), (4, 0)}
    assert all(f == pytest.approx(1.0) for _, f in row.values())
    # Range of (1, 0) is 0.5 + bias: bin 1.
    assert [row[i, 0][0] for i in (1, 2, 3, 4)] == [1, 3, 5, 7]
    # A cone of 20 degrees lies wholly inside the next cell, seen under 90.
    narrow = listed((0.5, 0.5), (1.0, 0.0), math.radians(10), reach=1.0)
    assert list(narrow) == [(1, 0)]
    assert narrow[1, 0] == pytest.approx((1, 1.0))
    # Along a border: half to either side, whichever way.
    for way in (1.0, -1.0):
        halves = listed((0.5, 0.0), (way, 0.0), LEAST_HALF_ANGLE, reach=2.0)
        ahead = {c: f for c, (_, f) in halves.items()}
        assert ahead == {c: pytest.approx(0.5) for c in ahead}
        assert {y for _, y in ahead} == {-1, 0}
    space = listed((0.5, 0.5, 0.5), (0.0, 0.0, -1.0), LEAST_HALF_ANGLE, reach=3.0)
    assert {c for c, (_, f) in space.items() if f == 1.0} == {(0, 0, -1), (0, 0, -2), (0, 0, -3)}


def test_the_sensors_own_cell_is_left_out() -> None:
    for origin in ((0.5, 0.5), (0.0, 0.0), (0.0, 0.5)):
        assert (0, 0) not in listed(origin, (1.0, 0.0), math.pi / 2)
    # On the border the neighbour is next: bin 0, and half of a half-plane is all that it may be.
    assert listed((0.0, 0.5), (-1.0, 0.0), math.pi / 2)[-1, 0] == pytest.approx((0, 1.0))
    assert (0, 0, 0) not in listed((0.5, 0.2, 0.7), (1.0, 0.0, 0.0), math.pi / 2)


@pytest.mark.parametrize("d", [2, 3])
def test_a_window_leaves_out_what_is_outside(d: int) -> None:
    rng = np.random.default_rng(d)
    for _ in range(20):
        origin, axis = rng.uniform(-2, 2, d), rng.normal(size=d)
        axis /= np.linalg.norm(axis)
        lo, shape = rng.integers(-5, 1, d), rng.integers(1, 6, d)
        half = float(rng.uniform(0.05, 1.5))
        part = listed(origin.tolist(), axis.tolist(), half, lo=lo.tolist(), shape=shape.tolist())
        whole = listed(origin.tolist(), axis.tolist(), half)
        assert part == {
            c: v
            for c, v in whole.items()
            if ((np.array(c) >= lo) & (np.array(c) < lo + shape)).all()
        }


@pytest.mark.parametrize("d", [2, 3])
def test_whole_cells_move_the_answer(d: int) -> None:
    rng = np.random.default_rng(d)
    axis = rng.normal(size=d)
    axis /= np.linalg.norm(axis)
    origin = rng.integers(0, 64, d) / 64  # so that moving is exact
    here = listed(origin.tolist(), axis.tolist(), 0.3)
    by = 108_456_789
    there = listed((origin + by).tolist(), axis.tolist(), 0.3)
    assert here == {tuple(i - by for i in c): v for c, v in there.items()}


def test_many_beams_in_small_rooms() -> None:
    """Beams that do not fit are left for the next call, and nothing else changes."""
    rng = np.random.default_rng(0)
    n = 30
    origins, turns = rng.uniform(-3, 3, (n, 2)), rng.uniform(-3, 3, n)
    axes = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    reaches = rng.uniform(-1, 6, n)
    reaches[3] = np.nan
    lo, shape = np.array([-20, -20]), np.array([40, 40])
    first, calls = 0, 0
    rows: list[list[tuple[int, int, float]]] = []
    while first < n:
        offsets = np.empty(n - first + 1, np.int64)
        cells, bins = np.empty(60, np.int32), np.empty(60, np.int32)
        fractions = np.empty(60, np.float32)
        done = list_cells(
            origins, axes, reaches, 0.25, BIN, BIAS, lo, shape, first, offsets, cells, bins,
            fractions,
        )  # fmt: skip
        assert done > first
        for b in range(done - first):
            cut = slice(offsets[b], offsets[b + 1])
            rows.append(
                list(
                    zip(cells[cut].tolist(), bins[cut].tolist(), fractions[cut].tolist(),
                        strict=True)
                )
            )  # fmt: skip
        first, calls = done, calls + 1
    assert calls > 2
    assert rows[3] == []
    for i in range(n):
        reach = reaches[i]
        alone = (
            listed(origins[i].tolist(), axes[i].tolist(), 0.25, reach=reach) if reach > 0 else {}
        )
        mine = {(c % 40 - 20, c // 40 - 20): (k, f) for c, k, f in rows[i]}
        assert mine.keys() == alone.keys()
        for cell in mine:
            assert mine[cell] == pytest.approx(alone[cell], abs=1e-6)
    one = np.empty(1, np.int32)
    assert list_cells(
        origins[:1], axes[:1], np.array([6.0]), 0.25, BIN, BIAS, lo, shape, 0,
        np.empty(2, np.int64), one, one.copy(), np.empty(1, np.float32),
    ) == 0  # fmt: skip
