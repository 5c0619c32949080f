# SPDX-License-Identifier: Apache-2.0
"""How much a command says: -q, -v and --json."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from typing import Any, TextIO

import typer

from oddsmap.cli.layout import fitted, screen_width
from oddsmap.cli.spoken import at_command_line

__all__ = ["Voice"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Voice:
    """What is said where.

    Args:
        quiet: nothing but errors, and what --json prints.
        verbose: also details.
        as_json: facts as one JSON object, in place of words.

    Raises:
        ConfigError: both quiet and verbose.
    """

    quiet: bool = False
    verbose: bool = False
    as_json: bool = False

    def __post_init__(self) -> None:
        from oddsmap.errors import ConfigError

        if self.quiet and self.verbose:
            raise ConfigError("-q and -v do not go together: leave one out")

    @property
    def still(self) -> bool:
        """Whether to show no progress."""
        return self.quiet or self.as_json

    def say(self, line: str) -> None:
        """A line of the result in words, as wide as the screen; a command is left in one piece."""
        if not self.still:
            line = at_command_line(line)
            typer.echo(line if line.startswith("next ") else _fitted(line, sys.stdout))

    def note(self, where: object, note: str, *, err: bool = False) -> None:
        """What to know before trusting a result.

        Args:
            where: what the note is about.
            note: a sentence, or a `Note`, whose doubts are marked as such.
            err: on stderr also where the result is in words.
        """
        if self.quiet:
            return
        doubt = "warning: " if getattr(note, "severity", "info") == "warning" else ""
        code = f" ({note.code})" if self.verbose and hasattr(note, "code") else ""
        err = err or self.as_json
        line = f"{where}: {doubt}{at_command_line(note)}{code}"
        typer.echo(_fitted(line, sys.stderr if err else sys.stdout), err=err)

    def detail(self, line: str) -> None:
        """A line for those who want to know exactly, on stderr."""
        if self.verbose:
            typer.echo(line, err=True)

    def facts(self, facts: dict[str, Any]) -> None:
        """The result for programs."""
        if self.as_json:
            typer.echo(json.dumps(facts))


def _fitted(line: str, stream: TextIO) -> str:
    """A line for people: whole where it goes into a file or a pipe."""
    return fitted(line, screen_width()) if stream.isatty() else line
