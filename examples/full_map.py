# SPDX-License-Identifier: Apache-2.0
"""One sonar log through the textbook's filter and through full-map estimation, beside the truth.

python examples/full_map.py [-o full_map.png] [--log sonar.npz]

A robot with 24 sonars of 25 degrees drives through a simulated office. The log that it writes can
be mapped from the command line as well: oddsmap build sonar.npz --estimator full-map ...
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

import oddsmap
from oddsmap.plot.picture import cell_colours
from oddsmap.simulate import Sonar2D, office_drive, office_plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Panel = tuple[str, str, FloatArray, BoolArray]

FOLDER = Path("oddsmap-demo")
RESOLUTION = 0.1
CELLS = (200, 140)
POSES = 400
SONAR = Sonar2D(beam_count=24, cone_deg=25.0, range_max=4.0, p_random=0.02, p_dropout=0.02)
# A whole hit for every cell of an arc, as in table 9.2 of Probabilistic Robotics, with log Bayes
# factors 0.85 and -0.4. What this library does where nothing is said, one hit shared by the arc,
# does less harm and is printed as well.
TEXTBOOK = oddsmap.ConeSensor(
    cone_deg=SONAR.cone_deg,
    range_max=SONAR.range_max,
    share_hit=False,
    p_hit=0.7006,
    p_miss=0.4013,
)

PIXELS = 3  # of a cell's side
GAP, ABOVE, BELOW = 24, 74, 10  # pixels around the panels
INK, WAY = "#39434d", "#e4572e"


def write_log(path: Path, truth: BoolArray) -> None:
    """Drive through the office and write what the sonars hear, as an NPZ beam log."""
    rng = np.random.default_rng(0)
    poses = office_drive(POSES)
    ranges = np.array([SONAR.scan(truth, RESOLUTION, pose, rng).ranges for pose in poses])
    places = np.array([(pose.x, pose.y, pose.theta) for pose in poses])
    own = np.arctan2(*SONAR.directions.T[::-1])
    beams = np.empty((POSES, SONAR.beam_count, 4))
    beams[..., :2] = places[:, None, :2]
    beams[..., 2] = places[:, 2:] + own
    beams[..., 3] = ranges
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        path,
        beams=beams.reshape(-1, 4).astype(np.float32),
        scan=np.repeat(np.arange(POSES), SONAR.beam_count),
        cone_deg=SONAR.cone_deg,
        range_max=SONAR.range_max,
    )


def main(picture: Path, path: Path) -> None:
    """Simulate, map twice, draw."""
    truth = office_plan().rasterise(RESOLUTION, (0, 0), CELLS)
    write_log(path, truth)
    log = oddsmap.open_log(path)
    maps = {
        "Cell by cell: the textbook's filter": oddsmap.build_map(
            log, RESOLUTION, sensor=TEXTBOOK
        ).log_odds(),
        "Cell by cell: a shared hit": oddsmap.build_map(log, RESOLUTION).log_odds(),
        "All cells together: full-map": oddsmap.build_full_map(log, RESOLUTION),
    }
    box = ((0, 0), CELLS)
    seen = np.logical_and.reduce([view.observed(box) for view in maps.values()])
    # Of a solid thing only the surface can be seen.
    solid = np.pad(truth, 1, constant_values=True)
    inner = solid[:-2, 1:-1] & solid[2:, 1:-1] & solid[1:-1, :-2] & solid[1:-1, 2:]
    panels: list[Panel] = [
        ("The office", f"{POSES} poses, 24 sonars of 25 degrees", truth.astype(np.float64), ~inner)
    ]
    for title, view in maps.items():
        p = view.probability(box)
        wrong = 100.0 * np.mean((p > 0.5)[seen] != truth[seen])
        scores = oddsmap.evaluate(p, truth, seen)
        said = f"{wrong:.1f} % of cells wrong, log loss {scores.log_loss:.3f}"
        print(f"{title}: {said}, IoU {scores.iou:.3f}, AUC {scores.auc:.3f}")
        if "shared" not in title:
            panels.append((title, said, p, view.observed(box)))
    way = np.array([(pose.x, pose.y) for pose in office_drive(POSES)])
    picture.parent.mkdir(parents=True, exist_ok=True)
    draw(panels, way).savefig(picture, metadata={"Software": "oddsmap"})
    print(f"{path}, {picture}")


def draw(panels: list[Panel], way: FloatArray) -> Figure:
    """Panels side by side, each a title, a line below it, p(occupied), and what was observed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    nx, ny = (n * PIXELS for n in CELLS)
    width, height = len(panels) * (nx + GAP) + GAP, ABOVE + ny + BELOW
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    for number, (title, below, p, observed) in enumerate(panels):
        left = GAP + number * (nx + GAP)
        axes = figure.add_axes((left / width, BELOW / height, nx / width, ny / height))
        axes.imshow(
            cell_colours(p, observed),
            origin="lower",
            interpolation="nearest",
            aspect="auto",
            extent=(0.0, CELLS[0] * RESOLUTION, 0.0, CELLS[1] * RESOLUTION),
        )
        axes.plot(*way.T, color=WAY, linewidth=1.0)
        axes.set_axis_off()
        for text, top, size, weight in ((title, 8, 17, "bold"), (below, 42, 14, "normal")):
            figure.text(
                left / width, 1 - top / height, text,
                size=size, weight=weight, color=INK, va="top",
            )  # fmt: skip
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=FOLDER / "full_map.png")
    parser.add_argument("--log", type=Path, default=FOLDER / "sonar.npz")
    given = parser.parse_args()
    main(given.output, given.log)
