# SPDX-License-Identifier: Apache-2.0
"""The command line as a whole: pages of help, version, mistyped words, faults, completion."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, get_type_hints

import pytest

import oddsmap
from oddsmap.cli.app import app
from tests.cli.conftest import Run

COMMANDS = (
    "build", "view", "export", "info", "doctor", "config", "calibrate", "score", "why", "merge",
    "subtract", "crop", "rotate-frame", "compare", "resample", "clean", "landmarks", "demo",
    "costmap", "history",
)  # fmt: skip
CALLBACKS = {
    c.callback.__name__.replace("_", "-"): c.callback for c in app.registered_commands if c.callback
}
OF_SETTINGS = ("build", "calibrate", "score")
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")


def parameters(command: str) -> list[Any]:
    from typer.main import get_command

    return get_command(app).commands[command].params  # type: ignore[attr-defined, no-any-return]


def test_help_and_version(run: Run) -> None:
    page = run("--help").out
    assert "oddsmap build" in page
    assert oddsmap.__version__ in run("--version").out
    assert run("-h").out == page
    assert set(COMMANDS) == set(CALLBACKS)


def test_summaries_are_whole(run: Run) -> None:
    words = " ".join(run("--help").out.split())
    assert "..." not in words.partition("Commands:")[2]
    for command in COMMANDS:
        summary = run(command, "-h").out.split("\n\n")[1]
        assert " ".join(summary.split()) in words


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_pages_fit_into_80_columns(run: Run, command: str) -> None:
    page = run(*filter(None, [command]), "-h").out
    assert [line for line in page.splitlines() if len(line) > 80] == []
    assert "-h, --help" in page
    if command:
        assert page == run(command, "--help").out
        assert re.search(rf"^    oddsmap {command} ", page, re.MULTILINE)  # an example
        assert "{" not in page.partition("Usage")[2].partition("\n")[2]  # all is filled in


@pytest.mark.parametrize("command", COMMANDS)
def test_each_option_says_what_it_takes_and_what_it_is_without(run: Run, command: str) -> None:
    """Units or kinds of numbers as the name of the value; required, or a default."""
    page = " ".join(run(command, "-h").out.split())
    hints = get_type_hints(CALLBACKS[command])
    for parameter in parameters(command):
        help_of = parameter.help or ""
        # (Some versions of the parser lose the help of arguments.)
        assert help_of or parameter.param_type_name == "argument", parameter.name
        if parameter.required:
            assert "[required]" in page
        elif parameter.param_type_name == "option" and not getattr(parameter, "is_flag", False):
            stated = re.search(r"default|required, here or as|may be repeated|Settings from a file",
                               help_of)  # fmt: skip
            assert stated or (parameter.show_default and parameter.default is not None), parameter
        if "float" in str(hints.get(parameter.name)):
            units = {"METRES", "SECONDS", "DEGREES", "PROBABILITY", "SHARE", "UNITS", "VOTES",
                     "SCANS", "PER_METRE"}  # fmt: skip
            assert set(parameter.metavar.split()) <= units, parameter.name


@pytest.mark.parametrize("command", COMMANDS)
def test_where_settings_are_listed(run: Run, command: str) -> None:
    page = " ".join(run(command, "-h").out.split())
    assert ("Set any field that oddsmap config lists" in page) == (command in OF_SETTINGS)


def test_formats_are_listed(run: Run) -> None:
    from oddsmap.readers.registry import READERS

    page = " ".join(run("build", "-h").out.split())
    assert all(reader.name in page for reader in READERS)
    assert "depth images as a folder" in page
    assert "docs/formats.md" in page


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["bild"], ""),
        (["build", "x", "-o", "y", "--estimator", "full"], 'did you mean "full-map"?'),
        (["export", "x", "y", "--show", "intervalwidth"], 'did you mean "interval-width"?'),
        (["build", "x", "-o", "y", "--votes", "zzz"], "'scan', 'beam'"),
        (["build", "x", "-o", "y", "--resolution", "5cm"], "5cm"),
        (["build", "x", "-o", "y", "--range-max=0,1"], "0,1"),
        (["build", "x", "-o", "y", "--resolutin", "1"], "--resolution"),
        (
            ["build", "x", "-o", "y", "--p-hit", ".7"],
            ": set it with --set sensor.p_hit=.7, or give it to oddsmap export",
        ),
        (
            ["score", "x", "y", "--p-hti=.7"],
            "did you mean --p-hit? set it with --set sensor.p_hit=.7, or give it to oddsmap export",
        ),
        (
            ["build", "x", "--half-life", "3"],
            "set it with --set map.half_life=3",
        ),
        (["build", "x", "--cone-deg"], "set it with --set sensor.cone_deg=VALUE"),
        (["build", "x", "--z-min", "-1"], "it is an option of oddsmap export and costmap"),
        (["export", "x", "y.png", "--set", "sensor.p_hit=.7"], "here it is --p-hit .7"),
        (
            ["export", "x", "y.png", "--set", "map.votes=beam"],
            "oddsmap build, calibrate and score",
        ),
        (["export", "x", "-o", "y.png"], "the output is the last word, without an option"),
        (["export", "x", "y.png", "--cone-deg", "9"], "of oddsmap build, --set sensor.cone_deg=9"),
        (["demo", "--xyzzy"], "--xyzzy"),
    ],
)
def test_mistyped_words(run: Run, words: list[str], said: str) -> None:
    done = run(*words)
    assert done.status == 2
    assert said in done.err.splitlines()[-1]
    assert "Value error" not in done.err


def test_a_fault_is_one_line_and_with_v_a_traceback(
    run: Run, monkeypatch: pytest.MonkeyPatch, office: Path
) -> None:
    def fail(*args: object, **kwargs: object) -> None:
        raise KeyError("two\nlines " + 1000 * "x")

    monkeypatch.setattr("oddsmap.readers.open_log", fail)
    line = run("info", office).line
    assert line.startswith("unexpected KeyError: 'two\\nlines xxx")
    where = f" (test_app.py:{fail.__code__.co_firstlineno + 1})"
    assert line.endswith(f"xx{where}; this is a fault of oddsmap: please report it, with "
                         "what the same command says with -v")  # fmt: skip
    assert len(line) < 500
    with pytest.raises(KeyError):
        run("info", office, "-v")


def test_completion(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from oddsmap.cli.export import complete_view
    from oddsmap.cli.options import complete_field
    from oddsmap.cli.sensor_names import complete_sensor

    assert complete_sensor("lid") == ["lidar2d", "lidar3d"]
    assert complete_view("re") == ["reflection"]
    assert complete_field("sensor.range_m") == ["sensor.range_max=", "sensor.range_min="]
    for command, option, completer in (
        ("build", "sensor", complete_sensor),
        ("config", "sensor", complete_sensor),
        ("export", "posterior", complete_view),
        ("build", "settings", complete_field),
    ):
        (found,) = (p for p in parameters(command) if p.name == option)
        expected = completer("")
        context: Any = None
        given = found.shell_complete(context, "")
        assert [item.value for item in given] == expected
    # Typer asks which shell the test was started from, and a test may have been started by none.
    monkeypatch.setattr("shellingham.detect_shell", lambda *_: ("bash", "/bin/bash"))
    shown = run("--show-completion").out
    assert "complete_bash" in shown


def test_help_loads_nothing_heavy() -> None:
    """The page of all commands; that of one may ask what sensors and formats there are."""
    code = (
        "import sys; sys.argv = ['oddsmap', '--help']\n"
        "from oddsmap.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print('LOADED', *{name.split('.')[0] for name in sys.modules})"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )  # fmt: skip
    loaded = set(done.stdout.partition("LOADED")[2].split())
    assert "typer" in loaded
    assert not loaded & {"numpy", "numba", "zarr", "matplotlib", "PIL", "yaml", "scipy"}
