# SPDX-License-Identifier: Apache-2.0
"""Glass and leaves, three ways: log odds, counted reflections, and beam factors under a cone.

python docs/figures/glass.py        # prints the tables of docs/glass.md, writes images/glass.png
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap import Beams, BeamSensor, ConeSensor, ForwardModel, Scan, build_map
from oddsmap.posterior.beta import beta_interval
from oddsmap.simulate import GlassScene, GlassSensor, glass_path, glass_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "glass.png"
SEEDS = (0, 1, 2)
LIDAR, SONAR = GlassSensor.lidar(), GlassSensor.sonar()
POSES = {LIDAR: 600, SONAR: 2400}
TRIALS = 20.0
INK = "#39434d"
UNKNOWN = "#c7d5e3"


@dataclass(frozen=True)
class Reflections:
    """Beta posteriors of the cells' reflectivities, of the scene's shape.

    Args:
        a: weight of hits, the prior's in it.
        b: weight of passes, likewise.
        prior: weight of each in the prior.
    """

    a: FloatArray
    b: FloatArray
    prior: float

    @property
    def seen(self) -> BoolArray:
        """True where more than 20 trials are behind the estimate."""
        return self.a + self.b - 2.0 * self.prior > TRIALS

    @property
    def mean(self) -> FloatArray:
        """Expected reflectivity, NaN where not even one trial is behind it."""
        known = self.a + self.b - 2.0 * self.prior > 1.0
        return np.where(known, self.a / (self.a + self.b), np.nan)

    def score(self, truth: FloatArray, which: BoolArray) -> tuple[float, float, int]:
        """RMSE of the mean, coverage of the shortest 95 % intervals, and of how many cells."""
        cells = which & self.seen
        a, b, true = self.a[cells], self.b[cells], truth[cells]
        lower, upper = beta_interval(a, b, 0.95, "highest-density")
        rmse = np.sqrt(np.mean((a / (a + b) - true) ** 2))
        return float(rmse), float(np.mean((lower <= true) & (true <= upper))), len(true)


def drive(seed: int, sensor: GlassSensor) -> tuple[GlassScene, list[Scan]]:
    """A scene, and what a sensor sees on its way through it."""
    scene, rng = glass_scene(seed), np.random.default_rng(100 + seed)
    return scene, [sensor.scan(scene, pose, rng) for pose in glass_path(POSES[sensor], seed)]


def region(scene: GlassScene) -> tuple[list[int], list[int]]:
    """All cells of a scene, as (lo, hi)."""
    ny, nx = scene.reflectivity.shape
    return [0, 0], [nx, ny]


def filtered(scene: GlassScene, scans: list[Scan]) -> tuple[FloatArray, FloatArray]:
    """p(occupied) by the textbook filter from a lidar's scans, NaN where unknown; and votes."""
    grid = build_map(scans, scene.resolution, sensor=BeamSensor(range_max=LIDAR.range_max))
    hits, passes = grid.region(*region(scene))
    view = grid.log_odds()
    p = np.where(view.observed(region(scene)), view.probability(region(scene)), np.nan)
    return p, hits + passes


def counted(scene: GlassScene, scans: list[Scan], sensor: BeamSensor | ConeSensor) -> Reflections:
    """Beta(1 + hits, 1 + passes): the reflection map."""
    grid = build_map(scans, scene.resolution, sensor=sensor, votes="beam")
    hits, passes = grid.region(*region(scene))
    return Reflections(1.0 + hits, 1.0 + passes, 1.0)


def assumed_density(scene: GlassScene, scans: list[Scan], sensor: GlassSensor) -> Reflections:
    """Beam factors, one pass: an arc's hit shared by how likely each cell is to have caused it."""
    from oddsmap.kernels.beam_factor import BeamRows
    from oddsmap.kernels.beta_factor import filter_beams

    prior = 0.1  # cells are held to be free or solid more often than glass
    # A surface lies half a cell behind the nearest point of its cell, or more where it is met
    # aslant.
    model = ForwardModel(
        cone_deg=sensor.cone_deg, range_max=sensor.range_max, detection=1.0, p_random=0.005,
        p_dropout=0.005, sigma=0.035, range_bias=0.06,
    )  # fmt: skip
    beams, _ = Beams.from_scans(scans)
    shape = scene.reflectivity.shape
    a, b = np.full((2, scene.reflectivity.size), prior)
    for part, listed in model.cells(beams, scene.resolution, [0, 0], shape):
        rows = BeamRows(
            beams.ranges[part], listed.offsets, listed.cells.astype(np.int32),
            listed.bins.astype(np.uint16), listed.fractions,
        )  # fmt: skip
        order = np.arange(len(rows.readings))
        filter_beams(rows, order, model.noise(scene.resolution), np.ones(1), a, b)
    return Reflections(a.reshape(shape), b.reshape(shape), prior)


def estimates(seed: int) -> tuple[GlassScene, dict[str, Reflections]]:
    """Each way of a sensor and an estimator, on one scene."""
    scene, lidar = drive(seed, LIDAR)
    _, sonar = drive(seed, SONAR)
    cone = ConeSensor(cone_deg=SONAR.cone_deg, range_max=SONAR.range_max)
    return scene, {
        "lidar, counted": counted(scene, lidar, BeamSensor(range_max=LIDAR.range_max)),
        "lidar, beam factors": assumed_density(scene, lidar, LIDAR),
        "sonar, counted": counted(scene, sonar, cone),
        "sonar, beam factors": assumed_density(scene, sonar, SONAR),
    }


def verdicts(seeds: tuple[int, ...] = SEEDS) -> dict[float, tuple[float, float, int]]:
    """What log odds make of each reflectivity: share with p < 0.01, with p > 0.99; cells."""
    found: dict[float, list[FloatArray]] = {}
    for seed in seeds:
        scene, scans = drive(seed, LIDAR)
        p, votes = filtered(scene, scans)
        for value in (0.15, 0.3, 0.6, 1.0):
            found.setdefault(value, []).append(p[(votes > TRIALS) & (scene.reflectivity == value)])
    shares = {}
    for value, parts in found.items():
        p = np.concatenate(parts)
        shares[value] = float(np.mean(p < 0.01)), float(np.mean(p > 0.99)), len(p)
    return shares


def scores(seeds: tuple[int, ...] = SEEDS) -> dict[str, FloatArray]:
    """Of each estimate: RMSE and coverage over all cells, over surfaces, over glass; mean."""
    rows: dict[str, list[list[float]]] = {}
    for seed in seeds:
        scene, ways = estimates(seed)
        truth = scene.reflectivity
        for name, way in ways.items():
            cells = (truth >= 0.0, truth > 0.0, (truth > 0.0) & (truth < 1.0))
            row = [number for which in cells for number in way.score(truth, which)[:2]]
            rows.setdefault(name, []).append(row)
    return {name: np.mean(row, axis=0) for name, row in rows.items()}


def draw(seed: int = 0) -> Figure:
    """One scene: the truth, and what each way makes of it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene, ways = estimates(seed)
    p, _ = filtered(scene, drive(seed, LIDAR)[1])
    lidar = ways["lidar, counted"]
    lower, upper = beta_interval(lidar.a, lidar.b, 0.95, "equal-tailed")
    width = np.where(np.isnan(lidar.mean), np.nan, upper - lower)
    panels = (
        ("truth: reflectivity", scene.reflectivity, 1.0),
        ("lidar, log odds: p(occupied)", p, 1.0),
        ("lidar, reflection map: mean", lidar.mean, 1.0),
        ("its 95 % interval: width, 0 to 0.2", width, 0.2),
        ("sonar, counted: mean", ways["sonar, counted"].mean, 1.0),
        ("sonar, beam factors: mean", ways["sonar, beam factors"].mean, 1.0),
    )
    figure = Figure(figsize=(9.6, 5.1), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 3)
    ny, nx = scene.reflectivity.shape
    extent = (0.0, nx * scene.resolution, 0.0, ny * scene.resolution)
    for panel, (title, values, largest) in zip(axes.flat, panels, strict=True):
        panel.set_facecolor(UNKNOWN)
        image = panel.imshow(
            np.ma.masked_invalid(values), origin="lower", extent=extent, vmin=0.0, vmax=largest,
            cmap="viridis", interpolation="nearest",
        )  # fmt: skip
        panel.set_title(title, fontsize=9, color=INK)
        panel.tick_params(labelsize=7, colors=INK, length=2)
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.01)
    bar.ax.tick_params(labelsize=7, colors=INK, length=2)
    return figure


def tables(seeds: tuple[int, ...] = SEEDS) -> str:
    """The tables of docs/glass.md, in Markdown."""
    lines = ["| reflectivity | p < 0.01 | between | p > 0.99 | cells |", "|---|---|---|---|---|"]
    for value, (free, occupied, cells) in verdicts(seeds).items():
        shares = f"{free:.0%} | {1.0 - free - occupied:.0%} | {occupied:.0%}"
        lines.append(f"| {value:g} | {shares.replace('%', ' %')} | {cells} |")
    lines += ["", "| | all cells | surfaces | glass alone |", "|---|---|---|---|"]
    for name, row in scores(seeds).items():
        pairs = (f"{row[i]:.3f} / {row[i + 1]:.2f}" for i in (0, 2, 4))
        lines.append(f"| {name} | {' | '.join(pairs)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(tables())
    draw().savefig(OUTPUT, metadata={"Software": "oddsmap"})
