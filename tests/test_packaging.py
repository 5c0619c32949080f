# SPDX-License-Identifier: Apache-2.0
"""What is shipped: every module, the marker of types, one version in all places."""

from __future__ import annotations

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


@pytest.mark.skipif(find_spec("hatchling") is None, reason="hatchling is not installed")
def test_the_wheel_holds_the_package_and_nothing_else(tmp_path: Path) -> None:
    """Built in this environment, so that nothing is downloaded."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    about = f"oddsmap-{oddsmap.__version__}.dist-info"
    assert {name for name in names if not name.startswith(about)} == shipped()
    assert {f"{about}/{name}" for name in ("METADATA", "entry_points.txt")} <= names
    assert f"{about}/licenses/LICENSE" in names
