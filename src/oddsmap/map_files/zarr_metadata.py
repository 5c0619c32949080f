# SPDX-License-Identifier: Apache-2.0
"""What Zarr knows of a saved map: the `zarr.json` of its group and of its arrays.

They are what zarr-python writes, to the letter. Loading that takes longer than all the rest of
saving a small map.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["AXES", "array_json", "axis_json", "group_json"]

AXES = ("z", "y", "x")


def group_json(attributes: Mapping[str, Any]) -> str:
    """The `zarr.json` of a group with some attributes."""
    return _text({"attributes": dict(attributes), "zarr_format": 3, "node_type": "group"})


def array_json(
    shape: tuple[int, ...],
    shard: int,
    chunk: int,
    dtype: npt.DTypeLike,
    fill_value: float,
    attributes: Mapping[str, Any],
) -> str:
    """The `zarr.json` of an array in shards of zstd frames, as `shard_bytes` packs them.

    Args:
        shape: of the array.
        shard: cells along the side of a shard.
        chunk: cells along the side of a chunk.
        dtype: of the numbers.
        fill_value: of cells that are not written.
        attributes: of the array.
    """
    d = len(shape)
    sharding = {
        "chunk_shape": [chunk] * d,
        "codecs": _packed(np.dtype(dtype)),
        "index_codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "crc32c"},
        ],
        "index_location": "end",
    }
    codecs = [{"name": "sharding_indexed", "configuration": sharding}]
    return _array(shape, (shard,) * d, dtype, fill_value, codecs, attributes, AXES[-d:])


def axis_json(name: str, count: int, attributes: Mapping[str, Any]) -> str:
    """The `zarr.json` of the coordinates along one axis, float64 in one zstd frame."""
    codecs = _packed(np.dtype(np.float64))
    return _array((count,), (count,), np.float64, 0.0, codecs, attributes, (name,))


def _packed(kind: np.dtype[Any]) -> list[dict[str, Any]]:
    order: dict[str, Any] = {"name": "bytes"}
    if kind.itemsize > 1:
        order["configuration"] = {"endian": "little"}
    return [order, {"name": "zstd", "configuration": {"level": 0, "checksum": True}}]


def _array(
    shape: tuple[int, ...],
    chunk_shape: tuple[int, ...],
    dtype: npt.DTypeLike,
    fill_value: float,
    codecs: list[dict[str, Any]],
    attributes: Mapping[str, Any],
    names: tuple[str, ...],
) -> str:
    kind = np.dtype(dtype)
    chunk_grid = {"name": "regular", "configuration": {"chunk_shape": list(chunk_shape)}}
    return _text(
        {
            "shape": list(shape),
            "data_type": kind.name,
            "chunk_grid": chunk_grid,
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "fill_value": np.full((), fill_value, kind).item(),
            "codecs": codecs,
            "attributes": dict(attributes),
            "dimension_names": list(names),
            "zarr_format": 3,
            "node_type": "array",
            "storage_transformers": [],
        }
    )


def _text(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2)
