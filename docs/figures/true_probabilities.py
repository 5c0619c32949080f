# SPDX-License-Identifier: Apache-2.0
"""Reliability of three ways to predict hits and passes, on real logs whose scans are held out.

python docs/figures/true_probabilities.py LOG...   # writes docs/images/true_probabilities.png

Each log is mapped at 0.05 m without every tenth scan. A panel's title is the name of its file up
to the first "-corrected", "." or the end.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

import oddsmap
from oddsmap.scans.split_log import hold_out
from oddsmap.scoring.reflection import Predictions, predict_reflection

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "true_probabilities.png"
RESOLUTION, EVERY = 0.05, 10
INK = "#39434d"
# What predicts: its name here, its colour, and its mark.
WAYS = {
    "log odds": ("log odds", "#c2571a", "s"),
    "OctoMap's clamps": ("log odds, OctoMap's clamps", "#8a8f98", "^"),
    "calibrated": ("calibrated reflectivity", "#2563a6", "o"),
}
# Bins of equal width in the logit, and how many votes make a point.
EDGES, LEAST_VOTES = np.linspace(-10.0, 10.0, 27), 200.0
TICKS = (0.0001, 0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999)


def predictions(path: Path) -> Predictions:
    """What a map of nine scans of ten says of the tenth."""
    parts = hold_out(oddsmap.open_log(path), EVERY)
    return predict_reflection(*(oddsmap.build_map(part, RESOLUTION) for part in parts))


def logit(p: FloatArray) -> FloatArray:
    """Log odds, of what is no surer than the axes go."""
    p = np.clip(p, 5e-5, 1.0 - 5e-5)
    return np.asarray(np.log(p) - np.log1p(-p))


def points(q: FloatArray, found: Predictions) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean prediction, share of hits and votes of each bin that has enough."""
    place, votes = np.digitize(logit(q), EDGES), found.hits + found.passes
    n, predicted, hit = (
        np.bincount(place, weight, len(EDGES) + 1) for weight in (votes, q * votes, found.hits)
    )
    used = n >= LEAST_VOTES
    return predicted[used] / n[used], hit[used] / n[used], n[used]


def draw(logs: Sequence[tuple[str, Predictions]]) -> Figure:
    """A panel for each log."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0 * len(logs), 3.9), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(logs), sharey=True, squeeze=False)[0]
    for panel, (title, found) in zip(panels, logs, strict=True):
        _panel(panel, title, found)
    panels[0].set_ylabel("share of votes that were hits", color=INK, fontsize=9)
    figure.supxlabel("predicted chance of a hit", color=INK, fontsize=9)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=9
    )
    return figure


def _panel(axes: Axes, title: str, found: Predictions) -> None:
    ends = logit(np.array([0.0, 1.0]))
    axes.plot(ends, ends, color=INK, lw=0.8, ls="--", label="as many as predicted")
    for name, (label, colour, mark) in WAYS.items():
        predicted, happened, votes = points(found.by[name], found)
        x, y = logit(predicted), logit(happened)
        axes.plot(x, y, color=colour, lw=1.2)
        size = 6.0 + 10.0 * np.log10(votes / LEAST_VOTES)
        axes.scatter(x, y, s=size, color=colour, marker=mark, label=label, zorder=3)
    ticks, names = logit(np.array(TICKS)), [f"{p:g}".replace("0.", ".") for p in TICKS]
    axes.set_xticks(ticks, names, rotation=90)
    axes.set_yticks(ticks, names)
    axes.set(xlim=ends, ylim=ends, aspect="equal")
    axes.set_title(title, fontsize=10, color=INK)
    axes.tick_params(labelsize=7, colors=INK, length=2)
    axes.spines[["top", "right"]].set_visible(False)


def main(paths: Sequence[str]) -> None:
    """Draw the logs of these paths."""
    if not paths:
        raise SystemExit("usage: python docs/figures/true_probabilities.py LOG...")
    logs = [(re.split(r"-corrected|\.", Path(path).name)[0], Path(path)) for path in paths]
    figure = draw([(title, predictions(path)) for title, path in logs])
    figure.savefig(OUTPUT, metadata={"Software": "oddsmap"})


if __name__ == "__main__":
    main(sys.argv[1:])
