# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: no array is leaked."""

from __future__ import annotations

import ast
import textwrap
from pathlib import Path

import oddsmap.kernels

KERNELS = Path(oddsmap.kernels.__file__).parent
DECORATORS = {"kernel", "borrowing", "inlined"}
# What a function that makes no array may return.
SCALARS = {"None", "int", "float", "bool"}


def functions(trees: dict[str, ast.Module]) -> dict[str, tuple[str, ast.FunctionDef]]:
    """Compiled functions by full name: how each is compiled, and its tree."""
    found = {}
    for module, tree in trees.items():
        for node in tree.body:
            if isinstance(node, ast.FunctionDef):
                how = {ast.unparse(d) for d in node.decorator_list} & DECORATORS
                if how:
                    found[f"{module}.{node.name}"] = (how.pop(), node)
    return found


def calls(module: str, tree: ast.Module, node: ast.FunctionDef) -> set[str]:
    """Full names of the functions of kernels that a function calls by name."""
    home = {
        alias.asname or alias.name: f"{each.module}.{alias.name}"
        for each in tree.body
        if isinstance(each, ast.ImportFrom)
        for alias in each.names
    }
    return {
        home.get(call.func.id, f"{module}.{call.func.id}")
        for call in ast.walk(node)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
    }


def leaks(trees: dict[str, ast.Module]) -> list[str]:
    """Borrowing functions that are handed an array by a function that may have made it.

    Functions inlined into them count as their own lines.
    """
    known = functions(trees)
    found = []
    for name, (how, _) in known.items():
        if how != "borrowing":
            continue
        todo, seen = [name], {name}
        while todo:
            caller = todo.pop()
            module = caller.rsplit(".", 1)[0]
            for callee in calls(module, trees[module], known[caller][1]) & set(known):
                kind, node = known[callee]
                if kind == "inlined" and callee not in seen:
                    seen.add(callee)
                    todo.append(callee)
                elif kind == "kernel" and ast.unparse(node.returns or node) not in SCALARS:
                    found.append(f"{name} gets an array from {callee} and never frees it")
    return found


def test_no_borrowing_kernel_is_handed_a_new_array() -> None:
    trees = {
        "oddsmap." + ".".join(file.relative_to(KERNELS.parent).with_suffix("").parts): ast.parse(
            file.read_text(encoding="utf-8")
        )
        for file in KERNELS.rglob("*.py")
    }
    known = functions(trees)
    assert {how for how, _ in known.values()} == DECORATORS
    assert leaks(trees) == []


def test_the_test_above_sees_a_leak() -> None:
    code = """
        from oddsmap.kernels.jit import borrowing, inlined, kernel
        @kernel
        def make(n: int) -> Array: return np.empty(n)
        @kernel
        def count(n: int) -> int: return np.empty(n).shape[0]
        @inlined
        def through(n: int) -> Array: return make(n)
        @borrowing
        def bad(n: int) -> float: return make(n)[0]
        @borrowing
        def worse(n: int) -> float: return through(n)[0]
        @borrowing
        def good(n: int) -> int: return count(n)
        @kernel
        def careful(n: int) -> float: return make(n)[0]
    """
    found = leaks({"m": ast.parse(textwrap.dedent(code))})
    assert [line.split()[0] for line in found] == ["m.bad", "m.worse"]
