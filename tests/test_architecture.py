# SPDX-License-Identifier: Apache-2.0
"""Data flows one way; what is heavy is loaded when it is used."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import oddsmap

PACKAGE = Path(oddsmap.__file__).parent
HEAVY = {"numba", "zarr", "matplotlib", "xarray", "PIL", "yaml", "rich", "typer", "scipy"}
STDLIB = set(sys.stdlib_module_names)


def name_of(file: Path) -> str:
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {name_of(file): file for file in sorted(PACKAGE.rglob("*.py"))}


def imports(tree: ast.AST, *, lazy: bool, typing: bool = False) -> set[str]:
    """Full names of what a module imports: when it is loaded, or (`lazy`) inside functions too."""
    found: set[str] = set()
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            assert node.module is not None
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif not lazy and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue  # run when it is called
        elif not typing and isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue  # never run
        else:
            found |= imports(node, lazy=lazy, typing=typing)
    return found


def of(module: str, *, lazy: bool) -> set[str]:
    return imports(ast.parse(SOURCES[module].read_text(encoding="utf-8")), lazy=lazy)


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def modules(package: str) -> list[str]:
    found = [name for name in SOURCES if within(name, package)]
    assert found, f"{package} is gone: correct this test"
    return found


def test_this_test_sees_imports() -> None:
    code = (
        "import a.b\nfrom c import d\nif TYPE_CHECKING:\n    import e\n"
        "class X:\n    import f\n    def g(self):\n        from h import i\ntry:\n    import j\n"
        "except ImportError:\n    pass\n"
    )
    tree = ast.parse(code)
    assert imports(tree, lazy=False) == {"a.b", "c.d", "f", "j"}
    assert imports(tree, lazy=True) == {"a.b", "c.d", "f", "j", "h.i"}
    assert imports(tree, lazy=True, typing=True) == {"a.b", "c.d", "e", "f", "j", "h.i"}


@pytest.mark.parametrize("module", modules("oddsmap.kernels"))
def test_kernels_import_numpy_and_their_compiler(module: str) -> None:
    for name in of(module, lazy=True):
        top = name.split(".")[0]
        assert top in STDLIB | {"numpy", "numba"} or within(name, "oddsmap.kernels"), name


@pytest.mark.parametrize(
    "module", ["oddsmap.evidence.evidence", "oddsmap.evidence.tiles", "oddsmap.evidence.store"]
)
def test_evidence_knows_no_reader(module: str) -> None:
    for name in of(module, lazy=True):
        for other in ("readers", "simulate", "cli", "export", "plot"):
            assert not within(name, f"oddsmap.{other}"), name


@pytest.mark.parametrize("module", modules("oddsmap.readers"))
def test_readers_know_no_map(module: str) -> None:
    for name in of(module, lazy=True):
        for other in ("evidence", "tiles", "store", "integrate", "posterior", "kernels", "cli"):
            assert not within(name, f"oddsmap.{other}"), name


@pytest.mark.parametrize("module", modules("oddsmap.sensors"))
def test_sensors_know_no_map(module: str) -> None:
    for name in of(module, lazy=True):
        for other in ("evidence", "tiles", "store", "integrate", "posterior", "readers"):
            assert not within(name, f"oddsmap.{other}"), name


@pytest.mark.parametrize("module", SOURCES)
def test_the_library_knows_no_command_line(module: str) -> None:
    if within(module, "oddsmap.cli") or module == "oddsmap.__main__":
        return
    for name in of(module, lazy=True):
        assert not within(name, "oddsmap.cli"), name


@pytest.mark.parametrize("module", SOURCES)
def test_pictures_are_drawn_by_those_who_ask(module: str) -> None:
    if within(module, "oddsmap.plot"):
        return
    for name in of(module, lazy=False):
        assert not within(name, "oddsmap.plot"), name


@pytest.mark.parametrize("module", SOURCES)
def test_heavy_packages_are_imported_inside_functions(module: str) -> None:
    if within(module, "oddsmap.kernels"):
        return
    allowed = {"typer"} if within(module, "oddsmap.cli") else set()
    for name in of(module, lazy=False):
        assert name.split(".")[0] not in HEAVY - allowed, name


def run(code: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_loads_nothing_heavy() -> None:
    code = "import oddsmap, sys; print(*{name.split('.')[0] for name in sys.modules})"
    loaded = set(run(code).split())
    assert "oddsmap" in loaded
    assert not loaded & (HEAVY | {"numpy"})


def test_public_names_resolve_and_no_module_hides_one() -> None:
    """A module of the name of a function takes its place as soon as it is imported."""
    code = """
import importlib, pkgutil, types
import oddsmap
for module in pkgutil.walk_packages(oddsmap.__path__, "oddsmap."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
for name in oddsmap.__all__:
    value = getattr(oddsmap, name)
    assert not isinstance(value, types.ModuleType), f"oddsmap.{name} is a module"
print("fine")
"""
    assert run(code) == "fine\n"
    assert not set(oddsmap.__all__) & {path.stem for path in PACKAGE.iterdir()}
    assert len(set(oddsmap.__all__)) == len(oddsmap.__all__)
    assert set(oddsmap.__all__) == set(dir(oddsmap))


def test_the_lazy_table_and_the_type_checkers_see_the_same() -> None:
    tree = ast.parse(SOURCES["oddsmap"].read_text(encoding="utf-8"))
    typed = {name for name in imports(tree, lazy=False, typing=True) if within(name, "oddsmap")}
    lazy = {f"oddsmap.{home}.{name}" for name, home in oddsmap._HOME.items()}
    assert typed == lazy
    assert {name.rsplit(".", 1)[1] for name in lazy} | {"__version__"} == set(oddsmap.__all__)


def test_an_unknown_name() -> None:
    with pytest.raises(AttributeError, match="no attribute 'occupancy'"):
        oddsmap.occupancy  # noqa: B018
