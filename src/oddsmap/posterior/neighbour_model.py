# SPDX-License-Identifier: Apache-2.0
"""What cells are like, by what lies around them.

Each class of cells (`neighbour_codes`) has distributions of its own: of reflectivities, for what is
occupied (`count_model`), and the Beta prior of the reflectivity itself. They are fitted to the
counts of the class's cells, by the same maximisation as those of the whole map. Where it has few,
they are near those of all classes with as many hits around, and these near those of the map. A cell
that no beam entered has what its class has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.evidence.evidence import Evidence
from oddsmap.posterior.count_fit import fit_beta, fit_model
from oddsmap.posterior.count_model import CountModel
from oddsmap.posterior.count_pairs import CountPairs, PairCounter, few_pairs
from oddsmap.posterior.neighbour_codes import Codes, TileCodes, class_count, row_count

__all__ = ["NeighbourModel", "fit_neighbours", "pairs_of_classes"]

# A class is fitted to no more pairs of counts than this.
_FEW_PAIRS = 2000
# Tiles that are looked at together: half a million cells in space, a million in the plane.
_TILES = 1024


@dataclass(frozen=True, slots=True)
class NeighbourModel:
    """What cells of each class are like.

    Args:
        occupancy: their reflectivities, and so which are occupied; the first is the whole map's.
        reflectivity: the weights of hits and of passes of the Beta prior, likewise.
    """

    occupancy: tuple[CountModel, ...]
    reflectivity: tuple[tuple[float, float], ...]


def fit_neighbours(
    evidence: Evidence, occupancy: CountModel, reflectivity: tuple[float, float]
) -> NeighbourModel:
    """Fit a model to a map's counts; the same counts give the same model.

    Args:
        evidence: the map.
        occupancy: what was fitted to all of its cells.
        reflectivity: likewise.
    """
    pairs = pairs_of_classes(evidence)
    columns = len(pairs) // row_count()
    models, betas = [occupancy], [reflectivity]
    for row in range(row_count()):
        those = pairs[row * columns : (row + 1) * columns]
        model, beta = _fitted(_all_of(those), occupancy, reflectivity)
        for one in those:
            found = _fitted(one, model, beta)
            models.append(found[0])
            betas.append(found[1])
    return NeighbourModel(tuple(models), tuple(betas))


def _fitted(
    pairs: CountPairs, model: CountModel, beta: tuple[float, float]
) -> tuple[CountModel, tuple[float, float]]:
    if len(pairs.cells) == 0:
        return model, beta
    few = few_pairs(pairs, _FEW_PAIRS)
    return fit_model(few, model), fit_beta(few, beta)


def pairs_of_classes(evidence: Evidence) -> list[CountPairs]:
    """The counts of the cells of each class, but those around which nothing was seen."""
    from oddsmap.kernels.vote.pair_table import tabulate_classes

    found = [PairCounter() for _ in range(class_count(evidence.ndim) + 1)]
    tiles, codes = evidence.tiles, TileCodes(evidence.tiles)
    table = np.zeros((len(found), 1 << 16), np.int64)  # of whole votes below 256
    for first in range(0, tiles.count, _TILES):
        code = codes.of_tiles(tiles.coords[first : first + _TILES])
        tabulate_classes(tiles.arrays, first, code, table)
        wide = np.flatnonzero(tiles.arrays.wide_of[first : first + len(code)] >= 0)
        _add_cells(found, code[wide], tiles.units(first + wide))
    for one, row in zip(found, table, strict=True):
        one.add_table(row)
    return [one.pairs() for one in found[1:]]


def _add_cells(found: Sequence[PairCounter], code: Codes, units: IntArray) -> None:
    """Add tiles' cells, shapes (n, cells of a tile) and (n, 2, cells), to those of their class."""
    known = units.any(axis=1)
    code, hits, passes = code[known], units[:, 0][known], units[:, 1][known]
    for which in np.unique(code):
        chosen = code == which
        found[which].add(hits[chosen], passes[chosen])


def _all_of(parts: Sequence[CountPairs]) -> CountPairs:
    return CountPairs(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("hits", "passes", "cells"))
    )
