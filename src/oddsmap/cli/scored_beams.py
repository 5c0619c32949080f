# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap score` says of beams: how well are their readings predicted along their ways?"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.scored_tables import curve_facts, curve_lines

if TYPE_CHECKING:
    from oddsmap.posterior.belief import Belief
    from oddsmap.scans.log import Log
    from oddsmap.scoring.held_out import LogScores
    from oddsmap.sensors.registry import Sensor

__all__ = ["draw", "facts", "lines", "score"]

_BEAMS = (
    "scans",
    "beams",
    "no_returns",
    "log_likelihood",
    "prior_log_likelihood",
    "constant_log_likelihood",
    "constant",
    "ece",
    "ece_of_bins",
)


def score(
    belief: Belief,
    part: Log,
    sensor: Sensor,
    *,
    plot: Path | None,
    progress: Callable[[int], None] | None,
) -> LogScores | str:
    """Scores of beams, or why there are none.

    Without a range_max no reading is predicted, but the map's hits and passes can be.

    Args:
        belief: the map.
        part: the scans to score by.
        sensor: of these.
        plot: the picture that is to be drawn of the scores.
        progress: see `score_map`.

    Raises:
        ConfigError: there is no range_max, and nothing without it.
    """
    from oddsmap.posterior.count_view import CountView
    from oddsmap.scoring.held_out import score_map
    from oddsmap.sensors.beam import NO_RANGE_MAX, BeamSensor

    unlimited = isinstance(sensor, BeamSensor) and sensor.range_max is None
    if unlimited and isinstance(belief, CountView) and plot is None:
        return f"not scored: {NO_RANGE_MAX}"
    return score_map(belief, part, sensor, progress=progress)


def facts(scores: LogScores | str) -> dict[str, Any]:
    """For --json."""
    if isinstance(scores, str):
        return {**dict.fromkeys(_BEAMS), "skipped": {}, "reliability": [], "no_beams": scores}
    return {
        **{name: getattr(scores, name) for name in _BEAMS},
        "skipped": dict(scores.skipped),
        "reliability": curve_facts(scores.reliability),
    }


def lines(scores: LogScores | str) -> Iterator[str]:
    """For people."""
    if isinstance(scores, str):
        yield f"beams     {scores}"
        return
    yield (
        f"scored    {scores.scans:,} scans, {scores.beams:,} beams, {scores.no_returns:,} of them "
        "no-returns"
    )
    for reason, count in sorted(scores.skipped.items()):
        yield f"skipped   {count:,} x {reason}"
    yield f"map       {scores.log_likelihood:+.3f} nats per beam (mean log likelihood)"
    yield (
        f"constant  {scores.constant_log_likelihood:+.3f} with p = {scores.constant:.2g} in every "
        "cell, the best there is"
    )
    yield f"prior     {scores.prior_log_likelihood:+.3f} with the map's prior in every cell"
    yield f"ECE       {scores.ece:.4f} of beam ends, {scores.ece_of_bins:.4f} with all bins alike"
    yield from curve_lines(scores.reliability)


def draw(scores: LogScores, plot: Path, grid: Path, *, force: bool) -> None:
    """Draw the reliability of beam ends."""
    from oddsmap.scoring.picture import save_reliability_png

    title = f"{grid.name}, {scores.beams:,} beams"
    save_reliability_png(scores.reliability, plot, title=title, force=force)
