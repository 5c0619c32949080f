# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: no array is leaked, and no machine code outlives its sources."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

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


PACKAGE = {
    "__init__.py": "",
    "helper.py": (
        "from {name}.jit import inlined\n"
        "@inlined\ndef step(x: int) -> int:\n    return x + {step}\n"
    ),
    "outer.py": (
        "from {name}.helper import step\nfrom {name}.jit import kernel\n"
        "@kernel\ndef answer(x: int) -> int:\n    return step(x)\n"
    ),
}


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
@pytest.mark.parametrize("cache", ["beside the sources", "NUMBA_CACHE_DIR"])
def test_an_upgrade_runs_the_new_code(tmp_path: Path, cache: str) -> None:
    """pip replaces the sources and leaves compiled code behind; another file's change counts."""
    folder = tmp_path / "toy"
    folder.mkdir()
    shutil.copy(KERNELS / "jit.py", folder / "jit.py")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("NUMBA_CACHE_DIR", None)
    kept = folder / "__pycache__"
    if cache == "NUMBA_CACHE_DIR":
        kept = tmp_path / "cache"
        environment["NUMBA_CACHE_DIR"] = str(kept)

    def install(step: int) -> None:
        for name, code in PACKAGE.items():
            (folder / name).write_text(code.format(name="toy", step=step), encoding="utf-8")

    def run() -> tuple[int, int]:
        code = (
            "from toy.outer import answer\nprint(answer(1), sum(answer.stats.cache_hits.values()))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        value, hits = done.stdout.split()
        return int(value), int(hits)

    install(step=9)
    assert run() == (10, 0)
    assert run() == (10, 1), "the second start finds the code of the first"
    assert list(kept.rglob("*.nbi"))
    install(step=8)
    # Killed when the index is written and the data is not: the old data must not count.
    broken = (
        "import os; from numba.core.caching import IndexDataCacheFile as File\n"
        "File._save_data = lambda *_: os._exit(7)\n"
        "from toy.outer import answer; answer(1)"
    )
    done = subprocess.run([sys.executable, "-c", broken], env=environment, check=False)
    assert done.returncode == 7
    assert run() == (9, 0), "the old code is not taken for the new"
    assert run() == (9, 1)


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_without_a_folder_for_the_cache_it_compiles_anew(tmp_path: Path) -> None:
    code = (
        "from numba.core import caching\n"
        "caching.CacheImpl._locator_classes = []\n"
        "from oddsmap.kernels.trace.readings import SEEN, judge_all\n"
        "import numpy as np\n"
        "verdict, reach = np.zeros(1, np.uint8), np.zeros(1)\n"
        "judge_all(np.ones(1), (0.0, 2.0, 2.0, 2.0), verdict, reach)\n"
        "print(verdict[0] == SEEN)"
    )
    environment = {**os.environ, "PYTHONPATH": str(KERNELS.parent.parent)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout == "True\n", done.stderr
