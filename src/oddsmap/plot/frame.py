# SPDX-License-Identifier: Apache-2.0
"""What stands around a picture of cells: axes in metres, a scale bar, a title, a trajectory."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError
from oddsmap.map_files.fields import Grid
from oddsmap.plot.layout import Layout

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "INK", "TRAJECTORY", "UNKNOWN", "bands", "check_picture", "draw_around", "draw_axes",
    "draw_image", "draw_trajectory", "figure_of", "round_length", "save_figure",
]  # fmt: skip

SUFFIXES = (".png", ".pdf", ".svg")
INK = "#39434d"
UNKNOWN = "#c7d5e3"
TRAJECTORY = "#e4572e"

BAND = 1 << 19  # cells coloured, and pixels drawn, at a time: Matplotlib takes 100 bytes for each

Box = tuple[float, float, float, float]
"""Left, bottom, width and height in a figure."""


def figure_of(layout: Layout, *, right: float = 0.3, top: float = 0.35) -> tuple[Figure, Axes, Box]:
    """A figure with empty axes where the map belongs.

    Args:
        layout: of the map.
        right: room beside the map [inch].
        top: room above the map [inch].

    Returns:
        The figure, its axes, and their place in it: left, bottom, width, height.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    x0, x1, y0, y1 = layout.limits
    dpi = max(layout.width, layout.height) / layout.inches
    characters = max(len(f"{y:.1f}") for y in (y0, y1))  # UTM coordinates need room
    bottom = 0.95 if layout.outside else 0.75
    inches = (0.52 + 0.08 * characters, right, bottom, top)
    left, beside, below, above = (round(inch * dpi) for inch in inches)
    width, height = left + layout.width + beside, below + layout.height + above
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
    FigureCanvasAgg(figure)
    box = (left / width, below / height, layout.width / width, layout.height / height)
    axes = figure.add_axes(box)
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    axes.set_facecolor(UNKNOWN)
    return figure, axes, box


def draw_image(
    axes: Axes, grid: Grid, layout: Layout, image: npt.NDArray[np.generic], **how: object
) -> None:
    """Draw an image of the shown cells, or of blocks of them, to the pixel.

    Args:
        axes: where.
        grid: whose cells they are.
        layout: what is shown.
        image: colours or values, shape (ny, nx, ...).
        how: what `imshow` is told of values.
    """
    from matplotlib.transforms import Affine2D

    r = grid.resolution
    x, y = layout.columns.start * r, layout.rows.start * r
    side = r * layout.block
    for rows in bands(image.shape, layout, grid.yaw):
        axes.imshow(
            image[rows],
            origin="lower",
            interpolation="nearest",
            aspect="auto",  # equal by the layout, to the pixel
            extent=(x, x + side * image.shape[1], y + side * rows.start, y + side * rows.stop),
            transform=Affine2D().rotate(grid.yaw).translate(*grid.origin) + axes.transData,
            **how,  # type: ignore[arg-type]  # of several types, by their names
        )
    x0, x1, y0, y1 = layout.limits
    axes.set_xlim(x0, x1)  # imshow moves the limits
    axes.set_ylim(y0, y1)


def bands(shape: tuple[int, ...], layout: Layout, yaw: float) -> list[slice]:
    """Rows of an image of cells, or of blocks, to be drawn together: whole pixels high.

    Args:
        shape: of the image.
        layout: of the picture.
        yaw: of the grid; bands that are turned would have seams, so then it is one.
    """
    rows = shape[0] if yaw else max(1, BAND // (shape[1] * layout.scale**2))
    return [slice(at, min(at + rows, shape[0])) for at in range(0, shape[0], rows)]


def draw_trajectory(axes: Axes, line: FloatArray) -> None:
    """A way with a ring at its start and a dot at its end."""
    axes.plot(line[:, 0], line[:, 1], color=TRAJECTORY, linewidth=1.1, solid_joinstyle="round")
    known = line[np.isfinite(line).all(axis=1)]
    if len(known):
        for point, fill in ((known[0], "white"), (known[-1], TRAJECTORY)):
            axes.plot(*point, "o", markersize=6, color=TRAJECTORY, markerfacecolor=fill, zorder=3)


def draw_axes(axes: Axes) -> None:
    """Axes in metres, with ticks at round lengths."""
    from matplotlib.ticker import MultipleLocator

    for spine in axes.spines.values():
        spine.set_color(INK)
        spine.set_linewidth(0.6)
    axes.tick_params(colors=INK, width=0.6, length=3.5, labelsize=9)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    # One step for both, so that a square looks square; a corridor needs a smaller one across.
    step = round_length(max(x1 - x0, y1 - y0) / 5.0)
    for axis, side in ((axes.xaxis, x1 - x0), (axes.yaxis, y1 - y0)):
        own = min(step, round_length(side / 2.0))
        axis.set_major_locator(MultipleLocator(own))
        axis.set_major_formatter(f"{{x:.{max(0, -math.floor(math.log10(own)))}f}}")
    axes.set_xlabel("x [m]", color=INK, size=10)
    axes.set_ylabel("y [m]", color=INK, size=10)


def draw_around(figure: Figure, axes: Axes, layout: Layout, box: Box, title: str | None) -> None:
    """Draw axes, scale bar and title, and say which known cells are not shown."""
    draw_axes(axes)
    _draw_scale_bar(figure, layout, box)
    height = float(figure.get_figheight())
    if title:
        y = 1.0 - 0.2 / height
        figure.text(box[0], y, title, size=13, weight="bold", color=INK, va="top")
    if layout.outside:
        note = f"not shown: {layout.outside:,} of {layout.known:,} known cells, far from the others"
        figure.text(box[0], 0.12 / height, note, size=8, color=INK, va="bottom")


def _draw_scale_bar(figure: Figure, layout: Layout, box: Box) -> None:
    """Draw a bar of round length below the right end of the map, where it hides nothing."""
    from matplotlib.lines import Line2D

    width = layout.limits[1] - layout.limits[0]
    length = round_length(width / 5.0)
    inch = 1.0 / float(figure.get_figheight())
    end, y = box[0] + box[2], box[1] - 0.55 * inch
    start = end - box[2] * length / width
    tick = 0.05 * inch
    x_of, y_of = (start, start, end, end), (y + tick, y, y, y + tick)
    figure.add_artist(Line2D(x_of, y_of, color=INK, linewidth=1.6, solid_capstyle="butt"))
    label = f"{length:g} m" if length < 1000.0 else f"{length / 1000.0:g} km"
    gap = 0.08 / float(figure.get_figwidth())
    figure.text(start - gap, y, label, size=9, color=INK, ha="right", va="center")


def round_length(longest: float) -> float:
    """Give the largest of 1, 2 or 5 times a power of ten that is at most `longest` (> 0)."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= longest * (1.0 + 1e-9))


def check_picture(path: Path, *, force: bool) -> None:
    """Look at the name of a picture before anything is drawn.

    Raises:
        ConfigError: it ends in none of `SUFFIXES`.
        OutputError: the file exists already.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"{path}: a picture must have a name that ends in .png, .pdf or .svg")
    check_output(path, force=force)


def save_figure(figure: Figure, path: Path, *, force: bool) -> Path:
    """Write a figure, the same bytes each time.

    Raises:
        OutputError: the file cannot be written.
    """
    import matplotlib as mpl

    kind = path.suffix.lower()
    # Not savefig: the user's matplotlibrc may tell that to cut the figure. The canvases' own ways
    # to print have no types.
    with atomic_output(path, force=force) as part, mpl.rc_context({"svg.hashsalt": "oddsmap"}):
        if kind == ".pdf":
            from matplotlib.backends.backend_pdf import FigureCanvasPdf

            facts = {"Creator": "oddsmap", "CreationDate": None}
            FigureCanvasPdf(figure).print_pdf(str(part), metadata=facts)  # type: ignore[no-untyped-call]
        elif kind == ".svg":
            from matplotlib.backends.backend_svg import FigureCanvasSVG

            facts = {"Creator": "oddsmap", "Date": None}
            FigureCanvasSVG(figure).print_svg(str(part), metadata=facts)  # type: ignore[no-untyped-call]
        else:
            from matplotlib.backends.backend_agg import FigureCanvasAgg

            canvas = FigureCanvasAgg(figure)
            canvas.print_png(str(part), metadata={"Software": "oddsmap"})  # type: ignore[no-untyped-call]
    return path
