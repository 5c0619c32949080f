# SPDX-License-Identifier: Apache-2.0
"""Evidence between processes: pickle and copy keep every bit, and share nothing."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.evidence import packed_tiles, tiles
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import TileStore
from oddsmap.evidence_map import EvidenceMap, build_map
from oddsmap.kernels.units import ONE
from oddsmap.sensors.beam import BeamSensor
from tests.kit import add_votes, fan_scan, votes_of

SCANS = [fan_scan(0.3 * i, 0.1, 0.2 * i, np.linspace(1.0, 6.0, 40).tolist()) for i in range(8)]
WAYS: list[Callable[[Evidence], Evidence]] = [
    lambda grid: pickle.loads(pickle.dumps(grid)),
    copy.deepcopy,
]


def some_map() -> EvidenceMap:
    return build_map(SCANS, 0.1, votes="beam", sensor=BeamSensor(fade=0.3), path_lengths=True)


@pytest.mark.parametrize("way", WAYS)
def test_every_bit_arrives(way: Callable[[Evidence], Evidence]) -> None:
    grid = some_map()
    other = way(grid)
    assert type(other) is EvidenceMap
    assert votes_of(other) == votes_of(grid)
    for here, there in zip(other.cell_lengths(), grid.cell_lengths(), strict=True):
        assert np.array_equal(here, there)
    assert other.config == grid.config
    assert other.provenance == grid.provenance
    other.merge(grid)
    grid.merge(some_map())
    assert votes_of(other) == votes_of(grid), "it can be added to"


@pytest.mark.parametrize("way", WAYS)
def test_nothing_is_shared(way: Callable[[Evidence], Evidence]) -> None:
    grid = some_map()
    before, notes = votes_of(grid), len(grid.provenance)
    other = way(grid)
    other.add_cells(np.array([[3, 0]]), np.array([ONE]), np.array([0]))
    other.record("x.log", scans=1)
    assert votes_of(grid) == before
    assert len(grid.provenance) == notes


def test_an_empty_map_and_one_that_grows() -> None:
    for size in (0, 1, 40):
        grid = EvidenceMap(0.1, ndim=3)
        index = np.arange(3 * size).reshape(-1, 3) * 100
        grid.add_cells(index, np.full(size, ONE), np.zeros(size, np.int64))
        other = pickle.loads(pickle.dumps(grid))
        assert votes_of(other) == votes_of(grid)
        other.add_cells(index + 7, np.full(size, 2 * ONE), np.zeros(size, np.int64))
        assert other.cell_count() == 2 * size


def test_a_pickle_is_about_as_small_as_the_saved_map(tmp_path: Path) -> None:
    """Spare rows do not travel, and what does is packed."""
    grid = some_map()
    assert grid.tiles.arrays.narrow.shape[0] > 2 * grid.tiles.count
    grid.save(tmp_path / "map.zarr")
    arrays = [tmp_path / "map.zarr" / name for name in ("hits", "passes", "lengths")]
    saved = sum(file.stat().st_size for array in arrays for file in (array / "c").rglob("*/*"))
    assert len(pickle.dumps(grid)) < 1.5 * saved + 4000 < grid.nbytes


WEIGHTS = st.sampled_from([0, ONE, 2 * ONE, 255 * ONE, 256 * ONE, 1, ONE + 1, 2**60])
PLACES = st.integers(-40, 40) | st.sampled_from([-(2**45), -(10**9), 2**33, 2**45 - 1])


@settings(max_examples=60, deadline=None)
@given(st.data(), st.sampled_from([(2, 1), (2, 5), (2, 32), (3, 8)]))
def test_any_cells_arrive(data: st.DataObject, shape: tuple[int, int]) -> None:
    ndim, side = shape
    cells = st.dictionaries(
        st.tuples(*[PLACES] * ndim), st.tuples(WEIGHTS, WEIGHTS).filter(any), max_size=12
    )
    votes = data.draw(cells)
    grid = Evidence(0.5, ndim=ndim, tile_side=side)
    add_votes(grid, votes)
    content = pickle.dumps(grid)
    other = pickle.loads(content)
    assert votes_of(other) == votes_of(grid) == votes
    assert pickle.dumps(other) == content, "what is the same is packed the same"
    add_votes(other, {(3,) * ndim: (ONE, 0)})
    assert votes_of(grid) == votes, "nothing is shared"


def test_many_tiles_go_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed_tiles, "_WEIGHTS", 2 * 8**2)
    grid = EvidenceMap(0.1, tile_side=8)
    for i in range(20):
        add_votes(grid, {(8 * i, 5): (ONE, (1 + 20 * i) * ONE)})
    assert grid.tiles.count == 20
    assert len(grid.tiles.__getstate__()["parts"]) == 5 + 2 * 10 + 2 * 4
    assert votes_of(pickle.loads(pickle.dumps(grid))) == votes_of(grid)


def test_copies_are_not_packed(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = some_map()
    monkeypatch.setattr(tiles, "pack_tiles", None)
    twin = copy.deepcopy(grid)
    assert votes_of(twin) == votes_of(grid)
    copy.copy(grid.tiles).clear()
    assert votes_of(twin) == votes_of(grid)


def test_pickles_of_another_version_are_refused() -> None:
    grid = some_map()
    state = grid.tiles.__getstate__()
    for other, version in ({**state, "version": 3}, "3"), ({"ndim": 2, "narrow": b""}, "1"):
        with pytest.raises(InputError, match=rf"another version .* way {version}, "):
            TileStore.__new__(TileStore).__setstate__(other)


def test_a_damaged_pickle_is_one_line() -> None:
    """A byte of what is packed that another takes the place of, or that is missing, is noticed."""
    state = some_map().tiles.__getstate__()
    whole: list[Any] = state["parts"]
    rng = np.random.default_rng(4)
    for number, part in enumerate(whole):
        for at in {0, 3, 4, 5, 6, 7, len(part) - 1, *rng.integers(len(part), size=60).tolist()}:
            flipped = part[:at] + bytes([part[at] ^ (1 << rng.integers(8))]) + part[at + 1 :]
            for damaged in (flipped, part[:at]):
                parts = [*whole[:number], damaged, *whole[number + 1 :]]
                arrived = _arrived({**state, "parts": parts})
                # Some bits of a frame mean nothing.
                assert arrived is None or arrived.__getstate__() == state
    others: list[Any] = [whole[:-1], whole[1:], [], None, [*whole, 5], [*whole[:-1], "x"]]
    for parts in others:
        assert _arrived({**state, "parts": parts}) is None


def _arrived(state: dict[str, Any]) -> TileStore | None:
    found = TileStore.__new__(TileStore)
    try:
        found.__setstate__(state)
    except InputError as error:
        said = str(error)
    else:
        return found
    assert said.startswith("a pickled map is damaged, send it again: ")
    assert "\n" not in said
    return None
