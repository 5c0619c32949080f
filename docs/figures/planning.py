# SPDX-License-Identifier: Apache-2.0
"""The simulated office, mapped: how far each cell is from a wall, and what Nav2 charges for it.

python docs/figures/planning.py        # writes docs/images/planning.png
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oddsmap import LogOdds, build_map
from oddsmap.simulate import Lidar2D, office_drive, office_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "planning.png"
RESOLUTION = 0.05
INSCRIBED, INFLATION, SCALING = 0.25, 1.0, 3.0


def view(scans: int = 200) -> LogOdds:
    """What a drive through the office has seen."""
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    readings = (lidar.scan(plan, pose, rng) for pose in office_drive(scans))
    return build_map(readings, RESOLUTION).log_odds()


def draw(view: LogOdds) -> Figure:
    """Signed distances, and costs."""
    from matplotlib.figure import Figure

    field = view.distance_field(obstacles=("occupied", "unknown"), signed=True)
    costs = view.costmap(INSCRIBED, inflation_radius=INFLATION, cost_scaling_factor=SCALING)
    lo, hi = field.lo * RESOLUTION, field.hi * RESOLUTION
    extent = (lo[0], hi[0], lo[1], hi[1])
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    image = left.imshow(
        field.distance, origin="lower", extent=extent, cmap="RdBu", vmin=-1.5, vmax=1.5
    )
    x, y = (np.arange(a, b, RESOLUTION) + RESOLUTION / 2 for a, b in zip(lo, hi, strict=True))
    left.contour(
        x[: field.distance.shape[1]], y[: field.distance.shape[0]], field.distance,
        levels=[INSCRIBED], colors="black", linewidths=0.8,
    )  # fmt: skip
    left.set_title(f"distance to walls and unknown cells [m]; line: {INSCRIBED} m")
    figure.colorbar(image, ax=left, shrink=0.8)
    shown = np.ma.masked_equal(costs.cost, costs.NO_INFORMATION)
    right.set_facecolor("lightgrey")
    image = right.imshow(shown, origin="lower", extent=extent, cmap="inferno_r", vmin=0, vmax=254)
    right.set_title("cost: 254 obstacle, 253 collision, grey unknown")
    figure.colorbar(image, ax=right, shrink=0.8)
    for axes in (left, right):
        axes.set_xlabel("x [m]")
        axes.set_aspect("equal")
    left.set_ylabel("y [m]")
    return figure


if __name__ == "__main__":
    draw(view()).savefig(OUTPUT, dpi=80)
