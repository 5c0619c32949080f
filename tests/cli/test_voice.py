# SPDX-License-Identifier: Apache-2.0
"""How much is said (-q, -v, --json), and how wide."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np
import pytest

from oddsmap.cli.layout import fitted, screen_width
from oddsmap.cli.voice import Voice
from oddsmap.scans.note import Note
from tests.cli.conftest import Run


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def seen(tmp_path: Path) -> Path:
    path = tmp_path / "seen.csv"
    path.write_text("x,y,theta,range,bearing,id\n0,0,0,1,0,1\n0,0,0,1,0.1,1\n")
    return path


@pytest.fixture
def sonar(tmp_path: Path) -> Path:
    rng = np.random.default_rng(3)
    beams = np.stack([rng.random(60), rng.random(60), rng.random(60) * 6, 1 + rng.random(60)], 1)
    np.savez(tmp_path / "sonar.npz", beams=beams, cone_deg=25.0, range_max=4.0)
    return tmp_path / "sonar.npz"


def test_quiet_is_errors_alone(run: Run, sonar: Path, seen: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    for words in (
        ("build", sonar, "--resolution", 0.2, "-o", out, "--set", "sensor.kind=beam"),
        ("info", out),
        ("info", sonar),
        ("export", out, tmp_path / "m.png"),
        ("score", out, sonar),
        ("landmarks", seen, "-o", tmp_path / "trees.csv"),
        ("calibrate", sonar, "--resolution", 0.2, "--noise-only", "-o", tmp_path / "s.toml"),
    ):
        done = run(*words, "-q")
        assert (done.status, done.out, done.err) == (0, "", ""), words
    assert run("info", out, "-q", "--json").json["map"] == str(out)
    assert "no such file" in run("info", tmp_path / "gone", "-q").line
    assert "-q and -v do not go together" in run("info", out, "-q", "-v").line


def test_verbose_says_settings_and_bad_lines(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "hall.log"
    good = "FLASER 2 1.5 2.5 3 4 0.5 3 4 0.5 1 host 11"
    log.write_text(f"{good}\nFLASER 3 1 2\n{good}\n")
    words = ("build", log, "--resolution", 0.2, "--set", "sensor.p_hit=0.8", "--force", "-o")
    plain, verbose = run(*words, tmp_path / "a.zarr"), run(*words, tmp_path / "b.zarr", "-v")
    assert plain.err == ""
    assert f"{log}:2: " in verbose.err
    assert f"{log}: sensor.p_hit = 0.8\n" in verbose.err
    assert "sensor.p_miss" not in verbose.err


def test_doubts_are_marked(capsys: pytest.CaptureFixture[str]) -> None:
    doubt = Note("a sentence", code="pose.odd", severity="warning")
    Voice().note("a.log", doubt)
    Voice(verbose=True).note("a.log", doubt)
    Voice(verbose=True).note("a.log", "a sentence")
    assert capsys.readouterr().out.splitlines() == [
        "a.log: warning: a sentence",
        "a.log: warning: a sentence (pose.odd)",
        "a.log: a sentence",
    ]
    Voice(as_json=True).note("a.log", doubt)
    Voice().note("a.log", doubt, err=True)
    Voice(quiet=True).note("a.log", doubt)
    assert capsys.readouterr() == ("", 2 * "a.log: warning: a sentence\n")


def test_lines_are_as_wide_as_a_terminal_and_whole_in_a_pipe(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    for stream, widest in ((Terminal(), 60), (io.StringIO(), 209)):
        monkeypatch.setattr(sys, "stdout", stream)
        Voice().say("skipped  " + "word " * 40)
        Voice().say("next     oddsmap " + "word " * 40)  # to be copied
        first, *others, last = stream.getvalue().splitlines()
        assert max(map(len, [first, *others])) <= widest
        assert len(last) > 200
        assert len(others) == (0 if widest > 100 else 3)
        assert all(line.startswith("         word") for line in others)


def test_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    assert fitted("a  b c", 10) == "a  b c"
    assert fitted("beams/scan   one two three", 22) == "beams/scan   one two\n             three"
    assert fitted("one two three", 8) == "one two\nthree"
    assert fitted("     one two", 9) == "     one\n     two"
    assert fitted("word" * 9, 8) == "word" * 9  # what cannot be broken is not
    monkeypatch.setenv("COLUMNS", "7")
    assert screen_width() == 40
    monkeypatch.delenv("COLUMNS")
    assert screen_width() >= 40
