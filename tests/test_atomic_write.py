# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os
from pathlib import Path

import pytest

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import OutputError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write_half(path: Path, error: BaseException) -> None:
    with atomic_output(path, force=True) as part:
        part.mkdir()
        (part / "half").write_text("half")
        raise error


def test_a_file(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    with atomic_output(path) as part:
        assert part.parent == tmp_path
        assert part.suffix == ".png"
        assert part.name.startswith(".")
        assert not part.exists()
        part.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    with atomic_output(path, force=True) as part:
        part.write_text("newer")
        assert path.read_text() == "new"
    assert path.read_text() == "newer"
    assert names(tmp_path) == ["map.png"]


def test_a_folder(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    for content in ("one", "two"):
        with atomic_output(path, force=True) as part:
            part.mkdir()
            (part / content).write_text(content)
    assert names(path) == ["two"]
    assert names(tmp_path) == ["map.zarr"]


@pytest.mark.parametrize("error", [ValueError("x"), KeyboardInterrupt(), SystemExit(1)])
def test_an_error_leaves_the_old_one(tmp_path: Path, error: BaseException) -> None:
    path = tmp_path / "map.png"
    path.write_text("old")
    with pytest.raises(type(error)):
        write_half(path, error)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["map.png"]


def test_an_error_of_the_disk_is_told(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    path.mkdir()
    (path / "old").write_text("old")
    with pytest.raises(OutputError, match=r"map\.zarr: cannot be written: No space left"):
        write_half(path, OSError(28, "No space left on device"))
    assert names(path) == ["old"]
    assert names(tmp_path) == ["map.zarr"]


def test_the_old_folder_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The new folder cannot be renamed into place after the old one has stepped aside."""
    path = tmp_path / "map.zarr"
    path.mkdir()
    (path / "old").write_text("old")
    real = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if ".part" in self.name:
            raise OSError(5, "Input/output error")
        return real(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OutputError), atomic_output(path, force=True) as part:
        part.mkdir()
    assert names(path) == ["old"]
    assert names(tmp_path) == ["map.zarr"]


def test_nothing_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError), atomic_output(tmp_path / "map.png"):
        pass
    assert names(tmp_path) == []


def test_existing(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    check_output(path)
    path.write_text("old")
    check_output(path, force=True)
    with pytest.raises(OutputError, match="exists already; use --force"):
        check_output(path)
    with pytest.raises(OutputError), atomic_output(path):
        pytest.fail("nothing may be done before the check")


def test_no_folder(tmp_path: Path) -> None:
    for path in (tmp_path / "no" / "map.png", tmp_path / "no" / "such" / "map.png"):
        with pytest.raises(OutputError, match="does not exist; create it first"):
            check_output(path)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="does not exist"):
        check_output(tmp_path / "file" / "map.png")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_is_read_only(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be written to"):
        check_output(tmp_path / "map.png")


def test_a_relative_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with atomic_output(Path("map.png")) as part:
        part.write_text("new")
    assert names(tmp_path) == ["map.png"]


def test_a_folder_that_is_no_map_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "letters"
    path.mkdir()
    check_output(path, force=True)  # empty: nothing would be lost
    (path / "letter").write_text("dear")
    with pytest.raises(OutputError, match="is a folder and no map"):
        check_output(path, force=True)
    (path / "zarr.json").write_text("{}")
    check_output(path, force=True)


@pytest.mark.parametrize("path", [Path(), Path("/")])
def test_a_folder_without_a_name(path: Path) -> None:
    with pytest.raises(OutputError, match="is a folder"):
        check_output(path, force=True)


def test_a_link_to_a_folder_is_replaced_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "real.zarr").mkdir()
    (tmp_path / "real.zarr" / "old").write_text("old")
    (tmp_path / "map.zarr").symlink_to(tmp_path / "real.zarr")
    with atomic_output(tmp_path / "map.zarr", force=True) as part:
        part.mkdir()
        (part / "new").write_text("new")
    assert names(tmp_path) == ["map.zarr", "real.zarr"]
    assert names(tmp_path / "map.zarr") == ["new"]
    assert names(tmp_path / "real.zarr") == ["old"]
