# SPDX-License-Identifier: Apache-2.0
"""The robot of `examples/explore.py` on its way: what it knows, where that ends, where it goes.

python docs/figures/exploring.py            # writes images/exploring.png
python docs/figures/exploring.py --table    # prints the table of docs/exploring.md: a minute
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from oddsmap.plot.picture import cell_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DOCS = Path(__file__).resolve().parent.parent
OUTPUT = DOCS / "images" / "exploring.png"
STARTS = ((0.9, 7.0), (15.3, 6.9), (8.1, 9.6), (1.1, 1.5), (17.4, 7.0))
CELLS = (200, 140)
INK, WAY, EDGE = "#39434d", "#e4572e", "#00798c"


def example() -> Any:
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("explore", DOCS.parent / "examples/explore.py")
    if spec is None or spec.loader is None:
        raise ImportError("examples/explore.py is gone")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def draw(steps: list[Any] | None = None) -> Figure:
    """Four moments of the way."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    module = example()
    steps = list(module.explore()) if steps is None else steps
    figure = Figure(figsize=(9.6, 7.3), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    last = len(steps) - 1
    moments = (0, max(1, last // 5), max(1, last // 2), last)
    for panel, number in zip(figure.subplots(2, 2).flat, moments, strict=True):
        _draw_step(panel, module, steps[number])
    return figure


def _draw_step(panel: Axes, module: Any, step: Any) -> None:
    view, side = step.view, step.view.resolution
    region = ((0, 0), CELLS)
    colours = cell_colours(view.probability(region), view.observed(region))
    extent = (0.0, CELLS[0] * side, 0.0, CELLS[1] * side)
    panel.imshow(colours, origin="lower", extent=extent, interpolation="nearest")
    for frontier in step.frontiers:
        x, y = view.centre_of(frontier.cells).T
        panel.plot(x, y, "s", color=EDGE, markersize=1.6, markeredgewidth=0)
        panel.plot(*frontier.goal, "o", color=EDGE, markersize=4.0)
    panel.plot(*step.driven.T, color=WAY, linewidth=1.2)
    panel.plot(*step.way.T, color=WAY, linewidth=1.2, linestyle=(0, (2, 1.5)))
    panel.plot(*step.driven[-1], "o", color=WAY, markersize=6)
    driven, known = module.length_of(step.driven), module.share_known(view)
    scans = "1 scan" if step.scans == 1 else f"{step.scans} scans"
    title = f"{driven:.0f} m, {scans}: {known:.0%} of the floor known".replace("%", " %")
    panel.set_title(title, fontsize=9, color=INK)
    panel.tick_params(labelsize=7, colors=INK, length=2)


def table() -> str:
    """The table of docs/exploring.md, in Markdown: means over all starts."""
    module = example()
    lines = [
        "| to the frontier | 50 % | 75 % | 90 % | all | known then |",
        "|---|---|---|---|---|---|",
    ]
    for name, nearest in (("by gain and way", False), ("that is nearest", True)):
        rows = []
        for start in STARTS:
            module.START = start
            steps = [
                (module.share_known(step.view), module.length_of(step.driven))
                for step in module.explore(nearest=nearest)
            ]
            reached = [min(way for known, way in steps if known >= k) for k in (0.5, 0.75, 0.9)]
            rows.append([*reached, steps[-1][1], 100.0 * steps[-1][0]])
        *ways, known = np.mean(rows, axis=0)
        lines.append(f"| {name} | {' | '.join(f'{way:.0f} m' for way in ways)} | {known:.1f} % |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    if "--table" in sys.argv[1:]:
        sys.stdout.write(table())
    else:
        draw().savefig(OUTPUT, metadata={"Software": "oddsmap"})
