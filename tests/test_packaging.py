# SPDX-License-Identifier: Apache-2.0
"""What is shipped: every module, the marker of types, one version in all places."""

from __future__ import annotations

import ast
import os
import platform
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest

import oddsmap

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "oddsmap"


def shipped() -> set[str]:
    """The files of the package by their names in a wheel."""
    files = (path for path in PACKAGE.rglob("*") if path.is_file())
    return {
        path.relative_to(PACKAGE.parent).as_posix()
        for path in files
        if "__pycache__" not in path.parts
    }


def test_types_are_announced() -> None:
    assert "oddsmap/py.typed" in shipped()


def test_each_folder_of_modules_is_a_package() -> None:
    """Without `__init__.py`, some tools pass over the folder, in silence."""
    names = shipped()
    folders = {name.rpartition("/")[0] for name in names if name.endswith(".py")}
    assert {f"{folder}/__init__.py" for folder in folders} - names == set()


def test_there_is_one_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert project["version"] == oddsmap.__version__
    assert re.findall(r"^version: (.+)$", citation, flags=re.MULTILINE) == [oddsmap.__version__]
    assert re.findall(r"^license: (.+)$", citation, flags=re.MULTILINE) == [project["license"]]


def build_wheel(folder: Path, **environment: str) -> Path:
    """Built in this environment, so that nothing is downloaded."""
    if find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    kept = {key: word for key, word in os.environ.items() if key != "ODDSMAP_COMPILE_KERNELS"}
    done = subprocess.run(
        command, cwd=ROOT, env=kept | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_the_wheel_holds_the_package_and_nothing_else(tmp_path: Path) -> None:
    wheel = build_wheel(tmp_path)
    assert wheel.name.endswith("-py3-none-any.whl"), "for all, and without compiled kernels"
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    about = f"oddsmap-{oddsmap.__version__}.dist-info"
    assert {name for name in names if not name.startswith(about)} == shipped()
    assert {f"{about}/{name}" for name in ("METADATA", "entry_points.txt")} <= names
    assert f"{about}/licenses/LICENSE" in names


def kernels_called() -> set[str]:
    """The kernels that the rest of the package imports, by full name."""
    found = set()
    for file in PACKAGE.rglob("*.py"):
        if "kernels" in file.relative_to(PACKAGE).parts:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                "oddsmap.kernels."
            ):
                found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


NOT_RUN = """
import sys
from importlib import import_module
sys.path.insert(0, sys.argv[1])
import workload
workload.run()
for name in sys.argv[2:]:
    module, _, function = name.rpartition(".")
    if getattr(getattr(import_module(module), function), "overloads", True) == {}:
        print(name)
"""


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_the_toy_jobs_of_the_build_go_through_all_kernels() -> None:
    """What they leave out, users of the wheel compile: add it to build_hook/workload.py."""
    kernels = sorted(kernels_called())
    assert len(kernels) > 30
    done = subprocess.run(
        [sys.executable, "-c", NOT_RUN, str(ROOT / "build_hook"), *kernels],
        env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []


COMPILED = """
from numba.core import event
class Listener(event.Listener):
    def on_start(self, started):
        print("compiled", started.data["dispatcher"].py_func)
    def on_end(self, ended):
        pass
event.register("numba:compile", Listener())
import sys
sys.path.insert(0, sys.argv[1])
import oddsmap, workload
print(oddsmap.__file__)
workload.run()
"""


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() not in ("x86_64", "aarch64"),
    reason="kernels are shipped for Linux on x86_64 and aarch64",
)
def test_a_wheel_with_kernels_compiles_nothing(tmp_path: Path) -> None:
    wheel = build_wheel(tmp_path, ODDSMAP_COMPILE_KERNELS="1")
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    assert wheel.name.endswith(f"-{python}-{python}-manylinux_2_17_{platform.machine()}.whl")
    home = tmp_path / "installed"
    with zipfile.ZipFile(wheel) as file:
        file.extractall(home)
    environment = {
        key: word for key, word in os.environ.items() if not key.startswith(("NUMBA_", "ODDSMAP_"))
    }
    done = subprocess.run(
        [sys.executable, "-c", COMPILED, str(ROOT / "build_hook")],
        env={**environment, "PYTHONPATH": str(home)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [str(home / "oddsmap" / "__init__.py")]
