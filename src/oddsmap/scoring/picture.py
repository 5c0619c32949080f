# SPDX-License-Identifier: Apache-2.0
"""A reliability diagram: what was predicted, against what happened, and how often."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.plot.frame import INK, check_picture, save_figure
from oddsmap.scoring.reliability import BINS, Reliability

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["save_reliability_png"]

_CURVE = "#2d6a9f"
_GAP = "#e4572e"
_DPI = 150
_Z = 1.96  # 95 % of a normal distribution


def save_reliability_png(
    reliability: Reliability, path: str | Path, *, title: str | None = None, force: bool = False
) -> Path:
    """Draw a reliability diagram with 95 % intervals of the rates, above the counts.

    Each bin is a bar up to the share that happened, at its mean prediction a mark with the
    interval, and from there to the diagonal the gap that the calibration error adds up. Intervals
    are Wilson's, and take the events as independent. Below, each bar says how many predictions
    there are.

    Args:
        reliability: predictions in bins.
        path: the `.png`, `.pdf` or `.svg` to write.
        title: a line above the picture.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        ConfigError: `path` has another suffix.
        InputError: there is no prediction.
        OutputError: the file exists already or cannot be written.

    Source: Niculescu-Mizil and Caruana, Predicting good probabilities with supervised learning
        (ICML 2005); Wilson, Probable inference, the law of succession, and statistical inference
        (1927), for the intervals.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    check_picture(path, force=force)
    if not reliability.count.any():
        raise InputError(f"{path}: there is no prediction to draw")
    figure = Figure(figsize=(6.0, 7.8), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    curve, counts = figure.subplots(2, 1, sharex=True, height_ratios=[4, 1.2])
    _draw_curve(curve, reliability)
    _draw_counts(counts, reliability)
    if title:
        figure.suptitle(title, color=INK)
    return save_figure(figure, path, force=force)


def _draw_curve(axes: Axes, reliability: Reliability) -> None:
    used = reliability.count > 0
    x, y, n = reliability.mean_predicted[used], reliability.rate[used], reliability.count[used]
    left = np.flatnonzero(used) / BINS
    axes.bar(left, y, width=1.0 / BINS, align="edge", color=_CURVE, alpha=0.25, lw=0)
    axes.plot([0, 1], [0, 1], color=INK, lw=0.8, ls="--", label="as often as predicted")
    axes.vlines(x, x, y, color=_GAP, lw=3.0, alpha=0.6, label=f"gap (ECE {reliability.ece:.3f}, "
                f"bins alike {reliability.ece_of_bins:.3f})")  # fmt: skip
    low, high = _wilson(y, n)
    axes.errorbar(x, y, yerr=[np.maximum(y - low, 0.0), np.maximum(high - y, 0.0)], color=_CURVE,
                  marker="o", ms=4.5, lw=1.2, capsize=2, label="happened, 95 %")  # fmt: skip
    axes.set(xlim=(0, 1), ylim=(0, 1), ylabel="share of beams that ended there")
    axes.legend(frameon=False, loc="upper left", fontsize=9)


def _draw_counts(axes: Axes, reliability: Reliability) -> None:
    edges = np.arange(BINS) / BINS
    axes.bar(edges, reliability.count, width=1.0 / BINS, align="edge", color=_CURVE, lw=0)
    for edge, count in zip(edges, reliability.count.tolist(), strict=True):
        if count:
            axes.text(edge + 0.5 / BINS, 1.3 * count, _short(count), ha="center", size=6.5,
                      color=INK)  # fmt: skip
    total = f"{int(reliability.count.sum()):,} predictions"
    axes.set(xlabel="predicted chance that a beam ends in its next cell", ylabel=total)
    axes.set_yscale("log")
    axes.set_ylim(0.8, 5.0 * float(reliability.count.max()))


def _wilson(rate: FloatArray, count: IntArray) -> tuple[FloatArray, FloatArray]:
    """Wilson's interval of a rate: inside [0, 1], and none of length 0 where all or none came."""
    z2 = _Z * _Z / count
    middle = (rate + 0.5 * z2) / (1.0 + z2)
    half = _Z * np.sqrt(rate * (1.0 - rate) / count + 0.25 * z2 / count) / (1.0 + z2)
    return middle - half, middle + half


def _short(count: int) -> str:
    """A count in four characters: 950, 12k, 3.4M."""
    for size, unit in ((1_000_000, "M"), (1000, "k")):
        if count >= size:
            return f"{count / size:.2g}{unit}" if count < 100 * size else f"{count // size}{unit}"
    return str(count)
