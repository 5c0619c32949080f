# SPDX-License-Identifier: Apache-2.0
"""Machine code on disk: found again, never for other sources or processors, never damaged."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import oddsmap.kernels
from oddsmap.kernels import stored_code
from oddsmap.kernels.stored_code import SHIPPED, SHIPPED_CPU

KERNELS = Path(oddsmap.kernels.__file__).parent
PACKAGE = {
    "__init__.py": "",
    "helper.py": (
        "from toy.jit import inlined\n@inlined\ndef step(x: int) -> int:\n    return x + {step}\n"
    ),
    "outer.py": (
        "from toy.helper import step\nfrom toy.jit import kernel\n"
        "@kernel\ndef answer(x: int) -> int:\n    return step(x)\n"
        "@kernel\ndef twice(x: int) -> int:\n    return answer(answer(x))\n"
    ),
}

pytestmark = pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")


class Toy:
    """A package with a kernel, as it is installed and run."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.folder = home / "toy"
        self.kept = self.folder / "__pycache__"
        self.environment = {
            **{
                key: word
                for key, word in os.environ.items()
                if not key.startswith(("NUMBA_", "ODDSMAP_"))
            },
            "PYTHONPATH": str(home),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        self.folder.mkdir()
        for name in ("jit.py", "stored_code.py"):
            source = (KERNELS / name).read_text(encoding="utf-8")
            own = source.replace("oddsmap.kernels", "toy")
            (self.folder / name).write_text(own, encoding="utf-8")
        self.install(step=9)

    def install(self, step: int) -> None:
        for name, code in PACKAGE.items():
            (self.folder / name).write_text(code.format(step=step), encoding="utf-8")

    def run(self, code: str, environment: dict[str, str] | None = None, status: int = 0) -> str:
        done = subprocess.run(
            [sys.executable, "-c", code], env=self.environment | (environment or {}),
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == status, done.stderr
        return done.stdout

    def answer(self, before: str = "", **environment: str) -> tuple[int, int]:
        """What the kernel says of 1, and how often its code was found."""
        count = "sum(answer.stats.cache_hits.values())"
        code = f"{before}\nfrom toy.outer import answer\nprint(answer(1), {count})"
        value, hits = self.run(code, environment).split()
        return int(value), int(hits)


@pytest.fixture
def toy(tmp_path: Path) -> Toy:
    return Toy(tmp_path)


@pytest.mark.parametrize("cache", ["beside the sources", "NUMBA_CACHE_DIR"])
def test_an_upgrade_runs_the_new_code(toy: Toy, cache: str) -> None:
    """pip replaces the sources and leaves compiled code behind; another file's change counts."""
    if cache == "NUMBA_CACHE_DIR":
        toy.kept = toy.home / "cache"
        toy.environment["NUMBA_CACHE_DIR"] = str(toy.kept)
    assert toy.answer() == (10, 0)
    assert toy.answer() == (10, 1), "the second start finds the code of the first"
    assert list(toy.kept.rglob("*.code"))
    toy.install(step=8)
    assert toy.answer() == (9, 0), "the old code is not taken for the new"
    assert toy.answer() == (9, 1)


def test_who_is_killed_while_writing_leaves_no_code(toy: Toy) -> None:
    killed = "import os, pathlib\npathlib.Path.replace = lambda *_: os._exit(7)\n"
    toy.run(f"{killed}from toy.outer import answer\nanswer(1)", status=7)
    assert toy.answer() == (10, 0)
    assert toy.answer() == (10, 1)


def test_damaged_code_is_compiled_anew(toy: Toy) -> None:
    assert toy.answer() == (10, 0)
    (file,) = toy.kept.glob("*.code")
    whole = file.read_bytes()
    for damaged in (b"", whole[:-9], whole[:-1] + bytes([whole[-1] ^ 1])):
        file.write_bytes(damaged)
        assert toy.answer() == (10, 0)
    assert toy.answer() == (10, 1)


def test_without_a_folder_to_write_to_it_compiles_each_time(toy: Toy) -> None:
    nowhere = "from numba.core import caching\ncaching.CacheImpl._locator_classes = []"
    assert toy.answer(nowhere) == (10, 0)
    assert toy.answer(nowhere) == (10, 0)
    full = "import pathlib\ndef full(*_): raise OSError(28, 'full')\npathlib.Path.replace = full"
    assert toy.answer(full) == (10, 0)
    assert not list(toy.kept.iterdir())


def test_stored_code_runs_without_the_compiler(toy: Toy) -> None:
    """What Numba loads to compile with takes longer than all else; it still can compile then."""
    toy.answer()
    code = (
        "import sys\nfrom toy.outer import answer, twice\nanswer(1)\n"
        "print({'numba.np.arraymath', 'scipy.linalg'} & set(sys.modules), twice(1), answer(1.5))"
    )
    assert toy.run(code) == "set() 19 10.5\n"


def test_shipped_code_is_used_where_it_fits(toy: Toy) -> None:
    name, needed = shipped_cpu()
    for_all = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": needed}
    assert toy.answer(**for_all) == (10, 0)
    toy.kept.rename(toy.folder / SHIPPED)
    assert toy.answer() == (10, 1)
    assert not toy.kept.exists() or not list(toy.kept.glob("*.code"))
    nowhere = "from numba.core import caching\ncaching.CacheImpl._locator_classes = []"
    assert toy.answer(nowhere) == (10, 1), "it needs no folder to write to"
    assert toy.answer("import numba; numba.__version__ = '0.0'") == (10, 0)
    assert toy.answer("import sys; sys.implementation.cache_tag = 'other'") == (10, 0)
    if needed:
        assert toy.answer(NUMBA_CPU_NAME="x86-64-v2", NUMBA_CPU_FEATURES="+sse4.2") == (10, 0)
    toy.install(step=8)
    assert toy.answer() == (9, 0)


def test_code_for_this_very_processor_goes_before_shipped_code(toy: Toy) -> None:
    name, needed = shipped_cpu()
    toy.answer(NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=needed)
    toy.kept.rename(toy.folder / SHIPPED)
    assert toy.answer(ODDSMAP_NATIVE_KERNELS="1") == (10, 0), "it is asked for"
    (toy.folder / SHIPPED).rename(toy.folder / "away")
    assert toy.answer() == (10, 1), "and kept"


def shipped_cpu() -> tuple[str, str]:
    from numba.core.registry import cpu_target

    cpu = cpu_target.target_context.codegen().magic_tuple()
    name, needed = SHIPPED_CPU.get(cpu[0].partition("-")[0], ("", "+none"))
    if not set(needed.split(",")) <= {*cpu[2].split(","), ""}:
        pytest.skip("nothing is shipped for this processor")
    return name, needed


@pytest.fixture
def shipped_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., object]:
    monkeypatch.setattr(stored_code, "_SHIPPED_FOLDER", tmp_path)
    stored_code._shipped_for.cache_clear()
    return stored_code._shipped_for


def test_which_processors_run_shipped_code(shipped_for: Callable[..., object]) -> None:
    name, needed = SHIPPED_CPU["x86_64"]
    linux = "x86_64-unknown-linux-gnu"
    assert shipped_for(linux, "znver4", f"-amx,{needed},+avx512f") == (linux, name, needed)
    assert shipped_for(linux, "nehalem", needed.replace("+avx2", "-avx2")) is None
    assert shipped_for(linux, "generic", "") is None
    arm = "aarch64-unknown-linux-gnu"
    assert shipped_for(arm, "neoverse-n1", "+neon") == (arm, "generic", "")
    assert shipped_for("powerpc64le-unknown-linux-gnu", "pwr9", "+vsx") is None


def test_nothing_is_looked_for_where_nothing_is_shipped(
    shipped_for: Callable[..., object], tmp_path: Path
) -> None:
    tmp_path.rmdir()
    assert shipped_for("x86_64-unknown-linux-gnu", *SHIPPED_CPU["x86_64"]) is None


def test_each_choice_of_types_has_its_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays that may be written and those that may not, of each type, are told apart."""
    from numba import typeof

    code = stored_code.StoredCode(shipped_cpu)
    cpu = ("triple", "name", "+feature")
    arrays = [np.zeros(3, kind) for kind in ("f4", "f8", "i4", "i8", "u8")]
    arrays += [np.zeros((3, 3)), np.zeros((3, 3), order="F"), np.zeros((4, 4))[::2, ::2]]
    fixed = np.zeros(3)
    fixed.flags.writeable = False
    signatures = [(typeof(array),) for array in [*arrays, fixed]]  # type: ignore[no-untyped-call]
    assert len({code._name(each, cpu) for each in signatures}) == len(signatures)
    assert code._name(signatures[0], cpu) != code._name(signatures[0], ("triple", "name", ""))
