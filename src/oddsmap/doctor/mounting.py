# SPDX-License-Identifier: Apache-2.0
"""Whether the sensor is turned on its body by another angle than the log says."""

from __future__ import annotations

from oddsmap.doctor.alternatives import yawed
from oddsmap.doctor.trial import Court, Verdict

__all__ = ["find_yaw"]

# Angles that are tried first [deg], and steps around the best of them.
_COARSE = 20
_STEPS = (9.0, 4.5, 2.2, 1.1, 0.5)
# Less than this is what good calibrations err by [deg].
_LEAST = 1.0


def find_yaw(court: Court, d: int) -> Verdict | None:
    """The angle by which scans are to be turned, if one fits clearly better."""
    few = court.few()

    def gained(angle: float) -> float:
        return few.try_out(yawed(angle, d)).then if angle else few.try_out(court.current).now

    found = {float(a): gained(a) for a in range(-180 + _COARSE, 181, _COARSE)}
    best = max(found, key=lambda angle: found[angle])
    for step_size in _STEPS:
        for angle in (best - step_size, best + step_size):
            if angle not in found:
                found[angle] = gained(angle)
        best = max(found, key=lambda angle: found[angle])
    if abs(best) < _LEAST:
        return None
    verdict = court.try_out(yawed((best + 180.0) % 360.0 - 180.0, d))
    return verdict if verdict.is_sure else None
