# SPDX-License-Identifier: Apache-2.0
"""What became of the scans."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from oddsmap.short_repr import short_repr

__all__ = ["Report"]


@dataclass(slots=True)
class Report:
    """What became of the scans: counts, and wall times [s]."""

    scans: int = 0
    beams: int = 0
    skipped: Counter[str] = field(default_factory=Counter)
    integrate_s: float = 0.0
    compile_s: float = 0.0
    read_s: float = 0.0

    __repr__ = short_repr

    def add(self, scans: int, beams: int, skipped: Counter[str]) -> None:
        """Count one batch."""
        self.scans += scans
        self.beams += beams
        self.skipped += skipped

    def include(self, other: Report) -> None:
        """Count what became of other scans of the same map."""
        self.add(other.scans, other.beams, other.skipped)
        self.integrate_s += other.integrate_s
        self.compile_s += other.compile_s
        self.read_s += other.read_s
