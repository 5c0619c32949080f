"""OctoMap's formats node by node, as its source does it: slow and obvious."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

HALF = 32768

Cell = tuple[int, int, int]
Leaf = tuple[Cell, int]  # lowest cell, cells a side


@dataclass
class Node:
    value: float = 0.0
    children: dict[int, Node] = field(default_factory=dict)


def build(leaves: dict[Leaf, float]) -> Node | None:
    if not leaves:
        return None
    root = Node()
    for (cell, side), value in leaves.items():
        node, size = root, 65536
        while size > side:
            size //= 2
            x, y, z = (((i + HALF) // size) % 2 for i in cell)
            node = node.children.setdefault(x + 2 * y + 4 * z, Node())
        node.value = value
    for child in root.children.values():  # OctoMap never prunes the root
        _prune(child)
    root.value = max(child.value for child in root.children.values())
    return root


def _prune(node: Node) -> None:
    if not node.children:
        return
    for child in node.children.values():
        _prune(child)
    values = [child.value for child in node.children.values()]
    node.value = max(values)
    alike = len(values) == 8 and len(set(values)) == 1
    if alike and not any(child.children for child in node.children.values()):
        node.children = {}


def size(node: Node | None) -> int:
    return 0 if node is None else 1 + sum(size(child) for child in node.children.values())


def full(node: Node | None) -> bytes:
    if node is None:
        return b""
    mask = sum(1 << slot for slot in node.children)
    inner = b"".join(full(node.children[slot]) for slot in sorted(node.children))
    return struct.pack("<fB", node.value, mask) + inner


def binary(node: Node | None) -> bytes:
    if node is None:
        return b""
    word, inner = 0, b""
    for slot in sorted(node.children):
        child = node.children[slot]
        if child.children:
            word |= 3 << 2 * slot
            inner += binary(child)
        else:
            word |= (2 if child.value >= 0 else 1) << 2 * slot
    return struct.pack("<H", word) + inner


def header(node: Node | None, resolution: float, kind: str) -> bytes:
    return (
        f"# Octomap OcTree {kind}file\n"
        "# (feel free to add / change comments, but leave the first line as it is!)\n#\n"
        f"id OcTree\nsize {size(node)}\nres {resolution}\ndata\n"
    ).encode()


def leaves(node: Node | None) -> dict[Leaf, float]:
    found: dict[Leaf, float] = {}

    def visit(node: Node, cell: Cell, side: int) -> None:
        if not node.children:
            found[cell, side] = node.value
        for slot, child in node.children.items():
            half = side // 2
            x, y, z = cell
            place = (x + half * (slot & 1), y + half * (slot >> 1 & 1), z + half * (slot >> 2))
            visit(child, place, half)

    if node is not None:
        visit(node, (-HALF, -HALF, -HALF), 65536)
    return found
