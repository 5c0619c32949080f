# SPDX-License-Identifier: Apache-2.0
"""Evidence with a half-life, for worlds that change.

A scan of time t votes with the weight 2^(-(t_ref - t) / H), where the half-life H and the time
t_ref are fixed when the map is made. The weight of a scan does not depend on the scans before it,
so they still add up in any order; a common factor for all of them is what another t_ref would be.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.errors import ConfigError, InputError
from oddsmap.kernels.vote.tiles import ONE
from oddsmap.sensors.registry import Measurement

if TYPE_CHECKING:
    from oddsmap.evidence.evidence import EvidenceMap
    from oddsmap.evidence.tiles import TileStore

__all__ = ["by_weight", "last_stamp", "rescaled", "scan_weight"]

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


def rescaled(evidence: EvidenceMap, t_ref_ns: int) -> EvidenceMap:
    """See `EvidenceMap.rescaled`."""
    half_life, before = evidence.config.map.half_life, evidence.config.map.t_ref_ns
    if half_life is None or before is None:
        raise ConfigError("only evidence with a half-life can be rescaled: this map has none")
    if t_ref_ns < before:
        raise ConfigError(
            f"t_ref_ns {t_ref_ns} is earlier than the map's {before}: what was forgotten cannot "
            "come back"
        )
    factor = math.exp2(-(t_ref_ns - before) / (1e9 * half_life))
    later = evidence.like(t_ref_ns=t_ref_ns)
    lost = _add_scaled(later.tiles, evidence.tiles, factor)
    facts = {"rescaled_from_t_ref_ns": before, "t_ref_ns": t_ref_ns, "vote.underflow": lost}
    if later.lengths is not None and evidence.lengths is not None:
        facts["length.underflow"] = _add_scaled(later.lengths, evidence.lengths, factor)
    later.provenance = list(evidence.provenance)
    later.record(None, **facts)
    return later


def _add_scaled(to: TileStore, tiles: TileStore, factor: float) -> int:
    """Add weights times a factor; returns how many above 0 became 0."""
    lost = 0
    for coords, units in tiles.chunks():
        scaled = np.rint(units * factor).astype(np.int64)
        lost += int(np.count_nonzero((units > 0) & (scaled == 0)))
        kept = scaled.any(axis=(1, 2))
        to.add(coords[kept], scaled[kept])
    return lost
