# SPDX-License-Identifier: Apache-2.0
"""A scan scored from many poses, and all of p(z) along one ray, in a part of the office.

python docs/figures/localising.py        # writes docs/images/localising.png
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import oddsmap
from oddsmap.simulate import Lidar2D, office_drive, office_plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "localising.png"
RESOLUTION, RANGE_MAX, BEAMS = 0.1, 20.0, 60
BOX = (np.array([0, 0]), np.array([200, 140]))
FIELD, BEAM, INK = "#2563a6", "#c2571a", "#39434d"


def draw() -> Figure:
    """Particles and their weights; log likelihoods beside the true pose; p(z) along a ray."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(4)
    drive = office_drive(160)
    view = oddsmap.build_map([lidar.scan(plan, pose, rng) for pose in drive], RESOLUTION).log_odds()
    true = drive[70]
    scan, here = lidar.scan(plan, true, rng), np.array([true.x, true.y, true.theta])
    figure = Figure(figsize=(11.0, 3.6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.35, 1.0, 1.0])
    models = {
        "likelihood_field": (view.likelihood_field(RANGE_MAX), FIELD),
        "beam_likelihood": (view.beam_likelihood(RANGE_MAX), BEAM),
    }
    _particles(left, view, models["likelihood_field"][0], scan, here, rng)
    _beside(middle, models, scan, here)
    _along(right, view, here)
    for axes in (middle, right):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _particles(
    axes: Axes, view: Any, field: Any, scan: Any, here: Any, rng: np.random.Generator
) -> None:
    particles = here + rng.normal(size=(3000, 3)) * (1.2, 1.2, 0.3)
    logs = field.log_likelihood(particles, scan, max_beams=BEAMS)
    order = np.argsort(logs)
    axes.imshow(
        1.0 - view.probability(BOX), cmap="gray", vmin=0.0, vmax=1.0, origin="lower",
        extent=(0.0, 20.0, 0.0, 14.0),
    )  # fmt: skip
    shown = axes.scatter(
        *particles[order, :2].T, c=logs[order] - logs.max(), s=4, cmap="viridis", vmin=-150.0,
        linewidths=0,
    )  # fmt: skip
    axes.figure.colorbar(shown, ax=axes, shrink=0.7, label="log likelihood")
    axes.plot(*here[:2], "o", color="#dc2626", markersize=14, markerfacecolor="none")
    axes.set(title="particles, red: the true place", xlabel="x [m]", ylabel="y [m]")


def _beside(axes: Axes, models: dict[str, tuple[Any, str]], scan: Any, here: Any) -> None:
    off = np.linspace(-0.8, 0.8, 321)
    poses = here + off[:, None] * np.array([0.0, 1.0, 0.0])
    for name, (model, colour) in models.items():
        logs = model.log_likelihood(poses, scan, max_beams=BEAMS)
        axes.plot(off, logs - logs.max(), color=colour, linewidth=1.4, label=name)
    axes.set(title="along y through the true pose", xlabel="off by [m]", ylabel="log likelihood")
    axes.legend(frameon=False, loc="lower center")


def _along(axes: Axes, view: Any, here: Any) -> None:
    way = np.array([[np.cos(here[2] + 0.35), np.sin(here[2] + 0.35)]])
    sensor = oddsmap.BeamSensor(range_max=RANGE_MAX, sigma=0.05)
    found = view.range_distribution(here[:2], way, sensor, bin_width=0.05)
    met = view.cast_rays(here[:2], way, RANGE_MAX).distance[0]
    mean = view.expected_ranges(here[:2], way, sensor)[0]
    axes.semilogy(found.middles, found.density[0], color=INK, linewidth=1.2)
    axes.axvline(met, color=FIELD, linestyle="--", linewidth=1.2)
    axes.axvline(mean, color=BEAM, linewidth=1.2)
    axes.text(4.5, 3.0, f"cast_rays {met:.2f} m", color=FIELD, fontsize=8)
    axes.text(4.5, 1.2, f"expected_ranges {mean:.2f} m", color=BEAM, fontsize=8)
    axes.set_title("p(z) along one ray")
    axes.set(xlabel="reading z [m]", ylabel="density [1/m]")
    axes.set_xlim(0.0, 10.0)


if __name__ == "__main__":
    draw().savefig(OUTPUT, metadata={"Software": "oddsmap"})
