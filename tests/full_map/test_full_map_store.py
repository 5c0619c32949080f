# SPDX-License-Identifier: Apache-2.0
"""Full maps on disk: every bit comes back, and damage is said in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from oddsmap.errors import InputError, OutputError
from oddsmap.evidence.store import is_map
from oddsmap.evidence_map import load_map
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.full_map import FullMap, load_full_map
from oddsmap.full_map.store import is_full_map
from oddsmap.map_files.zarr_folder import NewFolder
from oddsmap.scans.scan import Scan
from tests.full_map.kit import SONAR, beam, estimated, moved, room, same, wall_of_space


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def one_line(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        load_full_map(path)
    text = str(caught.value)
    assert "\n" not in text
    assert str(path) in text
    return text


def edit(file: Path, **attributes: object) -> None:
    content = json.loads(file.read_text())
    content["attributes"].update({**attributes, "digest": None})
    file.write_text(json.dumps(content))


@pytest.fixture(scope="module")
def small() -> FullMap:
    return estimated(room(10), sweeps=4)


@pytest.fixture
def saved(small: FullMap, tmp_path: Path) -> Path:
    small.save(tmp_path / "a.zarr")
    return tmp_path / "a.zarr"


@pytest.mark.parametrize(
    "scans",
    [
        pytest.param(room(10), id="plane"),
        pytest.param(moved(room(4), (500_000.0, 5_400_000.0)), id="utm"),
        pytest.param(moved(room(4), (-1027.3, -1.6)), id="negative"),
        pytest.param([beam(0.05, 0.05, 0.0, 1.0), beam(310.05, -207.0, 1.0, 1.0)], id="far apart"),
        pytest.param(wall_of_space(2.0, 3), id="space"),
    ],
)
def test_every_bit_comes_back(scans: list[Scan], tmp_path: Path) -> None:
    grid = estimated(scans, sweeps=3)
    grid.save(tmp_path / "a.zarr")
    again = load_full_map(tmp_path / "a.zarr")
    assert same(grid, again)
    assert again.config == grid.config
    assert again.provenance == grid.provenance
    assert (again.sweeps, again.residual, again.converged) == (3, grid.residual, grid.converged)
    assert (again.cell_count, again.ndim) == (grid.cell_count, grid.ndim)
    for one, other in zip(grid.known_log_odds(), again.known_log_odds(), strict=True):
        np.testing.assert_array_equal(one, other)
    again.save(tmp_path / "b.zarr")
    first, second = files(tmp_path / "a.zarr"), files(tmp_path / "b.zarr")
    assert first.keys() == second.keys()
    # What says what it is differs by the id of the save.
    assert {name for name in first if first[name] != second[name]} == {
        "zarr.json", "log_odds/zarr.json", "marks/zarr.json",
    }  # fmt: skip


def test_a_map_without_cells(tmp_path: Path) -> None:
    grid = build_full_map([beam(0.5, 0.5, 0.0, 0.02)], 1.0, sensor=SONAR)
    assert len(grid.blocks) == 0
    grid.save(tmp_path / "a.zarr")
    again = load_full_map(tmp_path / "a.zarr")
    assert (again.cell_count, again.ndim, again.resolution) == (0, 2, 1.0)


def test_anyone_can_read_it(saved: Path, small: FullMap) -> None:
    root = zarr.open_group(saved, mode="r")
    origin = np.array(root.attrs["origin_cell"])
    log_odds, marks = root["log_odds"], root["marks"]
    assert isinstance(log_odds, zarr.Array)
    assert isinstance(marks, zarr.Array)
    box = (origin, origin + log_odds.shape[::-1])
    np.testing.assert_array_equal(np.asarray(log_odds), small.log_odds(box))
    np.testing.assert_array_equal(np.asarray(marks), small.marks_of(box))
    assert root.attrs["origin"] == [x * 0.1 for x in origin.tolist()]
    assert root.attrs["converged"] is False
    # Far from all beams: the prior's, in float32.
    assert log_odds.fill_value == np.float32(np.log(0.475 / 0.525))


def test_the_kinds_of_maps_are_told_apart(saved: Path, tmp_path: Path) -> None:
    assert is_full_map(saved)
    assert not is_map(saved)
    with pytest.raises(InputError, match=r"a full map, .*: read it with oddsmap\.load_full_map$"):
        load_map(saved)
    for name in ("none", "file", "folder"):
        assert not is_full_map(tmp_path / name)
    (tmp_path / "folder").mkdir()
    assert "not a saved full map" in one_line(tmp_path / "folder")
    zarr.open_group(tmp_path / "alike.zarr", mode="w").create_array(
        "log_odds", shape=(4, 4), dtype="f4"
    )
    assert "not one of oddsmap" in one_line(tmp_path / "alike.zarr")


def test_a_newer_format(saved: Path) -> None:
    edit(saved / "zarr.json", format_version=2)
    assert "format version 2, this oddsmap reads 1: update oddsmap" in one_line(saved)


@pytest.mark.parametrize("name", ["log_odds", "marks"])
@pytest.mark.parametrize("damage", ["lost", "empty", "cut", "garbled"])
def test_a_damaged_shard(saved: Path, name: str, damage: str) -> None:
    shard = max((saved / name / "c").rglob("*/*"), key=lambda file: file.stat().st_size)
    content = shard.read_bytes()
    if damage == "lost":
        shard.unlink()
    elif damage == "garbled":
        middle = len(content) // 2
        shard.write_bytes(content[:middle] + bytes(64) + content[middle + 64 :])
    else:
        shard.write_bytes(content[: 0 if damage == "empty" else len(content) // 2])
    text = one_line(saved)
    assert "damaged, cannot be read as a map" in text
    if damage in ("lost", "empty"):
        assert f"{shard.relative_to(saved).as_posix()} is missing or empty" in text


@pytest.mark.parametrize("attribute", ["config", "origin_cell", "shards", "sweeps", "residual"])
def test_an_attribute_is_gone(saved: Path, attribute: str) -> None:
    content = json.loads((saved / "zarr.json").read_text())
    del content["attributes"][attribute]
    content["attributes"]["digest"] = None
    (saved / "zarr.json").write_text(json.dumps(content))
    assert "damaged" in one_line(saved)


def test_an_existing_map_is_not_replaced_unless_forced(saved: Path) -> None:
    before = files(saved)
    other = estimated([beam(0.05, 0.05, 0.0, 1.0)])
    with pytest.raises(OutputError, match="exists already"):
        other.save(saved)
    assert files(saved) == before
    other.save(saved, force=True)
    assert same(load_full_map(saved), other)
    assert [path.name for path in saved.parent.iterdir()] == ["a.zarr"]


@pytest.mark.parametrize("error", [RuntimeError("boom"), KeyboardInterrupt(), OSError("disk full")])
def test_a_broken_off_write_leaves_the_old_map(
    saved: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException
) -> None:
    before = files(saved)
    calls: list[int] = []

    real = NewFolder.write

    def failing(self: NewFolder, *what: Any) -> None:
        calls.append(1)
        if len(calls) == 4:  # of two arrays, in two shards
            raise error
        real(self, *what)

    monkeypatch.setattr(NewFolder, "write", failing)
    grid = estimated([beam(0.05, 0.05, 0.0, 1.0), beam(310.05, 0.0, 1.0, 1.0)])
    for target, force in ((saved, True), (saved.parent / "new.zarr", False)):
        calls.clear()
        with pytest.raises(OutputError if isinstance(error, OSError) else type(error)):
            grid.save(target, force=force)
        assert len(calls) >= 4  # other threads may have gone on
        assert files(saved) == before
        assert [path.name for path in saved.parent.iterdir()] == ["a.zarr"]
