# SPDX-License-Identifier: Apache-2.0
"""What reading the scans of a log has shown, kept so that parts of a log can be read apart."""

from __future__ import annotations

from dataclasses import dataclass, field

from oddsmap.errors import InputError
from oddsmap.scans.note import Note

__all__ = ["Found"]


@dataclass(slots=True)
class Found:
    """What reading has shown, by the number of the scan: a scan read again counts once.

    Args:
        bad: why a scan could not be read.
        notes: what a scan's file says, by the code of the note.
        left_out: how many beams were left out of a scan.
        restated: sensors that state other limits in a scan than in their first one.
        leaning: the sine of the angle by which a scan that is mapped as level leans.
    """

    bad: dict[int, InputError] = field(default_factory=dict)
    notes: dict[str, dict[int, Note]] = field(default_factory=dict)
    left_out: dict[int, int] = field(default_factory=dict)
    restated: dict[int, str] = field(default_factory=dict)
    leaning: dict[int, float] = field(default_factory=dict)

    def include(self, other: Found) -> None:
        """Add what reading other scans of the same log has shown."""
        self.bad |= other.bad
        for code, of_scans in other.notes.items():
            self.notes.setdefault(code, {}).update(of_scans)
        self.left_out |= other.left_out
        self.restated |= other.restated
        self.leaning |= other.leaning

    def take(self) -> Found:
        """What there is so far, of which nothing is kept here."""
        taken = Found(
            dict(self.bad),
            dict(self.notes),
            dict(self.left_out),
            dict(self.restated),
            dict(self.leaning),
        )
        for each in (self.bad, self.notes, self.left_out, self.restated, self.leaning):
            each.clear()
        return taken
