# SPDX-License-Identifier: Apache-2.0
"""The views of counts that --posterior of `oddsmap score` and `compare` names."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.posterior.count_view import CountView

__all__ = ["check_view", "view_of"]

_VIEWS = ("log-odds", "calibrated")


def check_view(posterior: str) -> None:
    """Refuse a view that there is not.

    Raises:
        ConfigError: it is none of these.
    """
    from oddsmap.errors import ConfigError, did_you_mean

    if posterior not in _VIEWS:
        raise ConfigError(
            f"--posterior {posterior}: there is no such view{did_you_mean(posterior, _VIEWS)} "
            f"(known: {', '.join(_VIEWS)})"
        )


def view_of(grid: EvidenceMap, posterior: str) -> CountView:
    """The view that --posterior names."""
    return grid.calibrated() if posterior == "calibrated" else grid.log_odds()
