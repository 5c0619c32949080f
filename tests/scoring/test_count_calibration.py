# SPDX-License-Identifier: Apache-2.0
"""Narrow beams predicted from counts without their own scan, and the sensor fitted to them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from oddsmap import EvidenceMap, build_map
from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward.model import ForwardModel
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.scan import Scan
from oddsmap.scoring.count_calibration import _told, calibrate_by_counts, calibrate_narrow
from oddsmap.scoring.counts_without import CountsWithout, spread_over
from oddsmap.scoring.held_out import score_map
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from tests.scoring.test_calibration import CELL, drawn

SENSOR = BeamSensor(range_max=2.5, clear_range=2.5, sigma=0.0, p_random=0.06, p_dropout=0.04)


def scans_of(count: int, seed: int = 8) -> list[Scan]:
    return drawn(SENSOR.forward_model(), count, seed)


@pytest.mark.parametrize("votes", ["scan", "beam"])
def test_it_is_the_map_of_the_other_scans(votes: str) -> None:
    scans = scans_of(12)
    view = build_map(scans, CELL, sensor=SENSOR, votes=votes).log_odds(prior=0.1)
    work, model = CountsWithout(view, scans, SENSOR), SENSOR.forward_model()
    work.settle(model, 1.0, 1)
    expected, beams = 0.0, 0
    for i, scan in enumerate(scans):
        others = build_map([*scans[:i], *scans[i + 1 :]], CELL, sensor=SENSOR, votes=votes)
        found = score_map(others.log_odds(prior=0.1), [scan], SENSOR)
        expected, beams = expected + found.log_likelihood * found.beams, beams + found.beams
    assert (work.scans, len(work.beams)) == (12, beams)
    assert work.log_likelihood(model) == pytest.approx(expected, rel=1e-5)


def test_what_readings_were_drawn_with_is_found() -> None:
    start = dataclasses.replace(SENSOR, p_random=0.3, p_dropout=0.01)
    found = calibrate_narrow(scans_of(60), CELL, start, noise_only=True)
    assert list(found.values) == ["p_random", "p_dropout"]
    assert abs(found.values["p_random"] - 0.06) < 0.03
    assert abs(found.values["p_dropout"] - 0.04) < 0.02
    assert isinstance(found.sensor, BeamSensor)
    assert found.sensor.sigma == 0.0
    assert "sigma of ranges is 0." in " ".join(found.notes)
    assert (found.scans, found.beams) == (60, 24 * 60 - found.skipped["beam.nan"])


class Steep:
    """Readings that p_random explains best at 0.1, and that detection and sigma do not change."""

    no_returns = np.zeros(3, np.bool_)

    def settle(self, model: ForwardModel, edge: float, sweeps: int) -> None: ...

    def go_on(self, model: ForwardModel, sweeps: int) -> None: ...

    def causes(self, model: ForwardModel) -> FloatArray:
        raise NotImplementedError

    def log_likelihood(self, model: ForwardModel) -> float:
        return -1000.0 * (model.p_random - 0.1) ** 2


def test_what_a_log_cannot_tell_is_kept_and_said() -> None:
    start = ForwardModel(cone_deg=0.0, range_max=5.0)
    found = dataclasses.replace(start, detection=0.5, p_random=0.1, sigma=1.0)
    errors = {"detection": np.nan, "p_random": 0.02, "sigma": 0.7}
    told, notes = _told(Steep(), found, start, errors)
    assert told == {"p_random"}
    assert notes == [
        "the log cannot tell detection (0.5 explains it no better than 0.98): kept at 0.98",
        "the log cannot tell sigma (1 +- 0.7 explains it no better than 0.035): kept at 0.035",
    ]


def test_scans_are_spread_evenly() -> None:
    scans = scans_of(1) * 1000
    numbered = [dataclasses.replace(scan, number=i) for i, scan in enumerate(scans)]
    kept = [scan.number for scan in spread_over(iter(numbered)) if isinstance(scan, Scan)]
    assert 100 <= len(kept) <= 200
    assert len({*np.diff(np.array(kept, np.int64)).tolist()}) == 1
    assert len(spread_over(numbered[:150])) == 150


def test_what_is_refused() -> None:
    scans = scans_of(3)
    fading = EvidenceMap(CELL, sensor=SENSOR, half_life_scans=2.0, ref_scan=2)
    with pytest.raises(ConfigError, match="the map forgets"):
        calibrate_by_counts(fading.log_odds(), scans, SENSOR)
    with pytest.raises(ConfigError, match="range_max is needed"):
        calibrate_narrow(scans, CELL, BeamSensor())
    with pytest.raises(ConfigError, match="counts predict narrow beams"):
        calibrate_narrow(scans, CELL, ConeSensor(range_max=2.5, cone_deg=9))
    apart = [dataclasses.replace(s, map_from_sensor=Pose2(90.0 * i, 0.0, 0.0))
             for i, s in enumerate(scans)]  # fmt: skip
    with pytest.raises(InputError, match="do not end where other scans saw anything"):
        calibrate_narrow(apart, CELL, SENSOR)
    empty = EvidenceMap(CELL, sensor=SENSOR).log_odds()
    with pytest.raises(InputError, match="no usable scan"):
        calibrate_by_counts(empty, [], SENSOR)
    of_others = build_map(scans[:1], CELL, sensor=SENSOR).log_odds()
    with pytest.raises(InputError, match="more votes in a cell than the map"):
        calibrate_by_counts(of_others, scans, SENSOR)


def test_depth_images_are_taken_out_as_they_were_put_in() -> None:
    camera = PinholeCamera(fx=30.0, fy=30.0, cx=9.5, cy=7.5, width=20, height=16)
    scans = [
        DepthScan(Pose3(np.array([x, 0.0, 0.0]), np.eye(3)), np.full((16, 20), 1.5), camera)
        for x in (0.0, 0.1, 0.2)
    ]
    sensor, model = BeamSensor(range_max=4.0), BeamSensor(range_max=4.0).forward_model()
    view = build_map(scans, CELL, sensor=sensor, method="projective").calibrated()
    CountsWithout(view, scans, sensor, "projective").settle(model, 1.0, 0)
    with pytest.raises(InputError, match="another sensor, frame or method"):
        CountsWithout(view, scans, sensor).settle(model, 1.0, 0)
