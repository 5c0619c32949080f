# SPDX-License-Identifier: Apache-2.0
"""A scan of some of another one's beams, with all that belongs to them."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.scans.scan import Scan

__all__ = ["part_of"]


def part_of(
    scan: Scan, chosen: npt.NDArray[np.int64] | BoolArray, directions: FloatArray | None = None
) -> Scan:
    """A scan of some beams alone.

    Args:
        scan: of beams.
        chosen: their numbers, or for each of its beams whether it is one of them.
        directions: theirs, where scans of one sensor go on to share the array; None: taken here.
    """
    times, origins = scan.beam_times_ns, scan.beam_origins
    part = dataclasses.replace(
        scan,
        directions=scan.directions[chosen] if directions is None else directions,
        ranges=scan.ranges[chosen],
        beam_times_ns=None if times is None else times[chosen],
        beam_origins=None if origins is None else origins[chosen],
        trusted=True,
    )
    for name in ("measured_points", "own_vectors"):  # which `replace` leaves out
        vectors = getattr(scan, name)
        object.__setattr__(part, name, None if vectors is None else vectors[chosen])
    object.__setattr__(part, "stated", scan.stated)
    return part
