# SPDX-License-Identifier: Apache-2.0
"""A picture of two maps: where they agree, and what is different."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.plot import frame
from oddsmap.plot.frame import INK
from oddsmap.plot.layout import Cells, FrameOptions, layout_of, positions_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "save_kinds"]

COLOURS = ("#c7d5e3", "#ffffff", "#9c9c9c", "#cba6dd", "#efe08a", "#11141a", "#2f7fd0", "#e4572e")
"""Of unknown, free, undecided, known in the first or the second alone, occupied, gone, new.

A test holds that they stay apart for the three kinds of colour blindness, too."""


def save_kinds(
    kinds: npt.NDArray[np.uint8],
    path: str | Path,
    *,
    resolution: float,
    origin: tuple[float, float],
    names: tuple[str, ...],
    force: bool = False,
    **options: Unpack[FrameOptions],
) -> Path:
    """Draw what two maps say of each cell.

    A map of more than 3800 cells per side is drawn with one pixel for a block of cells, which takes
    the largest kind among them.

    Args:
        kinds: numbers of `COLOURS`, 0 where neither map knows the cell, shape (ny, nx).
        path: the `.png`, `.pdf` or `.svg` to write.
        resolution: side of a cell [m].
        origin: the corner of the first cell [m].
        names: of the kinds, for the legend.
        force: True where an existing file may be replaced.
        options: see `oddsmap.plot.layout.FrameOptions`.

    Returns:
        The path written.

    Raises:
        InputError: no cell is known.
        ConfigError: `path` has another suffix, or a size or crop out of range.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    frame.check_picture(path, force=force)
    if not kinds.any():
        raise InputError(f"{path}: neither map knows a cell, nothing to draw")
    seen = kinds > 0
    grid = Cells(np.broadcast_to(0.0, kinds.shape), seen, resolution, origin)
    try:
        figure = _draw(kinds, grid, names, options)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return frame.save_figure(figure, path, force=force)


def _draw(
    kinds: npt.NDArray[np.uint8],
    grid: Cells,
    names: tuple[str, ...],
    options: FrameOptions,
) -> Figure:
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    title, line = options.get("title"), positions_of(options.get("trajectory"))
    layout = layout_of(grid, options)
    figure, axes, box = frame.figure_of(layout, top=1.1 if title else 0.85)
    shades = np.rint(255 * np.array([to_rgb(colour) for colour in COLOURS])).astype(np.uint8)
    image = shades[_of_blocks(kinds[layout.rows, layout.columns], layout.block)]
    frame.draw_image(axes, grid, layout, image)
    if line is not None:
        frame.draw_trajectory(axes, line)
    frame.draw_around(figure, axes, layout, box, title)
    patches = [
        Patch(facecolor=colour, edgecolor=INK, linewidth=0.6, label=name)
        for colour, name in zip(COLOURS, names, strict=True)
    ]
    figure.legend(
        handles=patches,
        loc="lower right",
        bbox_to_anchor=(box[0] + box[2], box[1] + box[3]),
        ncols=4,
        frameon=False,
        fontsize=9,
        labelcolor=INK,
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
