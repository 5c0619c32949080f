# SPDX-License-Identifier: Apache-2.0
"""One PNG of a quantity of the cells: a colour map, a colour bar, axes in metres.

For what is not a probability of being occupied: a reflectivity, its spread, a change. The layout is
that of the picture of a map, in whole pixels.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.plot.picture import (
    _INK,
    _UNKNOWN,
    _draw_axes,
    _draw_scale_bar,
    _hex,
    _Layout,
    _layout,
    bands,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

__all__ = ["block_largest", "save_quantity"]

_COLOURS = "viridis"
_BAR = 0.18  # width of the colour bar [inch]


def save_quantity(
    grid: ProbabilityMap,
    path: str | Path,
    *,
    label: str,
    limits: tuple[float, float] | None = None,
    force: bool = False,
) -> Path:
    """Draw a quantity of the observed cells; the others, and those of NaN, are light blue.

    A map of more than 3800 cells per side is drawn with one pixel for a block of cells, which takes
    the largest value among them.

    Args:
        grid: the quantity, in the place of the probability; at least one cell observed.
        path: the `.png` to write.
        label: what is drawn, with its unit: the title.
        limits: values at the ends of the colour bar; None: 0 and the largest that occurs.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: no cell is observed.
        ConfigError: `path` does not end in .png.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise ConfigError(f"{path}: a picture must have a name that ends in .png")
    check_output(path, force=force)
    if not grid.observed.any():
        raise InputError(f"{path}: no cell of the map is observed, nothing to draw")
    figure = _draw(grid, label, limits)
    with atomic_output(path, force=force) as part:
        # Not savefig: the user's matplotlibrc may tell that to cut the figure.
        figure.canvas.print_png(str(part), metadata={"Software": "oddsmap"})  # type: ignore[attr-defined]
    return path


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


def _draw(grid: ProbabilityMap, label: str, limits: tuple[float, float] | None) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    layout = _layout(grid)
    x0, x1, y0, y1 = layout.limits
    dpi = max(layout.width, layout.height) / 10.0
    characters = max(len(f"{y:.1f}") for y in (y0, y1))
    left, right, bottom, top = (
        round(inch * dpi) for inch in (0.52 + 0.08 * characters, 0.95, 0.75, 0.5)
    )
    width, height = left + layout.width + right, bottom + layout.height + top
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    box = (left / width, bottom / height, layout.width / width, layout.height / height)
    axes = figure.add_axes(box)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    part = (layout.rows, layout.columns)
    value = np.where(grid.observed[part], grid.probability[part], np.nan)
    value = block_largest(value, layout.block)
    scale = Normalize(*(limits or (0.0, _largest(value))))
    _draw_values(axes, grid, layout, value, scale)
    _draw_axes(axes)
    _draw_bar(figure, box, width / dpi, scale)
    _draw_scale_bar(figure, box, x1 - x0)
    title_height = 1.0 - 0.15 / (height / dpi)
    figure.text(box[0], title_height, label, size=12, color=_INK, va="top")
    return figure


def _largest(value: npt.NDArray[np.float64]) -> float:
    seen = value[np.isfinite(value)]
    largest = float(seen.max()) if seen.size else 0.0
    return largest if largest > 0.0 else 1.0


def _draw_values(
    axes: Axes,
    grid: ProbabilityMap,
    layout: _Layout,
    value: npt.NDArray[np.float64],
    scale: Normalize,
) -> None:
    from matplotlib.transforms import Affine2D

    r = grid.resolution
    x, y = layout.columns.start * r, layout.rows.start * r
    side = r * layout.block
    axes.set_facecolor(_hex(_UNKNOWN))
    shown = np.ma.masked_invalid(value)
    for rows in bands(value.shape, layout, grid.yaw):
        axes.imshow(
            shown[rows],
            origin="lower",
            interpolation="nearest",
            interpolation_stage="data",
            aspect="auto",  # equal by the layout, to the pixel
            cmap=_COLOURS,
            norm=scale,
            extent=(x, x + side * value.shape[1], y + side * rows.start, y + side * rows.stop),
            transform=Affine2D().rotate(grid.yaw).translate(*grid.origin) + axes.transData,
        )
    x0, x1, y0, y1 = layout.limits
    axes.set_xlim(x0, x1)  # imshow moves the limits
    axes.set_ylim(y0, y1)


def _draw_bar(
    figure: Figure, box: tuple[float, float, float, float], inches: float, scale: Normalize
) -> None:
    from matplotlib.cm import ScalarMappable

    bar_box = (box[0] + box[2] + 0.15 / inches, box[1], _BAR / inches, box[3])
    bar = figure.colorbar(ScalarMappable(scale, _COLOURS), cax=figure.add_axes(bar_box))
    bar.outline.set_edgecolor(_INK)
    bar.outline.set_linewidth(0.6)
    bar.ax.tick_params(colors=_INK, width=0.6, length=3.5, labelsize=9)
