# SPDX-License-Identifier: Apache-2.0
"""Evidence between processes: pickle and copy keep every bit, and share nothing."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pytest

from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence_map import EvidenceMap, build_map
from oddsmap.kernels.units import ONE
from oddsmap.sensors.beam import BeamSensor
from tests.kit import fan_scan, votes_of

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


def test_a_pickle_holds_what_is_used() -> None:
    """Tiles are taken by the many; what is not used yet does not travel."""
    grid = some_map()
    assert grid.tiles.arrays.narrow.shape[0] > 2 * grid.tiles.count
    assert len(pickle.dumps(grid)) < grid.nbytes + 10_000
