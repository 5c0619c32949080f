# SPDX-License-Identifier: Apache-2.0
"""The pages of the command line say what the commands say."""

from __future__ import annotations

import re
from importlib.metadata import version

import pytest

from docs_site.commands import (
    COMMANDS_PAGE,
    MORE,
    RENEWED_BY,
    SETTINGS_PAGE,
    commands_page,
    names,
    printed,
    settings_page,
)
from tests.test_docs import blocks


def by_words(text: str) -> str:
    """A text without its white space: where lines break is the parser's affair."""
    return "".join(text.split())


def test_the_page_of_commands_is_up_to_date() -> None:
    """To the letter with the parser that it was made with, and else in its options and words."""
    page = COMMANDS_PAGE.read_text(encoding="utf-8")
    made_with = re.search(r"\(typer (\S+), click (\S+)\)", page)
    assert made_with is not None
    if made_with.groups() == (version("typer"), version("click")):
        assert page == commands_page(), f"{COMMANDS_PAGE.name} is out of date: {RENEWED_BY}"
        return
    helps = dict(zip(["", *names()], (text for _, text in blocks(page)), strict=True))
    for name, shown in helps.items():
        now = printed(*filter(None, [name]), "-h")
        start = by_words(now.partition("\n")[2]).partition("Arguments:")[0].partition("Options:")[0]
        missing = [start] if start not in by_words(shown) else []
        for option in re.findall(r"^  (-\S.*(?:\n {3,}\S.*)*)", now, flags=re.MULTILINE):
            told = by_words(re.sub(r"<.*?>|\[.*?\]", "", option))
            if told not in by_words(re.sub(r"<.*?>|\[.*?\]", "", shown)):
                missing.append(option)
        assert not missing, f"{COMMANDS_PAGE.name} is out of date: {RENEWED_BY}"


def test_the_page_of_settings_is_up_to_date() -> None:
    page = SETTINGS_PAGE.read_text(encoding="utf-8")
    assert page == settings_page(), f"{SETTINGS_PAGE.name} is out of date: {RENEWED_BY}"


def test_each_command_has_its_section() -> None:
    page = COMMANDS_PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^## (.+)$", page, flags=re.MULTILINE) == names()
    assert set(MORE) - set(names()) == set()


def test_a_changed_help_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with another version of the parser."""
    from oddsmap.cli.app import app

    (crop,) = (c for c in app.registered_commands if c.callback and c.callback.__name__ == "crop")
    monkeypatch.setattr(crop, "help", f"{crop.help}\n  Said since.")
    for other in (version, lambda name: "0.0"):
        monkeypatch.setattr("tests.test_commands_page.version", other)
        with pytest.raises(AssertionError, match=rf"out of date: {RENEWED_BY}"):
            test_the_page_of_commands_is_up_to_date()
    monkeypatch.undo()
    monkeypatch.setattr("tests.test_commands_page.version", lambda name: "0.0")
    test_the_page_of_commands_is_up_to_date()
