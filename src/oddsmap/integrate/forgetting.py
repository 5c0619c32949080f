# SPDX-License-Identifier: Apache-2.0
"""Evidence with a half-life, for worlds that change.

A scan of time t votes with the weight 2^(-(t_ref - t) / H), where the half-life H and the time
t_ref are fixed when the map is made. The weight of a scan does not depend on the scans before it,
so they still add up in any order; a common factor for all of them is what another t_ref would be.

Where there are no times, the number of a scan in its log takes the place of its time, a number of
scans that of the half-life, and a reference number that of t_ref. The number is the scan's own: it
is the same in whatever part of the log, and whatever order, the scan is added.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Iterator, Sequence

from oddsmap.config.config import MapConfig
from oddsmap.errors import InputError
from oddsmap.kernels.units import ONE
from oddsmap.scans.measurement import Measurement

__all__ = ["by_weight", "last_number", "last_stamp", "numbered", "scan_weight", "weight_by_number"]

_UNSTAMPED = (
    "a scan has no stamp: map.half_life needs the time of each; use a log with stamps, or no "
    "half-life"
)
_UNNUMBERED = (
    "a scan has no number: map.half_life_scans needs its place in its log; give it, as in "
    "EvidenceMap.add(scans, number=0) or Scan(..., number=0), or map.half_life for logs with stamps"
)


def scan_weight(stamp_ns: int | None, half_life: float, t_ref_ns: int) -> int:
    """What a scan's votes weigh, in units of 1/65536.

    Args:
        stamp_ns: time of the scan [ns].
        half_life: after this time evidence weighs half [s].
        t_ref_ns: the time at which it weighs 1 [ns].

    Raises:
        InputError: the scan has no stamp, or is later than `t_ref_ns`.
    """
    if stamp_ns is None:
        raise InputError(_UNSTAMPED)
    if stamp_ns > t_ref_ns:
        raise InputError(
            f"stamp {stamp_ns} ns is later than the map's t_ref_ns {t_ref_ns}: make the map for a "
            "later t_ref_ns, or use EvidenceMap.rescaled (inexact)"
        )
    return round(ONE * math.exp2(-(t_ref_ns - stamp_ns) / (1e9 * half_life)))


def weight_by_number(number: int | None, half_life_scans: float, ref_scan: int) -> int:
    """What a scan's votes weigh, in units of 1/65536, where scans are counted.

    Args:
        number: of the scan in its log.
        half_life_scans: after so many scans evidence weighs half.
        ref_scan: the number at which it weighs 1.

    Raises:
        InputError: the scan has no number, or one above `ref_scan`.
    """
    if number is None:
        raise InputError(_UNNUMBERED)
    if number > ref_scan:
        raise InputError(
            f"scan {number} is later than the map's ref_scan {ref_scan}: make the map for a later "
            "map.ref_scan"
        )
    return round(ONE * math.exp2(-(ref_scan - number) / half_life_scans))


def by_weight(scans: Sequence[Measurement], settings: MapConfig) -> dict[int, list[Measurement]]:
    """Scans by what their votes weigh in a map that forgets [1/65536].

    Raises:
        InputError: see `scan_weight` and `weight_by_number`.
    """
    groups: dict[int, list[Measurement]] = {}
    for scan in scans:
        if settings.half_life_scans is not None:
            weight = weight_by_number(scan.number, settings.half_life_scans, settings.ref_scan or 0)
        else:
            weight = scan_weight(scan.stamp_ns, settings.half_life or 0.0, settings.t_ref_ns or 0)
        groups.setdefault(weight, []).append(scan)
    return groups


def numbered(scans: Iterable[Measurement], first: int = 0) -> Iterator[Measurement]:
    """Copies of scans, numbered one after the other.

    Args:
        scans: in the order of their log.
        first: the number of the first.
    """
    for number, scan in enumerate(scans, first):
        twin = copy.copy(scan)
        object.__setattr__(twin, "number", number)
        yield twin


def last_number(scans: Iterable[Measurement]) -> int:
    """The highest number of a scan.

    Raises:
        InputError: a scan has no number, two have the same one, or there is no scan.
    """
    met: set[int] = set()
    for scan in scans:
        if scan.number is None:
            raise InputError(_UNNUMBERED)
        if scan.number in met:
            raise InputError(
                f"two scans have the number {scan.number}: map.half_life_scans counts the scans of "
                "one log; map the logs one by one, or number the scans"
            )
        met.add(scan.number)
    if not met:
        raise InputError("no scan: nothing to map, and no number to count a half-life back from")
    return max(met)


def last_stamp(scans: Iterable[Measurement]) -> int:
    """The latest stamp [ns].

    Raises:
        InputError: a scan has no stamp, or there is no scan.
    """
    latest: int | None = None
    for scan in scans:
        if scan.stamp_ns is None:
            raise InputError(_UNSTAMPED)
        latest = scan.stamp_ns if latest is None else max(latest, scan.stamp_ns)
    if latest is None:
        raise InputError("no scan: nothing to map, and no time to count a half-life back from")
    return latest
