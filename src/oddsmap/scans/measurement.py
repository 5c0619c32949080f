# SPDX-License-Identifier: Apache-2.0
"""Any measurement z_t with its pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from oddsmap.errors import InputError
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.scan import Scan

__all__ = ["Measurement", "ranges_of"]

Measurement: TypeAlias = Scan | DepthScan | GridScan
"""One z_t with its pose."""


def ranges_of(scans: Sequence[Measurement]) -> list[Scan]:
    """Measurements of ranges as beams.

    Raises:
        InputError: one sees cells, not ranges.
    """
    beams = [scan.to_scan() if isinstance(scan, DepthScan) else scan for scan in scans]
    ranges = [scan for scan in beams if isinstance(scan, Scan)]
    if len(ranges) < len(beams):
        raise InputError("a scan sees cells, not ranges: it needs an OverheadSensor")
    return ranges
