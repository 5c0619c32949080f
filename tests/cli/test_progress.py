# SPDX-License-Identifier: Apache-2.0
"""What is shown on a terminal while a command works, and nowhere else."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numba
import pytest
from rich.console import Console

from oddsmap.cli import progress
from oddsmap.cli.compiling import EACH_TIME, ONCE, when_compiling
from oddsmap.kernels.trace.readings import judge_all
from tests.cli.conftest import Run


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What is drawn on stderr, were it a terminal of 80 columns."""
    drawn = io.StringIO()
    monkeypatch.setattr(
        progress, "_console", lambda: Console(force_terminal=True, width=80, file=drawn)
    )
    return drawn


@pytest.fixture
def made(run: Run, office: Path, tmp_path: Path) -> Path:
    out = tmp_path / "m.zarr"
    assert run("build", office, "--resolution", 0.3, "--hold-out", 0.2, "-o", out).status == 0
    return out


def test_each_long_step_is_shown(
    run: Run, office: Path, made: Path, tmp_path: Path, screen: io.StringIO
) -> None:
    toml = tmp_path / "s.toml"
    words = ["--resolution", 0.3, "--noise-only", "-o", toml, "--set", "sensor.range_max=40"]
    for command, steps in (
        (("build", office, "--resolution", 0.3, "-o", tmp_path / "n.zarr"),
         ("getting ready", "mapping", "20/20", "left", "saving n.zarr ")),
        (("export", made, tmp_path / "m.png"), ("writing m.png ",)),
        (("info", made), ("reading m.zarr ",)),
        (("info", office), ("reading", "20/20", "left")),
        (("score", made, office, "--held-out"), ("loading", "scoring", "4/4", "left")),
        (("calibrate", office, *words), ("getting ready", "fitting")),
    ):  # fmt: skip
        screen.seek(0)
        screen.truncate()
        done = run(*command)
        assert done.status == 0, done.err
        for step in steps:
            assert step in screen.getvalue(), (command, step)
        assert screen.getvalue().endswith("\x1b[2K")  # gone when all is done


def test_nothing_is_shown_in_a_pipe_for_programs_or_when_quiet(
    run: Run, office: Path, made: Path, screen: io.StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    run("info", office, "--json")
    run("score", made, office, "--held-out", "-q")
    assert screen.getvalue() == ""
    monkeypatch.undo()
    assert run("score", made, office, "--held-out").err == ""


def test_compiling_is_said_when_it_happens_and_for_whom() -> None:
    said: list[str] = []

    def double(x: float) -> float:
        return x + x

    anew: Callable[[float], float] = numba.njit()(double)
    with when_compiling(said.append):
        anew(1)
        anew(1.0)  # once is enough
    assert said == [EACH_TIME]
    with when_compiling(said.append):
        anew(1)  # compiled already
    assert said == [EACH_TIME]


def test_what_is_said_of_compiling_stays_above_the_bar(screen: io.StringIO) -> None:
    for quiet in (True, False):
        with progress.progress_of_sweeps(3, quiet=quiet):
            numba.njit()(lambda x: x + 1)(quiet)
        assert (EACH_TIME in screen.getvalue()) != quiet
    assert screen.getvalue().count("compiling ") > 1


def test_compiling_for_good(tmp_path: Path) -> None:
    kernel = judge_all
    if not hasattr(kernel, "_cache"):
        pytest.skip("NUMBA_DISABLE_JIT: nothing is compiled")
    assert kernel._cache.is_kept  # what tells that machine code is kept
    from numba.core import event

    said: list[str] = []
    with when_compiling(said.append), event.trigger_event("numba:compile", {"dispatcher": kernel}):
        pass
    assert said == [ONCE]
