# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap score` says of hits and passes: are the map's probabilities true?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.posterior.belief import Belief
    from oddsmap.scans.log import Log
    from oddsmap.scoring.reflection import ReflectionScores
    from oddsmap.sensors.registry import Sensor

__all__ = ["check", "facts", "lines", "score", "view_of"]

_VIEWS = ("log-odds", "calibrated")


def check(posterior: str) -> None:
    """Refuse a view that there is not.

    Raises:
        ConfigError: it is none of those that are scored.
    """
    from oddsmap.errors import ConfigError, did_you_mean

    if posterior not in _VIEWS:
        raise ConfigError(
            f"--posterior {posterior}: there is no such view{did_you_mean(posterior, _VIEWS)} "
            f"(known: {', '.join(_VIEWS)})"
        )


def view_of(grid: EvidenceMap, posterior: str) -> Belief:
    """The view that --posterior names."""
    return grid.calibrated() if posterior == "calibrated" else grid.log_odds()


def score(grid: EvidenceMap, part: Log, sensor: Sensor) -> ReflectionScores | str | None:
    """Scores of hits and passes; why there are none; or None under wide beams.

    Args:
        grid: the map.
        part: the scans to score by.
        sensor: of these.
    """
    from oddsmap.errors import InputError
    from oddsmap.evidence_map import build_map
    from oddsmap.scoring.reflection import score_reflection
    from oddsmap.sensors.beam import BeamSensor

    if not (isinstance(sensor, BeamSensor) and isinstance(grid.sensor, BeamSensor)):
        return None
    other = build_map(part, grid.resolution, sensor=sensor, votes=grid.votes)
    try:
        return score_reflection(grid, other)
    except InputError as error:
        return str(error)


def facts(scores: ReflectionScores | str | None) -> dict[str, Any] | None:
    """For --json."""
    if scores is None or isinstance(scores, str):
        return None
    ways = {
        name: {
            "log_loss": way.log_loss,
            "ece": way.ece,
            **{
                key: {"predicted": _number(p), "happened": _number(share), "votes": votes}
                for key, (p, share, votes) in (
                    ("below_0.01", way.sure_free), ("above_0.99", way.sure_hit)
                )
            },
        }
        for name, way in scores.of.items()
    }  # fmt: skip
    return {
        "votes": scores.votes,
        "votes_in_unknown_cells": scores.unknown,
        "log_odds_worse_than_constant": scores.log_odds_fail,
        "predicted_by": ways,
    }


def lines(scores: ReflectionScores | str | None) -> Iterator[str]:
    """For people."""
    if scores is None or isinstance(scores, str):
        if scores is not None:
            yield f"hits      {scores}"
        return
    yield (
        f"hits      {scores.votes:,.0f} votes of these scans in known cells, hits and passes, "
        "predicted by"
    )
    yield "          way               log loss     ECE   hits where p < .01  where p > .99"
    for name, way in scores.of.items():
        sure = f"{_share(way.sure_free, 5):>20}{_share(way.sure_hit, 3):>15}"
        yield f"          {name:16}  {way.log_loss:8.4f}  {way.ece:6.4f}{sure}"
    if scores.log_odds_fail:
        yield (
            "note      log odds predict hits worse than a constant here: take the calibrated view "
            "(--posterior calibrated of oddsmap export and score)"
        )


def _share(sure: tuple[float, float, float], digits: int) -> str:
    return f"{sure[1]:.{digits}f}" if sure[2] else "none"


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value
