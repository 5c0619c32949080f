# SPDX-License-Identifier: Apache-2.0
"""A picture of a landmark map: positions, 95 % ellipses, and the way of the sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.landmarks.landmark import Landmark
from oddsmap.plot.frame import (
    INK,
    TRAJECTORY,
    check_picture,
    draw_trajectory,
    round_length,
    save_figure,
)
from oddsmap.plot.layout import positions_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["ellipse_axes", "plot_landmarks", "save_landmarks_png"]


_MARK = "#2d6a9f"
_LONG_SIDE = 9.0  # [inch], without the margins
_DPI = 150
_MARGIN = 0.06  # of the longer side, around all that is drawn
_MIN_SIDE = 0.3  # of the longer side
_NAMED = 80  # more numbers than these cover each other
_PROBABILITY = 0.95
_SEEN_FROM = 0.02  # of the longer side; smaller ellipses are enlarged, and the legend says so


def save_landmarks_png(
    landmarks: Sequence[Landmark],
    path: str | Path,
    *,
    trajectory: npt.ArrayLike | None = None,
    title: str | None = None,
    force: bool = False,
) -> Path:
    """Draw landmarks with their 95 % ellipses, axes in metres; of 3D landmarks, the x-y plane.

    Where the ellipses are too small to be seen they are all enlarged by one round factor, which
    the legend names.

    Args:
        landmarks: at least one.
        path: the `.png`, `.pdf` or `.svg` to write.
        trajectory: positions of the sensor [m], shape (n, 2), drawn as a line with a ring at its
            start and a dot at its end.
        title: a line above the picture.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: no landmark, or the trajectory has another shape.
        ConfigError: `path` has another suffix.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    check_picture(path, force=force)
    try:
        figure = _draw(landmarks, _way(trajectory), title)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return save_figure(figure, path, force=force)


def plot_landmarks(
    landmarks: Sequence[Landmark],
    ax: Axes | None = None,
    *,
    trajectory: npt.ArrayLike | None = None,
    title: str | None = None,
) -> Axes:
    """Draw landmarks into axes, as `save_landmarks_png` does.

    Args:
        landmarks: at least one.
        ax: where; None: the current axes of pyplot.
        trajectory: positions of the sensor [m], shape (n, 2).
        title: a line above the axes.

    Returns:
        The axes, in metres.

    Raises:
        InputError: no landmark, or the trajectory has another shape.
    """
    line = _way(trajectory)
    low, size, factor = _extent(landmarks, line)
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.gca()
    _fill(ax, landmarks, line, low, size, factor)
    ax.set_aspect("equal")
    if title:
        ax.set_title(title, loc="left")
    return ax


def _way(trajectory: npt.ArrayLike | None) -> FloatArray:
    line = positions_of(trajectory)
    return np.empty((0, 2)) if line is None else line


def ellipse_axes(covariance: FloatArray, probability: float) -> tuple[float, float, float]:
    """The ellipse about the mean of a 2D Gaussian that holds a given probability.

    Args:
        covariance: [m^2], shape (2, 2).
        probability: in (0, 1).

    Returns:
        Longer and shorter semi-axis [m], and the angle of the longer one from the x axis [rad].
    """
    # The chi-square quantile of two degrees of freedom has a closed form.
    scale = math.sqrt(-2.0 * math.log1p(-probability))
    (small, large), vectors = np.linalg.eigh(covariance)
    angle = math.atan2(vectors[1, 1], vectors[0, 1])
    return scale * math.sqrt(large), scale * math.sqrt(small), angle


def _draw(landmarks: Sequence[Landmark], line: FloatArray, title: str | None) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    low, size, factor = _extent(landmarks, line)
    inches = _LONG_SIDE * size / size.max()
    left, right, bottom, top = 0.9, 0.3, 0.7, 0.75 if title else 0.45
    width, height = left + inches[0] + right, bottom + inches[1] + top
    figure = Figure(figsize=(width, height), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((left / width, bottom / height, inches[0] / width, inches[1] / height))
    _fill(axes, landmarks, line, low, size, factor)
    if title:
        figure.text(left / width, 1.0 - 0.2 / height, title, size=12, weight="bold", color=INK,
                    va="top")  # fmt: skip
    return figure


def _extent(
    landmarks: Sequence[Landmark], line: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """The lower left corner and the size of what is shown [m], and how ellipses are enlarged."""
    if not landmarks:
        raise InputError("no landmark to draw")
    means = np.array([mark.mean[:2] for mark in landmarks])
    longer = np.array([_axes_of(mark)[0] for mark in landmarks])
    known = line[np.isfinite(line).all(axis=1)]
    span = float(np.ptp(np.concatenate([means, known]), axis=0).max())
    factor = _enlargement(float(np.median(longer)), span)
    reach = factor * longer[:, None]
    everything = np.concatenate([means - reach, means + reach, known])
    low, size = everything.min(axis=0), np.ptp(everything, axis=0)
    longest = max(float(size.max()), 1e-6)  # a sure landmark at a large coordinate is a point
    pad = np.maximum(_MARGIN * longest, (_MIN_SIDE * longest - size) / 2.0)
    return low - pad, size + 2.0 * pad, factor


def _axes_of(mark: Landmark) -> tuple[float, float, float]:
    return ellipse_axes(mark.covariance[:2, :2], _PROBABILITY)


def _fill(
    axes: Axes,
    landmarks: Sequence[Landmark],
    line: FloatArray,
    low: FloatArray,
    size: FloatArray,
    factor: float,
) -> None:
    axes.set_xlim(low[0], low[0] + size[0])
    axes.set_ylim(low[1], low[1] + size[1])
    _draw_axes(axes, float(size.max()))
    if len(line):
        draw_trajectory(axes, line)
    _draw_landmarks(axes, landmarks, factor)
    _draw_legend(axes, factor, with_path=len(line) > 0)


def _enlargement(ellipse: float, longest: float) -> float:
    """How much to enlarge ellipses of that semi-axis in a picture of that side: 1, 2, 5, 10..."""
    wanted = _SEEN_FROM * longest / (2.0 * ellipse)
    return round_length(wanted) if wanted > 1.0 else 1.0


def _draw_axes(axes: Axes, longest: float) -> None:
    from matplotlib.ticker import MultipleLocator

    for spine in axes.spines.values():
        spine.set_color(INK)
        spine.set_linewidth(0.6)
    step = round_length(longest / 4.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))
        axis.set_major_formatter(f"{{x:.{max(0, -math.floor(math.log10(step)))}f}}")
    axes.grid(color="#dfe5ea", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, width=0.6, length=3.5, labelsize=9)
    axes.set_xlabel("x [m]", color=INK, size=10)
    axes.set_ylabel("y [m]", color=INK, size=10)


def _draw_landmarks(
    axes: Axes,
    landmarks: Sequence[Landmark],
    factor: float,
) -> None:
    from matplotlib.patches import Ellipse
    from matplotlib.patheffects import withStroke

    for mark in landmarks:
        longer, shorter, angle = _axes_of(mark)
        x, y = map(float, mark.mean[:2])
        axes.add_patch(
            Ellipse(
                (x, y),
                2.0 * factor * longer,
                2.0 * factor * shorter,
                angle=math.degrees(angle),
                facecolor=_MARK + "30",
                edgecolor=_MARK,
                linewidth=0.9,
                zorder=3,
            )
        )
        axes.plot(x, y, ".", color=_MARK, markersize=3.5, zorder=4)
        if len(landmarks) <= _NAMED:
            axes.annotate(
                str(mark.id),
                (x, y),
                xytext=(5, 5),
                textcoords="offset points",
                size=7.5,
                color=INK,
                path_effects=[withStroke(linewidth=2.0, foreground="white")],
                zorder=5,
            )


def _draw_legend(axes: Axes, factor: float, *, with_path: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    name = f"{_PROBABILITY:.0%} ellipse".replace("%", " %")
    if factor > 1.0:
        name += f", enlarged {factor:g} times"
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=_MARK, marker=".", linestyle="none", label="landmark"),
        Patch(facecolor=_MARK + "30", edgecolor=_MARK, label=name),
    ]
    if with_path:
        handles.insert(
            0, Line2D([], [], color=TRAJECTORY, linewidth=1.0, label="sensor from ring to dot")
        )
    axes.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(handles),
        frameon=False,
        fontsize=9,
        labelcolor=INK,
        columnspacing=1.4,
        borderaxespad=0.2,
    )
