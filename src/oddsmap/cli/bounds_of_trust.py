# SPDX-License-Identifier: Apache-2.0
"""What is said of a map whose log odds predict its own votes worse than a constant."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.evidence.evidence import Evidence
    from oddsmap.posterior.count_pairs import CountPairs

__all__ = ["facts_of_votes", "trust_line"]


def facts_of_votes(like: Evidence, pairs: CountPairs) -> dict[str, Any] | None:
    """How well log odds predict each vote from the others of its cell; None where that is not told.

    Args:
        like: a map of the same configuration.
        pairs: the counts of the map itself.
    """
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.scoring.own_votes import predict_own_votes

    if like.sensor.kind != "beam":  # under wide beams a hit belongs to one cell of many
        return None
    found = predict_own_votes(LogOdds(like), pairs)
    if found is None:
        return None
    return {
        "votes": found.votes,
        "log_odds": found.log_odds,
        "constant": found.constant,
        "log_odds_worse_than_constant": found.log_odds_fail,
        "log_odds_too_sure": found.too_sure,
    }


def trust_line(facts: dict[str, Any] | None) -> str | None:
    """What to know before log odds are taken for probabilities; None where there is nothing."""
    if facts is None or not facts["log_odds_worse_than_constant"]:
        return None
    why = "too sure" if facts["log_odds_too_sure"] else "near their prior, with few votes a cell"
    losses = f"{facts['log_odds']:.3f}, {facts['constant']:.3f}"
    return (
        f"log odds are {why}: they predict a vote from the others of its cell worse than one "
        f"number for all does (log loss {losses}); where probabilities matter take --posterior "
        "calibrated (oddsmap export, score)"
    )
