# SPDX-License-Identifier: Apache-2.0
"""Maps scored by readings: right predictions score best, and are reliable."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import oddsmap
from oddsmap.array_types import Region
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.beams import Beams
from oddsmap.forward.occupancy_box import Window
from oddsmap.kernels.units import ONE
from oddsmap.odds import Thresholds, logit
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.posterior.belief import Belief
from oddsmap.posterior.log_odds import LogOdds
from oddsmap.scans.scan import Scan
from oddsmap.scoring import held_out
from oddsmap.scoring.held_out import LogScores, score_map
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor

FloatArray = npt.NDArray[np.float64]

CELL = 0.1
SONAR = ConeSensor(cone_deg=20.0, range_max=1.5, p_random=0.05, p_dropout=0.05)


class Given(Belief):
    """Probabilities of a box of cells from the origin on; 0.5 elsewhere."""

    def __init__(self, probability: FloatArray) -> None:
        self._log_odds = logit(np.clip(probability, 1e-9, 1 - 1e-9))
        self.thresholds = Thresholds(0.2, 0.6)

    @property
    def ndim(self) -> int:
        return self._log_odds.ndim

    @property
    def resolution(self) -> float:
        return CELL

    def bounds(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]] | None:
        return np.zeros(self.ndim, np.int64), np.array(self._log_odds.shape[::-1])

    def log_odds(self, region: Region | None = None) -> FloatArray:
        raise NotImplementedError

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        raise NotImplementedError

    def log_odds_at(self, index: npt.ArrayLike) -> FloatArray:
        raise NotImplementedError

    def observed_at(self, index: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        raise NotImplementedError

    def known_log_odds(self) -> tuple[npt.NDArray[np.int64], FloatArray]:
        index = np.stack(np.unravel_index(np.arange(self._log_odds.size), self._log_odds.shape), 1)
        return index[:, ::-1], self._log_odds.ravel()

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        raise NotImplementedError


def drawn(probability: FloatArray, count: int, seed: int) -> list[Scan]:
    """Beams whose readings are drawn from the predictive distribution of a map's marginals."""
    rng = np.random.default_rng(seed)
    d = probability.ndim
    middle = np.array(probability.shape[::-1]) * CELL / 2
    origins = middle + rng.uniform(-0.4, 0.4, (count, d))
    axes = rng.normal(size=(count, d))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    beams = SONAR.forward_model().simulate(origins, axes, Window(probability, CELL), rng)
    return scans_of(beams)


def scans_of(beams: Beams) -> list[Scan]:
    poses = [
        Pose2(float(at[0]), float(at[1]), 0.0) if len(at) == 2 else Pose3(at, np.eye(3))
        for at in beams.origins
    ]
    return [
        Scan(pose, beams.directions[i : i + 1], beams.ranges[i : i + 1])
        for i, pose in enumerate(poses)
    ]


def some_map(d: int, seed: int) -> FloatArray:
    """Walls half way, some cells undecided."""
    rng = np.random.default_rng(seed)
    shape = (50,) * d
    p = np.full(shape, 0.001)
    p[rng.random(shape) < (0.04 if d == 2 else 0.01)] = 0.4
    p[rng.random(shape) < (0.03 if d == 2 else 0.01)] = 0.9
    return p


@pytest.mark.parametrize("d", [2, 3])
def test_right_predictions_are_reliable_and_score_best(d: int) -> None:
    p = some_map(d, 1)
    scans = drawn(p, 3000, 2)
    right = score_map(Given(p), scans, SONAR)
    assert right.beams == 3000 - right.skipped["beam.nan"] - right.skipped["beam.below_range_min"]
    assert right.ece < 0.004
    curve = right.reliability
    many = curve.count > 50
    assert many.sum() > 8, "predictions of all sorts"
    assert curve.happened.sum() == right.beams - right.no_returns
    # Five standard deviations of the number of events that happen, in every bin.
    spread = np.sqrt(curve.predicted * (1 - curve.predicted / np.maximum(curve.count, 1)))
    assert (np.abs(curve.happened - curve.predicted)[many] < 5 * spread[many] + 1).all()

    sure = score_map(Given(np.where(p > 0.3, 0.999, 0.001)), scans, SONAR)
    blind = score_map(Given(np.roll(p, 7, axis=0)), scans, SONAR)
    assert right.log_likelihood > sure.log_likelihood + 0.05
    assert right.log_likelihood > blind.log_likelihood + 0.3
    assert right.ece < min(sure.ece, blind.ece)
    assert right.log_likelihood > right.constant_log_likelihood > right.prior_log_likelihood


def test_baselines_need_no_map() -> None:
    """They are the same for every map with that prior, and the constant is among the best."""
    scans = drawn(some_map(2, 1), 400, 3)
    one, other = (score_map(Given(some_map(2, seed)), scans, SONAR) for seed in (1, 4))
    assert one.prior_log_likelihood == other.prior_log_likelihood
    assert one.constant_log_likelihood == other.constant_log_likelihood
    same = score_map(Given(np.full((50, 50), one.constant)), scans, SONAR)
    assert same.log_likelihood == pytest.approx(one.constant_log_likelihood, abs=1e-9)
    for p in (one.constant / 3, one.constant * 3):
        assert score_map(Given(np.full((50, 50), p)), scans, SONAR).log_likelihood < (
            same.log_likelihood
        )


def test_likelihoods_are_those_of_the_model() -> None:
    """Beam by beam against `ForwardModel.log_likelihood`, whose map ends at the window's edge."""
    p = some_map(2, 5)
    scans = drawn(p, 200, 6)
    beams, _ = Beams.from_scans(scans)
    kept = beams.ranges >= 0
    model = SONAR.forward_model()
    logs = model.log_likelihood(beams, Window(p, CELL))[kept]
    finite = beams.ranges[kept] < model.range_max
    expected = (logs - np.where(finite, math.log(model.bin_width_at(CELL)), 0.0)).mean()
    # Cells behind the reach of a reading are looked at here and not there.
    assert score_map(Given(p), scans, SONAR).log_likelihood == pytest.approx(expected, abs=0.002)


def test_memory_is_bounded_and_batches_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    scans = drawn(some_map(2, 1), 500, 7)
    whole = score_map(Given(some_map(2, 1)), scans, SONAR)
    monkeypatch.setattr(held_out, "_BATCH", 16)
    done: list[int] = []
    parts = score_map(Given(some_map(2, 1)), scans, SONAR, progress=done.append)
    assert done[:2] == [16, 32]
    assert done[-1] == 500
    assert parts.log_likelihood == pytest.approx(whole.log_likelihood, abs=1e-12)
    assert parts.reliability.count.tolist() == whole.reliability.count.tolist()
    assert parts.reliability.happened.tolist() == whole.reliability.happened.tolist()


def test_a_prior_map_is_the_prior() -> None:
    """A log-odds view has its own prior in unobserved cells, cell by cell."""
    from oddsmap.posterior.prior import PriorArray

    p = some_map(2, 1)
    scans = drawn(p, 300, 8)
    empty = oddsmap.EvidenceMap(CELL, sensor=SONAR)
    with_prior = LogOdds(empty, prior=PriorArray(p, (0, 0)))
    got = score_map(with_prior, scans, SONAR)
    assert got.prior_log_likelihood == got.log_likelihood
    assert got.log_likelihood == pytest.approx(
        score_map(Given(p), scans, SONAR).log_likelihood, abs=1e-6
    )


def test_a_calibrated_view_has_its_prior_where_nothing_is_known() -> None:
    rng = np.random.default_rng(2)
    index = np.unique(rng.integers(0, 9, (200, 2)), axis=0)
    grid = oddsmap.EvidenceMap(CELL)
    grid.add_cells(index, np.full(len(index), ONE), np.full(len(index), 3 * ONE))
    scans = drawn(some_map(2, 1), 100, 8)
    got = score_map(grid.calibrated(prior=0.03), scans, SONAR)
    bare = score_map(oddsmap.EvidenceMap(CELL).log_odds(prior=0.03), scans, SONAR)
    assert got.prior_log_likelihood == pytest.approx(bare.log_likelihood, abs=1e-9)


def test_what_says_nothing_is_counted() -> None:
    axes = np.array([[1.0, 0.0]] * 4)
    scan = Scan(Pose2(2.5, 2.5, 0.0), axes, np.array([np.nan, 0.7, np.inf, 3.0]))
    lost = Scan(Pose2(math.nan, 0.0, 0.0), axes[:1], np.array([1.0]))
    scores = score_map(Given(some_map(2, 1)), [scan, lost], SONAR)
    # Of a cone a finite reading at range_max or above is a no-return, too.
    assert (scores.scans, scores.beams, scores.no_returns) == (1, 3, 2)
    assert scores.skipped == {"beam.nan": 1, "scan.nan_pose": 1}


def test_wrong_input() -> None:
    view = Given(some_map(2, 1))
    with pytest.raises(InputError, match=r"no usable scan \(there are none\); nothing to score"):
        score_map(view, [], SONAR)
    with pytest.raises(InputError, match="the scans are 3D, the map is 2D"):
        score_map(view, drawn(some_map(3, 1)[:20, :20, :20], 2, 1), SONAR)
    with pytest.raises(ConfigError, match="a sensor of kind overhead has no forward model"):
        score_map(view, [], OverheadSensor())
    with pytest.raises(ConfigError, match="range_max is needed"):
        score_map(view, [], BeamSensor())
    with pytest.raises(ConfigError, match=r"above 0, got 0\.0"):
        score_map(view, [], ConeSensor(cone_deg=20.0, range_max=1.5, p_random=0.0))


@pytest.mark.realdata
@pytest.mark.slow
def test_the_full_map_predicts_the_benchmark_best(data_folder: Path, tmp_path: Path) -> None:
    """Held-out beams of E1: full map, textbook cone filter, no map."""
    source = data_folder / "sonar_bench" / "E1_nominal_24x25deg_A_seed0.npz"
    arrays = dict(np.load(source))
    path = tmp_path / "held.npz"
    names = ("cone_deg", "range_max", "p_random", "p_dropout")
    np.savez(path, beams=arrays["heldout_beams"], **{name: arrays[name] for name in names})
    log, held = oddsmap.open_log(source), oddsmap.open_log(path)
    sensor = ConeSensor(cone_deg=25.0, range_max=4.0, p_random=0.03, p_dropout=0.03)
    textbook = ConeSensor(
        cone_deg=25.0, range_max=4.0, share_hit=False,
        p_hit=1 / (1 + math.exp(-0.85)), p_miss=1 / (1 + math.exp(0.4)),
    )  # fmt: skip

    def scored(view: Belief) -> LogScores:
        return score_map(view, held, sensor)

    full = scored(oddsmap.build_full_map(log, CELL, sensor=sensor))
    filtered = scored(oddsmap.build_map(log, CELL, sensor=textbook).log_odds())
    assert full.log_likelihood > full.constant_log_likelihood + 2.0
    assert full.log_likelihood > filtered.log_likelihood + 2.5
    assert full.ece < 0.01 < 0.04 < filtered.ece
