# SPDX-License-Identifier: Apache-2.0
"""What people get wrong at first is refused with a line that says what was expected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import ConfigError, InputError, LogOdds, Scan


@pytest.fixture(scope="module")
def view() -> LogOdds:
    angles = np.linspace(-3.0, 3.0, 61)
    scan = Scan.from_angles((0.0, 0.0, 0.0), angles, np.full(61, 2.0))
    return oddsmap.build_map([scan], 0.1).log_odds()


@pytest.fixture(scope="module")
def space() -> LogOdds:
    scan = Scan.from_points(np.eye(4), [[2.0, 0.0, 0.5], [2.0, 0.1, 0.0]])
    return oddsmap.build_map([scan], 0.1).log_odds()


Ask = Callable[[LogOdds], object]


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda view: view.cast_rays([0, 0], [[1, 0]], "10"), "max_range is one number, got '10'"),
        (lambda view: view.distance_field("occupied"), "max_distance is one number, got 'occ"),
        (lambda view: view.distance_field().within([0.1]), "radius is one number, got"),
        (lambda view: view.distance_field(threads=1.5), "threads are a whole number, got 1.5"),
        (lambda view: view.distance_band("1"), "max_distance is one number"),
        (lambda view: view.costmap("0.25"), "inscribed_radius is one number, got '0.25'"),
        (lambda view: view.costmap(0.6), "give a larger inflation_radius"),
        (lambda view: view.likelihood_field("30"), "range_max is one number"),
        (lambda view: view.beam_likelihood("30"), "range_max is one number"),
        (lambda view: view.information_gain([[0, 0, 0]], [[1, 0]], "10"), "max_range is one num"),
        (lambda view: view.distance_field(thresholds=0.5), r"oddsmap.Thresholds\(.*\), got 0.5"),
        (lambda view: view.frontiers(thresholds=(0.2, 0.65)), "thresholds are"),
        (lambda view: view.cast_rays([0, 0], [[1, 0]], 9, thresholds=0.5), "thresholds are odds"),
        (lambda view: view.state(thresholds=0.5), "thresholds are oddsmap.Thresholds"),
        (
            lambda view: view.to_probability_map().frontiers(thresholds=0.5),
            "thresholds are oddsmap.Thresh",
        ),
    ],
)
def test_numbers_and_thresholds(view: LogOdds, ask: Ask, message: str) -> None:
    with pytest.raises((ConfigError, InputError), match=message):
        ask(view)


@pytest.mark.parametrize("pose", [[0, 0, 0], (0.0, 0.0, 0.0), np.zeros(3), oddsmap.Pose2(0, 0, 0)])
def test_one_pose_alone(view: LogOdds, pose: object) -> None:
    with pytest.raises(InputError, match=r"one alone is \[pose\]"):
        view.information_gain(pose, [[1, 0]], 5.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"one alone is \[pose\]|\(x, y, yaw\) each"):
        view.likelihood_field(9.0).log_likelihood(
            pose,  # type: ignore[arg-type]
            Scan.from_angles((0, 0, 0), [0.0], [1.0]),
        )


def test_one_matrix_alone(space: LogOdds) -> None:
    for pose in (np.eye(4), np.eye(4).tolist()):
        with pytest.raises(InputError, match=r"one alone is \[pose\]"):
            space.information_gain(pose, [[1, 0, 0]], 5.0)
    assert space.information_gain([np.eye(4)], [[1, 0, 0]], 5.0).shape == (1,)
    mixed: list[Any] = [oddsmap.Pose3(np.zeros(3), np.eye(3)), np.eye(4)]
    assert space.information_gain(mixed, [[1, 0, 0]], 5.0).shape == (2,)
    assert space.information_gain([], [[1, 0, 0]], 5.0).shape == (0,)


def test_a_part_of_a_beam(view: LogOdds) -> None:
    scan = Scan.from_angles((0, 0, 0), [0.0], [1.0])
    with pytest.raises(ConfigError, match=r"max_beams is a whole number, got 1\.5"):
        view.likelihood_field(9.0).log_likelihood(
            [[0, 0, 0]],
            scan,
            max_beams=1.5,  # type: ignore[arg-type]
        )


def test_a_map_in_place_of_its_view(view: LogOdds) -> None:
    with pytest.raises(InputError, match=r"from a view, such as grid.log_odds\(\), got EvidenceM"):
        view.distance_field().update(view.evidence)  # type: ignore[arg-type]


def test_a_ground_that_is_none(space: LogOdds) -> None:
    for ground in ("relative", 0.0):
        with pytest.raises(InputError, match="the ground is a GroundPlane or a GroundSurface"):
            oddsmap.traversable(space, ground=ground)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"robot_height is one number, got '1.2'"):
        oddsmap.traversable(space, robot_height="1.2")  # type: ignore[arg-type]
