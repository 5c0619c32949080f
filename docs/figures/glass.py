# SPDX-License-Identifier: Apache-2.0
"""Glass and leaves, three ways: log odds, counted reflections, and beam factors under a cone.

python docs/figures/glass.py        # prints the tables of docs/glass.md, writes images/glass.png
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap import BeamSensor, ConeSensor, Scan, build_map, build_reflection_map
from oddsmap.simulate import GlassScene, GlassSensor, glass_path, glass_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from oddsmap.full_map.reflection import ReflectionMethod
    from oddsmap.posterior.reflectivity import BetaView

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "glass.png"
SEEDS = (0, 1, 2)
LIDAR, SONAR = GlassSensor.lidar(), GlassSensor.sonar()
POSES = {LIDAR: 600, SONAR: 2400}
TRIALS = 20.0
METHODS: dict[str, ReflectionMethod] = {
    "beam factors, one pass": "adf",
    "beam factors": "ep",
    "expected counts": "em",
}
INK = "#39434d"
UNKNOWN = "#c7d5e3"


def trials(view: BetaView, scene: GlassScene) -> FloatArray:
    """What is behind each estimate beyond the prior: beams that reached the cell; else 0."""
    alpha, beta = view.parameters(region(scene))
    return np.where(view.observed(region(scene)), alpha + beta - view.a - view.b, 0.0)


def mean(view: BetaView, scene: GlassScene) -> FloatArray:
    """Expected reflectivity, NaN where not even one trial is behind it."""
    return np.where(trials(view, scene) > 1.0, view.mean(region(scene)), np.nan)


def score(view: BetaView, scene: GlassScene, which: BoolArray) -> tuple[float, float]:
    """RMSE of the mean, and coverage of the shortest 95 % intervals."""
    cells = which & (trials(view, scene) > TRIALS)
    true = scene.reflectivity[cells]
    ends = view.interval(region(scene), kind="highest-density")
    lower, upper = (end[cells] for end in ends)
    rmse = np.sqrt(np.mean((view.mean(region(scene))[cells] - true) ** 2))
    return float(rmse), float(np.mean((lower <= true) & (true <= upper)))


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


def counted(scene: GlassScene, scans: list[Scan], sensor: BeamSensor | ConeSensor) -> BetaView:
    """Beta(1 + hits, 1 + passes)."""
    return build_map(scans, scene.resolution, sensor=sensor, votes="beam").reflection()


def estimates(seed: int) -> tuple[GlassScene, dict[str, BetaView]]:
    """Each way of a sensor and an estimator, on one scene."""
    ways: dict[str, BetaView] = {}
    for name, sensor in (("lidar", LIDAR), ("sonar", SONAR)):
        scene, scans = drive(seed, sensor)
        cone = ConeSensor(cone_deg=sensor.cone_deg, range_max=sensor.range_max)
        narrow = BeamSensor(range_max=sensor.range_max)
        ways[f"{name}, counted"] = counted(scene, scans, narrow if sensor is LIDAR else cone)
        for title, method in METHODS.items():
            ways[f"{name}, {title}"] = build_reflection_map(
                scans, scene.resolution, sensor=cone, method=method
            )
    return scene, ways


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
        cells = (truth >= 0.0, truth > 0.0, (truth > 0.0) & (truth < 1.0))
        for name, way in ways.items():
            row = [number for which in cells for number in score(way, scene, which)]
            rows.setdefault(name, []).append(row)
    return {name: np.mean(row, axis=0) for name, row in rows.items()}


def draw(seed: int = 0) -> Figure:
    """One scene: the truth, and what each way makes of it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene, ways = estimates(seed)
    p, _ = filtered(scene, drive(seed, LIDAR)[1])
    lidar = ways["lidar, counted"]
    lower, upper = lidar.interval(region(scene), kind="equal-tailed")
    width = np.where(np.isnan(mean(lidar, scene)), np.nan, upper - lower)
    panels = (
        ("truth: reflectivity", scene.reflectivity, 1.0),
        ("lidar, log odds: p(occupied)", p, 1.0),
        ("lidar, reflection map: mean", mean(lidar, scene), 1.0),
        ("its 95 % interval: width, 0 to 0.2", width, 0.2),
        ("sonar, counted: mean", mean(ways["sonar, counted"], scene), 1.0),
        ("sonar, beam factors: mean", mean(ways["sonar, beam factors"], scene), 1.0),
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
