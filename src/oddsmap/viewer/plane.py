# SPDX-License-Identifier: Apache-2.0
"""A 2D map of evidence as the page takes it: counts in square tiles, and what views start from.

The page makes every posterior itself, so that all it needs is hits and passes. It also makes the
coarser levels that are shown from afar, which are sums of these counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.viewer.facts import census_of, facts_of, packing_of
from oddsmap.viewer.given import Given, box_of
from oddsmap.viewer.given_sheets import sheets_of
from oddsmap.viewer.layout import TILE, check_span
from oddsmap.viewer.payload import BytePlanes, payload_of

__all__ = ["plane_payload"]

# Of maps of counts.
_REMEDY = "show a part (oddsmap crop) or a coarser map (oddsmap resample)"


def plane_payload(
    evidence: Evidence, name: str, beside: Sequence[Given] = (), **more: Any
) -> bytes:
    """The payload of a 2D map.

    Args:
        evidence: the map, with some evidence.
        name: of its file, for the title and for commands that the page writes.
        beside: maps of probabilities of the same cells.
        more: facts, plain values for JSON.

    Raises:
        InputError: a 3D map, one without evidence, or one too wide for the page; one beside it has
            other cells.
    """
    if evidence.ndim != 2:
        raise InputError(f"{name}: the page of a plane needs a 2D map, this one is 3D")
    census, bounds = census_of(evidence, name)
    packing = packing_of(census)
    places = _places(evidence)
    first = places.min(axis=0)
    check_span(places.max(axis=0) - first + 1, evidence.resolution, name, _REMEDY)
    coords = BytePlanes("coords", np.uint32)
    hits, passes = (BytePlanes(kind, packing.dtype) for kind in ("hits", "passes"))
    tiles = 0
    for place in places:
        units = evidence.tiles.region(place * TILE, (place + 1) * TILE)
        if not units.any():
            continue
        counts = packing.counts(units)
        coords.append(place - first)
        hits.append(counts[0])
        passes.append(counts[1])
        tiles += 1
    facts = {
        "kind": "plane",
        "tile": TILE,
        "tiles": tiles,
        "first_cell": (first * TILE).tolist(),
        **facts_of(evidence, name, packing, census.cells, box_of(name, bounds, beside)),
    }
    sheets = sheets_of(beside, facts)
    arrays = [coords, hits, passes, *sheets.arrays]
    return payload_of({**facts, "given": sheets.facts, **more}, arrays)


def _places(evidence: Evidence) -> IntArray:
    """The tiles of the page that hold evidence, shape (n, 2), row by row."""
    side = evidence.tiles.side
    lowest, highest = (evidence.tiles.coords + step for step in (0, 1))
    first, last = lowest * side // TILE, (highest * side - 1) // TILE
    # A tile of the map may lie across several of the page's, where its side does not divide theirs.
    spans = [
        np.stack(np.meshgrid(np.arange(a[0], b[0] + 1), np.arange(a[1], b[1] + 1)), -1)
        for a, b in np.unique(np.stack([first, last], axis=1), axis=0)
    ]
    places = np.unique(np.concatenate([span.reshape(-1, 2) for span in spans]), axis=0)
    return np.asarray(places[np.lexsort(places.T)], np.int64)
