# SPDX-License-Identifier: Apache-2.0
"""What a saved map says of itself, checked before anything is made of it.

Nothing is taken from Zarr's own reading here: sizes are known before memory is asked for, and a
folder that only looks like a map is told from one that is damaged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.map_files.zarr_folder import (
    ARRAYS,
    CHUNK,
    FORMAT_VERSION,
    SHARD,
    digest_of,
    read_json,
)

__all__ = [
    "ArrayHeader",
    "Header",
    "array_header",
    "check_equal",
    "check_place",
    "read_header",
    "whole_numbers",
]

# Cells of all maps lie within; numbers beyond it are damage.
_MAX_INDEX = 1 << 62
_INDEX_CODECS = [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}]


@dataclass(frozen=True, slots=True)
class ArrayHeader:
    """What one array says: how a number is stored, which one is not, and its attributes."""

    dtype: np.dtype[Any]
    fill_value: float
    attributes: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Header:
    """What a saved map says of itself.

    Args:
        attributes: of the group.
        origin_cell: the first cell of the arrays, shape (d,), x first.
        shape: of all arrays, (ny, nx) or (nz, ny, nx).
        arrays: by their names.
        shards: the files that were written of each array, in shards, z before y before x.
        checksums: the `shard_checksum` of each of these; empty where none are to be looked at.
    """

    attributes: Mapping[str, Any]
    origin_cell: IntArray
    shape: tuple[int, ...]
    arrays: Mapping[str, ArrayHeader]
    shards: Mapping[str, list[tuple[int, ...]]]
    checksums: Mapping[str, Mapping[tuple[int, ...], int]]


def read_header(path: Path, kind: str) -> Header:
    """Read and check what a map says of itself.

    Args:
        path: the folder.
        kind: the format that it must have.

    Raises:
        InputError: another format, or a later version of it.
        ValueError: it contradicts itself, or its digest: it is damaged.
        OSError, LookupError, TypeError, RuntimeError: likewise.
    """
    root = read_json(path / "zarr.json")
    attributes: Mapping[str, Any] = _mapping(root.get("attributes"), "attributes")
    if attributes.get("format") != kind:
        raise InputError(f"{path}: a Zarr folder, but not one of oddsmap (attribute format)")
    version = attributes.get("format_version")
    if version != FORMAT_VERSION or isinstance(version, bool):
        raise InputError(
            f"{path}: format version {version!r:.40}, this oddsmap reads {FORMAT_VERSION}: "
            "update oddsmap"
        )
    names = list(_mapping(attributes["shards"], "shards"))
    if not names or not set(names) <= set(ARRAYS[kind]):
        raise ValueError(f"attribute shards lists the arrays {names!r:.80}, which are no map's")
    zarrs = {name: read_json(path / name / "zarr.json") for name in names}
    _check_seal(attributes, zarrs)
    origin = whole_numbers(attributes, "origin_cell")
    d = len(origin)
    if any(first % SHARD[d] for first in origin):
        raise ValueError(f"origin_cell {origin} is no multiple of {SHARD[d]} cells")
    shapes = {name: _shape(name, metadata, d) for name, metadata in zarrs.items()}
    shape = next(iter(shapes.values()), ())
    if any(other != shape for other in shapes.values()):
        raise ValueError(f"arrays of one map differ in shape: {shapes}")
    if any(first + n > _MAX_INDEX for first, n in zip(origin, shape[::-1], strict=True)):
        raise ValueError(f"{shape} cells from {origin} on are beyond all maps")
    provenance = attributes["provenance"]
    if not (isinstance(provenance, list) and all(isinstance(each, dict) for each in provenance)):
        raise ValueError(f"attribute provenance is no list of tables: {provenance!r:.60}")
    grid = tuple(n // SHARD[d] for n in shape)
    shards = {name: _places(attributes["shards"][name], name, grid) for name in names}
    return Header(
        attributes=attributes,
        origin_cell=np.array(origin, np.int64),
        shape=shape,
        arrays={name: array_header(name, metadata, d) for name, metadata in zarrs.items()},
        shards=shards,
        checksums=_checksums_by_place(attributes, shards),
    )


def whole_numbers(attributes: Mapping[str, Any], name: str) -> list[int]:
    """An attribute that is the index of a cell.

    Raises:
        ValueError: it is not 2 or 3 whole numbers.
    """
    value = attributes[name]
    if not (isinstance(value, list) and len(value) in (2, 3) and all(map(_is_index, value))):
        raise ValueError(f"attribute {name} needs 2 or 3 indices, got {value!r:.80}")
    return value


def check_equal(attributes: Mapping[str, Any], name: str, value: object) -> None:
    """Raise ValueError where an attribute is not what the configuration says."""
    if type(attributes[name]) is not type(value) or attributes[name] != value:
        raise ValueError(
            f"attribute {name} is {attributes[name]!r:.60}, and the configuration says {value!r}"
        )


def check_place(header: Header, resolution: float) -> None:
    """Check where a map says it lies against the side of its cells [m].

    Raises:
        ValueError: its resolution is another, or its origin is not that of its first cell.
    """
    check_equal(header.attributes, "resolution", resolution)
    origin = [float(i) * resolution for i in header.origin_cell]
    if header.attributes["origin"] != origin:
        raise ValueError(
            f"attribute origin is {header.attributes['origin']!r:.60}, and origin_cell lies at "
            f"{origin}"
        )


def _is_index(value: object) -> bool:
    return type(value) is int and abs(value) <= _MAX_INDEX


def _mapping(value: object, name: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{name} is not a table of names and values")
    return value


def _check_seal(attributes: Mapping[str, Any], zarrs: Mapping[str, dict[str, Any]]) -> None:
    own = {name: _mapping(zarr.get("attributes", {}), name) for name, zarr in zarrs.items()}
    # Maps saved before there were seals have none of this; one that has some of it has it all.
    sealed = {"save", "digest"} & set(attributes) or any("save" in each for each in own.values())
    if not sealed and not any(_checksums(zarr) for zarr in zarrs.values()):
        return
    if "digest" not in attributes:
        raise ValueError("attribute digest is missing")
    digest = attributes["digest"]
    if digest is not None and digest != digest_of(attributes, zarrs):
        raise ValueError(
            "what its zarr.json files say is not what was saved (attribute digest; set that to "
            "null if you have edited the map)"
        )
    for name, each in own.items():
        if each.get("save") != attributes.get("save"):
            raise ValueError(f"{name} is of another save than the group (attribute save)")


def _checksums(zarr: Mapping[str, Any]) -> bool:
    try:
        codecs = zarr["codecs"][0]["configuration"]["codecs"]
        return any(codec["configuration"].get("checksum") for codec in codecs[1:])
    except (LookupError, TypeError, AttributeError):
        return False


def _shape(name: str, zarr: Mapping[str, Any], d: int) -> tuple[int, ...]:
    shape = zarr["shape"]
    fine = (
        isinstance(shape, list)
        and len(shape) == d
        and all(_is_index(n) and n > 0 and n % SHARD[d] == 0 for n in shape)
    )
    if not fine:
        raise ValueError(f"{name} has shape {shape!r:.80}, not whole shards of {SHARD[d]} cells")
    return tuple(shape)


def array_header(name: str, zarr: Mapping[str, Any], d: int) -> ArrayHeader:
    """What the `zarr.json` of an array of a map says.

    Raises:
        ValueError: it is none of a map's, or not stored as those are.
    """
    dtype = zarr["data_type"]
    if dtype not in ("uint8", "uint16", "uint32", "uint64", "float32"):
        raise ValueError(f"{name} holds {dtype!r:.40}, which no map does")
    fill = zarr["fill_value"]
    if isinstance(fill, bool) or not isinstance(fill, int | float):
        raise ValueError(f"{name} has the fill value {fill!r:.40}")
    if zarr.get("node_type") != "array" or zarr.get("zarr_format") != 3:
        raise ValueError(f"{name} is not an array")
    separator = zarr["chunk_key_encoding"]
    grid, codecs = zarr["chunk_grid"], zarr["codecs"]
    fine = (
        grid == {"name": "regular", "configuration": {"chunk_shape": [SHARD[d]] * d}}
        and separator.get("name") == "default"
        and separator.get("configuration", {}).get("separator", "/") == "/"
        and not zarr.get("storage_transformers")
        and len(codecs) == 1
        and _is_sharding(codecs[0], d)
    )
    if not fine:
        raise ValueError(f"{name} is not stored as maps are: chunks of {CHUNK[d]}, in shards")
    return ArrayHeader(np.dtype(dtype), fill, _mapping(zarr.get("attributes", {}), name))


def _is_sharding(codec: Mapping[str, Any], d: int) -> bool:
    settings = codec["configuration"]
    order, pack = settings["codecs"]
    return bool(
        codec["name"] == "sharding_indexed"
        and settings["chunk_shape"] == [CHUNK[d]] * d
        and settings["index_codecs"] == _INDEX_CODECS
        and settings.get("index_location", "end") == "end"
        and order["name"] == "bytes"
        and order.get("configuration", {}).get("endian", "little") == "little"
        and pack["name"] == "zstd"
    )


def _places(listed: object, name: str, grid: tuple[int, ...]) -> list[tuple[int, ...]]:
    if not isinstance(listed, list):
        raise ValueError(f"attribute shards lists no places of {name}")
    for place in listed:
        fine = (
            isinstance(place, list)
            and len(place) == len(grid)
            and all(_is_index(i) and 0 <= i < n for i, n in zip(place, grid, strict=True))
        )
        if not fine:
            raise ValueError(f"attribute shards lists {place!r:.60} of {name}, outside the map")
    return [tuple(place) for place in listed]


def _checksums_by_place(
    attributes: Mapping[str, Any], shards: Mapping[str, list[tuple[int, ...]]]
) -> dict[str, dict[tuple[int, ...], int]]:
    if attributes.get("digest") is None or "checksums" not in attributes:  # edited, or from before
        return {}
    found = {}
    for name, places in shards.items():
        digits = attributes["checksums"][name]
        each = [int(digits[at : at + 8], 16) for at in range(0, len(digits), 8)]
        found[name] = dict(zip(places, each, strict=True))
    return found
