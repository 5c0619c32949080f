# SPDX-License-Identifier: Apache-2.0
"""Octrees as sorted leaves: Morton codes in, OctoMap's depth-first nodes out, and back.

The Morton code of a cell holds its place bit by bit, x lowest: ... z1 y1 x1 z0 y0 x0. A cube of
2^level cells per side, aligned to its size, covers the codes [code, code + 8^level). So disjoint
cubes in the order of their codes are the leaves of an octree in depth-first order, child x + 2y +
4z of a node being number 0 to 7: OctoMap's order.

The tree has `DEPTH` levels below its root; a node at depth d is a cube of level `DEPTH` - d.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined, kernel

__all__ = ["DEPTH", "KEPT", "Branch", "Nodes", "lay_out", "new_branch", "read_nodes", "read_pairs"]

DEPTH = 16
KEPT = 8 * DEPTH
"""Of the nodes laid out the last so many may still be merged: of each depth, a node and seven."""

# What a reader found: `FINE`, or the fault that stopped it.
FINE = 0
CUT_OFF = 1
TOO_DEEP = 2
CHILDLESS = 3

Codes = npt.NDArray[np.int64]
Levels = npt.NDArray[np.uint8]
Values = npt.NDArray[np.float32]

CODE, LAST, NODES, BASE, LATE = range(5)
UNLIKE = -1


class Nodes(NamedTuple):
    """Nodes of a tree, depth first."""

    value: Values
    """Log odds."""
    children: npt.NDArray[np.uint8]
    """A bit for each child that there is; 0: a leaf."""
    pairs: npt.NDArray[np.uint16]
    """Two bits for each child: 0 none, 1 a leaf below zero, 2 one of zero or more, 3 an inner node.
    """


class Branch(NamedTuple):
    """The nodes that are not complete, by depth: those from the root to the last leaf."""

    at: npt.NDArray[np.int64]
    """Their numbers."""
    children: npt.NDArray[np.int64]
    pairs: npt.NDArray[np.int64]
    highest: Values
    """The largest of their leaves so far."""
    alike: npt.NDArray[np.int64]
    """How many children there are, all equal leaves; `UNLIKE` where they are anything else."""
    first: Values
    """The first child's value, where they are alike."""
    state: npt.NDArray[np.int64]
    """The last leaf's code and depth, the count of nodes so far, the number of the first that is
    still held in arrays, how many `lay_out` had to complete before that."""


def new_branch() -> Branch:
    """Of a tree that has no leaf yet."""
    whole = [np.zeros(DEPTH + 1, np.int64) for _ in range(4)]
    highest, first = (np.zeros(DEPTH + 1, np.float32) for _ in range(2))
    at, children, pairs, alike = whole
    return Branch(at, children, pairs, highest, alike, first, np.zeros(5, np.int64))


@inlined
def _shared_depth(one: int, other: int) -> int:
    # Depth of the smallest node that holds both codes.
    depth = DEPTH
    differ = one ^ other
    while differ != 0:
        differ >>= 3
        depth -= 1
    return depth


@inlined
def _open(branch: Branch, nodes: Nodes, d: int) -> None:
    at = branch.state[NODES]
    branch.state[NODES] += 1
    # Not 0, which is a leaf's: what is open when it is written out has children.
    nodes.children[at - branch.state[BASE]] = 255
    branch.at[d], branch.children[d], branch.pairs[d] = at, 0, 0
    branch.highest[d], branch.alike[d] = -np.inf, 0


@inlined
def _add_leaf(branch: Branch, d: int, slot: int, value: float) -> None:
    # To the open node at depth d, as a child.
    branch.children[d] |= 1 << slot
    branch.pairs[d] |= (2 if value >= 0.0 else 1) << (2 * slot)
    branch.highest[d] = max(branch.highest[d], value)
    if branch.alike[d] == 0:
        branch.alike[d], branch.first[d] = 1, value
    elif branch.alike[d] > 0 and branch.first[d] == value:
        branch.alike[d] += 1
    else:
        branch.alike[d] = UNLIKE


@inlined
def _close(branch: Branch, nodes: Nodes, late: Nodes, late_at: Codes, d: int) -> None:
    at = branch.at[d]
    slot = (branch.state[CODE] >> (3 * (DEPTH - d))) & 7
    place = at - branch.state[BASE]
    if d > 0 and branch.alike[d] == 8:
        # Eight equal leaves, which lie just behind it: one leaf in their place.
        branch.state[NODES] = at + 1
        nodes.value[place], nodes.children[place], nodes.pairs[place] = branch.first[d], 0, 0
        _add_leaf(branch, d - 1, slot, branch.first[d])
    else:
        if place >= 0:
            nodes.value[place] = branch.highest[d]
            nodes.children[place] = np.uint8(branch.children[d])
            nodes.pairs[place] = np.uint16(branch.pairs[d])
        else:
            k = branch.state[LATE]
            branch.state[LATE] += 1
            late_at[k], late.value[k] = at, branch.highest[d]
            late.children[k] = np.uint8(branch.children[d])
            late.pairs[k] = np.uint16(branch.pairs[d])
        if d > 0:
            branch.children[d - 1] |= 1 << slot
            branch.pairs[d - 1] |= 3 << (2 * slot)
            branch.highest[d - 1] = max(branch.highest[d - 1], branch.highest[d])
            branch.alike[d - 1] = UNLIKE


@borrowing
def lay_out(
    code: Codes,
    level: Levels,
    value: Values,
    done: bool,
    branch: Branch,
    nodes: Nodes,
    late: Nodes,
    late_at: Codes,
) -> None:
    """Go on with the nodes of a tree, depth first, by some more of its leaves.

    Eight equal leaves of one node become one, again and again; the root stays: OctoMap prunes nodes
    of depth 1 to 15 alone. An inner node's value is the largest of its leaves.

    Args:
        code: of the leaves, in order, each beyond those before, shape (n,).
        level: shape (n,).
        value: shape (n,).
        done: True: these were the last.
        branch: what is open; see `new_branch`.
        nodes: filled from `branch.state[NODES]` - `branch.state[BASE]` on, with room for
            DEPTH * n + 1 more. All but the last `KEPT` are final, and those that are open.
        late: filled with nodes that lie before `nodes`, which are complete now; of length DEPTH.
        late_at: their numbers, likewise. There are `branch.state[LATE]`.
    """
    state = branch.state
    state[LATE] = 0
    for i in range(code.shape[0]):
        depth = DEPTH - np.int64(level[i])
        shared = 0
        if state[NODES] == 0:
            _open(branch, nodes, 0)
        else:
            shared = _shared_depth(state[CODE], code[i])
        for d in range(state[LAST] - 1, shared, -1):
            _close(branch, nodes, late, late_at, d)
        for d in range(shared + 1, depth):
            _open(branch, nodes, d)
        place = state[NODES] - state[BASE]
        nodes.value[place], nodes.children[place], nodes.pairs[place] = value[i], 0, 0
        state[NODES] += 1
        state[CODE], state[LAST] = code[i], depth
        _add_leaf(branch, depth - 1, (code[i] >> (3 * (DEPTH - depth))) & 7, value[i])
    if done:
        for d in range(state[LAST] - 1, -1, -1):
            _close(branch, nodes, late, late_at, d)


@kernel
def read_pairs(
    pairs: npt.NDArray[np.uint16], code: Codes, level: Levels, occupied: npt.NDArray[np.bool_]
) -> tuple[int, int, int, int]:
    """Read the nodes of a `.bt`; its leaves go to `code`, `level` and `occupied`.

    Returns:
        fault, words read, leaves, nodes.
    """
    word = np.zeros(DEPTH, np.uint16)
    slot = np.zeros(DEPTH, np.int64)
    prefix = np.zeros(DEPTH, np.int64)
    if pairs.shape[0] == 0:
        return CUT_OFF, 0, 0, 0
    word[0] = pairs[0]
    read, leaves, nodes, depth = 1, 0, 1, 0
    while depth >= 0:
        s = slot[depth]
        if s == 8:
            depth -= 1
            continue
        slot[depth] = s + 1
        kind = (np.int64(word[depth]) >> (2 * s)) & 3
        if kind == 0:
            continue
        nodes += 1
        child = prefix[depth] * 8 + s
        if kind < 3:
            level[leaves] = DEPTH - 1 - depth
            code[leaves] = child << (3 * (DEPTH - 1 - depth))
            occupied[leaves] = kind == 2
            leaves += 1
            continue
        if depth == DEPTH - 1:
            return TOO_DEEP, read, leaves, nodes
        if read == pairs.shape[0]:
            return CUT_OFF, read, leaves, nodes
        if pairs[read] == 0:
            return CHILDLESS, read, leaves, nodes
        depth += 1
        word[depth] = pairs[read]
        slot[depth] = 0
        prefix[depth] = child
        read += 1
    return FINE, read, leaves, nodes


@kernel
def read_nodes(
    children: npt.NDArray[np.uint8], code: Codes, level: Levels, node: npt.NDArray[np.int64]
) -> tuple[int, int, int]:
    """Read the nodes of an `.ot`; its leaves go to `code` and `level`, their numbers to `node`.

    Returns:
        fault, nodes read, leaves.
    """
    slot = np.zeros(DEPTH + 1, np.int64)
    mask = np.zeros(DEPTH + 1, np.int64)
    prefix = np.zeros(DEPTH + 1, np.int64)
    read, leaves, depth, child = 0, 0, 0, np.int64(0)
    while True:
        if read == children.shape[0]:
            return CUT_OFF, read, leaves
        mask[depth] = children[read]
        slot[depth] = 0
        prefix[depth] = child
        if mask[depth] == 0:
            level[leaves] = DEPTH - depth
            code[leaves] = child << (3 * (DEPTH - depth))
            node[leaves] = read
            leaves += 1
        elif depth == DEPTH:
            return TOO_DEEP, read, leaves
        read += 1
        # On to the next child of the deepest node that has one left.
        while depth >= 0 and (mask[depth] >> slot[depth]) == 0:
            depth -= 1
        if depth < 0:
            return FINE, read, leaves
        while (mask[depth] >> slot[depth]) & 1 == 0:
            slot[depth] += 1
        child = prefix[depth] * 8 + slot[depth]
        slot[depth] += 1
        depth += 1
