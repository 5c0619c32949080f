# SPDX-License-Identifier: Apache-2.0
"""A 2D map of evidence as the page takes it: counts in square tiles, and what views start from.

The page makes every posterior itself, so that all it needs is hits and passes. It also makes the
coarser levels that are shown from afar, which are sums of these counts.
"""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import ONE
from oddsmap.limits import in_metres
from oddsmap.posterior.calibrated import Calibrated
from oddsmap.posterior.count_model import LOG_MISS, LOG_REFLECT, occupied_at
from oddsmap.viewer.payload import BytePlanes, payload_of

__all__ = ["TILE", "plane_payload"]

TILE = 128
"""Cells along the side of a tile of the page."""

_LARGEST = (1 << 32) - 1
# The page finds a tile in a table of all places of the map's box: 4 bytes for each, and no longer
# along an axis than the textures of any graphics card.
_MOST_PLACES, _LONGEST_SIDE = 1 << 22, 4096


def plane_payload(evidence: Evidence, name: str) -> bytes:
    """The payload of a 2D map.

    Args:
        evidence: the map, with some evidence.
        name: of its file, for the title and for commands that the page writes.

    Raises:
        InputError: a 3D map, one without evidence, or one too wide for the page.
    """
    if evidence.ndim != 2:
        raise InputError(f"{name}: the page of a plane needs a 2D map, this one is 3D")
    census = evidence.tiles.census()
    if census.bounds is None:
        raise InputError(f"{name}: no cell of the map has evidence, nothing to show")
    lo, hi = census.bounds
    # Units of a vote in one count: exact, but where a sum of parts of votes passes 32 bits.
    shift = ONE.bit_length() - 1 if census.whole_votes else 0
    exact = shift
    while census.largest >> shift > _LARGEST:
        shift += 1
    dtype = np.min_scalar_type(census.largest >> shift)
    places = _places(evidence)
    first = places.min(axis=0)
    _check_span(places.max(axis=0) - first + 1, evidence.resolution, name)
    coords = BytePlanes("coords", np.uint32)
    hits, passes = BytePlanes("hits", dtype), BytePlanes("passes", dtype)
    tiles = 0
    for place in places:
        units = evidence.tiles.region(place * TILE, (place + 1) * TILE)
        if not units.any():
            continue
        # What is rounded away must not make a cell unseen.
        counts = np.where(units > 0, np.maximum(units >> shift, 1), 0)
        coords.append(place - first)
        hits.append(counts[0])
        passes.append(counts[1])
        tiles += 1
    facts = {
        "kind": "plane",
        "name": PurePath(name).name,
        "sources": _sources(evidence),
        "resolution": evidence.resolution,
        "tile": TILE,
        "tiles": tiles,
        "first_cell": (first * TILE).tolist(),
        "lo": lo.tolist(),
        "hi": hi.tolist(),
        "cells": census.cells,
        "bytes": dtype.itemsize,
        "unit": float(2.0 ** (shift - (ONE.bit_length() - 1))),
        "rounded": shift != exact,
        "votes": evidence.votes,
        "sensor": evidence.sensor.kind,
        "p_hit": evidence.sensor.p_hit,
        "p_miss": evidence.sensor.p_miss,
        "prior": evidence.config.posterior.prior,
        "free": evidence.config.posterior.thresholds.free,
        "occupied": evidence.config.posterior.thresholds.occupied,
        "calibrated": _model(evidence),
    }
    return payload_of(facts, [coords, hits, passes])


def _check_span(span: IntArray, resolution: float, name: str) -> None:
    columns, rows = span.tolist()
    if columns * rows > _MOST_PLACES or max(columns, rows) > _LONGEST_SIDE:
        width, height = (in_metres(n * TILE * resolution) for n in (columns, rows))
        raise InputError(
            f"{name}: the page cannot show {width} x {height} m at {resolution:g} m; show a part "
            "(oddsmap crop) or a coarser map (oddsmap resample)"
        )


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


def _sources(evidence: Evidence) -> list[dict[str, Any]]:
    """What the map was made of: names of logs with their numbers of scans, where they are known."""
    found = []
    for entry in evidence.provenance:
        source, scans = entry.get("source"), entry.get("scans")
        found.append(
            {
                "source": source if isinstance(source, str) else None,
                "scans": scans if isinstance(scans, int) else None,
            }
        )
    return found


def _model(evidence: Evidence) -> dict[str, Any] | None:
    """What `Calibrated` is fitted to this map; None under wide beams, where counts say little."""
    if evidence.sensor.kind == "cone":
        return None
    fitted = Calibrated(evidence)
    return {
        "log_reflect": LOG_REFLECT.tolist(),
        "log_miss": LOG_MISS.tolist(),
        "occupied": occupied_at().tolist(),
        "distributions": fitted.model.distributions,
        "share": fitted.model.occupied_share,
        "beta": [fitted.reflectivity.a, fitted.reflectivity.b],
    }
