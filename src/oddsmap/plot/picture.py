# SPDX-License-Identifier: Apache-2.0
"""One PNG of a map, made for people to look at.

The picture is laid out in whole pixels: a cell is k by k pixels or, in a map too large for that, a
pixel is b by b cells, so that no wall falls between two pixels. Where a line of one pixel is too
fine to be seen, walls are drawn three pixels wide.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.maps.probability_map import ProbabilityMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["bands", "cell_colours", "round_length", "save_png"]

_FREE = (255.0, 255.0, 255.0)
_OCCUPIED = (17.0, 20.0, 26.0)
_UNKNOWN = (199.0, 213.0, 227.0)
_INK = "#39434d"
_TRAJECTORY = "#e4572e"

_MIN_PIXELS = 1200  # long side of the map; small maps get several pixels per cell
_MAX_PIXELS = 3800  # with the margins for the text it stays below 4000
_BOLD_FROM = 1900  # from here on a line of one pixel fades on a screen: walls take three
_LONG_SIDE = 10.0  # [inch]; the text is sized for this, whatever the number of pixels
_MARGIN = 0.025  # of the long side, around the observed cells
_BAND = 1 << 19  # cells coloured, and pixels drawn, at a time: Matplotlib takes 100 bytes for each
_MIN_SIDE = 0.3  # a corridor is padded with unknown to this part of its length


@dataclass(frozen=True, slots=True)
class _Layout:
    """What is shown, and how large.

    Args:
        rows: observed rows of the grid.
        columns: observed columns of the grid.
        limits: x0, x1, y0, y1 of the map frame [m], margin included.
        block: cells per pixel, along each side.
        scale: pixels per cell, or per block.
        width: of the map [pixel].
        height: of the map [pixel].
    """

    rows: slice
    columns: slice
    limits: tuple[float, float, float, float]
    block: int
    scale: int
    width: int
    height: int


def save_png(
    grid: ProbabilityMap,
    path: str | Path,
    *,
    title: str | None = None,
    trajectory: npt.ArrayLike | None = None,
    force: bool = False,
) -> Path:
    """Draw a map: free white, occupied near black, unknown light blue, axes in metres.

    Only the observed part is shown, with a small margin. A map of more than 3800 cells per side is
    drawn with one pixel for a block of cells, which takes the colour of the most occupied cell
    among them where that is rather occupied than free (an average would fade a wall of one cell
    away), and else of their mean; it is unknown only if all are. A map of more than 1900 pixels per
    side has its walls drawn three pixels wide.

    Args:
        grid: the map, at least one cell observed.
        path: the `.png` to write.
        title: a line above the picture.
        trajectory: positions in the map frame [m], shape (n, 2), drawn as a line with a ring at its
            start and a dot at its end; a row with NaN interrupts it.
        force: True where an existing file may be replaced.

    Returns:
        The path written.

    Raises:
        InputError: no cell is observed, or the trajectory has another shape.
        ConfigError: `path` does not end in .png.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise ConfigError(f"{path}: a picture must have a name that ends in .png")
    check_output(path, force=force)
    line = None if trajectory is None else np.asarray(trajectory, dtype=np.float64)
    if line is not None and (line.ndim != 2 or line.shape[1] != 2):
        raise InputError(f"{path}: the trajectory must have shape (n, 2), got {line.shape}")
    if not grid.observed.any():
        raise InputError(f"{path}: no cell of the map is observed, nothing to draw")
    figure = _draw(grid, title, line)
    with atomic_output(path, force=force) as part:
        # Not savefig: the user's matplotlibrc may tell that to cut the figure.
        figure.canvas.print_png(str(part), metadata={"Software": "oddsmap"})  # type: ignore[attr-defined]
    return path


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
    rows = max(1, _BAND // max(1, nx * block))
    for first in range(0, height, rows):
        past = min(first + rows, height)
        # With one row more on both sides, from which walls spread.
        begin, end = max(first - 1, 0), min(past + 1, height)
        cells = slice(begin * block, end * block)
        # -1 loses against any other.
        value = np.where(observed[cells], probability[cells], -1.0).astype(np.float32)
        if block > 1:
            value = _of_blocks(value, block)
        if bold:
            around = _largest_around(value)
            value = np.where(around > 0.0, around, value)
        colour[first:past] = _shades(value[first - begin : past - begin])
    return colour


def _shades(value: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    colour = np.empty((*value.shape, 3), dtype=np.uint8)
    for channel in range(3):
        free, occupied = _FREE[channel], _OCCUPIED[channel]
        shade = np.rint(free + (occupied - free) * np.clip(value, 0.0, 1.0))
        colour[..., channel] = np.where(value < 0.0, _UNKNOWN[channel], shade)
    return colour


def _of_blocks(value: npt.NDArray[np.float32], block: int) -> npt.NDArray[np.float32]:
    """The largest of each block of cells from 0.5 on, else the mean of those observed, else -1."""
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


def _layout(grid: ProbabilityMap) -> _Layout:
    seen = [np.flatnonzero(grid.observed.any(axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(int(hit[0]), int(hit[-1]) + 1) for hit in seen)
    corners = np.array(
        [(x, y) for x in (columns.start, columns.stop) for y in (rows.start, rows.stop)], float
    )
    cos, sin = math.cos(grid.yaw), math.sin(grid.yaw)
    corners = corners @ np.array([[cos, sin], [-sin, cos]])  # in cells, axes of the map frame
    low, size = corners.min(axis=0), np.ptp(corners, axis=0)
    longest = float(size.max())
    block = math.ceil((1.0 + 2.0 * _MARGIN) * longest / _MAX_PIXELS)
    scale = max(1, math.ceil(_MIN_PIXELS / longest))  # pixels per cell
    pad = np.maximum(max(1.0, _MARGIN * longest), (_MIN_SIDE * longest - size) / 2.0)
    # A margin of whole blocks, so that the pixels of the picture are those of the cells.
    pad = block * np.ceil(pad / block)
    blocks = np.ceil((size + 2.0 * pad) / block - 1e-6)  # not one more for a rounding error
    r = grid.resolution
    x0, y0 = np.array(grid.origin) + r * (low - pad)
    x1, y1 = np.array([x0, y0]) + r * block * blocks
    width, height = (int(n) * scale for n in blocks)
    return _Layout(rows, columns, (x0, x1, y0, y1), block, scale, width, height)


def _draw(grid: ProbabilityMap, title: str | None, line: npt.NDArray[np.float64] | None) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    layout = _layout(grid)
    x0, x1, y0, y1 = layout.limits
    dpi = max(layout.width, layout.height) / _LONG_SIDE
    characters = max(len(f"{y:.1f}") for y in (y0, y1))  # UTM coordinates need room
    inches = (0.52 + 0.08 * characters, 0.3, 0.75, 0.6 if title else 0.35)
    left, right, bottom, top = (round(inch * dpi) for inch in inches)
    width, height = left + layout.width + right, bottom + layout.height + top
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    box = (left / width, bottom / height, layout.width / width, layout.height / height)
    axes = figure.add_axes(box)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    _draw_cells(axes, grid, layout)
    if line is not None:
        _draw_trajectory(axes, line)
    _draw_axes(axes)
    _draw_legend(figure, box)
    _draw_scale_bar(figure, box, x1 - x0)
    if title:
        figure.text(
            box[0], 1.0 - 0.2 / (height / dpi), title, size=13, weight="bold", color=_INK, va="top"
        )
    return figure


def _draw_cells(axes: Axes, grid: ProbabilityMap, layout: _Layout) -> None:
    from matplotlib.transforms import Affine2D

    part = (layout.rows, layout.columns)
    bold = max(layout.width, layout.height) > _BOLD_FROM and layout.scale == 1
    picture = cell_colours(grid.probability[part], grid.observed[part], layout.block, bold=bold)
    r = grid.resolution
    x, y = layout.columns.start * r, layout.rows.start * r
    side = r * layout.block
    axes.set_facecolor(_hex(_UNKNOWN))
    for rows in bands(picture.shape, layout, grid.yaw):
        axes.imshow(
            picture[rows],
            origin="lower",
            interpolation="nearest",
            aspect="auto",  # equal by the layout, to the pixel
            extent=(x, x + side * picture.shape[1], y + side * rows.start, y + side * rows.stop),
            transform=Affine2D().rotate(grid.yaw).translate(*grid.origin) + axes.transData,
        )
    x0, x1, y0, y1 = layout.limits
    axes.set_xlim(x0, x1)  # imshow moves the limits
    axes.set_ylim(y0, y1)


def bands(shape: tuple[int, ...], layout: _Layout, yaw: float) -> list[slice]:
    """Rows of an image of cells, or of blocks, to be drawn together: whole pixels high.

    Args:
        shape: of the image.
        layout: of the picture.
        yaw: of the grid; bands that are turned would have seams, so then it is one.
    """
    rows = shape[0] if yaw else max(1, _BAND // (shape[1] * layout.scale**2))
    return [slice(at, min(at + rows, shape[0])) for at in range(0, shape[0], rows)]


def _draw_trajectory(axes: Axes, line: npt.NDArray[np.float64]) -> None:
    axes.plot(line[:, 0], line[:, 1], color=_TRAJECTORY, linewidth=1.1, solid_joinstyle="round")
    known = line[np.isfinite(line).all(axis=1)]
    if len(known):
        for point, fill in ((known[0], "white"), (known[-1], _TRAJECTORY)):
            axes.plot(*point, "o", markersize=6, color=_TRAJECTORY, markerfacecolor=fill, zorder=3)


def _draw_axes(axes: Axes) -> None:
    from matplotlib.ticker import MultipleLocator

    for spine in axes.spines.values():
        spine.set_color(_INK)
        spine.set_linewidth(0.6)
    axes.tick_params(colors=_INK, width=0.6, length=3.5, labelsize=9)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    # One step for both, so that a square looks square; a corridor needs a smaller one across.
    step = round_length(max(x1 - x0, y1 - y0) / 5.0)
    for axis, side in ((axes.xaxis, x1 - x0), (axes.yaxis, y1 - y0)):
        own = min(step, round_length(side / 2.0))
        axis.set_major_locator(MultipleLocator(own))
        axis.set_major_formatter(f"{{x:.{max(0, -math.floor(math.log10(own)))}f}}")
    axes.set_xlabel("x [m]", color=_INK, size=10)
    axes.set_ylabel("y [m]", color=_INK, size=10)


def _draw_legend(figure: Figure, box: tuple[float, float, float, float]) -> None:
    from matplotlib.patches import Patch

    names = {"free": _FREE, "unknown": _UNKNOWN, "occupied": _OCCUPIED}
    patches = [
        Patch(facecolor=_hex(colour), edgecolor=_INK, linewidth=0.6, label=name)
        for name, colour in names.items()
    ]
    figure.legend(
        handles=patches,
        loc="lower right",
        bbox_to_anchor=(box[0] + box[2], box[1] + box[3]),
        ncols=3,
        frameon=False,
        fontsize=9,
        labelcolor=_INK,
        handlelength=1.0,
        handleheight=1.0,
        columnspacing=1.2,
        borderaxespad=0.2,
        borderpad=0.2,
    )


def _hex(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(channel):02x}" for channel in colour)


def _draw_scale_bar(figure: Figure, box: tuple[float, float, float, float], width: float) -> None:
    """Draw a bar of round length below the right end of the map, where it hides nothing."""
    from matplotlib.lines import Line2D

    length = round_length(width / 5.0)
    inch = 1.0 / float(figure.get_figheight())
    end, y = box[0] + box[2], 0.2 * inch
    start = end - box[2] * length / width
    tick = 0.05 * inch
    x_of, y_of = (start, start, end, end), (y + tick, y, y, y + tick)
    figure.add_artist(Line2D(x_of, y_of, color=_INK, linewidth=1.6, solid_capstyle="butt"))
    label = f"{length:g} m" if length < 1000.0 else f"{length / 1000.0:g} km"
    gap = 0.08 / float(figure.get_figwidth())
    figure.text(start - gap, y, label, size=9, color=_INK, ha="right", va="center")


def round_length(longest: float) -> float:
    """Give the largest of 1, 2 or 5 times a power of ten that is at most `longest` (> 0)."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))
