# SPDX-License-Identifier: Apache-2.0
"""The cells of a map as a NumPy archive: the most general export."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError

__all__ = ["save_npz"]


def save_npz(
    path: str | Path,
    *,
    index: npt.NDArray[np.integer],
    hits: npt.NDArray[np.floating],
    passes: npt.NDArray[np.floating],
    probability: npt.NDArray[np.floating],
    observed: npt.NDArray[np.bool_],
    resolution: float,
    extra: Mapping[str, npt.NDArray[np.floating]] | None = None,
    force: bool = False,
) -> Path:
    """Write one row per cell to a compressed `.npz`, under the names of the arguments.

    Read it with `numpy.load(path)`; cell i covers [i * resolution, (i + 1) * resolution) in the map
    frame along each axis.

    Args:
        path: the file to write.
        index: global cell indices, shape (n, 2) or (n, 3), any integers; stored as int64.
        hits: weights of the hits, shape (n,); stored as float64.
        passes: weights of the passes, shape (n,); stored as float64.
        probability: p(occupied) in [0, 1], shape (n,); stored as float32.
        observed: True where there was evidence, shape (n,); stored as bool.
        resolution: side of a cell [m]; stored as float64, shape ().
        extra: more columns of a posterior by name, shape (n,); stored as float32.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: an array has the wrong shape, type or values.
        ConfigError: `path` does not end in .npz, or the resolution is not positive.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ConfigError(f"{path}: a NumPy archive is named .npz; give a name that ends in .npz")
    if not (resolution > 0.0 and math.isfinite(resolution)):
        raise ConfigError(f"{path}: resolution must be positive [m], got {resolution}")
    check_output(path, force=force)
    index = np.asarray(index)
    if index.ndim != 2 or index.shape[1] not in (2, 3):
        raise InputError(f"{path}: index must have shape (n, 2) or (n, 3), got {index.shape}")
    if not np.issubdtype(index.dtype, np.integer):
        raise InputError(f"{path}: index must hold integers, got {index.dtype}")
    if np.asarray(observed).dtype != np.bool_:
        raise InputError(f"{path}: observed must hold bool, got {np.asarray(observed).dtype}")
    weights = {
        "hits": np.asarray(hits, dtype=np.float64),
        "passes": np.asarray(passes, dtype=np.float64),
    }
    p = np.asarray(probability, dtype=np.float32)
    seen = np.asarray(observed)
    columns: dict[str, npt.NDArray[np.generic]] = {
        **weights,
        "probability": p,
        "observed": seen,
    }
    more: dict[str, Any] = {
        name: np.asarray(values, np.float32) for name, values in (extra or {}).items()
    }
    columns.update(more)
    for name, values in columns.items():
        if values.shape != (len(index),):
            raise InputError(
                f"{path}: {name} must have shape ({len(index)},) like index, got {values.shape}"
            )
    for name, weight in weights.items():
        wrong = np.count_nonzero(~(np.isfinite(weight) & (weight >= 0.0)))
        if wrong:
            raise InputError(f"{path}: {name} must be finite and >= 0, {wrong} values are not")
    wrong = np.count_nonzero(~((p >= 0.0) & (p <= 1.0)))
    if wrong:
        raise InputError(f"{path}: probability must lie in [0, 1], {wrong} values do not")
    # Through an open file: NumPy would add .npz to the temporary name of a path without it.
    with atomic_output(path, force=force) as part, part.open("wb") as file:
        np.savez_compressed(
            file,
            index=index.astype(np.int64),
            hits=weights["hits"],
            passes=weights["passes"],
            probability=p,
            observed=seen,
            resolution=np.float64(resolution),
            **more,
        )
    return path
