# SPDX-License-Identifier: Apache-2.0
"""A picture of a quantity of the cells: a colour map, a colour bar, axes in metres.

For what is not a probability of being occupied: a reflectivity, its spread, a change, a distance.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.map_files.fields import Grid
from oddsmap.plot import frame
from oddsmap.plot.frame import INK
from oddsmap.plot.layout import FrameOptions, layout_of, positions_of

if TYPE_CHECKING:
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "block_largest", "limits_of", "save_quantity"]

COLOURS = "viridis"
"""Told apart by people with any kind of colour vision, and in grey."""
_BAR = 0.18  # width of the colour bar [inch]


def save_quantity(
    grid: Grid,
    path: str | Path,
    *,
    label: str,
    limits: tuple[float, float] | None = None,
    force: bool = False,
    **options: Unpack[FrameOptions],
) -> Path:
    """Draw a quantity of the observed cells; the others, and those of NaN, are light blue.

    A map of more than 3800 cells per side is drawn with one pixel for a block of cells, which takes
    the largest value among them.

    Args:
        grid: the quantity, in the place of the probability; at least one cell observed.
        path: the `.png`, `.pdf` or `.svg` to write.
        label: what is drawn, with its unit: the title, or beside the colour bar below a title.
        limits: values at the ends of the colour bar; None: 0 and the largest that occurs.
        force: True where an existing file may be replaced.
        options: see `oddsmap.plot.layout.FrameOptions`.

    Returns:
        The path written.

    Raises:
        InputError: no cell is observed, or the trajectory has another shape.
        ConfigError: `path` has another suffix, or a size or crop out of range.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    frame.check_picture(path, force=force)
    try:
        figure = _draw(grid, label, limits, options)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return frame.save_figure(figure, path, force=force)


def block_largest(value: npt.NDArray[np.float64], block: int) -> npt.NDArray[np.float64]:
    """The largest value of each block of cells, NaN where it has none but NaN.

    Args:
        value: shape (ny, nx).
        block: cells along each side.

    Returns:
        Shape (ceil(ny / block), ceil(nx / block)).
    """
    ny, nx = value.shape
    padded = np.where(np.isnan(value), -np.inf, value)  # loses against any other
    padded = np.pad(padded, ((0, -ny % block), (0, -nx % block)), constant_values=-np.inf)
    rows, columns = padded.shape[0] // block, padded.shape[1] // block
    largest = padded.reshape(rows, block, columns, block).max(axis=(1, 3))
    return np.where(np.isneginf(largest), np.nan, largest)


def limits_of(value: npt.NDArray[np.float64]) -> tuple[float, float]:
    """The ends of a colour bar: 0, or what is lower, and the largest value that occurs."""
    seen = value[np.isfinite(value)]
    low, high = (float(seen.min()), float(seen.max())) if seen.size else (0.0, 0.0)
    low = min(low, 0.0)
    return low, high if high > low else low + 1.0


def _draw(
    grid: Grid,
    label: str,
    limits: tuple[float, float] | None,
    options: FrameOptions,
) -> Figure:
    from matplotlib.colors import Normalize

    title, line = options.get("title"), positions_of(options.get("trajectory"))
    layout = layout_of(grid, options)
    figure, axes, box = frame.figure_of(layout, right=1.15 if title else 0.95, top=0.5)
    part = (layout.rows, layout.columns)
    value = np.where(grid.observed[part], grid.probability[part], np.nan)
    value = block_largest(value, layout.block)
    scale = Normalize(*(limits or limits_of(value)))
    shown = np.ma.masked_invalid(value)
    frame.draw_image(
        axes, grid, layout, shown, interpolation_stage="data", cmap=COLOURS, norm=scale
    )
    if line is not None:
        frame.draw_trajectory(axes, line)
    frame.draw_around(figure, axes, layout, box, title)
    _draw_bar(figure, box, scale, label if title else None)
    _say_unknown(figure, box)
    if not title:
        y = 1.0 - 0.15 / float(figure.get_figheight())
        figure.text(box[0], y, label, size=12, color=INK, va="top")
    return figure


def _draw_bar(figure: Figure, box: frame.Box, scale: Normalize, label: str | None) -> None:
    from matplotlib.cm import ScalarMappable

    wide = float(figure.get_figwidth())
    place = figure.add_axes((box[0] + box[2] + 0.15 / wide, box[1], _BAR / wide, box[3]))
    bar = figure.colorbar(ScalarMappable(scale, COLOURS), cax=place)
    bar.outline.set_edgecolor(INK)
    bar.outline.set_linewidth(0.6)
    bar.ax.tick_params(colors=INK, width=0.6, length=3.5, labelsize=9)
    if label is not None:
        bar.set_label(label, color=INK, size=9)


def _say_unknown(figure: Figure, box: frame.Box) -> None:
    """What light blue is, below the colour bar."""
    from matplotlib.patches import Rectangle

    wide, high = float(figure.get_figwidth()), float(figure.get_figheight())
    x, y = box[0] + box[2] + 0.15 / wide, box[1] - 0.3 / high
    patch = ((x, y - 0.06 / high), 0.12 / wide, 0.12 / high)
    figure.add_artist(Rectangle(*patch, facecolor=frame.UNKNOWN, edgecolor=INK, linewidth=0.6))
    figure.text(x + 0.18 / wide, y, "unknown", size=8, color=INK, va="center_baseline")
