# SPDX-License-Identifier: Apache-2.0
"""What an option that a command lacks may have been meant for: a setting, or another command."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

__all__ = ["own_ones_like", "where_it_belongs"]

_ALIKE = 0.75  # of two names; "p-hti" and "p-hit" are 0.8
_MOST = 4  # commands that are named


def own_ones_like(option: str, possible: Iterable[str]) -> list[str]:
    """Those of a command's own options that begin so, or are hardly misspelt."""
    return [
        name for name in possible if name.startswith(option) or _likeness(option, name) > _ALIKE
    ]


def where_it_belongs(
    option: str,
    command: str,
    commands: Mapping[str, Any],
    words: Sequence[str],
    *,
    exactly: bool = False,
) -> str:
    """How to say what an option that a command lacks says elsewhere; empty where nothing is known.

    Args:
        option: as it was typed: "--p-hit".
        command: the one that lacks it.
        commands: all of them by name, as the parser has them.
        words: what was typed.
        exactly: whether to leave out names that are only like it.
    """
    own, value = _options(commands[command]), _value(option, words)
    if option in ("-o", "--output") and any(p.name == "output" for p in commands[command].params):
        return "the output is the last word, without an option"
    field, equals, given = value.partition("=")
    if option == "--set" and equals and (short := _as_option(field.split(".")[-1])) in own:
        return f"here it is {short} {given}"
    owners = {name: _options(other) for name, other in commands.items() if name != command}
    fields = _fields()
    known = {*fields, *(each for theirs in owners.values() for each in theirs)} - own
    name = option if option in known else None if exactly else _nearest(option, known)
    if name is None:
        return ""
    having = [other for other, theirs in owners.items() if name in theirs][:_MOST]
    setting = f"--set {fields.get(name)}={value or 'VALUE'}"
    question = "" if name == option else f"did you mean {name}? "
    if name in fields and "--set" in own:
        elsewhere = f", or give it to oddsmap {_list(having, 'or')}" if having else ""
        return f"{question}set it with {setting}{elsewhere}"
    if having:
        return f"{question}it is an option of oddsmap {_list(having, 'and')}"
    return f"{question}it is a setting of oddsmap build, {setting}"


def _options(command: Any) -> set[str]:
    return {word for parameter in command.params for word in parameter.opts if word[:2] == "--"}


def _as_option(field: str) -> str:
    return "--" + field.replace("_", "-")


def _fields() -> dict[str, str]:
    """The settings by what would be their option, the first of each name."""
    from oddsmap.cli.setting_fields import all_fields

    named: dict[str, str] = {}
    for field in all_fields():
        named.setdefault(_as_option(field.name), f"{field.section}.{field.name}")
    return named


def _list(names: Sequence[str], between: str) -> str:
    *others, last = names
    return f"{', '.join(others)} {between} {last}" if others else last


def _value(option: str, words: Sequence[str]) -> str:
    """What was typed behind an option, or after an equals sign."""
    for word, following in zip(words, [*words[1:], "-"], strict=True):
        name, equals, value = word.partition("=")
        if name == option:
            return value if equals else "" if following.startswith("-") else following
    return ""


def _likeness(option: str, name: str) -> float:
    return SequenceMatcher(None, option.strip("-"), name.strip("-")).ratio()


def _nearest(option: str, names: Iterable[str]) -> str | None:
    likeness = {name: _likeness(option, name) for name in sorted(names)}
    best = max(likeness, key=lambda name: likeness[name], default=None)
    return best if best is not None and likeness[best] >= _ALIKE else None
