# SPDX-License-Identifier: Apache-2.0
"""Outputs replace old ones when they are complete, and only what may be replaced."""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from oddsmap.atomic_write import atomic_output, atomic_outputs, check_output, swap
from oddsmap.errors import OutputError


def anything(_: Path) -> str | None:
    """All that is there may be replaced."""
    return None


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def write_half(path: Path, error: BaseException) -> None:
    with atomic_output(path, force=True, why_not=anything) as part:
        part.mkdir()
        (part / "half").write_text("half")
        raise error


def test_a_file(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    with atomic_output(path) as part:
        assert part.name == "map.png"
        assert part.relative_to(tmp_path).parts[0].startswith(".oddsmap-")
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
        with atomic_output(path, force=True, why_not=anything) as part:
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
    make_folder(path, "old")
    with pytest.raises(OutputError, match=r"map\.zarr: cannot be written: No space left"):
        write_half(path, OSError(28, "No space left on device"))
    assert names(path) == ["old"]
    assert names(tmp_path) == ["map.zarr"]


def make_folder(path: Path, content: str, *, force: bool = True) -> None:
    with atomic_output(path, force=force, why_not=anything) as part:
        part.mkdir()
        (part / content).write_text(content)


@pytest.fixture(params=["one step", "two steps"])
def steps(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """With and without the system's exchange of two folders."""
    if request.param == "two steps":
        monkeypatch.setattr(swap, "_renameat2", lambda: None)
    elif swap._renameat2() is None:
        pytest.skip("this system does not exchange folders")
    return str(request.param)


def test_a_folder_takes_the_place_of_another(tmp_path: Path, steps: str) -> None:
    for content in ("one", "two", "three"):
        make_folder(tmp_path / "map.zarr", content)
        assert names(tmp_path / "map.zarr") == [content]
        assert names(tmp_path) == ["map.zarr"]


def overtaken(path: Path, *, force: bool) -> None:
    """Write a folder, and meanwhile another one comes to its place."""
    with atomic_output(path, force=force, why_not=anything) as part:
        part.mkdir()
        path.mkdir()
        (path / "other").write_text("other")


def test_what_came_meanwhile_is_not_replaced(tmp_path: Path, steps: str) -> None:
    path = tmp_path / "map.zarr"
    with pytest.raises(
        OutputError, match=r"map\.zarr: has come while it was being .*; use force=True"
    ):
        overtaken(path, force=False)
    assert names(path) == ["other"]
    assert names(tmp_path) == ["map.zarr"]
    (path / "other").unlink()
    path.rmdir()
    overtaken(path, force=True)
    assert names(path) == []
    assert names(tmp_path) == ["map.zarr"]


def overtaken_file(path: Path) -> None:
    """Write a file, and meanwhile a folder comes to its place."""
    with atomic_output(path, force=True) as part:
        part.write_text("new")
        path.mkdir()


def test_what_came_meanwhile_is_looked_at_again(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is a folder"):
        overtaken_file(tmp_path / "map.png")
    assert names(tmp_path) == ["map.png"]


def test_writers_of_one_folder_disturb_nobody(tmp_path: Path, steps: str) -> None:
    """Each writes ten files, again and again: what is there is always whole, of one writer."""
    path, failed, seen = tmp_path / "map.zarr", [], set()

    def write(name: str) -> None:
        try:
            for _ in range(10):
                with atomic_output(path, force=True, why_not=anything) as part:
                    part.mkdir()
                    for i in range(10):
                        (part / f"{name}{i}").write_text(name)
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=write, args=(name,)) for name in "abc"]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        try:
            found = names(path)
        except FileNotFoundError:
            continue  # between two renames
        if found:  # the folder just replaced is being removed
            seen.add(found[0][0])
    for thread in threads:
        thread.join()
    assert failed == []
    assert names(path) in [[f"{name}{i}" for i in range(10)] for name in "abc"]
    assert names(tmp_path) == ["map.zarr"]
    assert seen <= set("abc")


def test_the_old_folder_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The new folder cannot be renamed into place after the old one has stepped aside."""
    path = tmp_path / "map.zarr"
    make_folder(path, "old")
    monkeypatch.setattr(swap, "_renameat2", lambda: None)
    real = Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.parent.name == "new":
            raise OSError(errno.EIO, "Input/output error")
        return real(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OutputError, match="Input/output error"):
        make_folder(path, "new")
    assert names(path) == ["old"]
    assert names(tmp_path) == ["map.zarr"]


def test_files_that_belong_together(tmp_path: Path) -> None:
    image, text = tmp_path / "map.pgm", tmp_path / "map.yaml"
    with atomic_outputs(image, text) as (first, second):
        first.write_text("image")
        second.write_text("text")
        assert [name for name in names(tmp_path) if not name.startswith(".")] == []
    assert (image.read_text(), text.read_text()) == ("image", "text")
    with pytest.raises(OutputError), atomic_outputs(image, text, force=True) as (first, second):
        first.write_text("newer image")
    assert (image.read_text(), text.read_text()) == ("image", "text")
    assert names(tmp_path) == ["map.pgm", "map.yaml"]


def test_all_is_on_the_disk_before_it_is_renamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    real_sync, real_rename = os.fsync, swap._rename

    def sync(number: int) -> None:
        done.append(Path(f"/proc/self/fd/{number}").readlink().name)
        real_sync(number)

    def rename(source: Path, path: Path, flag: int) -> bool:
        done.append("renamed")
        return real_rename(source, path, flag)

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("no /proc to name open files by")
    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(swap, "_rename", rename)
    with atomic_output(tmp_path / "map.zarr") as part:
        (part / "hits").mkdir(parents=True)
        (part / "hits" / "0").write_text("0")
        (part / "zarr.json").write_text("{}")
    at = done.index("renamed")
    assert {"map.zarr", "zarr.json", "hits", "0"} <= set(done[:at])
    assert done[at + 1 :] == [tmp_path.name]


def test_a_disk_that_does_not_take_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "map.png"
    path.write_text("old")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with (
        pytest.raises(OutputError, match=r"map\.png: cannot be written: No space left"),
        atomic_output(path, force=True) as part,
    ):
        part.write_text("new")
    assert path.read_text() == "old"
    assert names(tmp_path) == ["map.png"]


def test_a_file_that_grows_too_large(tmp_path: Path) -> None:
    """The system refuses the rest of a file, as a full disk does."""
    resource = pytest.importorskip("resource")
    path = tmp_path / "map.png"
    path.write_text("old")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with (
            pytest.raises(OutputError, match=r"map\.png: cannot be written: File too large"),
            atomic_output(path, force=True) as part,
        ):
            part.write_bytes(bytes(10000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == "old"
    assert names(tmp_path) == ["map.png"]


def test_nothing_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError), atomic_output(tmp_path / "map.png"):
        pass
    assert names(tmp_path) == []


def test_existing(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    check_output(path)
    path.write_text("old")
    check_output(path, force=True)
    with pytest.raises(OutputError, match="exists already; use force=True to replace it"):
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


def a_fifo(path: Path) -> None:
    os.mkfifo(path)


def a_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        before = Path.cwd()
        os.chdir(path.parent)  # the name of a socket is short
        try:
            end.bind(path.name)
        finally:
            os.chdir(before)


@pytest.mark.parametrize(
    ("make", "what"),
    [(Path.mkdir, "is a folder, and a file"), (a_fifo, "is no file but"), (a_socket, "is no file")],
)
def test_a_file_takes_the_place_of_files_alone(
    tmp_path: Path, make: Callable[[Path], None], what: str
) -> None:
    if make is not Path.mkdir and not hasattr(os, "mkfifo"):
        pytest.skip("no pipes and no sockets among the files of this system")
    path = tmp_path / "map.png"
    make(path)
    mode = path.lstat().st_mode
    for force in (False, True):
        with pytest.raises(OutputError, match=what if force else "exists already"):
            check_output(path, force=force)
    assert path.lstat().st_mode == mode


def test_a_device_is_not_replaced() -> None:
    with pytest.raises(OutputError, match="is no file but a pipe, a socket or a device"):
        check_output(Path(os.devnull), force=True)


@pytest.mark.parametrize("path", [Path(), Path("/")])
def test_a_folder_without_a_name(path: Path) -> None:
    with pytest.raises(OutputError, match="is a folder"):
        check_output(path, force=True)


@pytest.mark.parametrize("kind", ["folder", "file", "nothing"])
def test_a_link_is_replaced_and_not_what_it_leads_to(tmp_path: Path, kind: str) -> None:
    real, path = tmp_path / "real.zarr", tmp_path / "map.zarr"
    if kind == "folder":
        real.mkdir()
        (real / "old").write_text("old")
    elif kind == "file":
        real.write_text("old")
    path.symlink_to(real)
    with pytest.raises(OutputError, match="exists already"):
        check_output(path)
    with atomic_output(path, force=True) as part:
        part.mkdir()
        (part / "new").write_text("new")
    assert names(path) == ["new"]
    assert not path.is_symlink()
    assert names(tmp_path) == ["map.zarr", *(["real.zarr"] if kind != "nothing" else [])]
    if kind == "folder":
        assert names(real) == ["old"]
