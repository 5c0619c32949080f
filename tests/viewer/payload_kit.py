# SPDX-License-Identifier: Apache-2.0
"""The payload of the viewer's page, read slowly: number by number, byte by byte."""

from __future__ import annotations

import json
import math
import struct
import zlib
from typing import Any

Cell = tuple[int, int]


def parts_of(payload: bytes) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The facts, and the sections by name, undone."""
    length = int.from_bytes(payload[:4], "little")
    facts = json.loads(zlib.decompress(payload[4 : 4 + length]))
    at, sections = 4 + length, {}
    for name, size in facts["sections"]:
        sections[name] = zlib.decompress(payload[at : at + size])
        at += size
    assert at == len(payload)
    return facts, sections


def numbers_of(sections: dict[str, bytes], name: str, size: int) -> list[int]:
    """The numbers of an array: its planes of bytes put together."""
    planes = [sections[f"{name}.{i}"] for i in range(size)]
    return [int.from_bytes(bytes(word), "little") for word in zip(*planes, strict=True)]


def probabilities_of(payload: bytes, number: int = 0) -> dict[tuple[int, ...], float]:
    """p of each cell of a map of probabilities of the page."""
    facts, sections = parts_of(payload)
    own = facts["given"][number]
    prefix = f"given{number}."
    sections = {
        name.removeprefix(prefix): data
        for name, data in sections.items()
        if name.startswith(prefix)
    }
    facts = {**facts, **own, "unit": 1.0}
    read = _cells_of if facts["kind"] == "plane" else _voxels_of
    codes = read(facts, sections)
    if own["listed"] is None:
        return {cell: _evenly_spaced(int(code)) for cell, (code, _) in codes.items()}
    low, high = (numbers_of(sections, name, 4) for name in ("low", "high"))
    words = zip(low, high, strict=True)
    values = [struct.unpack("<d", struct.pack("<II", *pair))[0] for pair in words]
    assert len(values) == own["listed"]
    assert values == sorted(set(values))
    return {cell: values[int(code) - 1] for cell, (code, _) in codes.items()}


def _evenly_spaced(code: int) -> float:
    """The p of which p + 0.001 l is that of a place, l being its log odds: by bisection."""
    place = -0.04 + 1.08 * (code - 1) / 65534
    low, high = -41.0, 41.0
    for _ in range(100):
        middle = (low + high) / 2
        if 1 / (1 + math.exp(-middle)) + 0.001 * middle < place:
            low = middle
        else:
            high = middle
    return 1 / (1 + math.exp(-(low + high) / 2))


def voxels_of(payload: bytes) -> dict[tuple[int, int, int], tuple[float, float]]:
    """Hits and passes [votes] of each voxel of a 3D map that the page gets."""
    facts, sections = parts_of(payload)
    assert facts["kind"] == "space"
    return _voxels_of(facts, sections)


def _voxels_of(
    facts: dict[str, Any], sections: dict[str, bytes]
) -> dict[tuple[int, int, int], tuple[float, float]]:
    steps = zip(*(numbers_of(sections, axis, 2) for axis in "xyz"), strict=True)
    hits, passes = (numbers_of(sections, name, facts["bytes"]) for name in ("hits", "passes"))
    at = [0, 0, 0]
    found: dict[tuple[int, int, int], tuple[float, float]] = {}
    for step, h, p in zip(steps, hits, passes, strict=True):
        at = [(a + s) % 65536 for a, s in zip(at, step, strict=True)]
        x, y, z = (a + first for a, first in zip(at, facts["lo"], strict=True))
        found[x, y, z] = (h * facts["unit"], p * facts["unit"])
    assert len(found) == len(hits) == facts["voxels"]
    return found


def air_of(payload: bytes) -> dict[tuple[int, int, int], float]:
    """Passes [votes] of each voxel without hits that the page gets."""
    facts, sections = parts_of(payload)
    air, size = facts["air"], facts["bytes"]
    width = facts["hi"][1] - facts["lo"][1]
    found: dict[tuple[int, int, int], float] = {}
    for slab in air["slabs"]:
        rows, gaps, lengths, passes = (
            numbers_of(sections, f"air.{slab}.{name}", n)
            for name, n in (("rows", 4), ("gaps", 2), ("lengths", 2), ("passes", size))
        )
        row = x = at = 0
        for step, gap, less in zip(rows, gaps, lengths, strict=True):
            row, x = row + step, (x + gap) % 65536
            height, y = divmod(row, width)
            for _ in range(less + 1):
                place = (x, y, slab * air["heights"] + height)
                voxel = tuple(a + b for a, b in zip(place, facts["lo"], strict=True))
                found[voxel[0], voxel[1], voxel[2]] = passes[at] * facts["unit"]
                x, at = x + 1, at + 1
        assert at == len(passes)
    return found


def cells_of(payload: bytes) -> dict[Cell, tuple[float, float]]:
    """Hits and passes [votes] of each cell that has any."""
    facts, sections = parts_of(payload)
    assert facts["kind"] == "plane"
    return _cells_of(facts, sections)


def _cells_of(facts: dict[str, Any], sections: dict[str, bytes]) -> dict[Cell, tuple[float, float]]:
    side, size, unit = facts["tile"], facts["bytes"], facts["unit"]
    coords = numbers_of(sections, "coords", 4)
    hits, passes = (numbers_of(sections, name, size) for name in ("hits", "passes"))
    assert len(hits) == len(passes) == facts["tiles"] * side * side
    found: dict[Cell, tuple[float, float]] = {}
    for at, pair in enumerate(zip(hits, passes, strict=True)):
        if pair == (0, 0):
            continue
        tile, within = divmod(at, side * side)
        y, x = divmod(within, side)
        cell = (
            facts["first_cell"][0] + coords[2 * tile] * side + x,
            facts["first_cell"][1] + coords[2 * tile + 1] * side + y,
        )
        found[cell] = (pair[0] * unit, pair[1] * unit)
    return found
