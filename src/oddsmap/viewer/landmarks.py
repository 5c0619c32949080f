# SPDX-License-Identifier: Apache-2.0
"""Landmarks as the page takes them: on top of a 2D map, or alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from oddsmap.landmarks.landmark import Landmark
from oddsmap.landmarks.picture import ellipse_axes
from oddsmap.plot.frame import round_length
from oddsmap.viewer.layout import TILE
from oddsmap.viewer.payload import packed, payload_of

__all__ = ["landmark_facts", "landmarks_payload"]

_PROBABILITY = 0.95
# Cells along what landmarks cover: they have none of their own, but positions count in cells.
_CELLS_ACROSS = 1000.0
_SMALLEST = 0.1  # [m]


def landmark_facts(landmarks: Sequence[Landmark]) -> list[dict[str, Any]]:
    """Plain values for JSON; of 3D landmarks the ellipse is that of x and y."""
    return [
        {
            # As text: a page counts only up to 2^53.
            "id": str(mark.id),
            "mean": mark.mean.tolist(),
            "ellipse": list(ellipse_axes(mark.covariance[:2, :2], _PROBABILITY)),
            "count": mark.count,
        }
        for mark in landmarks
    ]


def landmarks_payload(landmarks: Sequence[Landmark], name: str) -> bytes:
    """The payload of landmarks without a map below them.

    Args:
        landmarks: at least one.
        name: of their file.
    """
    means = np.array([mark.mean[:2] for mark in landmarks])
    reach = np.sqrt([np.diag(mark.covariance)[:2] for mark in landmarks])
    low, high = (means - 2.5 * reach).min(axis=0), (means + 2.5 * reach).max(axis=0)
    resolution = round_length(max(float((high - low).max()), _SMALLEST) / _CELLS_ACROSS)
    lo = np.floor(low / resolution).astype(np.int64)
    hi = np.ceil(high / resolution).astype(np.int64) + 1
    facts = {
        "kind": "plane",
        "counts": False,
        "name": PurePath(name).name,
        "sources": [],
        "resolution": resolution,
        "corner": [0.0, 0.0],
        "yaw": 0.0,
        "lo": lo.tolist(),
        "hi": hi.tolist(),
        "cells": 0,
        "unit": 1.0,
        "rounded": False,
        "free": 0.196,
        "occupied": 0.65,
        "calibrated": None,
        "tile": TILE,
        "landmarks": landmark_facts(landmarks),
        "given": [
            {
                "name": PurePath(name).name, "what": "landmark map", "cells": 0, "free": 0.196,
                "occupied": 0.65, "bytes": 1, "listed": 0, "tiles": 1,
                "first_cell": (lo // TILE * TILE).tolist(),
            }
        ],
    }  # fmt: skip
    # A tile of which nothing is known.
    nothing = np.zeros(TILE * TILE, np.uint8)
    arrays = [packed("given0.coords", np.zeros(2, np.uint32), np.uint32)]
    arrays += [packed(f"given0.{kind}", nothing, np.uint8) for kind in ("hits", "passes")]
    arrays += [packed(f"given0.{half}", nothing[:0], np.uint32) for half in ("low", "high")]
    return payload_of(facts, arrays)
