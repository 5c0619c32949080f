# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap calibrate` and `build --auto` say of a sensor that was fitted to a log."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.scoring.calibration import Calibration
    from oddsmap.scoring.mirrors import Mirrors

__all__ = ["facts_of_fit", "lines_of_fit"]

_UNITS = {"cone_deg": "deg", "sigma": "m"}


def facts_of_fit(found: Calibration) -> dict[str, Any]:
    """For --json."""
    return {
        "scans": found.scans,
        "beams": found.beams,
        "skipped": dict(found.skipped),
        "parameters": found.values,
        "standard_errors": {
            name: None if math.isnan(error) else error for name, error in found.errors.items()
        },
        "edge": found.edge,
        "log_likelihood": found.log_likelihood,
        "updates": found.updates,
        "converged": found.converged,
        "notes": list(found.notes),
        "warnings": list(found.warnings),
        "mirrors": None if found.mirrors is None else _statistics(found.mirrors),
    }


def _statistics(mirrors: Mirrors) -> dict[str, float | None]:
    shares = {name: getattr(mirrors, name) for name in ("correlation", "head_on", "aslant")}
    return {name: None if math.isnan(share) else share for name, share in shares.items()}


def lines_of_fit(found: Calibration) -> Iterator[str]:
    """For people."""
    yield f"used        {found.scans:,} scans, {found.beams:,} beams"
    for reason, count in sorted(found.skipped.items()):
        yield f"skipped     {count:,} x {reason}"
    for name, value in found.values.items():
        error = found.errors[name]
        sure = "at its bound" if math.isnan(error) else f"+- {error:.2g}"
        yield f"{name:<11} {value:.4g} {sure} {_UNITS.get(name, '')}".rstrip()
    yield f"likelihood  {found.log_likelihood:+.4f} nats per beam, each predicted without itself"
    if not found.converged:
        yield f"NOT at rest after {found.updates} updates: start from this sensor to go on"
