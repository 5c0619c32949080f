"""From 3D to 2D: bands of heights, above zero and above the ground."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

import oddsmap
from oddsmap import ConfigError, EvidenceMap, InputError, State, VoxelMap, project
from oddsmap.projection.ground_plane import GroundPlane, fit_ground

ONE = 65536
R = 0.1
Index = npt.NDArray[np.int64]


def space(hits: npt.ArrayLike, passes: npt.ArrayLike = ()) -> EvidenceMap:
    """A 3D map with six hits, or six passes, in the cells given."""
    grid = EvidenceMap(R, ndim=3)
    for index, vote in ((hits, 0), (passes, 1)):
        cells = np.array(index, np.int64).reshape(-1, 3)
        units = np.zeros((2, len(cells)), np.int64)
        units[vote] = 6 * ONE
        grid.add_cells(cells, *units)
    return grid


def test_a_column_is_its_most_occupied_seen_cell() -> None:
    passes = [[x, 0, z] for x in (0, 1) for z in range(20)]
    grid = space([[1, 0, 20], [3, 0, 5]], passes)
    plane = project(grid, 0.0, 2.1, rule="largest")
    # Twenty free cells are as free as one; unseen cells grey nothing; column 2 was never seen.
    one = float(grid.log_odds().of_votes(0, 6))
    assert plane.probability[0, 0] == pytest.approx(1 / (1 + math.exp(-one)), rel=1e-12)
    assert plane.state().tolist() == [[State.FREE, State.OCCUPIED, State.UNKNOWN, State.OCCUPIED]]
    assert (plane.resolution, plane.origin) == (R, (0.0, 0.0))


def test_a_cell_belongs_to_the_band_of_its_centre() -> None:
    grid = space([[0, 0, 3], [1, 0, 4], [-2, 5, 50]])  # centres at 0.35, 0.45
    assert project(grid, 0.36, 0.46).observed.sum() == 1
    assert project(grid, 0.34, 0.46).observed.sum() == 2
    assert project(grid, 0.34, 0.44).observed.sum() == 1
    all_ = project(grid, -math.inf, math.inf)
    # The rectangle is that of all columns, whatever the band.
    assert all_.probability.shape == project(grid, 0.36, 0.46).probability.shape == (6, 4)
    assert all_.origin == pytest.approx((-0.2, 0.0))
    assert all_.observed[5, 0]
    assert all_.observed[0, 2]


def test_prior_and_voxels() -> None:
    grid = space([[0, 0, 0]], [[2, 1, 0]])
    plane = project(grid.log_odds(prior=0.2), -1.0, 1.0)
    assert plane.probability[0, 1] == 0.2
    assert plane.probability[0, 0] == grid.log_odds(prior=0.2).probability().max()
    cube = VoxelMap(np.array([[4, 4, 0]]), np.array([2.0]), R, np.array([2]))
    assert project(cube, 0.3, 1.0).state().tolist() == [[State.OCCUPIED] * 4] * 4


def world(tilt: float, yaw: float = 0.7, seed: int = 1) -> tuple[EvidenceMap, Index, Index]:
    """A tilted hall of 20 x 20 m: floor, walls of 2 m, a ceiling, a table, ghosts below a window.

    Returns:
        The map; columns of the walls and the table; columns of bare floor.
    """
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(-100, 100), np.arange(-100, 100))
    x, y = np.concatenate(x), np.concatenate(y)
    slope = math.tan(tilt)
    rise = slope * (math.cos(yaw) * x + math.sin(yaw) * y)
    floor = np.floor(rise + rng.normal(0.0, 0.2, len(x)) + 0.5).astype(np.int64)
    wall = (np.abs(x) == 99) | (np.abs(y) == 99) | ((x == 20) & (y > 0))
    table = (np.abs(x + 50) < 12) & (np.abs(y + 50) < 12)
    ghost = (x > 60) & (y > 80) & ~wall
    seen = rng.random(len(x)) < 0.6
    cells = [
        np.stack([x, y, floor], axis=1)[seen & ~wall & ~table & ~ghost],
        np.stack([x, y, floor - 15], axis=1)[ghost & seen],
        np.stack([x, y, floor + 7], axis=1)[table],
        np.stack([x, y, floor + 25], axis=1),
    ]
    cells += [np.stack([x, y, floor + k], axis=1)[wall] for k in range(1, 20)]
    stands = np.stack([x, y], axis=1)[wall | table]
    bare = np.stack([x, y], axis=1)[seen & ~wall & ~table & ~ghost]
    return space(np.unique(np.concatenate(cells), axis=0)), stands, bare


@pytest.mark.parametrize("tilt", [0.0, 2.0, 5.0, -8.0])
def test_a_tilted_hall(tilt: float) -> None:
    grid, stands, bare = world(math.radians(tilt))
    # Free space above the floor, so that its columns are seen in the band.
    plane = project(grid, 0.3, 2.2, ground="relative")
    state = plane.state()
    at = tuple((stands + 100).T[::-1])
    assert (state[at] == State.OCCUPIED).mean() == 1.0
    assert not plane.observed[tuple((bare + 100).T[::-1])].any(), "the floor is an obstacle"
    if abs(tilt) >= 5.0:
        flat = project(grid, 0.3, 2.2)
        assert flat.observed[tuple((bare + 100).T[::-1])].any(), "this world is not tilted enough"


def test_the_plane_is_found_far_from_the_origin() -> None:
    grid, _, _ = world(math.radians(4.0))
    index, p = grid.log_odds().cells()
    occupied = index[p > 0.5]
    shift = np.array([5_000_000, 50_000_000, 900])
    near, far = fit_ground(occupied, R), fit_ground(occupied + shift, R)
    rise = math.tan(math.radians(4.0))
    assert near.slope_x == pytest.approx(rise * math.cos(0.7), abs=2e-3)
    assert near.slope_y == pytest.approx(rise * math.sin(0.7), abs=2e-3)
    assert near.height == pytest.approx(0.05, abs=0.03)  # centres of the floor's cells
    moved = far.at(500_000.0 + 3.0, 5_000_000.0 - 2.0) - 90.0
    assert moved == pytest.approx(float(near.at(3.0, -2.0)), abs=0.02)


@pytest.mark.parametrize(
    ("index", "height"),
    [
        ([[7, 9, 3]], 0.35),
        ([[x, 0, 3] for x in range(50)], 0.35),
        ([[x, 0, z] for x in range(50) for z in range(3, 30)], 0.35),
        ([[x, x, x] for x in range(30)], None),
    ],
)
def test_few_cells_still_give_a_plane(index: list[list[int]], height: float | None) -> None:
    plane = fit_ground(np.array(index), R)
    centres = (np.array(index) + 0.5) * R
    if height is None:
        assert plane.at(centres[:, 0], centres[:, 1]) == pytest.approx(centres[:, 2], abs=0.3)
    else:
        assert (plane.height, plane.slope_x, plane.slope_y) == pytest.approx((height, 0.0, 0.0))


def test_most_of_the_ground_may_be_out_of_sight() -> None:
    # Roofs of 3 to 6 m over two thirds of the patches, ghosts below a tenth.
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(-15, 15), np.arange(-15, 15))
    kind = rng.random(x.shape)
    z = np.where(kind < 0.65, rng.integers(30, 60, x.shape), np.where(kind > 0.9, -20, 0)) + x
    index = np.stack([10 * x, 10 * y, z], axis=-1).reshape(-1, 3)
    plane = fit_ground(index, R)
    assert plane.slope_x == pytest.approx(0.1, abs=1e-3)
    assert plane.slope_y == pytest.approx(0.0, abs=1e-3)
    assert plane.height == pytest.approx(0.045, abs=0.02)


def test_ground_of_ones_own() -> None:
    grid = space([[x, 0, x * x // 10 + 5] for x in range(30)])
    hill = project(grid, 0.4, 0.6, ground=lambda x, y: (x - R / 2) ** 2 + 0.0 * y)
    assert hill.observed.all()
    known = project(grid, 0.4, 0.6, ground=GroundPlane(0.1))
    assert np.array_equal(known.observed, project(grid, 0.5, 0.7).observed)


def test_senseless_requests() -> None:
    grid = space([], [[0, 0, 0]])
    with pytest.raises(ConfigError, match="z_min < z_max"):
        project(grid, 1.0, 1.0)
    with pytest.raises(InputError, match="no cell is occupied"):
        project(grid, 0.0, 1.0, ground="relative")
    with pytest.raises(ConfigError, match="ground is None"):
        project(grid, 0.0, 1.0, ground="flat")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="2D already"):
        project(EvidenceMap(R), 0.0, 1.0)
    with pytest.raises(oddsmap.MapTooLargeError, match="crop the map"):
        project(space([[0, 0, 0], [10**6, 10**6, 0]]), 0.0, 1.0)
    assert project(EvidenceMap(R, ndim=3), 0.0, 1.0).probability.shape == (0, 0)
