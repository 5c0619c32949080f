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

__all__ = ["array_json", "group_json"]

_AXES = ("z", "y", "x")


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
    d, kind = len(shape), np.dtype(dtype)
    order: dict[str, Any] = {"name": "bytes"}
    if kind.itemsize > 1:
        order["configuration"] = {"endian": "little"}
    sharding = {
        "chunk_shape": [chunk] * d,
        "codecs": [order, {"name": "zstd", "configuration": {"level": 0, "checksum": True}}],
        "index_codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "crc32c"},
        ],
        "index_location": "end",
    }
    return _text(
        {
            "shape": list(shape),
            "data_type": kind.name,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [shard] * d}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
            "fill_value": np.full((), fill_value, kind).item(),
            "codecs": [{"name": "sharding_indexed", "configuration": sharding}],
            "attributes": dict(attributes),
            "dimension_names": list(_AXES[-d:]),
            "zarr_format": 3,
            "node_type": "array",
            "storage_transformers": [],
        }
    )


def _text(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2)
