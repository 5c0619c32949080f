# SPDX-License-Identifier: Apache-2.0
"""What a saved map says of itself is checked before anything is made of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from oddsmap import EvidenceMap, load_full_map, load_map
from oddsmap.errors import InputError
from tests.kit import ONE, votes_of
from tests.saved_maps_kit import KINDS

Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    grid = EvidenceMap(0.1, votes="beam", path_lengths=True)
    grid.add_cells(np.array([[3, 4], [-5, 6]]), np.array([ONE, 0]), np.array([0, 3 * ONE]))
    grid.save(tmp_path / "a.zarr")
    return tmp_path / "a.zarr"


@pytest.fixture
def full(tmp_path: Path) -> Path:
    KINDS["full map"].make(1).save(tmp_path / "f.zarr")
    return tmp_path / "f.zarr"


def change(path: Path, file: str, what: Change, *, sealed: bool = False) -> None:
    """Change a JSON file of a map, as an editor would who knows of the digest."""
    for name, step in ((file, what), ("zarr.json", unsealed)):
        if name == "zarr.json" and step is unsealed and sealed:
            continue
        content = json.loads((path / name).read_text())
        step(content)
        (path / name).write_text(json.dumps(content))


def unsealed(content: dict[str, Any]) -> None:
    content["attributes"]["digest"] = None


def put(*place: str | int, value: Any) -> Change:
    def step(content: Any) -> None:
        for name in place[:-1]:
            content = content[name]
        content[place[-1]] = value

    return step


def complaint(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        (load_full_map if path.name == "f.zarr" else load_map)(path)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < len(str(path)) + 300
    return text.removeprefix(f"{path}: damaged, cannot be read as a map: ")


ROOT = [
    ("resolution", 0.2, "attribute resolution is 0.2, and the configuration says 0.1"),
    ("resolution", "0.1", "attribute resolution is '0.1', and"),
    ("votes", "scan", "attribute votes is 'scan', and the configuration says 'beam'"),
    ("origin_cell", [-1023, 0], "origin_cell [-1023, 0] is no multiple of 1024 cells"),
    ("origin_cell", [-1024.0, 0], "attribute origin_cell needs 2 or 3 indices"),
    ("origin_cell", [True, 0], "attribute origin_cell needs 2 or 3 indices"),
    ("origin_cell", [1 << 70, 0], "attribute origin_cell needs 2 or 3 indices"),
    ("origin_cell", [0, 0], "attribute origin is [-102.4"),
    ("origin", [0.0, 0.0], "attribute origin is [0.0, 0.0], and origin_cell lies at [-102.4"),
    ("provenance", "x", "attribute provenance is no list of tables: 'x'"),
    ("provenance", ["x"], "attribute provenance is no list of tables: ['x']"),
    ("known_cells_lo", [-2000, 0], "known cells [-2000, 0] to [4, 7] lie outside the arrays"),
    ("known_cells_hi", [4, 70000], "lie outside the arrays"),
    ("known_cells_hi", [-5, 4], "lie outside the arrays"),
    ("known_cells_hi", [4, 7, 1], "lie outside the arrays"),
    ("shards", {}, "attribute shards lists the arrays [], which are no"),
    ("shards", {"hits": [], "passes": [], "lengths": [], "more": []}, "which are no map's"),
    ("shards", {"hits": [], "passes": [[0, 9]], "lengths": []}, "lists [0, 9] of passes, outside"),
    ("shards", {"hits": [], "passes": [[0]], "lengths": []}, "lists [0] of passes, outside"),
    ("shards", {"hits": [], "passes": [[-1, 0]], "lengths": []}, "lists [-1, 0] of passes"),
    ("shards", {"hits": [], "passes": [["0", 0]], "lengths": []}, "lists ['0', 0] of passes"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "value", "said"), ROOT)
def test_attributes_that_contradict(saved: Path, name: str, value: object, said: str) -> None:
    change(saved, "zarr.json", put("attributes", name, value=value))
    assert said in complaint(saved)


ARRAY = [
    (put("fill_value", value=7), "passes has the fill value 7, and 0 is no evidence"),
    (put("fill_value", value="NaN"), "passes has the fill value 'NaN'"),
    (put("attributes", "weight_unit", value=0.5), "passes has weight_unit 0.5, which is 1.0 or"),
    (put("attributes", "weight_unit", value=1 / ONE), "stored in different units"),
    (put("attributes", "save", value="another"), "passes is of another save than the group"),
    (put("shape", value=[1024, 1024]), "arrays of one map differ in shape"),
    (put("shape", value=[1024, 2047]), "passes has shape [1024, 2047], not whole shards of 1024"),
    (put("shape", value=[0, 2048]), "not whole shards"),
    (put("shape", value=[1024, 2048, 1024]), "not whole shards"),
    (put("shape", value=[1 << 61, 1 << 61]), "arrays of one map differ"),
    (put("shape", value=[1 << 80, 1024]), "not whole shards"),
    (put("data_type", value="float64"), "passes holds 'float64', which no map does"),
    (put("data_type", value="float32"), "passes holds float32, which are no counts"),
    (put("data_type", value="uint16"), "stored in different units"),
    (put("data_type", value=["x"] * 100), "which no map does"),
    (put("node_type", value="group"), "passes is not an array"),
    (put("chunk_grid", "configuration", "chunk_shape", value=[1 << 40, 1 << 40]), "not stored as"),
    (put("codecs", 0, "configuration", "chunk_shape", value=[1, 1]), "is not stored as maps are"),
    (put("codecs", 0, "configuration", "codecs", value=[{"name": "bytes"}]), "damaged"),
    (put("codecs", 0, "configuration", "codecs", 1, "name", value="gzip"), "is not stored as maps"),
    (put("codecs", value=[]), "is not stored as maps are"),
    (put("chunk_key_encoding", value={"name": "v2"}), "is not stored as maps are"),
    (put("storage_transformers", value=[{"name": "x"}]), "is not stored as maps are"),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(ARRAY)))
def test_arrays_that_contradict(saved: Path, case: int) -> None:
    step, said = ARRAY[case]
    change(saved, "passes/zarr.json", step)
    text = complaint(saved)
    assert said in text or said == "damaged"


def test_all_arrays_are_huge(saved: Path) -> None:
    """A few kB that ask for 32 TiB, and more."""
    for name in ("hits", "passes", "lengths"):
        change(saved, f"{name}/zarr.json", put("shape", value=[1 << 50, 1 << 50]))
    assert load_map(saved).cell_count() == 2  # far apart, and nothing there: no memory is taken


@pytest.mark.parametrize("file", ["zarr.json", "hits/zarr.json", "lengths/zarr.json"])
def test_a_change_by_hand_is_noticed(saved: Path, file: str) -> None:
    change(saved, file, put("attributes", "mine", value=3), sealed=True)
    assert load_map(saved).cell_count() == 2  # other people's attributes are theirs
    name = "provenance" if file == "zarr.json" else "description"
    change(saved, file, put("attributes", name, value=[{"x": 1}]), sealed=True)
    assert "is not what was saved (attribute digest; set that to null" in complaint(saved)
    change(saved, file, put("attributes", "mine", value=3))
    assert load_map(saved).cell_count() == 2


@pytest.mark.parametrize("gone", [["digest"], ["save"], ["digest", "save"]])
def test_a_seal_that_is_gone_in_part(saved: Path, gone: list[str]) -> None:
    for name in gone:
        change(saved, "zarr.json", lambda root: root["attributes"].pop(name), sealed=True)  # noqa: B023
    assert "attribute digest is missing" in complaint(saved) or gone == ["save"]


def test_maps_of_before_there_were_seals(saved: Path, full: Path) -> None:
    for path, names in ((saved, ("hits", "passes", "lengths")), (full, ("log_odds", "marks"))):
        load = load_full_map if path is full else load_map
        before: Any = load(path)
        for name in names:
            file = f"{name}/zarr.json"
            change(path, file, lambda array: array["attributes"].pop("save"), sealed=True)
            pack = put("codecs", 0, "configuration", "codecs", 1, "configuration", "checksum", value=False)  # fmt: skip # noqa: E501
            change(path, file, pack, sealed=True)
        for name in ("save", "digest"):
            change(path, "zarr.json", lambda root: root["attributes"].pop(name), sealed=True)  # noqa: B023
        again: Any = load(path)
        if path is full:
            assert np.array_equal(again.values, before.values)
        else:
            assert votes_of(again) == votes_of(before)


def test_full_maps_that_contradict(full: Path) -> None:
    for file, step, said in (
        ("zarr.json", put("attributes", "resolution", value=0.2), "attribute resolution is 0.2"),
        ("zarr.json", put("attributes", "sweeps", value=-1), "attribute sweeps is -1"),
        ("zarr.json", put("attributes", "residual", value=float("nan")), "attribute residual is"),
        ("zarr.json", put("attributes", "origin_cell", value=[7, 0]), "no multiple of 1024"),
        (
            "log_odds/zarr.json",
            put("fill_value", value=7.0),
            "log_odds has the fill value 7.0, and",
        ),
        ("marks/zarr.json", put("fill_value", value=2), "marks has the fill value 2, and its"),
        ("marks/zarr.json", put("data_type", value="uint16"), "marks holds uint16, not uint8"),
    ):
        kept = {name: (full / name).read_text() for name in ("zarr.json", file)}
        change(full, file, step)
        assert said in complaint(full)
        for name, text in kept.items():
            (full / name).write_text(text)
    load_full_map(full)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("log_odds", np.nan, "log_odds holds values that are no numbers"),
        ("log_odds", -np.inf, "log_odds holds values that are no numbers"),
        ("marks", 3, "marks holds 3, and marks are 0, 1 or 2"),
    ],
)
def test_values_of_full_maps(full: Path, name: str, value: float, said: str) -> None:
    array = zarr.open_group(full, mode="r+")[name]
    assert isinstance(array, zarr.Array)
    array[3, 4] = value
    assert f"{name}/c/0/0 is not what was saved" in complaint(full)
    change(full, "zarr.json", unsealed)
    assert said in complaint(full)


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("spare", [0, 1, 255 * ONE - 1, 255 * ONE])
def test_the_heaviest_cells_come_back(tmp_path: Path, spare: int, ndim: int) -> None:
    """Also of two shards, and in part: what can be held can be saved, and read."""
    grid = EvidenceMap(0.5, ndim=ndim)
    grid.add_cells(np.array([[1] * ndim, [5000] * ndim]), np.array([1, 1]), np.array([1, 1]))
    wide = grid.tiles.arrays.wide
    wide[wide == 1] = (1 << 62) - spare
    grid.save(tmp_path / "a.zarr")
    assert votes_of(load_map(tmp_path / "a.zarr")) == votes_of(grid)
    part = load_map(tmp_path / "a.zarr", lo=[0] * ndim, hi=[9] * ndim)
    assert votes_of(part) == {(1,) * ndim: votes_of(grid)[(1,) * ndim]}
