# SPDX-License-Identifier: Apache-2.0
"""Full-map estimation on the sonar benchmark, on the doors, and on a LIDAR log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import build_map, open_log
from oddsmap.config.full_map import FullMapConfig
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.full_map import FullMap
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import stated_of_sensor

pytestmark = pytest.mark.realdata

# Log loss and expected calibration error at most, intersection over union at least.
LIMITS = {
    "E1": (0.028, 0.010, 0.83),
    "E2": (0.025, 0.008, 0.81),
    "E3": (0.029, 0.012, 0.84),
    "E4": (0.030, 0.011, 0.81),
    "E5": (0.048, 0.018, 0.61),
    "E6": (0.070, 0.012, 0.69),
    "E7": (0.033, 0.012, 0.79),
}
# The walls of E6 send beams away that come in at more than 35 degrees.
SPECULAR = {"detection": 0.3, "p_dropout": 0.3, "p_random": 0.1, "sigma": 0.04}


def scores(p: npt.NDArray[np.float64], truth: npt.NDArray[np.bool_]) -> tuple[float, float, float]:
    """Log loss, expected calibration error over 15 bins of equal width, IoU at one half."""
    given = np.clip(np.where(truth, p, 1.0 - p), 1e-9, 1.0)
    place = np.minimum((p * 15).astype(int), 14)
    gaps = [
        np.count_nonzero(place == k) * abs(p[place == k].mean() - truth[place == k].mean())
        for k in np.unique(place)
    ]
    called = p > 0.5
    overlap = np.count_nonzero(called & truth) / np.count_nonzero(called | truth)
    return float(-np.log(given).mean()), float(sum(gaps)) / len(p), overlap


def sonar_map(
    path: Path, others: dict[str, float], settings: FullMapConfig | None = None
) -> FullMap:
    said = stated_of_sensor(open_log(path))
    assert said.pop("kind") == "cone"
    sensor = ConeSensor(**(said | others))
    return build_full_map(open_log(path), 0.1, sensor=sensor, settings=settings)


def scores_of(path: Path) -> tuple[float, float, float]:
    grid = sonar_map(path, SPECULAR if path.name.startswith("E6") else {})
    assert grid.residual < 0.01
    with np.load(path) as arrays:
        truth, scored = arrays["truth"], arrays["scored"]
    ny, nx = truth.shape
    return scores(grid.probability(((0, 0), (nx, ny)))[scored], truth[scored])


@pytest.mark.parametrize("case", LIMITS)
def test_a_file_of_the_sonar_benchmark(data_folder: Path, case: str) -> None:
    """Limits are for the mean of a case: a single file may be 5 % beyond."""
    log_loss, calibration, overlap = scores_of(
        min((data_folder / "sonar_bench").glob(f"{case}_*.npz"))
    )
    limits = LIMITS[case]
    assert log_loss <= 1.05 * limits[0]
    assert calibration <= 1.05 * limits[1]
    assert overlap >= 0.95 * limits[2]


@pytest.mark.slow
@pytest.mark.parametrize("case", LIMITS)
def test_a_case_of_the_sonar_benchmark(data_folder: Path, case: str) -> None:
    paths = sorted((data_folder / "sonar_bench").glob(f"{case}_*.npz"))
    assert len(paths) >= 3
    log_loss, calibration, overlap = np.mean([scores_of(path) for path in paths], axis=0)
    limits = LIMITS[case]
    assert log_loss <= limits[0]
    assert calibration <= limits[1]
    assert overlap >= limits[2]


@pytest.mark.parametrize("cone", [15, 30, 50])
@pytest.mark.parametrize("width", ["0.6", "0.8", "1.0"])
@pytest.mark.parametrize("prior", ["ising", "windows"])
def test_a_door_stands_open(data_folder: Path, prior: str, width: str, cone: int) -> None:
    """The textbook's cones shut it: see `tests/sensors/test_cone.py`."""
    path = data_folder / "sonar_doors" / f"door{width}_cone{cone}.npz"
    settings = None
    if prior == "windows":
        settings = FullMapConfig(method="gibbs", prior_model="windows", samples=20)
    grid = sonar_map(path, {}, settings)
    with np.load(path) as arrays:
        truth = arrays["truth"]
        first, last = np.rint(arrays["door_x"] / 0.1).astype(int)
        low, high = np.rint(arrays["door_y"] / 0.1).astype(int)
    ny, nx = truth.shape
    p, seen = grid.probability(((0, 0), (nx, ny))), grid.observed(((0, 0), (nx, ny)))
    assert not truth[low:high, first:last].any()
    assert (p[low:high, first:last] < 0.5).all()
    assert seen[low, first:last].all()
    if cone < 50:
        front = truth[20, 4:56]
        assert np.count_nonzero(front) > 40
        assert (p[20, 4:56][front] > 0.5).mean() >= 0.95
        assert grid.converged or prior == "windows"


@pytest.mark.slow
def test_a_lidar_log(data_folder: Path) -> None:
    """Narrow beams: much the same walls as the filter finds, and rest within the sweeps given."""
    log = open_log(data_folder / "laser2d" / "intel-corrected.log.gz")
    grid = build_full_map(
        log, 0.1, sensor=BeamSensor(range_max=81.83), settings=FullMapConfig(sweeps=12), threads=2
    )
    assert grid.report is not None
    assert grid.report.beams > 150_000
    assert grid.residual < 0.01
    lo, hi = grid.bounds() or (np.zeros(2), np.zeros(2))
    box = (lo.astype(np.int64), hi.astype(np.int64))
    # Unlike cones, rays seldom leave a cell open.
    p, seen = grid.probability(box), grid.observed(box)
    assert ((p < 0.196) | (p > 0.65))[seen].mean() > 0.97
    filtered = build_map(log, 0.1).log_odds()
    both = seen & filtered.observed(box)
    assert both.sum() > 0.9 * seen.sum()
    walls, theirs = p > 0.65, filtered.probability(box) > 0.65
    walls, theirs = walls & seen, theirs & filtered.observed(box)
    # Thinner by a third: a noisy wall is one cell here, and two cells to the filter.
    assert np.count_nonzero(walls) > 4000
    for some, others in ((walls, theirs), (theirs, walls)):
        assert (some & near(others)).sum() > 0.95 * some.sum()


def near(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The cells and the eight around each."""
    wide = np.pad(cells, 1)
    ny, nx = cells.shape
    parts = [wide[y : y + ny, x : x + nx] for y in range(3) for x in range(3)]
    return np.asarray(np.any(parts, axis=0))
