# SPDX-License-Identifier: Apache-2.0
"""Octrees as sorted leaves: Morton codes in, OctoMap's depth-first nodes out, and back.

The Morton code of a cell holds its place bit by bit, x lowest: ... z1 y1 x1 z0 y0 x0. A cube of
2^level cells per side, aligned to its size, covers the codes [code, code + 8^level). So disjoint
cubes in the order of their codes are the leaves of an octree in depth-first order, child x + 2y +
4z of a node being number 0 to 7: OctoMap's order.

The tree has `DEPTH` levels below its root; a node at depth d is a cube of level `DEPTH` - d.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import kernel

__all__ = ["DEPTH", "lay_out", "node_count", "prune", "read_nodes", "read_pairs"]

DEPTH = 16

# What a reader found: `FINE`, or the fault that stopped it.
FINE = 0
CUT_OFF = 1
TOO_DEEP = 2
CHILDLESS = 3

Codes = npt.NDArray[np.int64]
Levels = npt.NDArray[np.uint8]
Values = npt.NDArray[np.float32]


@kernel
def prune(code: Codes, level: Levels, value: Values) -> int:
    """Merge eight equal leaves of one node into one, again and again, in place; leaves left.

    The root stays: OctoMap prunes nodes of depth 1 to 15 alone.
    """
    n = 0
    for i in range(code.shape[0]):
        code[n], level[n], value[n] = code[i], level[i], value[i]
        n += 1
        # The eighth child came last: its seven sisters lie just before it, if they are leaves.
        while n >= 8 and level[n - 1] < DEPTH - 1:
            k = level[n - 1]
            first = code[n - 8]
            if code[n - 1] - first != np.int64(7) << np.int64(3 * k):
                break
            if (first >> np.int64(3 * k)) & 7 != 0:
                break
            alike = True
            for j in range(n - 8, n - 1):
                # Nothing else fits between: levels and codes of disjoint leaves in order.
                if level[j] != k or value[j] != value[n - 1]:
                    alike = False
            if not alike:
                break
            n -= 7
            level[n - 1] = k + 1
    return n


@kernel
def _shared_depth(one: int, other: int) -> int:
    # Depth of the smallest node that holds both codes.
    depth = DEPTH
    differ = one ^ other
    while differ != 0:
        differ >>= 3
        depth -= 1
    return depth


@kernel
def node_count(code: Codes, level: Levels) -> int:
    """Nodes of the tree with these leaves, the root and the leaves among them."""
    nodes = 1
    shared = 0
    for i in range(code.shape[0]):
        if i > 0:
            shared = _shared_depth(code[i - 1], code[i])
        nodes += DEPTH - int(level[i]) - shared
    return nodes


@kernel
def lay_out(
    code: Codes,
    level: Levels,
    value: Values,
    node_value: Values,
    children: npt.NDArray[np.uint8],
    pairs: npt.NDArray[np.uint16],
) -> None:
    """Write the nodes depth first: the value, which children exist, and of which kind they are.

    An inner node's value is the largest of its leaves. `children` has a bit, `pairs` has two bits
    per child: 0 none, 1 a leaf below zero, 2 a leaf of zero or more, 3 an inner node. Sizes as
    `node_count` says, all zero but for `node_value`.
    """
    path = np.zeros(DEPTH + 1, np.int64)  # the open node at each depth; all start at the root
    node_value[0] = -np.inf
    n = 1
    shared = 0
    for i in range(code.shape[0]):
        depth = DEPTH - np.int64(level[i])
        if i > 0:
            shared = _shared_depth(code[i - 1], code[i])
        for d in range(shared + 1, depth + 1):
            slot = (code[i] >> (3 * (DEPTH - d))) & 7
            kind = 3
            if d == depth:
                kind = 2 if value[i] >= 0.0 else 1
            children[path[d - 1]] |= np.uint8(1 << slot)
            pairs[path[d - 1]] |= np.uint16(kind << (2 * slot))
            path[d] = n
            node_value[n] = -np.inf
            n += 1
        for d in range(depth + 1):
            node_value[path[d]] = max(node_value[path[d]], value[i])


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
