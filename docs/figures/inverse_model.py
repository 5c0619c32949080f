# SPDX-License-Identifier: Apache-2.0
"""The inverse sensor model along one beam, for three priors.

python docs/figures/inverse_model.py        # writes docs/images/inverse_model.png
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from oddsmap import BeamSensor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "inverse_model.png"
READING = 3.0
PRIORS = ((0.5, "#111827"), (0.2, "#2563a6"), (0.05, "#c2571a"))
INK = "#39434d"


def draw() -> Figure:
    """Draw p(x | z) against the distance along the beam."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    sensor = BeamSensor(hit_width=0.6)
    distance = np.linspace(0.0, 5.0, 5001)
    near, far = READING - sensor.hit_width / 2, READING + sensor.hit_width / 2

    figure = Figure(figsize=(8.0, 3.6), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.axvspan(near, far, color="#e5e7eb", linewidth=0)
    axes.axvline(READING, ymax=0.87, color=INK, linewidth=0.8, linestyle=":")
    for prior, colour in PRIORS:
        chance = sensor.inverse_model(distance, READING, prior)
        axes.plot(distance, chance, color=colour, linewidth=1.8)
        axes.text(5.05, prior, f"prior {prior:g}", color=colour, va="center")
    for x, text in (
        (near / 2, "(3) before"),
        (READING, "(2) around"),
        ((far + 5.0) / 2, "(1) behind"),
    ):
        axes.text(x, 0.93, text, color=INK, ha="center", va="center")
    axes.set_xlim(0.0, 5.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_xlabel("distance along the beam [m]; the reading is 3 m")
    axes.set_ylabel("p(occupied | this reading)")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    draw().savefig(OUTPUT, metadata={"Software": "oddsmap"})
