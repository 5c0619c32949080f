# SPDX-License-Identifier: Apache-2.0
"""A map's folder takes the place of a map of ours, of nothing, and of nothing else."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import zarr

from oddsmap.errors import OutputError
from oddsmap.map_files.zarr_folder import check_map_output
from tests.saved_maps_kit import KINDS


def refused(path: Path) -> str:
    before = {file: file.lstat().st_mtime_ns for file in path.parent.rglob("*")}
    with pytest.raises(OutputError) as caught:
        check_map_output(path, force=True)
    with pytest.raises(OutputError):
        KINDS["full map"].make(1).save(path, force=True)
    assert {file: file.lstat().st_mtime_ns for file in path.parent.rglob("*")} == before
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert text.endswith(": it is not replaced; give another name")
    return text.removeprefix(f"{path}: ").removesuffix(": it is not replaced; give another name")


@pytest.mark.parametrize("kind", KINDS)
def test_maps_of_ours_are_replaced(kind: str, tmp_path: Path) -> None:
    make, load, content = KINDS[kind]
    path = tmp_path / "a.zarr"
    make(1).save(path)
    with pytest.raises(OutputError, match="exists already"):
        check_map_output(path)
    make(2).save(path, force=True)
    assert content(load(path)) == content(make(2))


def test_an_empty_folder_or_file_is_nothing(tmp_path: Path) -> None:
    (tmp_path / "folder.zarr").mkdir()
    (tmp_path / "file.zarr").touch()
    for name in ("folder.zarr", "file.zarr"):
        KINDS["full map"].make(1).save(tmp_path / name, force=True)
        KINDS["full map"].load(tmp_path / name)


def test_a_folder_of_that_name_is_not_ours_for_that(tmp_path: Path) -> None:
    path = tmp_path / "notes.zarr"
    path.mkdir()
    (path / "thesis.txt").write_text("years")
    assert refused(path) == "is a folder and no map of oddsmap"


@pytest.mark.parametrize("version", [2, 3])
def test_another_programs_zarr_is_not_ours(version: int, tmp_path: Path) -> None:
    path = tmp_path / "ocean.zarr"
    root = zarr.open_group(path, mode="w", zarr_format=version)  # type: ignore[arg-type]
    root.create_array("hits", shape=(4,), dtype="u1")
    root.attrs["format"] = "another"
    folder = "a folder" if version == 2 else "a Zarr folder of another program"
    assert refused(path) == f"is {folder} and no map of oddsmap"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"attributes": 3}', "[" * 100000])
def test_what_says_nothing_is_not_ours(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    path.mkdir()
    (path / "zarr.json").write_text(text)
    assert refused(path) == "is a Zarr folder of another program and no map of oddsmap"


@pytest.mark.parametrize(
    "name", ["notes.txt", "hits/notes.txt", "hits/c/0/note", "extra/zarr.json", "lengths.csv"]
)
def test_a_map_with_other_peoples_files_in_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    KINDS["2D"].make(1).save(path)
    (path / name).parent.mkdir(exist_ok=True)
    (path / name).write_text("mine")
    assert refused(path) == f"holds {name}, which is no part of the map"


def test_a_link_in_a_map_is_other_peoples(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    KINDS["2D"].make(1).save(path)
    (path / "more").symlink_to(tmp_path)
    assert refused(path) == "holds more, which is no part of the map"


def test_what_systems_leave_in_folders_does_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    KINDS["2D"].make(1).save(path)
    for name in (".DS_Store", "hits/c/0/0.1f2e.partial"):
        (path / name).write_text("")
    check_map_output(path, force=True)


def test_files_and_devices(tmp_path: Path) -> None:
    (tmp_path / "a.zarr").write_text("a letter")
    assert refused(tmp_path / "a.zarr") == "is a file, and a map is a folder"
    if not hasattr(os, "mkfifo"):
        return
    os.mkfifo(tmp_path / "pipe")
    assert refused(tmp_path / "pipe") == "is a file, and a map is a folder"


def test_a_map_that_is_damaged_but_says_what_it_is(tmp_path: Path) -> None:
    """It is ours: a new one may take its place."""
    path = tmp_path / "a.zarr"
    KINDS["2D"].make(1).save(path)
    (path / "hits" / "zarr.json").write_text("")
    root = json.loads((path / "zarr.json").read_text())
    root["attributes"]["origin_cell"] = None
    (path / "zarr.json").write_text(json.dumps(root))
    check_map_output(path, force=True)
