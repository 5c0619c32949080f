# SPDX-License-Identifier: Apache-2.0
"""A picture of a map, made for people to look at: PNG, PDF or SVG.

Where a line of one pixel is too fine to be seen, walls are drawn three pixels wide.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.map_files.fields import Grid
from oddsmap.plot import frame
from oddsmap.plot.frame import INK, UNKNOWN
from oddsmap.plot.layout import FrameOptions, layout_of, positions_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FREE", "OCCUPIED", "block_values", "cell_colours", "save_picture"]

FREE = (255.0, 255.0, 255.0)
OCCUPIED = (17.0, 20.0, 26.0)
_UNKNOWN = (199.0, 213.0, 227.0)

_BOLD_FROM = 1900  # from here on a line of one pixel fades on a screen: walls take three
_LEGEND = 3.4  # its width [inch]


def save_picture(
    grid: Grid, path: str | Path, *, force: bool = False, **options: Unpack[FrameOptions]
) -> Path:
    """Draw a map: free white, occupied near black, unknown light blue, axes in metres.

    Only the observed part is shown, with a small margin, and without the few cells that lie far
    from all others, where these would shrink the rest; how many there are stands below. A map of
    more than 3800 cells per side is drawn with one pixel for a block of cells, which takes the
    colour of the most occupied cell among them where that is rather occupied than free (an average
    would fade a wall of one cell away), and else of their mean; it is unknown only if all are. A
    map of more than 1900 pixels per side has its walls drawn three pixels wide.

    Args:
        grid: the map, at least one cell observed.
        path: the `.png`, `.pdf` or `.svg` to write.
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
        figure = _draw(grid, options)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return frame.save_figure(figure, path, force=force)


def cell_colours(
    probability: npt.NDArray[np.float64],
    observed: npt.NDArray[np.bool_],
    block: int = 1,
    *,
    bold: bool = False,
) -> npt.NDArray[np.uint8]:
    """Colour cells, or blocks of cells, those rather occupied than free deciding.

    Args:
        probability: p(occupied), shape (ny, nx).
        observed: True where there was evidence, same shape.
        block: cells per pixel, along each side.
        bold: True: what is rather occupied than free spreads to the pixels around it.

    Returns:
        RGB, shape (ceil(ny / block), ceil(nx / block), 3).
    """
    ny, nx = probability.shape
    height = -(-ny // block)
    colour = np.empty((height, -(-nx // block), 3), dtype=np.uint8)
    rows = max(1, frame.BAND // max(1, nx * block))
    for first in range(0, height, rows):
        past = min(first + rows, height)
        # With one row more on both sides, from which walls spread.
        begin, end = max(first - 1, 0), min(past + 1, height)
        cells = slice(begin * block, end * block)
        # -1 loses against any other.
        value = np.where(observed[cells], probability[cells], -1.0).astype(np.float32)
        if block > 1:
            value = block_values(value, block)
        if bold:
            around = _largest_around(value)
            value = np.where(around > 0.0, around, value)
        colour[first:past] = _shades(value[first - begin : past - begin])
    return colour


def _shades(value: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    colour = np.empty((*value.shape, 3), dtype=np.uint8)
    for channel in range(3):
        free, occupied = FREE[channel], OCCUPIED[channel]
        shade = np.rint(free + (occupied - free) * np.clip(value, 0.0, 1.0))
        colour[..., channel] = np.where(value < 0.0, _UNKNOWN[channel], shade)
    return colour


def block_values(value: npt.NDArray[np.float32], block: int) -> npt.NDArray[np.float32]:
    """The largest of each block of cells from 0.5 on, else the mean of those observed, else -1.

    Args:
        value: p(occupied), -1 where not observed, shape (ny, nx).
        block: cells along each side.
    """
    ny, nx = value.shape
    value = np.pad(value, ((0, -ny % block), (0, -nx % block)), constant_values=-1.0)
    rows, columns = value.shape[0] // block, value.shape[1] // block
    value = value.reshape(rows, block, columns, block)
    largest, seen = value.max(axis=(1, 3)), (value >= 0.0).sum(axis=(1, 3))
    total = np.maximum(value, 0.0).sum(axis=(1, 3))
    mean = total / np.maximum(seen, 1)
    return np.asarray(np.where((largest >= 0.5) | (seen == 0), largest, mean), np.float32)


def _largest_around(value: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The largest value of each pixel and the eight around it where it is from 0.5 on, else 0."""
    for axis in (0, 1):
        wide = np.pad(value, [(1, 1) if each == axis else (0, 0) for each in (0, 1)],
                      constant_values=-1.0)  # fmt: skip
        parts = [wide.take(range(k, k + value.shape[axis]), axis=axis) for k in range(3)]
        value = np.maximum(np.maximum(parts[0], parts[1]), parts[2])
    return np.where(value >= 0.5, value, np.float32(0.0))


def _draw(grid: Grid, options: FrameOptions) -> Figure:
    title, line = options.get("title"), positions_of(options.get("trajectory"))
    layout = layout_of(grid, options)
    figure, axes, box = frame.figure_of(layout, top=0.75 if title else 0.35)
    part = (layout.rows, layout.columns)
    bold = max(layout.width, layout.height) > _BOLD_FROM and layout.scale == 1
    image = cell_colours(grid.probability[part], grid.observed[part], layout.block, bold=bold)
    frame.draw_image(axes, grid, layout, image)
    if line is not None:
        frame.draw_trajectory(axes, line)
    frame.draw_around(figure, axes, layout, box, title)
    _draw_legend(figure, box)
    return figure


def _draw_legend(figure: Figure, box: frame.Box) -> None:
    """What white, grey, black and blue are, in a line above the right end of the map."""
    from matplotlib.patches import Rectangle

    wide, high = float(figure.get_figwidth()), float(figure.get_figheight())
    right, y = box[0] + box[2], box[1] + box[3] + 0.175 / high

    def place(inch: float) -> float:
        return right - (_LEGEND - inch) / wide

    def say(inch: float, text: str, side: str) -> None:
        figure.text(place(inch), y, text, size=9, color=INK, ha=side, va="center_baseline")

    say(0.92, "p(occupied):  0 free", "right")
    bar = figure.add_axes((place(1.0), y - 0.06 / high, 0.7 / wide, 0.12 / high))
    shades = _shades(np.linspace(0.0, 1.0, 64, dtype=np.float32)[None])
    bar.imshow(shades, aspect="auto", interpolation="nearest")
    bar.set(xticks=[], yticks=[])
    for spine in bar.spines.values():
        spine.set_color(INK)
        spine.set_linewidth(0.6)
    say(1.78, "1 occupied", "left")
    patch = ((place(2.62), y - 0.06 / high), 0.12 / wide, 0.12 / high)
    figure.add_artist(Rectangle(*patch, facecolor=UNKNOWN, edgecolor=INK, linewidth=0.6))
    say(2.82, "unknown", "left")
