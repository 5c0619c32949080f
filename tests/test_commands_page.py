# SPDX-License-Identifier: Apache-2.0
"""The pages of the command line say what the commands say."""

from __future__ import annotations

import re
from importlib.metadata import version
from typing import Any

import pytest

from docs_site.commands import (
    COMMANDS_PAGE,
    MORE,
    RENEWED_BY,
    SETTINGS_PAGE,
    commands_page,
    names,
    settings_page,
)
from tests.test_docs import blocks


def by_words(text: str) -> str:
    """A text without its white space: where lines break is the parser's affair."""
    return "".join(text.split())


def declared() -> dict[str, list[str]]:
    """By command, and "" for all: its help, and the names and the help of each of its options."""
    from typer.main import get_command

    from oddsmap.cli.app import app

    group: Any = get_command(app)
    found = {}
    for name, command in {"": group, **group.commands}.items():
        with command.make_context(name, [], resilient_parsing=True) as context:
            command.get_help(context)  # which fills in what helps leave open
        found[name] = [command.help.replace("\b", "")]
        for option in command.params:
            if option.param_type_name == "option":
                found[name] += [*option.opts, option.help]
    return found


def test_the_page_of_commands_is_up_to_date() -> None:
    """To the letter with the parser that it was made with, and else in its options and words."""
    page = COMMANDS_PAGE.read_text(encoding="utf-8")
    made_with = re.search(r"\(typer (\S+), click (\S+)\)", page)
    assert made_with is not None
    if made_with.groups() == (version("typer"), version("click")):
        assert page == commands_page(), f"{COMMANDS_PAGE.name} is out of date: {RENEWED_BY}"
        return
    shown = dict(zip(["", *names()], (by_words(text) for _, text in blocks(page)), strict=True))
    for name, words in declared().items():
        missing = [each for each in words if by_words(each) not in shown[name]]
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
