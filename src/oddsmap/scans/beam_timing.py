# SPDX-License-Identifier: Apache-2.0
"""Whether the beams of a log are taken at their own times: decided by some scans, and said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.scans.note import Note

__all__ = ["BeamTiming", "choose_deskew", "left_out_note"]

# A scan that takes less has no time to be skewed: 1 m/s and 1 rad/s are 1 mm and 1 mrad.
_SHORTEST_NS = 1e6
# A scan that takes longer than from one scan to the next, by more than clocks are off, is none.
_LONGEST = 1.5
# Poses that come ten times a second, or one for each scan, and a tenth as margin.
_RAREST_NS, _ONE_A_SCAN = 110e6, 1.1
# A scan cannot be written before its last beam is taken, by the clock of one computer. Bags that
# programs have made are written at the very stamps, and say nothing.
_BEFORE_THE_END, _AT_ONCE_NS = 0.9, 10e3


@dataclass(slots=True, eq=False)
class BeamTiming:
    """When the beams of a sensor were taken, by some of its scans.

    Args:
        clock_offset_ns: what is added to the stamps of scans [ns].
    """

    clock_offset_ns: int = 0
    _first: list[float] = field(default_factory=list)
    _last: list[float] = field(default_factory=list)
    _stamps: list[int] = field(default_factory=list)
    _numbers: list[int] = field(default_factory=list)
    _written: list[int] = field(default_factory=list)

    def add(
        self, number: int, stamp_ns: int, after_ns: IntArray | None, written_ns: int | None = None
    ) -> None:
        """Look at the scan of a number.

        Args:
            number: of the scan.
            stamp_ns: its stamp [ns].
            after_ns: the time of each beam after it [ns], shape (n,).
            written_ns: when it was written to the log [ns].
        """
        if written_ns is not None:
            self._written.append(written_ns - stamp_ns - self.clock_offset_ns)
        self._stamps.append(stamp_ns)
        self._numbers.append(number)
        if after_ns is not None and len(after_ns):
            self._first.append(float(after_ns.min()))
            self._last.append(float(after_ns.max()))

    @property
    def known(self) -> bool:
        """Whether there are times at all."""
        return bool(self._first)

    @property
    def span_ns(self) -> float:
        """How long a scan takes [ns]: the median."""
        return float(np.median(np.subtract(self._last, self._first)))

    @property
    def period_ns(self) -> float:
        """From one scan to the next [ns]: the median; infinite where there is one alone."""
        stamps, numbers = np.array(self._stamps, np.float64), np.array(self._numbers)
        steps = np.diff(numbers)
        if not (steps > 0).any():
            return np.inf
        return float(np.median((np.diff(stamps) / np.maximum(steps, 1))[steps > 0]))

    def doubt(self) -> str | None:
        """What speaks against the times; None where they can be trusted."""
        span, period = self.span_ns, self.period_ns
        first, last = float(np.median(self._first)), float(np.median(self._last))
        if span < _SHORTEST_NS:
            return f"they span {_ms(span)}"
        if period > 0.0 and span > _LONGEST * period:
            return f"they span {_ms(span)}, and scans come every {_ms(period)}"
        # The stamp is that of the first beam, of the last, or of one between.
        if first > span or last < -span:
            return f"they begin {_ms(first)} after the stamp"
        written = float(np.median(self._written)) if self._written else 0.0
        if abs(written) <= _AT_ONCE_NS or written >= _BEFORE_THE_END * last:
            return None
        if written < -last:
            return (
                f"scans were written {_ms(-written)} before their stamps: by clocks that differ it "
                "cannot be told whether a stamp is that of the first beam"
            )
        when = f"{_ms(abs(written))} {'after' if written > 0.0 else 'before'} their stamps"
        return (
            f"scans were written {when}, and their last beams are {_ms(last)} after them: the "
            f"stamp may be that of the last beam, and --clock-offset {-last / 1e9:.3g} put it right"
        )


def choose_deskew(
    path: str, stated: bool | None, timings: Sequence[BeamTiming], spacing_ns: float
) -> tuple[bool, tuple[Note, ...]]:
    """Whether scans are deskewed, and what to say of it.

    Args:
        path: what messages start with.
        stated: what the caller says; None: by what there is.
        timings: of the sensors.
        spacing_ns: from one pose to the next [ns].

    Raises:
        InputError: they are to be, and nothing says when their beams were taken.
    """
    timed = [timing for timing in timings if timing.known]
    if stated is False or (stated is None and not timed):
        return False, ()
    if not timed:
        raise InputError(
            f"{path}: nothing says when each beam was taken (LaserScan.time_increment, a field t, "
            "time or timestamp of points): leave `deskew` out"
        )
    longest = max(timed, key=lambda timing: timing.span_ns)
    takes, come = _ms(longest.span_ns), f"poses come every {_ms(spacing_ns)}"
    if spacing_ns == 0.0:
        come = "the sensor never moves"
    if spacing_ns == np.inf:
        come = "there is one pose"
    doubts = [doubt for timing in timed if (doubt := timing.doubt())]
    rarest = max(_RAREST_NS, _ONE_A_SCAN * longest.span_ns)
    if stated is None and (doubts or spacing_ns > rarest):
        why = f"scans take {takes}, but {come}"
        if doubts:
            why = f"the times of beams are not trusted: {doubts[0]}"
        if doubts and longest.span_ns < _SHORTEST_NS:
            return False, ()  # nothing to undo
        text = f"scans are taken at once ({why}); --deskew on takes beams at their own times"
        return False, (Note(text, code="log.not_deskewed"),)
    text = f"beams are taken at their own times (deskewed): scans take {takes}, {come}"
    if doubts:
        text += f"; the times look odd: {doubts[0]}"
    return True, (Note(text, code="log.deskewed", severity="warning" if doubts else "info"),)


def left_out_note(count: int) -> Note:
    """What to say of beams at whose times there is no pose."""
    text = f"{count:,} beams were left out: there is no pose at their times (deskewing)"
    return Note(text, code="beam.no_pose", severity="warning")


def _ms(span_ns: float) -> str:
    return f"{span_ns / 1e6:.3g} ms" if span_ns < 1e9 else f"{span_ns / 1e9:.3g} s"
