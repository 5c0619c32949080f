# SPDX-License-Identifier: Apache-2.0
"""What the page is told of any map of evidence, flat or not, and how its counts are packed."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.tiles import Census
from oddsmap.kernels.units import ONE
from oddsmap.posterior.calibrated import Calibrated
from oddsmap.posterior.count_model import LOG_MISS, LOG_REFLECT, occupied_at

__all__ = ["Packing", "census_of", "facts_of", "packing_of", "sources_of"]

_LARGEST = (1 << 32) - 1


class Packing(NamedTuple):
    """How units of a vote become the whole numbers that the page gets."""

    shift: int
    """Units in one count, as a power of two."""
    dtype: np.dtype[Any]
    """Of counts."""
    exact: bool
    """Whether nothing is rounded."""

    def counts(self, units: IntArray) -> npt.NDArray[Any]:
        """Counts of units, of any shape; what is rounded away must not make a cell unseen."""
        return np.where(units > 0, np.maximum(units >> self.shift, 1), 0)


def census_of(evidence: Evidence, name: str) -> tuple[Census, tuple[IntArray, IntArray]]:
    """What is in the map, and its box: the first index and one past the last.

    Raises:
        InputError: nothing.
    """
    census = evidence.tiles.census()
    if census.bounds is None:
        raise InputError(f"{name}: no cell of the map has evidence, nothing to show")
    return census, census.bounds


def packing_of(census: Census) -> Packing:
    """Whole votes where all are, else units; coarser where a sum of these passes 32 bits."""
    exact = shift = ONE.bit_length() - 1 if census.whole_votes else 0
    while census.largest >> shift > _LARGEST:
        shift += 1
    return Packing(shift, np.min_scalar_type(census.largest >> shift), shift == exact)


def facts_of(
    evidence: Evidence, name: str, packing: Packing, cells: int, bounds: tuple[IntArray, IntArray]
) -> dict[str, Any]:
    """Plain values for JSON: what the map is and what views of it start from.

    Args:
        evidence: the map.
        name: of its file, for the title and for commands that the page writes.
        packing: of its counts.
        cells: how many have evidence.
        bounds: see `census_of`.
    """
    lo, hi = bounds
    return {
        "counts": True,
        "name": PurePath(name).name,
        "sources": sources_of(evidence.provenance),
        "resolution": evidence.resolution,
        "corner": [0.0, 0.0],
        "yaw": 0.0,
        "lo": lo.tolist(),
        "hi": hi.tolist(),
        "cells": cells,
        "bytes": packing.dtype.itemsize,
        "unit": float(2.0 ** (packing.shift - (ONE.bit_length() - 1))),
        "rounded": not packing.exact,
        "votes": evidence.votes,
        "sensor": evidence.sensor.kind,
        "p_hit": evidence.sensor.p_hit,
        "p_miss": evidence.sensor.p_miss,
        "prior": evidence.config.posterior.prior,
        "free": evidence.config.posterior.thresholds.free,
        "occupied": evidence.config.posterior.thresholds.occupied,
        "calibrated": _model(evidence),
    }


def sources_of(provenance: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What a map was made of: names of logs with their numbers of scans, where they are known."""
    found = []
    for entry in provenance:
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
