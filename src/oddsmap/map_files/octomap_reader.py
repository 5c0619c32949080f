# SPDX-License-Identifier: Apache-2.0
"""Reading an OctoMap (`.bt`, `.ot`): it has no counts, so it becomes a `VoxelMap`.

Source: Hornung et al.: OctoMap (2013); AbstractOcTree.cpp (readHeader), OccupancyOcTreeBase.hxx
(readBinaryNode), OcTreeBaseImpl.hxx (readNodesRecurs).
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError, shown
from oddsmap.limits import check_content_size
from oddsmap.map_files.morton import unmorton
from oddsmap.map_files.octomap_range import HALF
from oddsmap.map_files.octomap_writer import NODE, OCTOMAP_CLAMP
from oddsmap.odds import logit

__all__ = ["OctoMapLeaves", "is_octomap", "read_octomap"]

_MAGIC = b"# Octomap OcTree "
_BINARY, _FULL = b"# Octomap OcTree binary file", b"# Octomap OcTree file"

# Kinds of trees, and how a node of their .ot looks; "1" is an OcTree of 2010. Colours are left out.
_COLOUR = np.dtype([("log_odds", "<f4"), ("colour", "u1", 3), ("children", "u1")])
_NODES = {"OcTree": NODE, "1": NODE, "ColorOcTree": _COLOUR}

# Leaves in each byte of a .bt: pairs of bits that are 01 or 10.
_LEAVES = np.array(
    [sum((byte >> shift) & 3 in (1, 2) for shift in (0, 2, 4, 6)) for byte in range(256)], np.uint8
)


@dataclass(frozen=True, slots=True)
class _Header:
    binary: bool
    id: str
    size: int
    resolution: float
    end: int


class OctoMapLeaves(NamedTuple):
    """The leaves of an OctoMap, in the order of the arguments of `oddsmap.VoxelMap`."""

    cells: IntArray
    log_odds: FloatArray
    resolution: float
    level: npt.NDArray[np.uint8]


def is_octomap(path: str | os.PathLike[str]) -> bool:
    """Whether a file starts as an OctoMap does."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except (FileNotFoundError, IsADirectoryError):
        return False


def read_octomap(path: str | os.PathLike[str]) -> OctoMapLeaves:
    """Read the leaves of an OctoMap: see `oddsmap.load_octomap`."""
    path = Path(path)
    try:
        check_content_size(path, path.stat().st_size, "the OctoMap")
        content = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError):
        raise InputError(f"{path}: no such file; give the .bt or .ot of an OctoMap") from None
    header = _read_header(content, path)
    read = _read_binary if header.binary else _read_full
    code, level, log_odds = read(content, header, path)
    return OctoMapLeaves(unmorton(code) - HALF, log_odds, header.resolution, level)


def _read_header(content: bytes, path: Path) -> _Header:
    binary = content.startswith(_BINARY)
    if not (binary or content.startswith(_FULL)):
        raise InputError(f'{path}: not an OctoMap: the first line is not "{_BINARY.decode()}"')
    fields: dict[str, str] = {}
    at = 0
    while True:
        end = content.find(b"\n", at)
        if end < 0 or len(fields) > 16:
            raise InputError(f'{path}: the header of the OctoMap has no line "data"; it is cut off')
        words = content[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and words[0] == "data":
            break
        if words and not words[0].startswith("#"):
            fields[words[0]] = words[1] if len(words) > 1 else ""
    missing = [name for name in ("id", "size", "res") if name not in fields]
    if missing:
        raise InputError(f"{path}: the header of the OctoMap lacks {', '.join(missing)}")
    if fields["id"] not in _NODES:
        raise InputError(
            f"{path}: an OctoMap of type {shown(fields['id'])}; OcTree and ColorOcTree can be read"
        )
    try:
        size, resolution = int(fields["size"]), float(fields["res"])
    except ValueError:
        size, resolution = -1, math.nan
    if size < 0 or not 0.0 < resolution < math.inf:
        raise InputError(
            f"{path}: the header needs a count and a positive resolution [m], "
            f"got size {shown(fields['size'])}, res {shown(fields['res'])}"
        )
    return _Header(binary, fields["id"], size, resolution, at)


_Leaves = tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8], npt.NDArray[np.float64]]


def _read_binary(content: bytes, header: _Header, path: Path) -> _Leaves:
    from oddsmap.kernels import octree

    data = np.frombuffer(content, np.uint8, offset=header.end)
    pairs = data[: len(data) // 2 * 2].view("<u2").astype(np.uint16)
    room = int(_LEAVES[data].sum(dtype=np.int64))
    code, level = np.empty(room, np.int64), np.empty(room, np.uint8)
    occupied = np.empty(room, np.bool_)
    fault, read, leaves, nodes = octree.FINE, 0, 0, 0
    if header.size > 0:
        fault, read, leaves, nodes = octree.read_pairs(pairs, code, level, occupied)
    _check(path, header, fault, nodes=nodes, used=2 * read, held=len(data))
    low, high = (np.float64(np.float32(logit(p))) for p in OCTOMAP_CLAMP)
    return code[:leaves], level[:leaves], np.where(occupied[:leaves], high, low)


def _read_full(content: bytes, header: _Header, path: Path) -> _Leaves:
    from oddsmap.kernels import octree

    kind = _NODES[header.id]
    held = len(content) - header.end
    nodes = np.frombuffer(content, kind, offset=header.end, count=held // kind.itemsize)
    children = np.ascontiguousarray(nodes["children"])
    room = int(np.count_nonzero(children == 0))
    code, level = np.empty(room, np.int64), np.empty(room, np.uint8)
    number = np.empty(room, np.int64)
    fault, read, leaves = octree.FINE, 0, 0
    if header.size > 0:
        fault, read, leaves = octree.read_nodes(children, code, level, number)
    _check(path, header, fault, nodes=read, used=read * kind.itemsize, held=held)
    log_odds = nodes["log_odds"][number[:leaves]].astype(np.float64)
    wrong = np.flatnonzero(~np.isfinite(log_odds))
    if wrong.size:
        raise InputError(
            f"{path}: {wrong.size} leaves have log odds that are not finite; it is damaged"
        )
    if leaves == 1 and level[0] == octree.DEPTH:
        # The root alone, the whole world: as its eight children, on both sides of the origin.
        code, level = (
            np.arange(8) << (3 * (octree.DEPTH - 1)),
            np.full(8, octree.DEPTH - 1, np.uint8),
        )
        return code, level, np.repeat(log_odds, 8)
    return code[:leaves], level[:leaves], log_odds


def _check(path: Path, header: _Header, fault: int, *, nodes: int, used: int, held: int) -> None:
    from oddsmap.kernels import octree

    if fault == octree.CUT_OFF:
        raise InputError(
            f"{path}: announces {header.size} nodes, ends after {nodes} ({held} bytes of data); "
            "it is cut off"
        )
    if fault != octree.FINE:
        what = (
            "a node below depth 16"
            if fault == octree.TOO_DEEP
            else "an inner node without children"
        )
        raise InputError(f"{path}: {what} at byte {header.end + used}; it is damaged")
    if nodes != header.size:
        raise InputError(f"{path}: announces {header.size} nodes, holds {nodes}; it is damaged")
    if used != held:
        raise InputError(
            f"{path}: {held - used} bytes after the last of {nodes} nodes; it is damaged"
        )
