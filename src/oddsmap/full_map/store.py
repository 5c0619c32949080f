# SPDX-License-Identifier: Apache-2.0
"""A full map on disk: a Zarr folder, laid out as an evidence map's (see `oddsmap.evidence.store`).

`log_odds` (float32) and `marks` (see `FullMap`) cover the box of cells that beams list, rounded
to whole shards; empty shards are not written. Where nothing is written `log_odds` is the prior's.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.config.config import Config
from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.kernels.infer.cell_status import REACHED
from oddsmap.limits import TILE_SIDE, memory_limit
from oddsmap.map_files.chunk_blocks import (
    ShardBlocks,
    block_coords,
    blocks_by_shard,
    blocks_from_chunks,
    used_blocks,
)
from oddsmap.map_files.side_by_side import do_side_by_side
from oddsmap.map_files.zarr_folder import FORMAT_VERSION, FULL_MAP, SHARD, new_folder
from oddsmap.map_files.zarr_header import Header, check_place, read_header
from oddsmap.map_files.zarr_shards import SavedShards
from oddsmap.map_files.zarr_snapshot import holds, read_unchanged

__all__ = ["FullMapFields", "is_full_map", "read_full_map", "save_full_map"]

_TYPES = {"log_odds": "float32", "marks": "uint8"}
_TEXTS = {
    "log_odds": "log odds of occupancy [nats]",
    "marks": "2 where a beam has reached the cell, 1 where one was stopped",
}
# The logarithm's last digit is the C library's own.
_SAME = 1e-6


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
    return holds(path, "log_odds")


def save_full_map(
    full_map: FullMapFields,
    path: str | os.PathLike[str],
    *,
    converged: bool,
    force: bool = False,
) -> None:
    """Write a full map; the old one stays in place until the new one is complete.

    Args:
        full_map: what there is to store.
        path: folder to make, by custom with the suffix .zarr.
        converged: see `FullMap`.
        force: True where an existing map may be replaced.

    Raises:
        OutputError: it exists and `force` is False, or is no map, or cannot be written.
    """
    d = full_map.blocks.shape[1]
    side, shard, resolution = TILE_SIDE[d], SHARD[d], full_map.config.map.resolution
    # Of each block, in shards: a shard's side is a multiple of a block's. A map without cells, of
    # beams that end in the sensor's own cell, still has a box.
    begin = full_map.blocks * side // shard
    begin = begin if len(begin) else np.zeros((1, d), np.int64)
    lo, hi = begin.min(axis=0) * shard, (begin.max(axis=0) + 1) * shard
    shape = tuple(int(n) for n in (hi - lo)[::-1])
    fills = _fills(full_map.config, d)
    with new_folder(Path(path), shape, force=force) as folder:
        for name, dtype in _TYPES.items():
            folder.create(name, dtype, fills[name], {"description": _TEXTS[name]})
        cells: dict[str, npt.NDArray[Any]] = {"log_odds": full_map.values, "marks": full_map.marks}

        def write(part: ShardBlocks) -> None:
            where = tuple((part.place - lo // shard)[::-1].tolist())
            for name, dtype in _TYPES.items():
                own = cells[name][part.blocks].astype(dtype, copy=False)
                folder.write(name, where, part.numbers, part.to_chunks(own, side, fills[name]))

        do_side_by_side(write, blocks_by_shard(full_map.blocks, side))
        folder.seal(
            {
                "format": FULL_MAP,
                "format_version": FORMAT_VERSION,
                "resolution": resolution,
                "origin": [float(i) * resolution for i in lo],
                "origin_cell": [int(i) for i in lo],
                "sweeps": full_map.sweeps,
                "residual": full_map.residual,
                "converged": converged,
                "config": full_map.config.to_dict(),
                "provenance": full_map.provenance,
            }
        )


def _fills(config: Config, d: int) -> dict[str, float]:
    """What a cell is that is in no shard."""
    return {"log_odds": config.full_map.log_odds_in(d), "marks": 0}


def read_full_map(path: str | os.PathLike[str]) -> FullMapFields:
    """Read what `save_full_map` wrote: see `oddsmap.load_full_map`."""
    return read_unchanged(Path(path), lambda: _read(Path(path)))


def _read(path: Path) -> FullMapFields:
    if not is_full_map(path):
        raise InputError(f"{path}: not a saved full map (a Zarr folder with log_odds)")
    header = read_header(path, FULL_MAP)
    attributes = header.attributes
    config = Config.from_dict(attributes["config"], str(path))
    _check(header, config)
    d = len(header.shape)
    side = TILE_SIDE[d]
    prior = np.float32(header.arrays["log_odds"].fill_value)
    coords: list[IntArray] = []
    values: list[npt.NDArray[Any]] = []
    seen: list[npt.NDArray[Any]] = []
    taken, limit = 0, memory_limit()

    for chunks in SavedShards(path, header).read_all(tuple(_TYPES)):
        log_odds, marks = chunks.cells
        if not np.isfinite(log_odds).all():
            raise ValueError("log_odds holds values that are no numbers")
        if marks.max(initial=0) > REACHED:
            raise ValueError(f"marks holds {marks.max()}, and marks are 0, 1 or 2")
        some = np.flatnonzero(used_blocks((log_odds != prior) | (marks != 0), side, d))
        log_odds, marks = (blocks_from_chunks(cells, side, d, some) for cells in chunks.cells)
        coords.append(block_coords(chunks.first, side, some))
        values.append(log_odds)
        seen.append(marks)
        taken += coords[-1].nbytes + log_odds.nbytes + marks.nbytes
        if 2 * taken > limit:  # they lie side by side with what is made of them
            raise MapTooLargeError(
                f"{path}: more than {taken / 1e9:.1f} GB of cells, and this machine's memory "
                f"of {limit / 1e9:.1f} GB would not hold them twice"
            )
    return FullMapFields(
        config,
        np.concatenate([np.empty((0, d), np.int64), *coords]),
        np.concatenate([np.empty((0, side**d), np.float32), *values]),
        np.concatenate([np.empty((0, side**d), np.uint8), *seen]),
        sweeps=int(attributes["sweeps"]),
        residual=float(attributes["residual"]),
        provenance=list(attributes["provenance"]),
    )


def _check(header: Header, config: Config) -> None:
    """Refuse a map that contradicts itself."""
    check_place(header, config.map.resolution)
    if set(header.arrays) != set(_TYPES):
        raise ValueError(f"a full map has {' and '.join(_TYPES)}, not {', '.join(header.arrays)}")
    for name, fill in _fills(config, len(header.shape)).items():
        array = header.arrays[name]
        if array.dtype != np.dtype(_TYPES[name]):
            raise ValueError(f"{name} holds {array.dtype}, not {_TYPES[name]}")
        if not math.isclose(array.fill_value, fill, rel_tol=_SAME, abs_tol=_SAME):
            raise ValueError(
                f"{name} has the fill value {array.fill_value}, and its configuration says {fill}"
            )
    sweeps, residual = header.attributes["sweeps"], header.attributes["residual"]
    if type(sweeps) is not int or sweeps < 0:
        raise ValueError(f"attribute sweeps is {sweeps!r:.40}")
    if type(residual) not in (int, float) or not residual >= 0:
        raise ValueError(f"attribute residual is {residual!r:.40}")
