# SPDX-License-Identifier: Apache-2.0
"""What the page gets of maps of probabilities: every cell in its place, p within 1e-5."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap, FullMap, FullMapConfig, ProbabilityMap, VoxelMap
from oddsmap.config.config import Config, MapConfig
from oddsmap.errors import InputError
from oddsmap.limits import TILE_SIDE
from oddsmap.odds import sigmoid
from oddsmap.viewer.given import given_of
from oddsmap.viewer.given_sheets import given_payload
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload
from oddsmap.viewer.text import text_of
from tests.saved_maps_kit import full_map
from tests.viewer.payload_kit import cells_of, parts_of, probabilities_of

CLOSE = 1e-5
chance = st.floats(0, 1)
near = st.integers(-300, 300)


def ros_map(shape: tuple[int, int], seed: int, *, values: int) -> ProbabilityMap:
    rng = np.random.default_rng(seed)
    p = rng.permutation(np.linspace(0, 1, values))[rng.integers(0, values, shape)]
    observed = rng.random(shape) < 0.5
    observed[0, 0] = True
    return ProbabilityMap(p, observed, 0.05, (-3.1, 12.35))


@settings(max_examples=10)
@given(
    st.integers(1, 150), st.integers(1, 150), st.integers(0, 99), st.sampled_from([3, 256, 70_000])
)
def test_each_cell_of_a_ros_map(rows: int, columns: int, seed: int, values: int) -> None:
    view = ros_map((rows, columns), seed, values=values)
    payload = given_payload([given_of(view, "m.yaml")])
    found = probabilities_of(payload)
    y, x = np.nonzero(view.observed)
    # The origin is a corner of the cells that count from that of the world.
    assert parts_of(payload)[0]["corner"] == [0.0, 0.0]
    want = {(int(i) - 62, int(j) + 247): view.probability[j, i] for i, j in zip(x, y, strict=True)}
    assert found == pytest.approx(want, rel=0, abs=CLOSE)
    if values == 3:
        assert found == want, "values that repeat are kept as they are"


@settings(max_examples=20)
@given(st.lists(chance | st.floats(-60, 60).map(lambda x: float(sigmoid(x))), min_size=1))
def test_any_probability_is_kept(values: list[float]) -> None:
    # Among so many others that they are not listed.
    p = np.array([*values, *np.linspace(0, 1, 300)])[None]
    view = ProbabilityMap(p, np.ones(p.shape, np.bool_), 1.0)
    payload = given_payload([given_of(view, "m")])
    found = probabilities_of(payload)
    assert parts_of(payload)[0]["given"][0]["listed"] is None
    for x, want in enumerate(p[0]):
        got = found[x, 0]
        assert got == pytest.approx(want, rel=0, abs=CLOSE)
        if 1e-16 < want < 0.5:
            assert math.log(got) == pytest.approx(math.log(want), abs=0.01)


@settings(max_examples=10)
@given(
    st.dictionaries(st.tuples(near, near, near), st.floats(-9, 9), min_size=1, max_size=9),
    st.sampled_from([0, 54_000_000, -54_000_000]),
    st.integers(0, 2),
)
def test_each_leaf_of_an_octomap_that_may_be_occupied(
    cells: dict[tuple[int, int, int], float], far: int, level: int
) -> None:
    side = 1 << level
    index = np.array(list(cells), np.int64) * 4 + np.array([far, -far, 0])
    view = VoxelMap(index, np.array(list(cells.values())), 0.1, np.full(len(cells), level))
    listed, p = view.cells()
    want = {tuple(at): q for at, q in zip(listed.tolist(), p, strict=True) if q > 0.196}
    if not want:
        with pytest.raises(InputError, match=r"^m\.bt: no voxel of the map may be occupied"):
            given_payload([given_of(view, "m.bt")])
        return
    payload = given_payload([given_of(view, "m.bt")])
    assert probabilities_of(payload) == pytest.approx(want, rel=0, abs=CLOSE)
    facts, _ = parts_of(payload)
    assert (facts["kind"], facts["cells"]) == ("space", len(cells) * side**3)
    lo, hi = view.bounds() or (None, None)
    assert (facts["lo"], facts["hi"]) == (np.array(lo).tolist(), np.array(hi).tolist())


def space_full_map() -> FullMap:
    rng, side = np.random.default_rng(0), TILE_SIDE[3]
    blocks = np.array([[0, 0, 0], [2, -1, 0]])
    values = rng.normal(0.0, 3.0, (2, side**3)).astype(np.float32)
    marks = rng.integers(0, 3, values.shape).astype(np.uint8)
    config = Config(map=MapConfig(resolution=0.1))
    return FullMap(config, blocks, values, marks, sweeps=3, residual=0.5)


@pytest.mark.parametrize("view", [full_map(1), space_full_map()], ids=["2D", "3D"])
def test_each_cell_of_a_full_map_that_beams_reached(view: FullMap) -> None:
    index, p = view.cells()
    payload = given_payload([given_of(view, "full.zarr")])
    kept = p > (0.196 if view.ndim == 3 else -1)
    want = dict(zip(map(tuple, index[kept].tolist()), p[kept], strict=True))
    found = probabilities_of(payload)
    assert found.keys() == want.keys()
    assert found == pytest.approx(want, rel=0, abs=CLOSE)
    facts, _ = parts_of(payload)
    assert facts["cells"] == len(index)
    assert (facts["given"][0]["what"], facts["counts"]) == ("full map", False)


def test_values_that_are_no_marginals_are_called_so() -> None:
    view = full_map(1)
    view.config = Config(map=MapConfig(resolution=0.1), full_map=FullMapConfig(method="map"))
    assert "no marginals" in given_of(view, "m").what


def test_a_map_beside_counts() -> None:
    full, grid = full_map(0), EvidenceMap(0.1)
    grid.add_cells(np.array([[7, -9], [9000, 5]]), np.array([1, 2]), np.array([0, 5]))
    payload = plane_payload(grid, "m.zarr", [given_of(full, "full.zarr")])
    assert cells_of(payload) == cells_of(plane_payload(grid, "m.zarr"))
    assert probabilities_of(payload) == probabilities_of(
        given_payload([given_of(full, "full.zarr")])
    )
    facts, _ = parts_of(payload)
    lo, hi = full.bounds() or (None, None)
    assert facts["hi"] == [9001, max(6, hi[1])]  # type: ignore[index]
    assert facts["lo"] == [min(7, lo[0]), min(-9, lo[1])]  # type: ignore[index]
    assert (facts["name"], facts["given"][0]["name"]) == ("m.zarr", "full.zarr")


def test_two_maps_in_space_count_from_one_cell() -> None:
    full, grid = space_full_map(), EvidenceMap(0.1, ndim=3)
    grid.add_cells(np.array([[-50, 0, 0]]), np.array([1]), np.array([0]))
    payload = space_payload(grid, "m.zarr", [given_of(full, "full.zarr", above=0.4)])
    want = dict(zip(map(tuple, full.cells()[0].tolist()), full.cells()[1], strict=True))
    want = {at: p for at, p in want.items() if p > 0.4}
    assert probabilities_of(payload) == pytest.approx(want, rel=0, abs=CLOSE)
    assert parts_of(payload)[0]["lo"][0] == -50


def test_where_a_ros_map_lies() -> None:
    view = ros_map((4, 4), 0, values=3)
    for origin, yaw, first, corner in (
        ((-3.1, 12.35), 0.0, (-62, 247), (0.0, 0.0)),
        ((-3.08, 12.35), 0.0, (-62, 247), (0.02, 0.0)),
        ((-3.1, 12.35), 0.3, (0, 0), (-3.1, 12.35)),
    ):
        moved = dataclasses.replace(view, origin=origin, yaw=yaw)
        facts, _ = parts_of(given_payload([given_of(moved, "m.yaml")]))
        assert facts["corner"] == pytest.approx(corner)
        assert facts["yaw"] == yaw
        assert min(probabilities_of(given_payload([given_of(moved, "m.yaml")]))) == first


def test_what_cannot_be_shown_or_not_together() -> None:
    grid = EvidenceMap(0.05)
    grid.add_cells(np.array([[0, 0]]), np.array([1]), np.array([0]))
    view = ros_map((4, 4), 0, values=3)
    for other, said in (
        (dataclasses.replace(view, resolution=0.1), r"b: cells of 0\.1 m, those of a have 0\.05 m"),
        (dataclasses.replace(view, yaw=0.1), "b: its cells lie between those of a, or are turned"),
        (dataclasses.replace(view, origin=(0.01, 0.0)), "b: its cells lie between those of a"),
        (space_full_map(), "b: a 3D map, which cannot be shown beside a, a 2D one"),
    ):
        with pytest.raises(InputError, match=f"^{said}"):
            plane_payload(grid, "a", [given_of(other, "b")])
    unknown = dataclasses.replace(view, observed=np.zeros((4, 4), np.bool_))
    with pytest.raises(InputError, match=r"^b: no cell of the map is known, nothing to show$"):
        given_of(unknown, "b")
    wide = VoxelMap(np.array([[0, 0, 0], [70_000, 0, 0]]), np.ones(2), 0.1)
    with pytest.raises(InputError, match=r"^b: the page cannot show 7000 x 0\.1 x 0\.1 m at"):
        given_payload([given_of(wide, "b")])
    cube = VoxelMap(np.array([[0, 0, 0]]), np.ones(1), 0.1, np.array([12]))
    with pytest.raises(InputError, match=r"^b: 68,719,476,736 voxels that may be occupied"):
        given_of(cube, "b")


def test_a_payload_is_no_larger_than_the_saved_map(tmp_path: Path) -> None:
    """As it stands in a file to send, within 1.3 of it, also where no two cells are the same."""
    folder = tmp_path / "m.zarr"
    full_map(1).save(folder)
    saved = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
    assert len(text_of(given_payload([given_of(full_map(1), "m.zarr")]))) <= 1.3 * saved
