# SPDX-License-Identifier: Apache-2.0
"""Commands that are killed, at any moment: the old output or the new one, and nothing else."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.cli import main
from oddsmap.cli.endings import ended_by_signals
from tests.cli.conftest import Run, folder_bytes
from tests.cli.test_landmarks import write
from tests.cli.test_score import sonar
from tests.kills_kit import FORK, Content, copied, left_by
from tests.saved_maps_kit import KINDS

__all__ = ["sonar"]

if not hasattr(os, "fork"):
    pytest.skip("needs children that can be killed", allow_module_level=True)


def command(words: Sequence[object]) -> None:
    """Run a command, in silence, as the program that this process is."""
    with Path(os.devnull).open("w") as nowhere:
        for number in (1, 2):
            os.dup2(nowhere.fileno(), number)
    sys.argv = ["oddsmap", *map(str, words)]
    try:
        main()
    except SystemExit as end:
        os._exit(end.code if isinstance(end.code, int) else 0)


def killed_at_random(
    times: int, words: Sequence[object], path: Path, restore: Callable[[], None], content: Content
) -> dict[str, int]:
    """Kill a command that replaces an output, at moments all over its time."""
    restore()
    old, begin = content(path), time.monotonic()
    process = FORK.Process(target=command, args=(words,))
    process.start()
    process.join()
    took = time.monotonic() - begin
    assert process.exitcode == 0
    sides = [old, content(path)]
    assert sides[0] != sides[1]
    rng, counts = np.random.default_rng(0), {"old": 0, "new": 0, "ended before": 0}
    for i in range(times):
        restore()
        number = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)[i % 3]
        process = FORK.Process(target=command, args=(words,))
        process.start()
        process.join(rng.uniform(0.0, 1.1 * took))
        assert process.pid is not None
        if process.exitcode is None:
            os.kill(process.pid, number)
        process.join()
        assert process.exitcode in (0, -number, 128 + number)
        counts["ended before"] += process.exitcode == 0
        counts["new" if left_by(number, path, content, sides) else "old"] += 1
    return counts


@pytest.fixture
def case(
    request: pytest.FixtureRequest, tmp_path: Path, office: Path, maps: Path, sonar: Path
) -> tuple[list[object], Path, Callable[[], None], Content]:
    """A command that replaces an output, how the old one comes back, and what an output holds."""
    name: str = request.param
    folder = tmp_path / "out"
    folder.mkdir()
    if name == "build":
        out = folder / "m.zarr"
        words = ["build", office, "--resolution", 0.2, "-o", out, "--force"]
        make, load, of = KINDS["2D"]

        def again() -> None:
            make(1).save(out, force=True)

        return words, out, again, lambda path: of(load(path))[:3]
    if name == "export":
        out = folder / "m.yaml"
        image = out.with_suffix(".pgm")
        words = ["export", maps / "hall.zarr", out, "--force"]
        return words, out, copied({out: b"old", image: b"old"}), lambda _: folder_bytes(folder)
    if name == "calibrate":
        out = folder / "s.toml"
        words = ["calibrate", sonar, "--resolution", 0.2, "--noise-only", "-o", out, "--force"]
    else:
        out = folder / "trees.csv"
        table = write(tmp_path / "seen.csv", "range,bearing", ids=True)
        words = ["landmarks", table, "-o", out, "--force"]
    return words, out, copied({out: b"old"}), Path.read_bytes


COMMANDS = ["build", "export", "calibrate", "landmarks"]


@pytest.mark.parametrize("case", COMMANDS, indirect=True)
def test_a_command_that_is_killed(case: Any) -> None:
    killed_at_random(3, *case)


@pytest.mark.slow
@pytest.mark.parametrize("case", COMMANDS, indirect=True)
def test_a_command_that_is_killed_many_times(case: Any) -> None:
    print(case[0][0], killed_at_random(60, *case))  # noqa: T201


# Signals, and what is said.


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_signal_ends_a_command(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    number = signal.Signals[name]
    before = signal.signal(number, signal.SIG_DFL)  # under nohup, SIGHUP is ignored
    try:
        with pytest.raises(SystemExit) as end, ended_by_signals():
            signal.raise_signal(number)
        assert signal.getsignal(number) == signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert end.value.code == 128 + number
    assert capfd.readouterr().err == f"oddsmap: ended by {name}: no unfinished output is left\n"


def test_a_signal_that_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_what_a_killed_run_left_is_said(run: Run, maps: Path, tmp_path: Path) -> None:
    left = tmp_path / ".oddsmap-0123456789abcdef.part"
    (left / "new").mkdir(parents=True)
    (left / "owner").write_text('{"outputs": ["old.png"]}')
    done = run("export", maps / "hall.zarr", tmp_path / "hall.npz")
    assert (
        f"oddsmap: {left}: what a killed run left of its output, old.png, is removed\n" in done.err
    )
    assert not left.exists()
