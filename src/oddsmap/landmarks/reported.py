# SPDX-License-Identifier: Apache-2.0
"""The landmarks of a file that `LandmarkMap.save` or `oddsmap landmarks` wrote, JSON or CSV."""

from __future__ import annotations

import csv
import io
import os
from itertools import combinations_with_replacement

import numpy as np

from oddsmap.errors import InputError, as_line
from oddsmap.landmarks.landmark import Landmark
from oddsmap.landmarks.landmark_map import LandmarkMap
from oddsmap.readers.compression import open_source

__all__ = ["read_landmarks"]


def read_landmarks(path: str | os.PathLike[str]) -> tuple[Landmark, ...]:
    """The landmarks that a file reports, in its order.

    Args:
        path: a `.csv`, which is a table of landmarks; anything else is read as JSON.

    Raises:
        InputError: no such file, none that was written so, damaged, or one without a landmark.
    """
    name = os.fspath(path)
    is_table = name.lower().endswith(".csv")
    try:
        found = _read_table(name) if is_table else LandmarkMap.load(name).landmarks
    except csv.Error as error:
        raise InputError(f"{name}: not a CSV line ({error}): check what wrote the file") from None
    if not found:
        raise InputError(f"{name}: reports no landmark, nothing to show")
    return found


def _read_table(name: str) -> tuple[Landmark, ...]:
    text = open_source(name).content.decode("utf-8-sig", "replace")
    rows = csv.reader(io.StringIO(text, newline=""))
    header = next(rows, [])
    ndim = 3 if header[3:4] == ["z"] else 2
    axes = "xyz"[:ndim]
    pairs = list(combinations_with_replacement(range(ndim), 2))
    if header != ["id", *axes, *(f"cov_{axes[i]}{axes[j]}" for i, j in pairs), "count"]:
        raise InputError(
            f"{name}: not a table of landmarks (id, x, y, cov_xx, ...): oddsmap landmarks OBS "
            "-o TREES.csv makes one of observations"
        )
    found = []
    for row in rows:
        try:
            found.append(_landmark(row, ndim, pairs))
        except (ValueError, OverflowError) as error:
            reason = as_line(str(error), 100)
            raise InputError(f"{name}:{rows.line_num}: not a landmark ({reason})") from None
    return tuple(found)


def _landmark(row: list[str], ndim: int, pairs: list[tuple[int, int]]) -> Landmark:
    """A landmark of a row.

    Raises:
        ValueError: it is none.
    """
    if len(row) != 2 + ndim + len(pairs):
        raise ValueError(f"{len(row)} values, the header announces {2 + ndim + len(pairs)}")
    numbers = np.array(row[1:-1], np.float64)
    covariance = np.empty((ndim, ndim))
    for (i, j), value in zip(pairs, numbers[ndim:], strict=True):
        covariance[i, j] = covariance[j, i] = value
    if not np.isfinite(numbers).all():
        raise ValueError("a number that is not finite")
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        raise ValueError("its covariance has a variance that is not positive")
    return Landmark(int(row[0]), numbers[:ndim], covariance, int(row[-1]))
