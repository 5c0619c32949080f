# SPDX-License-Identifier: Apache-2.0
"""The simulated office in four plots.

python docs/figures/figures_and_notebooks.py    # writes docs/images/figures_and_notebooks.png
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oddsmap import EvidenceMap, build_map
from oddsmap.simulate import Lidar2D, office_drive, office_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "figures_and_notebooks.png"


def office(scans: int = 200) -> tuple[EvidenceMap, list[tuple[float, float]]]:
    """What a drive through the office has seen, and where it went."""
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    drive = office_drive(scans)
    readings = (lidar.scan(plan, pose, rng) for pose in drive)
    return build_map(readings, 0.1, votes="beam"), [(pose.x, pose.y) for pose in drive]


def draw(grid: EvidenceMap, way: list[tuple[float, float]]) -> Figure:
    """The map, its reflectivity, distances and a part."""
    from matplotlib.figure import Figure

    figure, view = Figure(figsize=(11.0, 7.4), layout="constrained"), grid.log_odds()
    (first, second), (third, fourth) = figure.subplots(2, 2)
    view.plot(first, title="view.plot(ax, trajectory=way)", trajectory=way)
    grid.reflection().plot(second, show="interval-width", title="reflection().plot(ax, show=...)")
    view.distance_field(1.0).plot(third, title="distance_field(1.0).plot(ax)")
    view.plot(fourth, title="view.plot(ax, crop=(2, 2, 8, 6))", crop=(2.0, 2.0, 8.0, 6.0))
    return figure


if __name__ == "__main__":
    draw(*office()).savefig(OUTPUT, dpi=80)
