# SPDX-License-Identifier: Apache-2.0
"""The ground as a surface: steps, ramps and hills are followed, what stands or hangs is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import oddsmap
from oddsmap import EvidenceMap, InputError, State, project
from oddsmap.projection.ground_plane import GroundPlane, fit_ground
from oddsmap.projection.ground_surface import GroundSurface, fit_ground_surface

R = 0.2
ONE = 65536
Cells = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
X, Y = (a.reshape(-1) for a in np.meshgrid(np.arange(-75, 75), np.arange(-75, 75)))  # 30 x 30 m
CX, CY = (X + 0.5) * R, (Y + 0.5) * R


def layer(z: npt.ArrayLike, where: Mask | None = None) -> Cells:
    """One cell in each column: at a height [m]."""
    cells = np.stack([X, Y, np.floor(np.broadcast_to(z, X.shape) / R + 1e-9)], axis=1)
    return np.asarray(cells if where is None else cells[where], np.int64)


def stack(low: float, high: float, where: Mask) -> Cells:
    """All cells of columns between two heights [m]."""
    return np.concatenate([layer(z, where) for z in np.arange(low, high - R / 2, R)])


def box(x: float, y: float, half: float) -> Mask:
    return np.asarray((np.abs(CX - x) <= half) & (np.abs(CY - y) <= half), np.bool_)


def off(surface: GroundSurface, z: npt.ArrayLike, where: Mask | None = None) -> float:
    """How far the surface is from heights of cells' floors [m], at worst."""
    worst = np.abs(surface.at(CX, CY) - R / 2 - np.broadcast_to(z, X.shape))
    return float((worst if where is None else worst[where]).max())


def test_between_patches_the_surface_is_bilinear_and_beyond_them_constant() -> None:
    plane = GroundPlane(1.0, 0.5, -0.25)
    surface = GroundSurface(plane, np.array([[0.0, 1.0], [2.0, 7.0]]), (-3, 10), 2.0)
    # Centres at x = -5 and -3, y = 21 and 23.
    x, y = np.array([-5.0, -3.0, -5.0, -4.0, -4.0, 9.0]), np.array([21.0, 21, 23, 21, 22, 99])
    expected = plane.at(x, y) + np.array([0.0, 1.0, 2.0, 0.5, 2.5, 7.0])
    assert surface.at(x, y) == pytest.approx(expected, abs=1e-12)
    assert surface.at(-4.0, 22.0).shape == ()


def test_two_levels_a_ramp_and_what_stands_on_them() -> None:
    # Half a metre up at x = 0 where y > 0, and by a ramp of 5 m where y < 0.
    rise = np.where(CY > 0, np.where(CX > 0, 0.5, 0.0), np.clip(CX / 10 + 0.25, 0.0, 0.5))
    low, high = box(-8, 6, 1.0), box(8, -8, 0.7)
    crate, pole = low | high, box(6, 6, 0.1) | box(-6, -9, 0.1)
    overhang = box(-8, -4, 1.5)
    floor = layer(rise, ~crate & ~pole)
    stands = crate | pole
    cells = [floor, stack(0.0, 1.0, low), stack(0.4, 1.4, high), layer(2.8, overhang)]
    cells += [stack(0.4, 3.0, pole)]
    step = (np.abs(CX) < 1.5) & (CY > -1.5)
    occupied = np.unique(np.concatenate(cells), axis=0)
    surface = fit_ground_surface(occupied, R)
    assert off(surface, rise, ~step & ~stands) < 0.25
    plane = project(as_map(occupied), 0.3, 2.0, ground="relative")
    state = plane.state().reshape(-1)
    assert (state[stands] == State.OCCUPIED).all()
    # Nothing seen there in the band: a floor is no obstacle, and no sight of what is above it.
    assert (state[~stands & ~step] == State.UNKNOWN).all()
    one = fit_ground(occupied, R)
    tilted = np.abs(one.at(CX, CY) - R / 2 - rise)
    assert tilted.max() > 0.25, "one plane would do: this world tests nothing"


def as_map(occupied: Cells) -> EvidenceMap:
    grid = EvidenceMap(R, ndim=3)
    grid.add_cells(occupied, np.full(len(occupied), 6 * ONE), np.zeros(len(occupied), np.int64))
    return grid


@pytest.mark.parametrize("height", [0.6, 1.6, 2.4])
def test_a_terrace_is_ground(height: float) -> None:
    rise = np.where(CX > 0, height, 0.0)
    surface = fit_ground_surface(layer(rise), R)
    assert off(surface, rise, np.abs(CX) > 1.5) < 0.2


def test_hills() -> None:
    hill = 1.1 * np.sin(CX / 8) * np.cos(CY / 9)  # up to 14 %
    surface = fit_ground_surface(layer(hill), R)
    assert off(surface, np.floor(hill / R) * R) < 0.25


@pytest.mark.parametrize(
    ("half", "height", "seen_beneath"), [(3.0, 2.4, False), (12.0, 3.0, False), (12.0, 2.4, True)]
)
def test_a_roof_over_floor_never_seen_is_no_ground(
    half: float, height: float, seen_beneath: bool
) -> None:
    roof = box(0, 0, half)
    occupied = np.concatenate([layer(0.0, ~roof), layer(height, roof)])
    free = stack(1.0, height, roof) if seen_beneath else None
    assert off(fit_ground_surface(occupied, R, free), 0.0) < 0.2
    if seen_beneath:
        assert off(fit_ground_surface(occupied, R), 0.0) > 2.0, "no rays are needed"


def test_a_ceiling_mirrored_in_the_floor_is_no_ground() -> None:
    mirrored = box(2, 3, 7.0)
    occupied = np.concatenate([layer(0.0, ~mirrored), layer(-4.0, mirrored)])
    air = stack(0.2, 2.0, np.ones(X.shape, np.bool_))
    assert off(fit_ground_surface(occupied, R, air), 0.0) < 0.2
    # Free space that reaches down to it makes it a pit.
    pit = np.concatenate([air, stack(-3.8, 0.2, mirrored)])
    inside = box(2, 3, 5.5)
    assert off(fit_ground_surface(occupied, R, pit), -4.0, inside) < 0.2


def test_small_surfaces_are_no_ground() -> None:
    odd = box(9, -9, 1.2)
    for z in (-2.0, 0.8, 5.0):
        occupied = np.concatenate([layer(0.0, ~odd), layer(z, odd)])
        assert off(fit_ground_surface(occupied, R), 0.0) < 0.2


def test_tilt_goes_on_where_no_ground_was_seen() -> None:
    seen = CX < 0
    far = layer(0.05 * 14.9 + 4.0, (CX > 14.7) & (CY > 0))  # the upper end of a wall
    surface = fit_ground_surface(np.concatenate([layer(0.05 * CX, seen), far]), R)
    assert surface.plane.slope_x == pytest.approx(0.05, abs=5e-3)
    assert off(surface, 0.05 * CX) < 0.3


def test_too_little_for_a_surface_gives_the_plane() -> None:
    few = layer(0.1 * CX, box(0, 0, 0.9))
    surface, plane = fit_ground_surface(few, R), fit_ground(few, R)
    assert surface.at(CX, CY) == pytest.approx(plane.at(CX, CY), abs=1e-12)
    hanging = fit_ground_surface(few, R, few - np.array([0, 0, 9]))
    assert hanging.at(CX, CY) == pytest.approx(plane.at(CX, CY), abs=1e-12)
    with pytest.raises(InputError, match="no cell is occupied"):
        fit_ground_surface(few[:0], R)


def test_neither_order_nor_place_matters() -> None:
    rng = np.random.default_rng(5)
    cells = layer(
        np.where(CX > 3, 1.0, 0.0) + rng.normal(0.0, 0.1, X.shape), rng.random(len(X)) < 0.5
    )
    free = layer(0.6)
    near = fit_ground_surface(cells, R, free)
    mixed = fit_ground_surface(rng.permutation(cells), R, rng.permutation(free))
    assert np.array_equal(near.at(CX, CY), mixed.at(CX, CY))
    shift = np.array([2_500_000, 25_000_000, 450])
    far = fit_ground_surface(cells + shift, R, free + shift)
    at_far = far.at(CX + 500_000.0, CY + 5_000_000.0) - 90.0
    assert at_far == pytest.approx(near.at(CX, CY), abs=1e-3)


@pytest.mark.realdata
def test_the_courtyard_of_hku1_is_free(data_folder: Path) -> None:
    folder = data_folder / "lidar3d" / "hku1_avia"
    log = oddsmap.open_log(folder, poses=folder / "poses_kitti.txt")
    grid = oddsmap.build_map(log, resolution=R)
    plane = project(grid, 0.3, 2.0, ground="relative")
    j, i = np.indices(plane.state().shape)
    x, y = plane.origin[0] + (i + 0.5) * R, plane.origin[1] + (j + 0.5) * R
    # Floor seen by most scans; above one plane 15 % of it is occupied.
    yard = (x > 3) & (x < 15) & (y > -15.5) & (y < -4.5) & (y < -4.5 - 0.3 * (x - 3))
    state = plane.state()[yard]
    assert (state == State.OCCUPIED).mean() < 0.03
    wall = (np.abs(x - 25.2) < 0.8) & (np.abs(y + 4) < 1.5)
    assert (plane.state()[wall] == State.OCCUPIED).sum() >= 10
