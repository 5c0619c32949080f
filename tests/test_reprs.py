# SPDX-License-Identifier: Apache-2.0
"""What is printed at a prompt is short, says something, and costs nothing."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap.evidence import counted_cells
from oddsmap.evidence.tiles import TileStore
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.log_items import LogItems
from oddsmap.short_repr import in_bytes, short_repr
from tests.reprs import help_of, pictured, plotted, things

LONGEST = 300


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return things(tmp_path_factory.mktemp("reprs"))


def test_every_public_class_is_in_the_table(held: dict[str, Any]) -> None:
    seen = {type(thing).__name__ for thing in held.values()}
    for name in oddsmap.__all__:
        kind = getattr(oddsmap, name)
        if inspect.isclass(kind) and not issubclass(kind, oddsmap.OddsmapError) and name != "Log":
            assert name in seen, f"tests/reprs.py has no {name}"
    assert any(isinstance(thing, LogItems) for thing in held.values())


def test_all_is_short_and_names_its_kind(held: dict[str, Any]) -> None:
    for name, thing in held.items():
        if isinstance(thing, str | tuple):  # notes are sentences
            continue
        text = repr(thing)
        assert len(text) <= LONGEST, f"{name}: {len(text)} characters"
        assert "0x" not in text, f"{name}: {text}"
        assert "\n" not in text, name
        assert type(thing).__name__ in text, f"{name}: {text}"
        assert text != f"<{type(thing).__name__}>", f"{name} could not say what it is"


def test_maps_say_what_they_hold(held: dict[str, Any]) -> None:
    grid, text = held["EvidenceMap"], repr(held["EvidenceMap"])
    assert f"{grid.cell_count():,} known" in text
    area = grid.cell_count() * 0.1**2
    assert f"({area:.3g} m²)" in text
    lo, hi = grid.bounds()
    assert f"x {lo[0] * 0.1:.10g} to {hi[0] * 0.1:.10g}, y " in text
    assert text.endswith(in_bytes(grid.nbytes) + ">")
    assert "p_hit 0.9" in repr(held["LogOdds, 3D"])
    assert "prior 0.5 and a map" in repr(held["LogOdds with a prior map"])
    assert repr(held["Log in memory"]) == "<LoadedLog log.npz, NPZ beam log, 50 scans, 1 note>"


# What a person may look at from above. 3D views of evidence say how a plot of them is made.
PICTURED = {
    "Calibrated", "Changes", "Costmap", "DecayRate", "DistanceField", "EvidenceMap", "FullMap",
    "LandmarkMap", "LogOdds", "ProbabilityMap", "Reflection", "ReflectionMap", "Traversability",
    "VoxelMap",
}  # fmt: skip


def test_what_can_be_looked_at(held: dict[str, Any]) -> None:
    kinds = {type(thing).__name__ for thing in held.values() if hasattr(thing, "plot")}
    assert kinds == PICTURED
    for name, thing in held.items():
        empty, space = "empty" in name, "3D" in name
        if type(thing).__name__ in PICTURED:
            assert pictured(thing) == ("no" if empty or name == "DistanceField, 3D" else "yes")
            assert plotted(thing) == "yes" or empty or space, name


def test_help_says_what_a_thing_is(held: dict[str, Any]) -> None:
    for name, thing in held.items():
        text, kind = help_of(thing), type(thing)
        assert 10 < len(text) <= 100, name
        assert text.endswith("."), name
        assert not text.startswith(f"{kind.__name__}("), f"{name}: dataclasses say their arguments"


def test_arrays_are_shape_and_range() -> None:
    scan = oddsmap.Scan.from_angles((1, 2, 0.5), np.zeros(180), np.linspace(2.0, 7.5, 180))
    assert "ranges=float64[180] of 2 to 7.5" in repr(scan)
    assert "ranges=float64[180]" in repr(
        oddsmap.Scan.from_angles((1, 2, 0), np.zeros(180), np.full(180, np.nan))
    )


def test_nothing_is_read_or_decoded(held: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise AssertionError("a repr is no reason to read")

    for name in ("parts", "chunks", "cells", "region", "units", "at"):
        monkeypatch.setattr(TileStore, name, refuse)
    for kind in (LazyLog, *{type(thing) for thing in held.values() if isinstance(thing, LogItems)}):
        monkeypatch.setattr(kind, "__iter__", refuse)
    for name, thing in held.items():
        assert repr(thing) != f"<{type(thing).__name__}>", name


def test_large_maps_are_not_even_gone_through(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = oddsmap.EvidenceMap(0.5)
    grid.add_cells(np.array([[0, 0], [40, 1]]), np.array([65536, 0]), np.array([0, 65536]))
    whole = repr(grid)
    monkeypatch.setattr(counted_cells, "_CENSUS_BYTES", 0)
    monkeypatch.setattr(TileStore, "census", None)
    assert "2 known" in whole
    assert "x 0 to 32, y 0 to 16 m, 2 tiles" in repr(grid)
    assert "2 tiles" in repr(grid.log_odds())


def test_what_is_half_made_can_be_looked_at(held: dict[str, Any]) -> None:
    for thing in held.values():
        kind: Any = type(thing)
        if kind.__repr__ is short_repr or hasattr(kind, "_facts"):
            text = repr(object.__new__(kind))
            assert kind.__name__ in text


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 B"), (999, "999 B"), (1000, "1 kB"), (2_345_678, "2.35 MB")]
)
def test_sizes_in_memory(number: int, text: str) -> None:
    assert in_bytes(number) == text
