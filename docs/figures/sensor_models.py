# SPDX-License-Identifier: Apache-2.0
"""What one reading says, sensor by sensor: maps of a single reading, and p(z | map).

python docs/figures/sensor_models.py        # writes docs/images/sensor_*.png
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from oddsmap import (
    Beams,
    BeamSensor,
    ConeSensor,
    ForwardModel,
    GridScan,
    OverheadSensor,
    Pose2,
    Scan,
    Window,
    build_map,
)
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import Sensor

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]
Case: TypeAlias = tuple[str, dict[str, Any], float]
"""Title, fields of the sensor, reading [m]."""

FOLDER = Path(__file__).resolve().parent.parent / "images"
RESOLUTION = 0.1
RANGE_MAX = 4.0
PRIORS = ((0.5, "#111827"), (0.2, "#2563a6"))
COLOURS = ("#111827", "#2563a6", "#c2571a", "#3f7d4e", "#8a3ffc")
INK = "#39434d"
UNKNOWN = "#c7d5e3"


def one_reading(
    reading: Measurement, sensor: Sensor, lo: Sequence[int], hi: Sequence[int], prior: float = 0.5
) -> FloatArray:
    """p(occupied) of a box of cells after one reading, NaN where it says nothing."""
    view = build_map([reading], RESOLUTION, sensor=sensor, votes="beam").log_odds(prior=prior)
    return np.where(view.observed((lo, hi)), view.probability((lo, hi)), np.nan)


def beam_of(z: float) -> Scan:
    """One beam along x, from the middle of cell (0, 0)."""
    pose = Pose2(RESOLUTION / 2, RESOLUTION / 2, 0.0)
    return Scan(pose, np.array([[1.0, 0.0]]), np.array([z]))


def sheet(rows: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    """An empty figure and its panels, row by row."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    panels = list(np.ravel(figure.subplots(rows, columns)))
    for panel in panels:
        panel.tick_params(labelsize=7, colors=INK, length=2)
    return figure, panels


def along(panel: Axes, p: FloatArray, prior: float, colour: str, label: str | None = None) -> None:
    """A line of cells as steps; where nothing was said, the prior, dotted."""
    edges = RESOLUTION * (np.arange(len(p) + 1) - 0.5)  # the sensor is in the middle of cell 0
    panel.stairs(
        np.where(np.isnan(p), prior, p), edges, color=colour, lw=0.9, ls=":", baseline=None
    )
    panel.stairs(p, edges, color=colour, lw=1.6, label=label, baseline=None)
    panel.set_xlim(0.0, RANGE_MAX)
    panel.set_ylim(0.0, 1.0)
    panel.spines[["top", "right"]].set_visible(False)


def narrow_beams() -> Figure:
    """BeamSensor: the cells along a beam, for two priors."""
    cases: tuple[Case, ...] = (
        ("default: a hit for one cell", {}, 3.0),
        ("hit_width = 0.6", {"hit_width": 0.6}, 3.0),
        ("hit_width = 0.6, share_hit", {"hit_width": 0.6, "share_hit": True}, 3.0),
        ("sigma = 0.1 (spread = 3)", {"sigma": 0.1}, 3.0),
        ("fade = 1", {"fade": 1.0}, 3.0),
        ("nothing seen: +Inf, range_max = 3.5", {"range_max": 3.5}, np.inf),
    )
    figure, panels = sheet(2, 3, 4.4)
    for panel, (title, fields, z) in zip(panels, cases, strict=True):
        sensor = BeamSensor(**{"range_max": RANGE_MAX, **fields})
        for prior, colour in PRIORS:
            p = one_reading(beam_of(z), sensor, [0, 0], [42, 1], prior)[0]
            along(panel, p, prior, colour, f"prior {prior:g}")
        panel.set_title(title, fontsize=9, color=INK)
    panels[0].legend(fontsize=7, frameon=False, loc="upper left")
    for panel in panels[3:]:
        panel.set_xlabel("distance [m]", fontsize=8, color=INK)
    for panel in panels[::3]:
        panel.set_ylabel("p(occupied | reading)", fontsize=8, color=INK)
    return figure


def wide_beams() -> Figure:
    """ConeSensor: maps of one reading, and the cells on the axis."""
    base = {"cone_deg": 30.0, "range_max": RANGE_MAX}
    cases: tuple[Case, ...] = (
        ("share_hit = false (textbook)", {"share_hit": False}, 3.0),
        ("default: one hit for the arc", {}, 3.0),
        ("textbook, angular_falloff = 1", {"share_hit": False, "angular_falloff": 1.0}, 3.0),
        ("textbook, range_falloff = 1", {"share_hit": False, "range_falloff": 1.0}, 3.0),
        ("textbook, pass_falloff = 1", {"share_hit": False, "pass_falloff": 1.0}, 3.0),
        ("nothing seen: +Inf, range_max = 3.5", {"range_max": 3.5}, np.inf),
    )
    figure, panels = sheet(3, 3, 6.2)
    extent = (-0.05, 4.05, -1.25, 1.25)
    for number, (title, fields, z) in enumerate(cases):
        sensor = ConeSensor(**{**base, **fields})
        p = one_reading(beam_of(z), sensor, [0, -12], [41, 13])
        panel = panels[number]
        panel.set_facecolor(UNKNOWN)
        image = panel.imshow(
            np.ma.masked_invalid(p), origin="lower", extent=extent, vmin=0.3, vmax=0.7,
            cmap="RdBu_r", interpolation="nearest",
        )  # fmt: skip
        panel.set_title(title, fontsize=9, color=INK)
        axis = panels[6 + number % 3]
        along(axis, p[12], 0.5, COLOURS[number // 3], title.removeprefix("textbook, "))
    bar = figure.colorbar(image, ax=panels[:6], shrink=0.7, pad=0.01)
    bar.set_label("p(occupied | reading)", fontsize=8, color=INK)
    bar.ax.tick_params(labelsize=7, colors=INK, length=2)
    for axis in panels[6:]:
        axis.set_ylim(0.3, 0.8)
        axis.legend(fontsize=7, frameon=False, loc="upper left")
        axis.set_xlabel("distance on the axis [m]", fontsize=8, color=INK)
    panels[6].set_ylabel("p(occupied | reading)", fontsize=8, color=INK)
    return figure


def overhead() -> Figure:
    """OverheadSensor: what a label or a detector's probability makes of a cell."""
    figure, panels = sheet(1, 2, 3.0)
    said = np.linspace(0.0, 1.0, 101)
    scan = GridScan(Pose2(0.0, 0.0, 0.0), said[None], RESOLUTION, (0.0, 0.0))
    for panel, sensor in zip(
        panels,
        (OverheadSensor(), OverheadSensor(true_positive_rate=0.6, false_positive_rate=0.05)),
        strict=True,
    ):
        for prior, colour in PRIORS:
            p = one_reading(scan, sensor, [0, 0], [len(said), 1], prior)[0]
            panel.plot(said, np.where(np.isnan(p), prior, p), color=colour, label=f"prior {prior}")
            ends = p[[0, -1]]
            panel.plot([0.0, 1.0], ends, "o", color=colour, ms=4, clip_on=False)
        panel.set_title(
            f"true_positive_rate = {sensor.true_positive_rate:g}, "
            f"false_positive_rate = {sensor.false_positive_rate:g}", fontsize=9, color=INK,
        )  # fmt: skip
        panel.set_xlabel("the detector's p; labels are 0 and 1 (dots)", fontsize=8, color=INK)
        panel.set_xlim(0.0, 1.0)
        panel.set_ylim(0.0, 1.0)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("p(occupied | seen)", fontsize=8, color=INK)
    panels[0].legend(fontsize=7, frameon=False, loc="upper left")
    return figure


def forward() -> Figure:
    """ForwardModel: the density of readings in a small world, and the chance of none."""
    from matplotlib.patches import Wedge

    figure, panels = sheet(1, 2, 3.3)
    world = np.zeros((25, 41))
    world[:, 30] = 1.0  # a wall
    world[16, 15] = 1.0  # a post, half of it in the wide cone
    origin = np.array([RESOLUTION / 2, 12.5 * RESOLUTION])
    panels[0].imshow(
        world, origin="lower", extent=(0.0, 4.1, 0.0, 2.5), cmap="Greys", interpolation="nearest"
    )
    z = np.append(np.arange(0.005, RANGE_MAX, 0.01), np.inf)
    beams = Beams(np.tile(origin, (len(z), 1)), np.tile([1.0, 0.0], (len(z), 1)), z)
    unsure = np.where(world > 0.0, 0.5, 0.0)
    cases = (
        ("cone of 30 deg", 30.0, world, "-"),
        ("ray (0 deg)", 0.0, world, "-"),
        ("cone, cells occupied with p = 0.5", 30.0, unsure, "--"),
    )
    for (name, cone_deg, occupancy, style), colour in zip(cases, COLOURS, strict=False):
        model = ForwardModel(cone_deg=cone_deg, range_max=RANGE_MAX)
        window = Window(occupancy, RESOLUTION)
        chance = model.likelihood(beams, window)
        density = chance[:-1] / model.bin_width_at(RESOLUTION)
        label = f"{name}; no return: {chance[-1]:.3f}"
        panels[1].semilogy(z[:-1], density, color=colour, ls=style, lw=1.4, label=label)
    for half_angle in (15.0, 0.25):
        panels[0].add_patch(
            Wedge(
                tuple(origin), 4.0, -half_angle, half_angle, facecolor=UNKNOWN, alpha=0.35,
                edgecolor=INK, lw=0.6,
            )
        )  # fmt: skip
    panels[0].set_title("the world: a post and a wall", fontsize=9, color=INK)
    panels[1].set_title("p(z | map) [1/m]", fontsize=9, color=INK)
    panels[1].set_xlabel("reading z [m]", fontsize=8, color=INK)
    panels[1].set_ylim(1e-3, 1e2)
    panels[1].set_xlim(0.0, RANGE_MAX)
    panels[1].spines[["top", "right"]].set_visible(False)
    panels[1].legend(fontsize=7, frameon=False, loc="upper left")
    return figure


FIGURES = {
    "sensor_beam": narrow_beams,
    "sensor_cone": wide_beams,
    "sensor_overhead": overhead,
    "sensor_forward": forward,
}

if __name__ == "__main__":
    for name, draw in FIGURES.items():
        draw().savefig(FOLDER / f"{name}.png", metadata={"Software": "oddsmap"})
