# SPDX-License-Identifier: Apache-2.0
"""A full map on disk: a Zarr folder, laid out as an evidence map's (see `oddsmap.evidence.store`).

`log_odds` (float32) and `marks` (see `FullMap`) cover the box of cells that beams list, rounded
to whole shards; empty shards are not written. Where nothing is written `log_odds` is the prior's.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.atomic_write import atomic_output
from oddsmap.config.config import Config
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.store import CHUNK, SHARD, shard_files
from oddsmap.full_map.blocks import dense_box
from oddsmap.limits import TILE_SIDE

__all__ = ["FullMapFields", "is_full_map", "read_full_map", "save_full_map"]

FORMAT = "oddsmap full map"
FORMAT_VERSION = 1


_ARRAYS = ("log_odds", "marks")
_AXES = ("z", "y", "x")


class FullMapFields(NamedTuple):
    """What is stored of a full map; see the arguments of `oddsmap.FullMap`."""

    config: Config
    blocks: IntArray
    values: npt.NDArray[np.float32]
    marks: npt.NDArray[np.uint8]
    sweeps: int
    residual: float
    provenance: list[dict[str, Any]]


def is_full_map(path: str | os.PathLike[str]) -> bool:
    """Whether a path looks like a saved full map: a Zarr folder with log odds."""
    folder = Path(path)
    return (folder / "zarr.json").is_file() and (folder / "log_odds").is_dir()


def save_full_map(
    full_map: FullMapFields,
    path: str | os.PathLike[str],
    *,
    prior_log_odds: float,
    converged: bool,
    force: bool = False,
) -> None:
    """Write a full map; the old one stays in place until the new one is complete.

    Args:
        full_map: what there is to store.
        path: folder to make, by custom with the suffix .zarr.
        prior_log_odds: of a cell that no beam lists.
        converged: see `FullMap`.
        force: True where an existing one may be replaced.

    Raises:
        OutputError: it exists and `force` is False, or cannot be written.
    """
    import zarr

    d = full_map.blocks.shape[1]
    side, shard, resolution = TILE_SIDE[d], SHARD[d], full_map.config.map.resolution
    # Of each block, in shards: a shard's side is a multiple of a block's. A map without cells, of
    # beams that end in the sensor's own cell, still has a box.
    begin = full_map.blocks * side // shard
    begin = begin if len(begin) else np.zeros((1, d), np.int64)
    lo, hi = begin.min(axis=0) * shard, (begin.max(axis=0) + 1) * shard
    shape = tuple(int(n) for n in (hi - lo)[::-1])
    with atomic_output(Path(path), force=force) as part:
        root = zarr.open_group(part, mode="w", zarr_format=3)
        arrays = [
            root.create_array(
                name,
                shape=shape,
                chunks=(CHUNK[d],) * d,
                shards=(shard,) * d,
                dtype=dtype,
                fill_value=fill,
                dimension_names=_AXES[-d:],
                attributes={"description": text},
            )
            for name, dtype, fill, text in (
                ("log_odds", "float32", prior_log_odds, "log odds of occupancy [nats]"),
                (
                    "marks",
                    "uint8",
                    0,
                    "2 where a beam has reached the cell, 1 where one was stopped",
                ),
            )
        ]
        for place in np.unique(begin, axis=0):
            first = place * shard
            box = (first, first + shard)
            values = [
                dense_box(full_map.blocks, side, cells, fill, *box)
                for cells, fill in ((full_map.values, prior_log_odds), (full_map.marks, 0))
            ]
            where = tuple(slice(int(a), int(a) + shard) for a in (first - lo)[::-1])
            for array, value in zip(arrays, values, strict=True):
                array[where] = value.astype(array.dtype)
        root.attrs.update(
            {
                "format": FORMAT,
                "format_version": FORMAT_VERSION,
                "resolution": resolution,
                "origin": [float(i) * resolution for i in lo],
                "origin_cell": [int(i) for i in lo],
                "sweeps": full_map.sweeps,
                "residual": full_map.residual,
                "converged": converged,
                "config": full_map.config.to_dict(),
                "provenance": full_map.provenance,
                "shards": {name: shard_files(part, name, d) for name in _ARRAYS},
            }
        )


def read_full_map(path: str | os.PathLike[str]) -> FullMapFields:
    """Read what `save_full_map` wrote: see `oddsmap.load_full_map`."""
    import zarr

    if not is_full_map(path):
        raise InputError(f"{path}: not a saved full map (a Zarr folder with log_odds)")
    try:
        root = zarr.open_group(Path(path), mode="r")
        return _load(path, root, dict(root.attrs))
    except (
        OSError, LookupError, AttributeError, TypeError, ValueError, ArithmeticError, RuntimeError,
    ) as error:  # fmt: skip
        if isinstance(error, InputError | ConfigError):
            raise
        raise InputError(f"{path}: damaged, cannot be read as a map: {error}") from None


def _load(path: str | os.PathLike[str], root: Any, attributes: dict[str, Any]) -> FullMapFields:
    if attributes.get("format") != FORMAT:
        raise InputError(f"{path}: a Zarr folder, but not one of oddsmap (attribute format)")
    version = attributes.get("format_version")
    if version != FORMAT_VERSION:
        raise InputError(
            f"{path}: format version {version}, this oddsmap reads {FORMAT_VERSION}: update oddsmap"
        )
    config = Config.from_dict(attributes["config"], str(path))
    lo = np.array(attributes["origin_cell"], np.int64)
    d = len(lo)
    side = TILE_SIDE[d]
    shard = int(root["log_odds"].shards[0])
    coords, values, seen = [], [], []
    prior = np.float32(root["log_odds"].fill_value)
    written = {name: {tuple(p) for p in attributes["shards"][name]} for name in _ARRAYS}
    for name in _ARRAYS:
        missing = written[name] - {tuple(p) for p in shard_files(Path(path), name, d)}
        if missing:
            raise ValueError(f"{name}/c/{'/'.join(map(str, min(missing)))} is missing or empty")
    for place in sorted(written["log_odds"] | written["marks"]):
        first = np.array(place[::-1], np.int64) * shard
        where = tuple(slice(int(a), int(a) + shard) for a in first[::-1])
        log_odds = _tiles(np.asarray(root["log_odds"][where]), side)
        marks = _tiles(np.asarray(root["marks"][where]), side)
        used = np.flatnonzero((log_odds != prior).any(axis=1) | marks.any(axis=1))
        count = shard // side
        at = np.stack(np.unravel_index(used, (count,) * d)[::-1], axis=1)
        coords.append(at + (first + lo) // side)
        values.append(log_odds[used].astype(np.float32))
        seen.append(marks[used].astype(np.uint8))
    cells = side**d
    return FullMapFields(
        config,
        np.concatenate([np.empty((0, d), np.int64), *coords]),
        np.concatenate([np.empty((0, cells), np.float32), *values]),
        np.concatenate([np.empty((0, cells), np.uint8), *seen]),
        sweeps=int(attributes["sweeps"]),
        residual=float(attributes["residual"]),
        provenance=list(attributes["provenance"]),
    )


def _tiles(box: npt.NDArray[Any], side: int) -> npt.NDArray[Any]:
    """A cube of cells as rows of blocks: (ty, side, tx, side) becomes (ty, tx, side, side)."""
    d, count = box.ndim, box.shape[0] // side
    parts = box.reshape((count, side) * d)
    order = [2 * axis for axis in range(d)] + [2 * axis + 1 for axis in range(d)]
    return parts.transpose(order).reshape(count**d, side**d)
