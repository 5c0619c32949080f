# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap score` says of hits and passes: are the map's probabilities true?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from oddsmap.cli.scored_tables import curve_lines, facts_of_ways, lines_of_ways

if TYPE_CHECKING:
    from oddsmap.posterior.belief import Belief
    from oddsmap.scans.log import Log
    from oddsmap.scoring.reflection import ReflectionScores
    from oddsmap.sensors.registry import Sensor

__all__ = ["facts", "lines", "score"]


def score(belief: Belief, part: Log, sensor: Sensor) -> ReflectionScores | str:
    """Scores of hits and passes, or why there are none.

    Args:
        belief: the map.
        part: the scans to score by.
        sensor: of these.
    """
    from oddsmap.errors import InputError
    from oddsmap.evidence_map import EvidenceMap, build_map
    from oddsmap.posterior.count_view import CountView
    from oddsmap.scoring.reflection import score_reflection
    from oddsmap.sensors.beam import BeamSensor

    grid = belief.evidence if isinstance(belief, CountView) else None
    if not isinstance(grid, EvidenceMap):
        return "not predicted: a full map has no hits and passes"
    if not (isinstance(sensor, BeamSensor) and isinstance(grid.sensor, BeamSensor)):
        return (
            "not predicted under wide beams: a hit belongs to one cell of many, so its cells' "
            "chances say little of it"
        )
    other = build_map(part, grid.resolution, sensor=sensor, votes=grid.votes)
    try:
        return score_reflection(grid, other)
    except InputError as error:
        return str(error)


def facts(scores: ReflectionScores | str) -> dict[str, Any]:
    """For --json."""
    if isinstance(scores, str):
        return {"reflection": None, "no_reflection": scores}
    return {
        "reflection": {
            "votes": scores.votes,
            "votes_in_unknown_cells": scores.unknown,
            "log_odds_worse_than_constant": scores.log_odds_fail,
            "predicted_by": facts_of_ways(scores.of),
        }
    }


def lines(scores: ReflectionScores | str, posterior: str) -> Iterator[str]:
    """For people.

    Args:
        scores: what `score` says.
        posterior: the view whose reliability is listed, as --posterior names it.
    """
    if isinstance(scores, str):
        yield f"hits      {scores}"
        return
    yield (
        f"hits      {scores.votes:,.0f} votes of these scans in known cells, hits and passes, "
        "predicted by"
    )
    yield from lines_of_ways(scores.of)
    way = posterior.replace("-", " ")
    yield f"          the same by {way}, in bins:"
    yield from curve_lines(scores.of[way].reliability)
    if scores.log_odds_fail:
        yield (
            "note      log odds predict hits worse than a constant here: take the calibrated view "
            "(--posterior calibrated of oddsmap export and score)"
        )
