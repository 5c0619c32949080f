# SPDX-License-Identifier: Apache-2.0
"""A reliability curve: what was predicted, against what happened."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.scoring.reliability import BINS, Reliability

__all__ = ["save_reliability_png"]

_INK = "#39434d"
_CURVE = "#2d6a9f"
_DPI = 150
_Z = 1.96  # 95 % of a normal distribution


def save_reliability_png(
    reliability: Reliability, path: str | Path, *, title: str | None = None, force: bool = False
) -> Path:
    """Draw a reliability curve with 95 % intervals of the rates, above the counts.

    The intervals take the events as independent.

    Args:
        reliability: predictions in bins.
        path: the `.png` to write.
        title: a line above the picture.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        ConfigError: `path` does not end in .png.
        InputError: there is no prediction.
        OutputError: the file exists already or cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    if path.suffix.lower() != ".png":
        raise ConfigError(f"{path}: a picture is named .png; give a name that ends in .png")
    check_output(path, force=force)
    if not reliability.count.any():
        raise InputError(f"{path}: there is no prediction to draw")
    figure = Figure(figsize=(6.0, 7.0), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    curve, counts = figure.subplots(2, 1, sharex=True, height_ratios=[4, 1])
    used = reliability.count > 0
    x, y = reliability.mean_predicted[used], reliability.rate[used]
    n = reliability.count[used]
    half = _Z * np.sqrt(np.maximum(y * (1.0 - y), 0.25 / n) / n)
    curve.plot([0, 1], [0, 1], color=_INK, lw=0.8, ls="--", label="perfect")
    bars = [np.minimum(half, y), np.minimum(half, 1.0 - y)]
    curve.errorbar(x, y, yerr=bars, color=_CURVE, marker="o", ms=5, lw=1.5, capsize=2,
                   label=f"this map (ECE {reliability.ece:.3f})")  # fmt: skip
    curve.set(xlim=(0, 1), ylim=(0, 1), ylabel="share of beams that ended there")
    curve.legend(frameon=False, loc="upper left")
    edges = np.arange(BINS) / BINS
    counts.bar(edges, reliability.count, width=1.0 / BINS, align="edge", color=_CURVE)
    counts.set(xlabel="predicted chance that a beam ends in its next cell", ylabel="predictions")
    counts.set_yscale("log")
    counts.set_ylim(0.8, 2.0 * 10 ** math.ceil(math.log10(reliability.count.max())))
    if title:
        figure.suptitle(title, color=_INK)
    with atomic_output(path, force=force) as part:
        canvas.print_png(str(part), metadata={"Software": "oddsmap"})  # type: ignore[no-untyped-call]
    return path
