# SPDX-License-Identifier: Apache-2.0
"""What full-map estimation knows about a cell besides its belief."""

from __future__ import annotations

__all__ = ["LISTED", "REACHED"]

LISTED, REACHED = 1, 2
"""It lies in a cone before the reading; a beam has come to it."""
