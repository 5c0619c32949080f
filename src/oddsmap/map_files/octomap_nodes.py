# SPDX-License-Identifier: Apache-2.0
"""The nodes of an OctoMap written to a file as its leaves come: memory for some, never for all."""

from __future__ import annotations

from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.kernels import octree

__all__ = ["NodeFile"]

_LEAVES = 1 << 16  # laid out at a time


class NodeFile:
    """Writes nodes depth first, from leaves in the order of their codes.

    A node comes before those below it, and says which there are: the few that are open when others
    behind them are written out are written again when they are complete.

    Args:
        file: a new file, which takes the nodes from its beginning on.
        kind: what is written: fields "log_odds" and "children" of each node (`.ot`), or a number
            alone: two bits for each child of an inner node (`.bt`).
    """

    def __init__(self, file: BinaryIO, kind: np.dtype[Any]) -> None:
        self._file, self._kind = file, kind
        self._branch = octree.new_branch()
        self._nodes = _room(octree.KEPT + octree.DEPTH * _LEAVES + 1)
        self._late, self._late_at = _room(octree.DEPTH + 1), np.zeros(octree.DEPTH + 1, np.int64)
        self._written = 0
        self._open: dict[int, int] = {}  # place in the file of nodes that are not complete

    @property
    def count(self) -> int:
        """Nodes of the tree so far, written or not."""
        return int(self._branch.state[octree.NODES])

    def add(
        self, code: IntArray, level: npt.NDArray[np.uint8], value: npt.NDArray[np.float32]
    ) -> None:
        """Add some more leaves: see `oddsmap.kernels.octree.lay_out`."""
        for start in range(0, len(code), _LEAVES):
            part = slice(start, start + _LEAVES)
            self._lay_out(code[part], level[part], value[part], done=False)
            held = self.count - int(self._branch.state[octree.BASE])
            self._write(max(0, held - octree.KEPT))

    def finish(self) -> None:
        """Write what is left, once all leaves have come."""
        nothing = np.zeros(0, np.int64)
        self._lay_out(nothing, nothing.astype(np.uint8), nothing.astype(np.float32), done=True)
        self._write(self.count - int(self._branch.state[octree.BASE]))

    def _lay_out(
        self,
        code: IntArray,
        level: npt.NDArray[np.uint8],
        value: npt.NDArray[np.float32],
        *,
        done: bool,
    ) -> None:
        octree.lay_out(
            code, level, value, done, self._branch, self._nodes, self._late, self._late_at
        )
        end = self._file.tell()
        for k in range(int(self._branch.state[octree.LATE])):
            self._file.seek(self._kind.itemsize * self._open.pop(int(self._late_at[k])))
            self._file.write(self._bytes(_some(self._late, slice(k, k + 1))))
        self._file.seek(end)

    def _write(self, many: int) -> None:
        """Write the first nodes of those held, and move the others to their place."""
        nodes, base = _some(self._nodes, slice(0, many)), int(self._branch.state[octree.BASE])
        if self._kind.names is None:  # inner nodes alone
            inner = np.flatnonzero(nodes.children)
            nodes = _some(nodes, inner)
        for number in self._branch.at[: self._branch.state[octree.LAST]].tolist():
            if base <= number < base + many:
                before = number - base
                if self._kind.names is None:
                    before = int(np.searchsorted(inner, before))
                self._open[number] = self._written + before
        self._file.write(self._bytes(nodes))
        self._written += len(nodes.value)
        held = self.count - base
        for field in self._nodes:
            field[: held - many] = field[many:held].copy()
        self._branch.state[octree.BASE] += many

    def _bytes(self, nodes: octree.Nodes) -> bytes:
        if self._kind.names is None:
            return nodes.pairs.astype(self._kind).tobytes()
        written = np.empty(len(nodes.value), self._kind)
        written["log_odds"], written["children"] = nodes.value, nodes.children
        return written.tobytes()


def _some(nodes: octree.Nodes, which: slice | IntArray) -> octree.Nodes:
    return octree.Nodes(nodes.value[which], nodes.children[which], nodes.pairs[which])


def _room(count: int) -> octree.Nodes:
    return octree.Nodes(
        np.zeros(count, np.float32), np.zeros(count, np.uint8), np.zeros(count, np.uint16)
    )
