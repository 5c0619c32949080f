# SPDX-License-Identifier: Apache-2.0
"""All checks of a log: can it be what it says?

Nothing is refused for a doubt. Each check takes what a `Sample` holds and says what it measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from oddsmap.plausibility.agreement import doubts_of_poses
from oddsmap.plausibility.false_ring import doubts_of_no_returns
from oddsmap.plausibility.range_unit import doubts_of_ranges
from oddsmap.plausibility.sample import Sample, sample_of
from oddsmap.plausibility.upright import doubts_of_upright
from oddsmap.scans.log import Log
from oddsmap.scans.log_view import LogView
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["WatchedLog", "check_log", "doubts_of_sample"]


def check_log(
    log: Log | Iterable[Measurement], *, range_max: float | None = None
) -> tuple[Note, ...]:
    """Doubts of a log's units and of the form of its poses, each a warning with its remedy.

    It looks at about a hundred scans. Of a log that reads its scans on demand it reads no others.

    Args:
        log: what `open_log` returns, or any scans.
        range_max: a reading from here on is no return [m]; by default what the log says.

    Returns:
        The doubts; none where nothing looks odd, or too little is seen to tell.
    """
    return doubts_of_sample(sample_of(log, range_max))


def doubts_of_sample(sample: Sample) -> tuple[Note, ...]:
    """All doubts of what a sample holds; of doubts of one code the first."""
    glances = sample.glances
    if len({glance.ndim for glance in glances}) != 1:
        return ()
    with np.errstate(all="ignore"):  # absurd numbers compare as what they are: far, or not at all
        found = [
            *doubts_of_ranges(glances),
            *doubts_of_poses(sample.pairs()),
            *doubts_of_upright(glances),
            *doubts_of_no_returns(glances, sample.range_max),
        ]
    return tuple({note.code: note for note in reversed(found)}.values())[::-1]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class WatchedLog(LogView):
    """A log whose scans are looked at while it is read; satisfies `Log`.

    Args:
        log: the log to map.
        sample: what takes the scans to look at.
    """

    sample: Sample

    def __iter__(self) -> Iterator[Scan | Any]:
        """The scans in file order; can be started again, and the sample starts again, too."""
        return self.sample.watch(self.log)
