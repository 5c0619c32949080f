# SPDX-License-Identifier: Apache-2.0
"""Which readings say something: the rule of `kernels/trace/readings.py`, for whole arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import InputError
from oddsmap.forward.beams import Beams
from oddsmap.limits import MAX_COORDINATE
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.scans.scan import Scan
from oddsmap.sensors.base import RangingSensor
from oddsmap.sensors.filters import NO_BODY, beams_within, check_filters

if TYPE_CHECKING:
    from oddsmap.kernels.trace.readings import Limits

__all__ = ["Verdicts", "judge_readings", "refuse_beam_origins", "usable_beams"]


class Verdicts(NamedTuple):
    """What some readings are, arrays of shape (n,)."""

    seen: BoolArray
    """A return."""
    used: BoolArray
    """A return, or a no-return that clears."""
    reach: FloatArray
    """How far each says something [m]; NaN where it says nothing."""
    skipped: Counter[str]
    """How many say nothing, by reason."""


def judge_readings(ranges: FloatArray, limits: Limits) -> Verdicts:
    """Sort readings [m], shape (n,)."""
    from oddsmap.kernels.trace.readings import (
        BELOW,
        CLEARS,
        NAN,
        NO_RETURN,
        SEEN,
        ZERO,
        judge_all,
    )

    verdict, reach = np.empty(len(ranges), np.uint8), np.empty(len(ranges))
    judge_all(np.ascontiguousarray(ranges, np.float64), limits, verdict, reach)
    count = np.bincount(verdict, minlength=SEEN + 1)
    skipped = Counter(
        {
            "beam.nan": int(count[NAN]),
            "beam.below_range_min": int(count[BELOW]),
            "beam.no_return": int(count[NO_RETURN]),
            "beam.zero_range": int(count[ZERO]),
        }
    )
    return Verdicts(verdict == SEEN, verdict >= CLEARS, reach, skipped)


def usable_beams(
    scans: Sequence[Measurement], sensor: RangingSensor, resolution: float = np.inf
) -> tuple[Beams, int, Counter[str]]:
    """The beams of some scans that carry information for the forward model.

    +Inf is a no-return. So is a finite reading of a cone at or above range_max: should it be a
    fault, `p_dropout` is there for it. A narrow beam's reaches past all that was ever seen there,
    and counts only where `clear_range` is set, whatever its length, as in the filter.

    Args:
        scans: measurements of one dimension; depth images are taken as beams.
        sensor: says which readings count.
        resolution: side of a cell [m]: a scan is skipped where its pose is 2^45 cells or more from
            the map's origin; by default none is.

    Returns:
        Beams, of finite range or +Inf; how many scans have any; what was skipped, by reason.

    Raises:
        InputError: 2D and 3D scans are mixed, or a scan is not of ranges.
    """
    taken = ranges_of(scans)
    if sensor.evidence_from == "cells":
        refuse_beam_origins(taken)
    # Only narrow beams have a window; another sensor may come from outside and not know of any.
    window = getattr(sensor, "angle_window", None)
    if window is not None and taken:
        check_filters(taken[0].directions.shape[1], (-np.inf, np.inf), NO_BODY, window)
    taken, lost = beams_within(taken, window)
    beams, skipped = Beams.from_scans(taken)
    finite = [scan for scan in taken if scan.map_from_sensor.is_finite]
    whose = np.repeat(np.arange(len(finite)), [scan.size for scan in finite])
    # A scan is too far where one of its beams starts there, as in the filter.
    limit = MAX_COORDINATE * resolution
    far = np.array([np.abs(s.map_from_sensor.translation).max() >= limit for s in finite], np.bool_)
    far &= np.array([scan.beam_origins is None for scan in finite], np.bool_)
    far[whose[np.abs(beams.origins).max(axis=1, initial=0.0) >= limit]] = True
    here = ~far[whose]
    verdicts = judge_readings(beams.ranges[here], sensor.forward_limits)
    used = here.copy()
    used[here] = verdicts.used
    scan_count = len(np.unique(whose[used]))
    near = int(np.count_nonzero(~far))
    skipped += verdicts.skipped
    skipped["beam.outside_angles"] = sum(
        lost.get(id(scan), 0) for scan, near in zip(finite, ~far, strict=True) if near
    )
    skipped["scan.pose_too_far"] = len(finite) - near
    skipped["scan.empty"] = near - scan_count
    ranges = verdicts.reach[verdicts.used]
    return Beams(beams.origins[used], beams.directions[used], ranges), scan_count, +skipped


def refuse_beam_origins(scans: Sequence[Scan]) -> None:
    """Refuse scans of cones whose beams start in several places.

    Raises:
        InputError: one has `beam_origins`.
    """
    if any(scan.beam_origins is not None for scan in scans):
        raise InputError(
            "a scan has beam_origins, which are for narrow beams: give each cone a scan of its "
            "own, with its own pose"
        )
