# SPDX-License-Identifier: Apache-2.0
"""The units of evidence; nothing is compiled here."""

from __future__ import annotations

__all__ = ["FRACTION_BITS", "HITS", "MAX_UNITS", "ONE", "PASSES"]

HITS, PASSES = 0, 1
"""The two channels of a tile."""
FRACTION_BITS = 16
ONE = 1 << FRACTION_BITS
"""Units in one whole vote."""
MAX_UNITS = 1 << 62
"""No cell may exceed this many units (7e13 votes): adding one more scan cannot wrap around."""
