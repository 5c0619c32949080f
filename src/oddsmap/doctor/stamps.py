# SPDX-License-Identifier: Apache-2.0
"""Times of scans that cannot be right."""

from __future__ import annotations

import numpy as np

from oddsmap.doctor.examined import Examined
from oddsmap.scans.note import Note

__all__ = ["doubts_of_stamps"]


def doubts_of_stamps(seen: Examined) -> list[Note]:
    """Times that repeat or run backward, in the order of the log."""
    known = [stamp for stamp in seen.stamps if stamp is not None]
    if len(known) < 2:
        return []
    steps = np.diff(np.array(known, np.int64))
    same, backward = int((steps == 0).sum()), int((steps < 0).sum())
    found = []
    if same:
        text = f"{same} of {len(known)} scans have the stamp of the one before: is each in the log "
        text += "twice, or are stamps cut to whole seconds?"
        found.append(Note(text, code="stamp.repeated", severity="warning"))
    if backward:
        text = f"{backward} of {len(known)} scans are older than the one before, the worst by "
        text += f"{-float(steps.min()) / 1e9:.3g} s: was the clock set, or were logs joined?"
        found.append(Note(text, code="stamp.backward", severity="warning"))
    return found
