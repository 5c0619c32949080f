# SPDX-License-Identifier: Apache-2.0
"""Data flows one way; what is heavy is loaded when it is used."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import oddsmap

PACKAGE = Path(oddsmap.__file__).parent
HEAVY = {
    "numba",
    "numcodecs",
    "zarr",
    "matplotlib",
    "xarray",
    "PIL",
    "yaml",
    "rich",
    "typer",
    "scipy",
}
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


# Top floor first: a room imports from the floors below it alone, at any time: when it is loaded, in
# a function, or for type checkers. CONTRIBUTING.md says what each room holds.
FLOORS = (
    ("__main__",),
    ("cli",),
    ("__init__",),
    ("doctor", "scoring"),
    ("cleaning",),
    ("evidence_map",),
    ("viewer",),
    ("scale",),
    ("full_map",),
    ("plausibility", "projection", "witnesses"),
    ("integrate",),
    ("posterior",),
    ("evidence",),
    ("config",),
    ("landmarks",),
    ("sensors",),
    ("forward",),
    ("simulate",),
    ("readers",),
    ("recordings",),
    ("maps",),
    ("query",),
    ("plot",),
    ("map_files",),
    ("scans",),
    ("image_file", "poses"),
    ("atomic_write", "cell_index", "decoding", "odds", "warm_up"),
    ("limits",),
    ("array_types", "errors", "short_repr", "version"),
    ("kernels",),
)
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
KERNEL_FLOORS = (
    ("query",),
    ("vote", "infer"),
    ("trace", "octree", "decimals", "lzf", "beam_poses"),
    ("units", "jit"),
    ("stored_code",),
)
KERNEL_FLOOR_OF = {room: floor for floor, rooms in enumerate(KERNEL_FLOORS) for room in rooms}


@cache
def edges() -> dict[str, set[str]]:
    """Modules of the package that each module imports, at any time."""
    graph: dict[str, set[str]] = {}
    for module, file in SOURCES.items():
        tree = ast.parse(file.read_text(encoding="utf-8"))
        names = {n for n in imports(tree, lazy=True, typing=True) if within(n, "oddsmap")}
        # `from oddsmap.scans.log import Log` is of oddsmap.scans.log, the longest that is a module.
        graph[module] = {
            next(
                candidate
                for end in range(len(name.split(".")), 0, -1)
                if (candidate := ".".join(name.split(".")[:end])) in SOURCES
            )
            for name in names
        }
    return graph


def arrows(graph: dict[str, set[str]], prefix: str, floor_of: dict[str, int]) -> list[str]:
    """Imports that do not go down, each in words."""
    found = []
    for module, targets in graph.items():
        for target in targets:
            if not (module.startswith(prefix) and target.startswith(prefix)):
                continue
            here, there = (
                name[len(prefix) :].split(".")[0] or "__init__" for name in (module, target)
            )
            if here != there and floor_of[here] >= floor_of[there]:
                found.append(f"{module} imports {target}, but {there} does not lie below {here}")
    return sorted(found)


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that import each other, directly or not (Tarjan's components)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(module: str) -> None:
        order[module] = low[module] = len(order)
        stack.append(module)
        for target in sorted(graph[module]):
            if target not in order:
                visit(target)
                low[module] = min(low[module], low[target])
            elif target in stack:
                low[module] = min(low[module], order[target])
        if low[module] == order[module]:
            group = stack[stack.index(module) :]
            del stack[len(stack) - len(group) :]
            if len(group) > 1:
                found.append(sorted(group))

    for module in sorted(graph):
        if module not in order:
            visit(module)
    return found


def with_root(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same with names that all have a room: the package itself is its `__init__`."""
    named = {name: "oddsmap.__init__" if name == "oddsmap" else name for name in graph}
    return {named[name]: {named[target] for target in graph[name]} for name in graph}


def test_this_test_sees_arrows_and_circles() -> None:
    graph = {"p.a.x": {"p.b.y"}, "p.b.y": {"p.a.z"}, "p.a.z": {"p.a.x"}}
    assert arrows(graph, "p.", {"a": 0, "b": 1}) == [
        "p.b.y imports p.a.z, but a does not lie below b"
    ]
    assert circles(graph) == [["p.a.x", "p.a.z", "p.b.y"]]
    assert circles({"a": {"b"}, "b": set()}) == []


def test_every_room_has_a_floor() -> None:
    rooms = {name.split(".")[1] for name in with_root({name: set() for name in SOURCES})}
    assert rooms == set(FLOOR_OF), "name a new room in FLOORS, and in CONTRIBUTING.md"
    kernels = {name.split(".")[2] for name in modules("oddsmap.kernels") if name.count(".") > 1}
    assert kernels == set(KERNEL_FLOOR_OF)


def test_a_room_imports_only_rooms_below_it() -> None:
    graph = with_root(edges())
    assert arrows(graph, "oddsmap.", FLOOR_OF) == []
    assert arrows(edges(), "oddsmap.kernels.", KERNEL_FLOOR_OF) == []


def test_no_modules_import_each_other() -> None:
    assert circles(edges()) == []


@pytest.mark.parametrize("module", modules("oddsmap.kernels"))
def test_kernels_import_numpy_and_their_compiler(module: str) -> None:
    for name in of(module, lazy=True):
        top = name.split(".")[0]
        assert top in STDLIB | {"numpy", "numba"} or within(name, "oddsmap.kernels"), name


def test_readers_know_no_sensor_and_no_map() -> None:
    for module in modules("oddsmap.readers"):
        for name in of(module, lazy=True):
            assert not any(
                within(name, f"oddsmap.{room}") for room in ("maps", "map_files", "sensors")
            ), name


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
    assert typed == lazy | {"oddsmap.version.__version__"}
    assert {name.rsplit(".", 1)[1] for name in lazy} | {"__version__"} == set(oddsmap.__all__)


def test_an_unknown_name() -> None:
    with pytest.raises(AttributeError, match="no attribute 'occupancy'"):
        oddsmap.occupancy  # noqa: B018


# What makes code of data, by the name that it is called or imported by.
CODE_OF_DATA = {
    "eval", "exec", "compile", "__import__",
    "yaml.load", "yaml.load_all", "yaml.full_load", "yaml.full_load_all",
    "yaml.unsafe_load", "yaml.unsafe_load_all",
    "pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve",
    "os.system", "os.popen",
}  # fmt: skip
UNSAFE_OPTIONS = {"allow_pickle", "shell"}


def code_of_data(tree: ast.AST) -> set[str]:
    """What in a module would run what it reads, by name."""
    found = {name for name in imports(tree, lazy=True) if {name, name.split(".")[0]} & CODE_OF_DATA}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        # A function handed on under another name is found by its import, or where it is called.
        if (name := ast.unparse(node.func)) in CODE_OF_DATA:
            found.add(name)
        for option in node.keywords:
            safe = isinstance(option.value, ast.Constant) and option.value.value is False
            if option.arg in UNSAFE_OPTIONS and not safe:
                found.add(str(option.arg))
    return found


def test_this_test_sees_code_of_data() -> None:
    for code, name in (
        ("def f(x):\n    import yaml\n    return yaml.load(x, yaml.SafeLoader)", "yaml.load"),
        ("from yaml import unsafe_load", "yaml.unsafe_load"),
        ("def f():\n    import pickle", "pickle"),
        ("from pickle import loads", "pickle.loads"),
        ("eval('1')", "eval"),
        ("np.load(path, allow_pickle=True)", "allow_pickle"),
        ("np.load(path, allow_pickle=wanted)", "allow_pickle"),
        ("subprocess.run(words, shell=True)", "shell"),
        ("os.system('ls')", "os.system"),
    ):
        assert code_of_data(ast.parse(code)) == {name}
    fine = "yaml.safe_load(x)\nnp.load(x, allow_pickle=False)\nre.compile(x)\nself.eval(x)"
    assert code_of_data(ast.parse(fine)) == set()


@pytest.mark.parametrize("module", SOURCES)
def test_what_is_read_is_never_run(module: str) -> None:
    tree = ast.parse(SOURCES[module].read_text(encoding="utf-8"))
    # Machine code is there to be run: SECURITY.md says who must not write where it is kept.
    allowed = {"pickle", "pickle.loads"} if module == "oddsmap.kernels.stored_code" else set()
    assert code_of_data(tree) <= allowed
