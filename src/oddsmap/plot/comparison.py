# SPDX-License-Identifier: Apache-2.0
"""One PNG of two maps: where they agree, and what is different. The layout is that of a map."""

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
    _draw_axes,
    _draw_scale_bar,
    _layout,
    bands,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "save_kinds"]

COLOURS = ("#c7d5e3", "#ffffff", "#d9d9d9", "#d6c4e6", "#c4e0bd", "#11141a", "#2f7fd0", "#e4572e")
"""Of unknown, free, undecided, known in the first or the second alone, occupied, gone, new."""


def save_kinds(
    kinds: npt.NDArray[np.uint8],
    path: str | Path,
    *,
    resolution: float,
    origin: tuple[float, float],
    names: tuple[str, ...],
    force: bool = False,
) -> Path:
    """Draw what two maps say of each cell.

    A map of more than 3800 cells per side is drawn with one pixel for a block of cells, which takes
    the largest kind among them.

    Args:
        kinds: numbers of `COLOURS`, 0 where neither map knows the cell, shape (ny, nx).
        path: the `.png` to write.
        resolution: side of a cell [m].
        origin: the corner of the first cell [m].
        names: of the kinds, for the legend.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: no cell is known.
        ConfigError: `path` does not end in .png.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise ConfigError(f"{path}: a picture must have a name that ends in .png")
    check_output(path, force=force)
    if not kinds.any():
        raise InputError(f"{path}: neither map knows a cell, nothing to draw")
    figure = _draw(kinds, resolution, origin, names)
    with atomic_output(path, force=force) as part:
        # Not savefig: the user's matplotlibrc may tell that to cut the figure.
        figure.canvas.print_png(str(part), metadata={"Software": "oddsmap"})  # type: ignore[attr-defined]
    return path


def _draw(
    kinds: npt.NDArray[np.uint8],
    resolution: float,
    origin: tuple[float, float],
    names: tuple[str, ...],
) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    seen = kinds > 0
    grid = ProbabilityMap(np.broadcast_to(0.0, kinds.shape), seen, resolution, origin)
    layout = _layout(grid)
    x0, x1, y0, y1 = layout.limits
    dpi = max(layout.width, layout.height) / 10.0
    characters = max(len(f"{y:.1f}") for y in (y0, y1))
    left, right, bottom, top = (
        round(inch * dpi) for inch in (0.52 + 0.08 * characters, 0.3, 0.75, 0.85)
    )
    width, height = left + layout.width + right, bottom + layout.height + top
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    box = (left / width, bottom / height, layout.width / width, layout.height / height)
    axes = figure.add_axes(box)
    axes.set_facecolor(COLOURS[0])
    shades = np.rint(255 * np.array([to_rgb(colour) for colour in COLOURS])).astype(np.uint8)
    picture = shades[_of_blocks(kinds[layout.rows, layout.columns], layout.block)]
    side = resolution * layout.block
    x = origin[0] + layout.columns.start * resolution
    y = origin[1] + layout.rows.start * resolution
    for rows in bands(picture.shape, layout, 0.0):
        axes.imshow(
            picture[rows],
            origin="lower",
            interpolation="nearest",
            aspect="auto",  # equal by the layout, to the pixel
            extent=(x, x + side * picture.shape[1], y + side * rows.start, y + side * rows.stop),
        )
    axes.set_xlim(x0, x1)  # imshow moves the limits
    axes.set_ylim(y0, y1)
    _draw_axes(axes)
    _draw_scale_bar(figure, box, x1 - x0)
    patches = [
        Patch(facecolor=colour, edgecolor=_INK, linewidth=0.6, label=name)
        for colour, name in zip(COLOURS, names, strict=True)
    ]
    figure.legend(
        handles=patches,
        loc="lower right",
        bbox_to_anchor=(box[0] + box[2], box[1] + box[3]),
        ncols=4,
        frameon=False,
        fontsize=9,
        labelcolor=_INK,
        handlelength=1.0,
        handleheight=1.0,
        columnspacing=1.2,
        borderaxespad=0.2,
        borderpad=0.2,
    )
    return figure


def _of_blocks(kinds: npt.NDArray[np.uint8], block: int) -> npt.NDArray[np.uint8]:
    """The largest kind of each block of cells."""
    ny, nx = kinds.shape
    padded = np.pad(kinds, ((0, -ny % block), (0, -nx % block)))
    rows, columns = padded.shape[0] // block, padded.shape[1] // block
    largest: npt.NDArray[np.uint8] = padded.reshape(rows, block, columns, block).max(axis=(1, 3))
    return largest
