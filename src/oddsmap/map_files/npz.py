# SPDX-License-Identifier: Apache-2.0
"""The cells of a map as a NumPy archive: the most general export."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray
from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError

__all__ = ["Column", "all_true", "save_npz"]

_ROWS = 1 << 16  # made at a time

Values = npt.NDArray[Any]


Rule = Callable[[Values], BoolArray]

_RULES: dict[str, Rule] = {
    "hits": lambda weights: np.isfinite(weights) & (weights >= 0.0),
    "passes": lambda weights: np.isfinite(weights) & (weights >= 0.0),
    "probability": lambda p: (p >= 0.0) & (p <= 1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a table that is made some rows at a time, when it is written.

    Args:
        shape: of all its rows.
        parts: gives them, in order.
    """

    shape: tuple[int, ...]
    parts: Callable[[], Iterable[Values]]


def all_true(count: int) -> Column:
    """A column that says of each row that it holds."""
    starts = range(0, count, _ROWS)
    return Column((count,), lambda: (np.ones(min(_ROWS, count - at), np.bool_) for at in starts))


def save_npz(
    path: str | Path,
    *,
    index: npt.NDArray[np.integer] | Column,
    hits: npt.NDArray[np.floating] | Column,
    passes: npt.NDArray[np.floating] | Column,
    probability: npt.NDArray[np.floating] | Column,
    observed: npt.NDArray[np.bool_] | Column,
    resolution: float,
    extra: Mapping[str, npt.NDArray[np.floating] | Column] | None = None,
    origin: tuple[float, float, float] | None = None,
    force: bool = False,
) -> Path:
    """Write one row per cell to a compressed `.npz`, under the names of the arguments.

    Read it with `numpy.load(path)`; cell i covers [i * resolution, (i + 1) * resolution) in the map
    frame along each axis. A `Column` takes the memory of some rows alone.

    Args:
        path: the file to write.
        index: global cell indices, shape (n, 2) or (n, 3), any integers; stored as int64.
        hits: weights of the hits, shape (n,); stored as float64.
        passes: weights of the passes, shape (n,); stored as float64.
        probability: p(occupied) in [0, 1], shape (n,); stored as float32.
        observed: True where there was evidence, shape (n,); stored as bool.
        resolution: side of a cell [m]; stored as float64, shape ().
        extra: more columns of a posterior by name, shape (n,); stored as float32.
        origin: x, y [m] and yaw [rad] of the corner from which the indices of a 2D map count,
            stored as float64; None: they count from the map frame's origin, and nothing is stored.
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
    if not isinstance(index, Column):
        index = np.asarray(index)
    if len(index.shape) != 2 or index.shape[1] not in (2, 3):
        raise InputError(f"{path}: index must have shape (n, 2) or (n, 3), got {index.shape}")
    for name, given, kind in (("index", index, "integers"), ("observed", observed, "bool")):
        dtype = None if isinstance(given, Column) else np.asarray(given).dtype
        if dtype is not None and dtype.kind not in {"integers": "iu", "bool": "b"}[kind]:
            raise InputError(f"{path}: {name} must hold {kind}, got {dtype}")
    columns = {
        "index": _column(index, np.int64),
        "hits": _column(hits, np.float64),
        "passes": _column(passes, np.float64),
        "probability": _column(probability, np.float32),
        "observed": _column(observed, np.bool_),
        "resolution": _column(np.float64(resolution), np.float64),
        **{name: _column(values, np.float32) for name, values in (extra or {}).items()},
    }
    if origin is not None:
        columns["origin"] = _column(np.array(origin, np.float64), np.float64)
    for name, (column, _) in columns.items():
        if name not in ("index", "resolution", "origin") and column.shape != index.shape[:1]:
            raise InputError(
                f"{path}: {name} must have shape ({index.shape[0]},) like index, got {column.shape}"
            )
    with (
        atomic_output(path, force=force) as part,
        part.open("wb") as file,
        ZipFile(file, "w", ZIP_DEFLATED) as archive,
    ):
        for name, (column, dtype) in columns.items():
            # As numpy.savez_compressed does it, which needs all rows at once.
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                wrong = _write(entry, column, dtype, _RULES.get(name))
            if wrong:
                rule = "be finite and >= 0" if name in ("hits", "passes") else "lie in [0, 1]"
                kind = "are not" if name in ("hits", "passes") else "do not"
                raise InputError(f"{path}: {name} must {rule}, {wrong} values {kind}")
    return path


def _column(values: npt.ArrayLike | Column, dtype: npt.DTypeLike) -> tuple[Column, np.dtype[Any]]:
    """A column, and the type that it is written in."""
    if isinstance(values, Column):
        return values, np.dtype(dtype)
    array = np.asarray(values, dtype)
    return Column(array.shape, lambda: [array]), array.dtype


def _write(entry: IO[bytes], column: Column, dtype: np.dtype[Any], rule: Rule | None) -> int:
    """Write a `.npy`; how many values break the rule."""
    header = {
        "descr": np.lib.format.dtype_to_descr(dtype),
        "fortran_order": False,
        "shape": column.shape,
    }
    np.lib.format.write_array_header_1_0(entry, header)
    wrong = 0
    for part in column.parts():
        values = np.ascontiguousarray(part, dtype)
        if rule is not None:
            wrong += len(values) - int(np.count_nonzero(rule(values)))
        entry.write(values.data)
    return wrong
