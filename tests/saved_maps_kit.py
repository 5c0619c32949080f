# SPDX-License-Identifier: Apache-2.0
"""Small maps of each kind to save, and whether two are the same."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from oddsmap import EvidenceMap, load_full_map, load_map
from oddsmap.config.config import Config, MapConfig
from oddsmap.full_map.full_map import FullMap
from oddsmap.limits import TILE_SIDE
from tests.kit import ONE


class Kind(NamedTuple):
    """How a kind of map is made of a number, read, and told from others."""

    make: Callable[[int], Any]
    load: Callable[[Path], Any]
    content: Callable[[Any], tuple[Any, ...]]


def evidence(ndim: int) -> Callable[[int], EvidenceMap]:
    def make(seed: int) -> EvidenceMap:
        rng = np.random.default_rng(seed)
        grid = EvidenceMap(0.1, ndim=ndim, votes="beam")
        # Elsewhere for each: another origin, and another number of shards.
        index = np.unique(rng.integers(0, 300 if ndim == 2 else 60, (400, ndim)), axis=0)
        index[:, 0] += (seed % 2) * 5090
        grid.add_cells(index, *(rng.integers(1, 9, (2, len(index))) * ONE))
        grid.record(f"{seed}.log", scans=seed)
        return grid

    return make


def full_map(seed: int) -> FullMap:
    rng, side = np.random.default_rng(seed), TILE_SIDE[2]
    blocks = np.unique(rng.integers(-5, 5, (6, 2)), axis=0) + (seed % 2) * 500
    values = rng.normal(0.0, 3.0, (len(blocks), side**2)).astype(np.float32)
    marks = rng.integers(0, 3, values.shape).astype(np.uint8)
    grid = FullMap(
        Config(map=MapConfig(resolution=0.1)), blocks, values, marks, sweeps=3, residual=0.5
    )
    grid.provenance = [{"source": "sonar.log", "scans": seed}]
    return grid


def of_evidence(grid: EvidenceMap) -> tuple[Any, ...]:
    cells = [array.tobytes() for array in grid.cells()]
    return (*cells, json.dumps(grid.config.to_dict()), json.dumps(grid.provenance))


def of_full_map(grid: FullMap) -> tuple[Any, ...]:
    order = np.lexsort(grid.blocks.T)
    cells = [array[order].tobytes() for array in (grid.blocks, grid.values, grid.marks)]
    facts = (grid.sweeps, grid.residual, json.dumps(grid.provenance))
    return (*cells, json.dumps(grid.config.to_dict()), *facts)


KINDS = {
    "2D": Kind(evidence(2), load_map, of_evidence),
    "3D": Kind(evidence(3), load_map, of_evidence),
    "full map": Kind(full_map, load_full_map, of_full_map),
}
