# SPDX-License-Identifier: Apache-2.0
"""What killed runs leave is put back, finished or removed; what living ones work in is not."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from oddsmap.atomic_write import atomic_output, atomic_outputs, check_output, put_back, swap
from oddsmap.atomic_write.work_folder import WorkFolder, clear_dead
from oddsmap.errors import RecoveryWarning

if not hasattr(os, "fork"):
    pytest.skip("needs children that can be killed", allow_module_level=True)

FORK = multiprocessing.get_context("fork")


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def anything(_: Path) -> str | None:
    return None


def killed(work: Callable[[], None]) -> None:
    """Do it in a child that kills itself at the end."""

    def child() -> None:
        work()
        os.kill(os.getpid(), signal.SIGKILL)

    process = FORK.Process(target=child)
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL


def put(path: Path, content: str) -> None:
    with atomic_output(path, force=True, why_not=anything) as part:
        part.mkdir()
        (part / content).write_text(content)


def test_what_a_killed_run_left_is_removed_by_the_next(tmp_path: Path) -> None:
    def half() -> None:
        with atomic_output(tmp_path / "map.png") as part:
            part.write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)

    killed(half)
    (left,) = names(tmp_path)
    with pytest.warns(RecoveryWarning) as said:
        check_output(tmp_path / "other.png")
    assert [str(each.message) for each in said] == [
        f"{tmp_path / left}: what a killed run left of its output, map.png, is removed"
    ]
    assert names(tmp_path) == []


def test_what_lives_is_left_alone(tmp_path: Path) -> None:
    with atomic_output(tmp_path / "map.png") as part:
        part.write_text("new")
        clear_dead(tmp_path)  # of this process

        def other() -> None:
            clear_dead(tmp_path)

        killed(other)
        assert part.read_text() == "new"
    assert names(tmp_path) == ["map.png"]


def test_a_folder_that_nobody_owns(tmp_path: Path) -> None:
    """Killed between making the folder and its lock; or a late thread made it anew."""
    folder = tmp_path / ".oddsmap-0123456789abcdef.part"
    folder.mkdir()
    clear_dead(tmp_path)
    assert names(tmp_path) == []
    (folder / "new" / "map.zarr" / "hits").mkdir(parents=True)
    with pytest.warns(RecoveryWarning, match="left of its output is removed"):
        clear_dead(tmp_path)
    assert names(tmp_path) == []


def test_other_names_are_other_peoples(tmp_path: Path) -> None:
    kept = [".map.part", ".oddsmap-0123.part", ".oddsmap-0123456789abcdef.part.bak", "a.part"]
    for name in kept:
        (tmp_path / name).mkdir()
    clear_dead(tmp_path)
    assert names(tmp_path) == sorted(kept)


def test_an_old_folder_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed between the two renames of a system that does not exchange folders."""
    path = tmp_path / "map.zarr"
    put(path, "old")
    monkeypatch.setattr(swap, "_renameat2", lambda: None)
    real = Path.rename

    def deadly(self: Path, target: Path) -> Path:
        done = real(self, target)
        os.kill(os.getpid(), signal.SIGKILL)
        return done

    def replace() -> None:
        monkeypatch.setattr(Path, "rename", deadly)
        put(path, "new")

    for recover in (clear_dead, put_back):
        killed(replace)
        assert not path.exists()
        with pytest.warns(RecoveryWarning, match=r"map\.zarr: a run was killed .*; the old one is"):
            recover(tmp_path if recover is clear_dead else path)
        assert names(path) == ["old"]
        assert names(tmp_path) == ["map.zarr"]


def test_what_is_in_place_is_not_put_back_over(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"

    def aside() -> None:
        work = WorkFolder(tmp_path, ["map.zarr"])
        work.old("map.zarr").mkdir()

    put(path, "new")
    killed(aside)
    with pytest.warns(RecoveryWarning, match="is removed"):
        clear_dead(tmp_path)
    assert names(path) == ["new"]
    assert names(tmp_path) == ["map.zarr"]


def test_there_is_nothing_to_put_back(tmp_path: Path) -> None:
    assert not put_back(tmp_path / "map.zarr")
    (tmp_path / "map.zarr").mkdir()
    assert put_back(tmp_path / "map.zarr")


def test_files_that_belong_together_are_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed when the first of two is in place: the next run puts the second one there."""
    paths = [tmp_path / name for name in ("map.pgm", "map.yaml")]
    for path in paths:
        path.write_text("old")
    real = Path.replace

    def deadly(self: Path, target: Path) -> Path:
        done = real(self, target)
        os.kill(os.getpid(), signal.SIGKILL)
        return done

    def replace() -> None:
        monkeypatch.setattr(Path, "replace", deadly)
        with atomic_outputs(*paths, force=True) as parts:
            for part in parts:
                part.write_text("new")

    killed(replace)
    assert [path.read_text() for path in paths] == ["new", "old"]
    with pytest.warns(RecoveryWarning, match=r"map\.yaml: a run was killed .*; finished"):
        check_output(tmp_path / "other.png")
    assert [path.read_text() for path in paths] == ["new", "new"]
    assert names(tmp_path) == ["map.pgm", "map.yaml"]


@pytest.mark.parametrize("force", [False, True])
def test_without_locks_nothing_is_taken_for_dead(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, force: bool
) -> None:
    """A network folder that knows no locks: writing works, and what is left stays."""
    import fcntl

    def none(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", none)
    left = tmp_path / ".oddsmap-0123456789abcdef.part"
    left.mkdir()
    (left / "owner").write_text("")
    with atomic_output(tmp_path / "map.png", force=force) as part:
        part.write_text("new")
    assert names(tmp_path) == [left.name, "map.png"]
