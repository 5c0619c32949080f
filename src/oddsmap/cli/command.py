# SPDX-License-Identifier: Apache-2.0
"""What the parser of the command line does for each command beyond its own."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

from typer.core import TyperCommand

__all__ = ["Command"]

# Which word was none of those that an option takes: the parser says it, and keeps it nowhere.
_NOT_ONE_OF = re.compile(r"^'(.*)' is not one of (.*)$")


class Command(TyperCommand):
    """A command whose help names what there is, and which knows what a mistyped word may mean."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Fill in `{sensors}` and `{formats}`: they are asked for when a page needs them."""
        self.help = _filled(self.help)
        for parameter in self.params:
            # Click's base class of parameters has no help; options and arguments of Typer do.
            parameter.help = _filled(getattr(parameter, "help", None))  # type: ignore[attr-defined]
        super().format_help(ctx, formatter)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """As the parser does; a word that is none of several is compared with those."""
        from oddsmap.errors import did_you_mean

        words = list(args)
        try:
            return super().parse_args(ctx, args)
        except Exception as error:  # the parser's own errors, of which there is no public name
            message = getattr(error, "message", "").removeprefix("Value error, ")
            if said := _NOT_ONE_OF.match(message):
                question = did_you_mean(said[1], re.findall(r"'(.+?)'", said[2]))
                error.message = message.removesuffix(".") + question  # type: ignore[attr-defined]
            elif message.startswith("No such option"):
                _say_where(error, ctx, words)
            elif message.startswith("Input should be a valid number"):
                got = _value_of(getattr(error, "param", None), words)
                error.message = f"a number is needed{got}"  # type: ignore[attr-defined]
            raise


def _say_where(error: Any, ctx: Any, words: list[str]) -> None:
    """Let the error of an option that a command lacks say what was meant."""
    from oddsmap.cli.unknown_option import own_ones_like, where_it_belongs

    if ctx.parent is None:
        return  # a command by itself has no others beside it
    option, commands = error.option_name, ctx.parent.command.commands
    error.possibilities = own_ones_like(option, error.possibilities or ())
    where = where_it_belongs(
        option, ctx.info_name, commands, words, exactly=bool(error.possibilities)
    )
    if where:
        error.message = f"{error.message.removesuffix('.')}: {where}"


def _value_of(parameter: Any, words: list[str]) -> str:
    """What was typed for an option: ", got 5cm"; empty where that is not to be found."""
    for word, following in pairwise([*words, ""]):
        option, equals, value = word.partition("=")
        if option in getattr(parameter, "opts", ()):
            return f", got {value if equals else following}"
    return ""


def _filled(text: str | None) -> str | None:
    if text and "{sensors}" in text:
        from oddsmap.sensors.registry import NAMES

        *others, last = NAMES
        text = text.replace("{sensors}", f"{', '.join(others)} or {last}")
    if text and "{formats}" in text:
        from oddsmap.readers.registry import known_formats

        text = text.replace("{formats}", known_formats())
    return text
