# SPDX-License-Identifier: Apache-2.0
"""A 3D map of evidence as the page takes it: the voxels with hits, one by one, and the air.

Passes only lower a probability: a voxel without a hit is occupied only where the prior (or the
lowest probability of a clamp) already is. So the page draws those with hits, unpacks the others
when they are asked for (`oddsmap.viewer.air`), and says so where it leaves out occupied ones, for
which it gets `unhit`, the fewest passes of such a voxel.

Voxels that others bury are sent: under another threshold, or cut open by a clip box, they show.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import ONE
from oddsmap.viewer.air import Air
from oddsmap.viewer.facts import census_of, facts_of, packing_of
from oddsmap.viewer.given import Given, box_of
from oddsmap.viewer.given_sheets import sheets_of
from oddsmap.viewer.layout import MOST_VOXELS, check_box, voxel_steps
from oddsmap.viewer.payload import packed, payload_of

__all__ = ["space_payload"]

# Of maps of counts.
_REMEDY = "show a part (oddsmap crop) or a coarser map (oddsmap resample)"


def space_payload(
    evidence: Evidence, name: str, beside: Sequence[Given] = (), **more: Any
) -> bytes:
    """The payload of a 3D map.

    Args:
        evidence: the map, with some evidence.
        name: of its file, for the title and for commands that the page writes.
        beside: maps of probabilities of the same voxels.
        more: facts, plain values for JSON.

    Raises:
        InputError: a 2D map, one without a hit, or one too wide or too full for the page; one
            beside it has other voxels.
    """
    if evidence.ndim != 3:
        raise InputError(f"{name}: the page of voxels needs a 3D map, this one is 2D")
    census, bounds = census_of(evidence, name)
    packing = packing_of(census)
    lo, hi = bounds = box_of(name, bounds, beside)
    check_box(lo, hi, evidence.resolution, name, _REMEDY)
    air = Air(lo, hi, packing)
    index, hits, passes, unhit = _hit_voxels(evidence, air)
    if not 0 < len(index) <= MOST_VOXELS:
        raise InputError(
            f"{name}: no voxel of the map has a hit, nothing to show"
            if len(index) == 0
            else f"{name}: {len(index):,} voxels with hits, the page shows up to {MOST_VOXELS:,}; "
            + _REMEDY
        )
    steps = voxel_steps(index, lo)
    arrays = [packed(axis, steps[:, i], np.uint16) for i, axis in enumerate("xyz")]
    for kind, units in (("hits", hits), ("passes", passes)):
        arrays.append(packed(kind, packing.counts(units), packing.dtype))
    facts = {
        "kind": "space",
        "voxels": len(index),
        "unhit": None if unhit is None else unhit / ONE,
        "air": air.facts(),
        **facts_of(evidence, name, packing, census.cells, bounds),
    }
    sheets = sheets_of(beside, facts)
    facts |= {"given": sheets.facts, **more}
    return payload_of(facts, arrays + air.arrays() + sheets.arrays)


def _hit_voxels(evidence: Evidence, air: Air) -> tuple[IntArray, IntArray, IntArray, int | None]:
    """The voxels with hits, x changing fastest; those without go into the air.

    Returns:
        index, shape (n, 3); hits and passes [units]; the fewest passes [units] of a voxel without
        hits, None where there is none.
    """
    kept: list[tuple[IntArray, IntArray, IntArray]] = []
    unhit: int | None = None
    for index, hits, passes in evidence.tiles.parts():
        hit = hits > 0
        if not hit.all():
            fewest = int(passes[~hit].min())
            unhit = fewest if unhit is None else min(unhit, fewest)
            air.append(index[~hit], passes[~hit])
        kept.append((index[hit], hits[hit], passes[hit]))
    index, hits, passes = (np.concatenate(part) for part in zip(*kept, strict=True))
    return index, hits, passes, unhit
