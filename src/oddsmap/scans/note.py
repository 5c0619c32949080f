# SPDX-License-Identifier: Apache-2.0
"""What to know before trusting a map of a log."""

from __future__ import annotations

from typing import Literal, Self

from oddsmap.errors import as_line

__all__ = ["Note", "Severity", "bad_scans"]

Severity = Literal["info", "warning"]
"""A warning names a doubt: something was assumed, left out or looks odd."""


def bad_scans(count: int, first: object) -> Note:
    """The warning of a log that had to skip scans.

    Args:
        count: how many.
        first: what was wrong with the first of them.
    """
    scans = "1 scan was skipped" if count == 1 else f"{count} scans were skipped, the first"
    return Note(f"{scans}: {first}", code="log.bad_scans", severity="warning")


class Note(str):
    """One sentence for people, with a code for programs.

    It is its text, so that it prints and compares as a string.

    Args:
        text: the sentence; what cannot be printed in it is escaped, and a long middle left out.
        code: what it is about, in the manner of the reasons of skipped readings
            ("pose.by_order").
        severity: how much it should worry people.
    """

    __slots__ = ("code", "severity")

    code: str
    severity: Severity

    def __new__(cls, text: str, *, code: str, severity: Severity = "info") -> Self:
        """A string with two attributes."""
        note = super().__new__(cls, as_line(text))
        note.code, note.severity = code, severity
        return note

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, str]]:
        """What pickle and copy make it of: a string alone would lose code and severity."""
        return (str(self),), {"code": self.code, "severity": self.severity}
