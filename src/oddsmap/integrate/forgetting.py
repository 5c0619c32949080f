# SPDX-License-Identifier: Apache-2.0
"""Evidence with a half-life, for worlds that change.

A scan of time t votes with the weight 2^(-(t_ref - t) / H), where the half-life H and the time
t_ref are fixed when the map is made. The weight of a scan does not depend on the scans before it,
so they still add up in any order; a common factor for all of them is what another t_ref would be.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from oddsmap.errors import InputError
from oddsmap.kernels.units import ONE
from oddsmap.scans.measurement import Measurement

__all__ = ["by_weight", "last_stamp", "scan_weight"]

_UNSTAMPED = (
    "a scan has no stamp: map.half_life needs the time of each; use a log with stamps, or no "
    "half-life"
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


def by_weight(
    scans: Sequence[Measurement], half_life: float, t_ref_ns: int
) -> dict[int, list[Measurement]]:
    """Scans by what their votes weigh [1/65536]; errors as in `scan_weight`."""
    groups: dict[int, list[Measurement]] = {}
    for scan in scans:
        groups.setdefault(scan_weight(scan.stamp_ns, half_life, t_ref_ns), []).append(scan)
    return groups


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
