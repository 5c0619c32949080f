# SPDX-License-Identifier: Apache-2.0
"""Maps of probabilities as the page takes them: each a sheet, alone or beside a map of counts.

A sheet is laid out as a map of counts is, so that one program reads and draws both: in the place of
hits stand the numbers of `oddsmap.viewer.probability_codes`, in that of passes nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.viewer.given import Given, box_of, check_beside
from oddsmap.viewer.layout import MOST_VOXELS, TILE, check_box, check_span, voxel_steps
from oddsmap.viewer.payload import BytePlanes, packed, payload_of
from oddsmap.viewer.probability_codes import codes_of

__all__ = ["Sheets", "given_payload", "sheets_of"]


# Nothing cuts or coarsens maps of probabilities.
_REMEDY = "show a map of a part of it, or a coarser one"


class Sheets(NamedTuple):
    """What maps of probabilities add to a payload."""

    facts: list[dict[str, Any]]
    """Of each map, for `given` of the page's facts."""
    arrays: list[BytePlanes]


def given_payload(maps: Sequence[Given], **more: Any) -> bytes:
    """The payload of maps without counts.

    Args:
        maps: at least one; the first one says what the page is called.
        more: facts, plain values for JSON.

    Raises:
        InputError: one is too wide or too full for the page, or lies on other cells than the first.
    """
    first = maps[0]
    lo, hi = box_of(first.name, first.bounds, maps[1:])
    facts = {"kind": "plane" if first.ndim == 2 else "space", **first.page_facts((lo, hi))}
    if first.ndim == 2:
        facts["tile"] = TILE
    sheets = sheets_of(maps, facts)
    return payload_of({**facts, "given": sheets.facts, **more}, sheets.arrays)


def sheets_of(maps: Sequence[Given], facts: dict[str, Any]) -> Sheets:
    """Maps of probabilities as they go beside whatever has such facts.

    Args:
        maps: none, or some.
        facts: of the page, with its box.

    Raises:
        InputError: as `given_payload`.
    """
    ndim = len(facts["lo"])
    sheets = Sheets([], [])
    for i, given in enumerate(maps):
        check_beside(facts, given)
        prefix = f"given{i}."
        codes, values = codes_of(given.probability)
        add = _add_plane if ndim == 2 else _add_space
        own = add(given, codes.astype(np.int64), prefix, facts, sheets.arrays, codes.itemsize)
        if values is not None:
            halves = values.astype("<f8").view("<u4").reshape(-1, 2)
            for j, half in enumerate(("low", "high")):
                sheets.arrays.append(packed(f"{prefix}{half}", halves[:, j], np.uint32))
        listed = None if values is None else len(values)
        sheets.facts.append(given.facts(bytes=codes.itemsize, listed=listed, **own))
    return sheets


def _add_plane(
    given: Given, codes: IntArray, prefix: str, facts: dict[str, Any], arrays: list[BytePlanes],
    size: int,
) -> dict[str, Any]:  # fmt: skip
    """Add the tiles of a 2D map, row by row; what the page is told of them."""
    place = given.cells // TILE
    first = place.min(axis=0)
    check_span(place.max(axis=0) - first + 1, given.resolution, given.name, _REMEDY)
    columns, rows = (place.max(axis=0) - first + 1).tolist()
    flat = (place - first) @ np.array([1, columns])
    there = np.zeros(columns * rows, np.bool_)
    there[flat] = True
    number, tile = np.flatnonzero(there), (np.cumsum(there) - 1)[flat]
    within = given.cells - place * TILE
    cells = np.zeros((len(number), TILE, TILE), f"u{size}")
    cells[tile, within[:, 1], within[:, 0]] = codes
    coords = np.stack([number % columns, number // columns], axis=1)
    arrays += [
        packed(f"{prefix}coords", coords, np.uint32),
        packed(f"{prefix}hits", cells, cells.dtype),
        packed(f"{prefix}passes", np.zeros_like(cells), cells.dtype),
    ]
    return {"tiles": len(number), "first_cell": (first * TILE).tolist()}


def _add_space(
    given: Given, codes: IntArray, prefix: str, facts: dict[str, Any], arrays: list[BytePlanes],
    size: int,
) -> dict[str, Any]:  # fmt: skip
    """Add the voxels of a 3D map; what the page is told of them."""
    lo, hi = (np.array(facts[end]) for end in ("lo", "hi"))
    check_box(lo, hi, given.resolution, given.name, _REMEDY)
    if not 0 < len(codes) <= MOST_VOXELS:
        raise InputError(
            f"{given.name}: no voxel of the map may be occupied, nothing to show"
            if len(codes) == 0
            else f"{given.name}: {len(codes):,} voxels that may be occupied, the page shows up to "
            f"{MOST_VOXELS:,}; {_REMEDY}"
        )
    order = np.lexsort(given.cells.T)
    steps = voxel_steps(given.cells[order], lo)
    dtype = f"u{size}"
    arrays += [packed(f"{prefix}{axis}", steps[:, i], np.uint16) for i, axis in enumerate("xyz")]
    arrays.append(packed(f"{prefix}hits", codes[order], dtype))
    arrays.append(packed(f"{prefix}passes", np.zeros(len(codes), dtype), dtype))
    return {"voxels": len(codes)}
