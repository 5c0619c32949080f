# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.simulate import Disc, FloorPlan, Polygon, Rectangle, Shape, walls_around
from tests.naive import floor_plan_oracle as oracle

# Surfaces grown by 1 um: it moves the point where a ray grazes a disc of 4 m by up to 3 mm.
SLACK = 1e-6

# Multiples of 1/4 make shapes that touch and share corners; angles that no edge has.
quarters = st.integers(-20, 20).map(lambda k: k / 4)
sizes = st.integers(1, 16).map(lambda k: k / 4)
angles = st.integers(0, 2879).map(lambda k: math.radians(k / 8 + 0.0371))
odd_points = st.tuples(quarters, quarters).map(lambda p: (p[0] + 0.0137, p[1] + 0.0291))


@st.composite
def rectangles(draw: st.DrawFn) -> Rectangle:
    x, y = draw(quarters), draw(quarters)
    return Rectangle(x, y, x + draw(sizes), y + draw(sizes))


@st.composite
def stars(draw: st.DrawFn) -> Polygon:
    """A polygon whose corners go around a centre once: concave, but without crossing edges."""
    x, y = draw(quarters), draw(quarters)
    turns = sorted(draw(st.sets(st.integers(0, 19), min_size=4, max_size=9)))
    radii = [draw(sizes) for _ in turns]
    around = [math.radians(18 * turn) for turn in turns]
    points = [
        (x + r * math.cos(a), y + r * math.sin(a)) for r, a in zip(radii, around, strict=True)
    ]
    return Polygon(points if draw(st.booleans()) else points[::-1])


discs = st.builds(Disc, quarters, quarters, sizes)
plans = st.lists(st.one_of(rectangles(), stars(), discs), max_size=6).map(FloorPlan)


@given(plans, st.lists(st.tuples(odd_points, angles), min_size=1, max_size=20))
def test_cast_equals_oracle(plan: FloorPlan, rays: list[tuple[tuple[float, float], float]]) -> None:
    directions = [(math.cos(angle), math.sin(angle)) for _, angle in rays]
    distances = plan.cast([origin for origin, _ in rays], directions)
    for (origin, _), direction, distance in zip(rays, directions, distances, strict=True):
        assert distance >= oracle.cast(plan, origin, direction, SLACK) - 1e-2
        assert distance <= oracle.cast(plan, origin, direction, -SLACK) + 1e-2
        exact = oracle.cast(plan, origin, direction, 0.0)
        if oracle.cast(plan, origin, direction, SLACK) == pytest.approx(
            oracle.cast(plan, origin, direction, -SLACK), abs=1e-2
        ):
            assert distance == pytest.approx(exact, abs=1e-9)


@given(plans, st.lists(odd_points, min_size=1, max_size=20))
def test_contains_equals_oracle(plan: FloorPlan, points: list[tuple[float, float]]) -> None:
    assert plan.contains(points).tolist() == [oracle.contains(plan, point) for point in points]


@given(plans, odd_points, angles)
def test_a_ray_from_free_space_ends_at_the_first_obstacle(
    plan: FloorPlan, origin: tuple[float, float], angle: float
) -> None:
    direction = np.array([math.cos(angle), math.sin(angle)])
    if oracle.contains(plan, origin):
        return
    reach = min(plan.cast([origin], [direction])[0], 20.0)
    steps = np.arange(0.0, reach - 1e-6, 0.05)[:, None]
    assert not plan.contains(np.array(origin) + steps * direction).any()


def test_no_ray_leaks_through_the_corners_of_a_room() -> None:
    room = Rectangle(0.0, 0.0, 3.0, 2.0)
    plan = FloorPlan(walls_around(room, 0.1))
    origins = np.random.default_rng(0).uniform((0.01, 0.01), (2.99, 1.99), (2000, 2))
    for corner in room.vertices:
        to_corner = corner - origins
        far = np.hypot(to_corner[:, 0], to_corner[:, 1])
        distances = plan.cast(origins, to_corner / far[:, None])
        np.testing.assert_allclose(distances, far, atol=1e-6)


def test_rays_along_the_axes() -> None:
    plan = FloorPlan([Rectangle(1.0, -1.0, 2.0, 1.0)])
    directions = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)]
    assert plan.cast((0.0, 0.0), directions).tolist() == [1.0, math.inf, math.inf, math.inf]
    # Along a face: its corner is touched. On a face: met at once. From within: the other side.
    assert plan.cast([(0.0, 1.0), (1.0, 0.0), (1.5, 0.0)], [(1.0, 0.0)] * 3).tolist() == [1, 0, 0.5]


def test_disc_from_outside_and_within() -> None:
    plan = FloorPlan([Disc(3.0, 0.0, 1.0)])
    origins = [(0.0, 0.0), (0.0, 1.5), (3.0, 0.0), (5.0, 0.0)]
    assert plan.cast(origins, [(1.0, 0.0)] * 4).tolist() == [2.0, math.inf, 1.0, math.inf]


def test_more_rays_than_one_block() -> None:
    plan = FloorPlan([Rectangle(1.0, 1.0, 2.0, 2.0), Disc(-2.0, 0.5, 1.0), Disc(0.0, -3.0, 0.5)])
    around = np.linspace(0.0, 2 * math.pi, 30_000)
    directions = np.stack([np.cos(around), np.sin(around)], axis=1)
    together = plan.cast((0.0, 0.0), directions)
    apart = [plan.cast((0.0, 0.0), part) for part in np.array_split(directions, 17)]
    assert np.array_equal(together, np.concatenate(apart))


def test_empty_plan_and_no_rays() -> None:
    assert FloorPlan([]).cast((0.0, 0.0), [(1.0, 0.0)]).tolist() == [math.inf]
    assert not FloorPlan([]).contains([(0.0, 0.0)]).any()
    assert FloorPlan([Disc(0, 0, 1)]).cast((0.0, 0.0), np.empty((0, 2))).shape == (0,)


def test_outline_is_half_open_like_a_cell() -> None:
    plan = FloorPlan([Rectangle(0.0, 0.0, 1.0, 2.0)])
    points = [(0.0, 0.0), (0.0, 1.0), (0.5, 0.0), (1.0, 1.0), (0.5, 2.0), (1.0, 2.0)]
    assert plan.contains(points).tolist() == [True, True, True, False, False, False]


def test_rasterise_has_row_y_and_the_window_asked_for() -> None:
    plan = FloorPlan([Rectangle(0.1, 0.3, 0.3, 0.4)])
    grid = plan.rasterise(0.1, (-1, 2), (4, 5))
    assert grid.astype(int).tolist() == [[0, 0, 0, 0, 0], [0, 0, 1, 1, 0], [0, 0, 0, 0, 0]]


def test_rasterise_with_samples_sees_a_thin_wall() -> None:
    plan = FloorPlan([Rectangle(0.0, 0.0, 1.0, 0.03)])
    assert not plan.rasterise(0.1, (0, 0), (10, 2)).any()
    assert plan.rasterise(0.1, (0, 0), (10, 2), samples=4).tolist() == [[True] * 10, [False] * 10]


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (lambda: Rectangle(1.0, 0.0, 0.0, 1.0), "x_min < x_max"),
        (lambda: Rectangle(0.0, 0.0, 1.0, 0.0), "x_min < x_max"),
        (lambda: Rectangle(0.0, 0.0, math.nan, 1.0), "finite"),
        (lambda: Disc(0.0, 0.0, 0.0), "radius must be positive"),
        (lambda: Disc(0.0, 0.0, -1.0), "radius must be positive"),
        (lambda: Disc(0.0, 0.0, math.nan), "radius must be positive"),
        (lambda: Disc(math.inf, 0.0, 1.0), "centre must be finite"),
        (lambda: Polygon([(0, 0), (1, 1)]), "at least 3 corners"),
        (lambda: Polygon([]), "at least 3 corners"),
        (lambda: Polygon([(0, 0), (1, 1), (2, 2)]), "no area"),
        (lambda: Polygon([(0, 0), (1, 0), (1, 0), (1, 1)]), "after corner 1 repeats"),
        (lambda: Polygon([(0, 0), (1, 0), (1, 1), (0, 0)]), "after corner 3 repeats"),
        (lambda: Polygon([(0, 0), (1, 0), (1, math.nan)]), "corner 2 is not finite"),
        (lambda: Polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)]), "pairs of numbers"),
        (lambda: walls_around(Rectangle(0, 0, 1, 1), 0.0), "thickness must be positive"),
    ],
)
def test_a_bad_shape_is_refused_in_one_line(shape: object, message: str) -> None:
    assert callable(shape)
    with pytest.raises(InputError, match=message) as caught:
        shape()
    assert "\n" not in str(caught.value)


def test_bad_rays_points_and_windows_are_refused() -> None:
    plan = FloorPlan([Disc(0.0, 0.0, 1.0)])
    with pytest.raises(InputError, match="direction 1 has length 2"):
        plan.cast((0.0, 0.0), [(1.0, 0.0), (0.0, 2.0)])
    with pytest.raises(InputError, match="direction 0 has length nan"):
        plan.cast((0.0, 0.0), [(math.nan, 0.0)])
    with pytest.raises(InputError, match="origin is not finite"):
        plan.cast((math.nan, 0.0), [(1.0, 0.0)])
    with pytest.raises(InputError, match=r"got \(3, 2\) and \(2, 2\)"):
        plan.cast(np.zeros((3, 2)), np.eye(2))
    with pytest.raises(InputError, match=r"points \(n, 2\) are needed"):
        plan.contains([0.0, 1.0])
    with pytest.raises(InputError, match="point is not finite"):
        plan.contains([(0.0, math.nan)])
    with pytest.raises(InputError, match="resolution must be positive"):
        plan.rasterise(0.0, (0, 0), (1, 1))
    with pytest.raises(InputError, match="samples must be at least 1"):
        plan.rasterise(0.1, (0, 0), (1, 1), samples=0)
    with pytest.raises(InputError, match="end_cell must lie beyond"):
        plan.rasterise(0.1, (0, 0), (1, 0))


def test_equal_plans_are_equal() -> None:
    shapes: list[Shape] = [Disc(0, 0, 1), Polygon([(0, 0), (1, 0), (0, 1)])]
    assert FloorPlan(shapes) == FloorPlan(shapes)
    assert FloorPlan(shapes) != FloorPlan(shapes[:1])
