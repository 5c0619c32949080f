# SPDX-License-Identifier: Apache-2.0
"""Writing an OctoMap: `.bt`, free and occupied, or `.ot`, log odds.

The files are pruned as OctoMap prunes: eight equal leaves of one node become one. Cell i has the
key i + 32768 along each axis, in a tree of 16 levels.

Source: Hornung et al.: OctoMap (2013); OccupancyOcTreeBase.hxx (writeBinaryNode),
OcTreeBaseImpl.hxx (writeNodesRecurs), AbstractOcTree.cpp (the header).
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError
from oddsmap.map_files.fields import Leaves, OfLogOdds
from oddsmap.map_files.front import put_in_front
from oddsmap.map_files.octomap_range import HALF, Shift, check_keys
from oddsmap.odds import State, Thresholds, logit, sigmoid

__all__ = ["HALF", "NODE", "OCTOMAP_CLAMP", "save_octomap", "write_nodes"]

OCTOMAP_CLAMP = (0.1192, 0.971)
"""The probabilities to which OctoMap clamps by default: -2 and 3.5 in log odds."""

NODE = np.dtype([("log_odds", "<f4"), ("children", "u1")])
"""A node of an `.ot`: 5 bytes, nothing between them."""

_PAIRS = np.dtype("<u2")

_COMMENT = "# (feel free to add / change comments, but leave the first line as it is!)\n#\n"


def save_octomap(
    voxels: Leaves,
    path: str | Path,
    *,
    clamp: tuple[float, float] | None = None,
    thresholds: Thresholds | None = None,
    shift: Shift | None = None,
    force: bool = False,
) -> Path:
    """Write a map as OctoMap writes it; the suffix says which of the two formats.

    - `.ot` keeps the log odds in single precision, and an inner node's is the largest of its
      children's. They are as the map has them: a long-seen cell lies beyond the bounds to which
      OctoMap clamps. It reads such a file without loss. With `clamp=OCTOMAP_CLAMP` the file is
      what OctoMap would write of a clamped map, smaller as more of it can be pruned.
    - `.bt` says free or occupied by the thresholds; cells undecided between them are occupied
      where p >= 0.5, which is OctoMap's own limit for all cells.

    Unknown cells are in neither.

    Args:
        voxels: the map's leaves.
        path: the file to write, named `.bt` or `.ot`.
        clamp: lowest and highest probability written to an `.ot`; None: as they are.
        thresholds: what is free and what is occupied in a `.bt`; by default 0.196, 0.65.
        shift: the point of the map that is the origin of the leaves given, which a comment in the
            file names; None: the map's own.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: a cell lies outside OctoMap's 65536 cells along an axis.
        ConfigError: the suffix is another, or `clamp` is not two probabilities around 0.5.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    binary = path.suffix == ".bt"
    if path.suffix not in (".bt", ".ot"):
        raise ConfigError(f"{path}: an OctoMap is named .bt (free or occupied) or .ot (log odds)")
    check_output(path, force=force)
    check_keys(path, voxels.bounds(), voxels.resolution)
    if clamp is not None:
        _check_clamp(clamp, path)
    moved = "" if shift is None or not shift.cells.any() else f"# {shift.words()}\n"
    with atomic_output(path, force=force) as part, part.open("w+b") as file:
        count = write_nodes(voxels, file, binary=binary, clamp=clamp, thresholds=thresholds)
        header = (
            f"# Octomap OcTree {'binary ' if binary else ''}file\n{_COMMENT}{moved}"
            # All digits: OctoMap's own writer keeps 6, so that cells of 1/3 m come back smaller.
            f"id OcTree\nsize {count}\nres {float(voxels.resolution)!r}\ndata\n"
        )
        put_in_front(file, header.encode("ascii"))
    return path


def write_nodes(
    voxels: Leaves,
    file: BinaryIO,
    *,
    binary: bool,
    clamp: tuple[float, float] | None = None,
    thresholds: Thresholds | None = None,
) -> int:
    """Write the nodes alone, without a header: how many there are.

    Args:
        voxels: the map's leaves, within OctoMap's keys: their codes are counted from its first.
        file: a new file, which takes them from its beginning on.
        binary: True for the nodes of a `.bt`, False for those of an `.ot`.
        clamp: see `save_octomap`.
        thresholds: see `save_octomap`.
    """
    from oddsmap.map_files.octomap_nodes import NodeFile

    nodes = NodeFile(file, _PAIRS if binary else NODE)
    for leaves in voxels.parts(_sign(thresholds or Thresholds()) if binary else _clamped(clamp)):
        nodes.add(*leaves)
    nodes.finish()
    return nodes.count


def _sign(limits: Thresholds) -> OfLogOdds:
    """What gives 1 where a cell is occupied and -1 where it is free."""

    def sign(log_odds: FloatArray) -> npt.NDArray[np.float32]:
        state = limits.state(sigmoid(log_odds), np.ones(log_odds.shape, np.bool_))
        occupied = np.where(state == State.UNDECIDED, log_odds >= 0.0, state == State.OCCUPIED)
        return np.where(occupied, np.float32(1), np.float32(-1))

    return sign


def _clamped(clamp: tuple[float, float] | None) -> OfLogOdds:
    """What gives log odds in single precision, within the bounds."""
    if clamp is None:
        return lambda log_odds: log_odds.astype(np.float32)
    lowest, highest = (float(logit(p)) for p in clamp)
    return lambda log_odds: np.clip(log_odds, lowest, highest).astype(np.float32)


def _check_clamp(clamp: tuple[float, float], path: Path) -> None:
    low, high = clamp
    if not 0.0 < low < 0.5 < high < 1.0:
        raise ConfigError(
            f"{path}: clamp needs probabilities 0 < low < 0.5 < high < 1, got {low} and {high}"
        )
