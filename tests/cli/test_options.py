# SPDX-License-Identifier: Apache-2.0
"""Options that commands share."""

from __future__ import annotations

import os

import pytest

from oddsmap.cli.options import flag, thread_count
from tests.cli.conftest import Run

SHARED = (
    "--poses", "--times", "--tolerance", "--body-from-sensor", "--camera", "--set", "--skip-bad"
)  # fmt: skip


def help_of_option(page: str, option: str) -> str:
    """What a page of help says of an option, up to the next one."""
    (start,) = (i for i, line in enumerate(page.splitlines()) if line.startswith(f"  {option} "))
    lines = page.splitlines()[start:]
    end = next(i for i, line in enumerate(lines) if i and line.startswith(("  -", "  --")))
    return " ".join(" ".join(lines[:end]).split())


@pytest.mark.parametrize("option", SHARED)
def test_one_help_for_all_commands(run: Run, option: str) -> None:
    pages = [run(command, "--help").out for command in ("build", "score", "calibrate")]
    (words,) = {help_of_option(page, option) for page in pages}
    assert words != option


@pytest.mark.parametrize(
    ("command", "force", "as_json"),
    [
        ("build", "an existing map", "the summary"),
        ("score", "an existing picture", "the scores"),
        ("calibrate", "an existing file", "the result"),
        ("landmarks", "an existing file", "the summary"),
    ],
)
def test_what_is_replaced_and_printed(run: Run, command: str, force: str, as_json: str) -> None:
    page = run(command, "--help").out
    assert help_of_option(page, "--force") == f"--force Replace {force}."
    assert help_of_option(page, "--json") == f"--json Print {as_json} as one JSON object."


def test_an_option_as_it_is_typed() -> None:
    assert flag("p_hit") == "--p-hit"
    assert flag("show") == "--show"


def test_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    assert thread_count(3) == 3
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 5}, raising=False)
    assert thread_count(None) == 2
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert thread_count(None) == 1
