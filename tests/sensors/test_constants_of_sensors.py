# SPDX-License-Identifier: Apache-2.0
"""What sensor models take for granted, as their docstrings have it: the numbers."""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
import pytest

from oddsmap import (
    Beams,
    BeamSensor,
    ConeSensor,
    ConfigError,
    ForwardModel,
    GridScan,
    InputError,
    MapTooLargeError,
    OverheadSensor,
    Pose2,
    Pose3,
    Scan,
)

HERE = Pose2(0.25, 0.25, 0.0)


def ahead(z: float) -> Scan:
    return Scan(HERE, np.array([[1.0, 0.0]]), np.array([z]))


def test_the_range_noise_of_a_lidar_is_2_cm_where_nothing_is_said() -> None:
    assert BeamSensor(range_max=5.0).forward_model().sigma == 0.02
    assert BeamSensor(range_max=5.0, sigma=0.3).forward_model().sigma == 0.3


def test_echoes_count_up_to_five_sigma_behind_a_reading() -> None:
    model = ForwardModel(cone_deg=10.0, range_max=4.0, range_min=0.5, sigma=0.125)
    given = [0.5, 1.0, 4.0, 9.0, math.inf, math.nextafter(0.5, 0.0), math.nan]
    want = [1.125, 1.625, 4.625, 4.625, 4.625, math.nan, math.nan]
    np.testing.assert_array_equal(model.reach(given), want)


def test_a_cone_is_2_to_the_22_cells_long_at_most() -> None:
    """By its reading and the depth of its arc; nothing is listed before it is asked for."""
    side = 0.25
    longest = side * (1 << 22)
    for width in (0.0, 2.0):
        sensor = ConeSensor(cone_deg=1e-6, hit_width=width)
        sensor.votes([ahead(longest - width)], side)
        with pytest.raises(MapTooLargeError, match=r"is over 4\.2e\+06 cells"):
            sensor.votes([ahead(longest - width + 1e-6)], side)


def test_cones_of_a_scan_hold_2_to_the_26_cells_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Room doubles until then; nothing is listed, so that none of it takes memory."""
    from oddsmap.kernels.vote import cone_votes

    monkeypatch.setattr(cone_votes, "list_cones", lambda *arguments: 0)
    cone = ConeSensor(cone_deg=30.0, range_max=3.0)
    lists, _ = cone.votes([ahead(1.0)], 0.25)
    with pytest.raises(MapTooLargeError, match=r"hold over 6\.7e\+07 cells"):
        next(lists)


def test_a_grid_spans_2_to_the_25_cells_at_most() -> None:
    # One cell of margin on each side, and the one that the outline ends in.
    high = 1 << 10
    for width, fits in ((1 << 15, True), ((1 << 15) + 1, False)):
        corner, nothing = (1.0, 1.0), np.full((high - 3, 1), np.nan)
        # A pixel as wide as the window: a quarter turn makes no difference to its size.
        pixel = GridScan(Pose2(0.0, 0.0, 0.0), nothing, 1.0, corner)
        wide = GridScan(Pose2(0.0, 0.0, 0.0), np.full((high - 3, width - 3), np.nan), 1.0, corner)
        lists, skipped = OverheadSensor().votes([pixel, wide], 1.0)
        if fits:
            assert list(lists) == []
            assert skipped == {"scan.empty": 2}
        else:
            with pytest.raises(MapTooLargeError, match=r"limit 3\.4e\+07"):
                list(lists)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_direction_is_a_unit_vector_to_a_millionth(sign: float) -> None:
    def beams(off: float) -> Beams:
        return Beams(np.zeros((1, 2)), np.array([[1.0 + sign * off, 0.0]]), np.ones(1))

    assert len(beams(0.99e-6)) == 1
    with pytest.raises(InputError, match="unit vector"):
        beams(1.01e-6)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rotations_of_few_digits_may_be_off_by_two_thousandths(sign: float) -> None:
    def scan(off: float) -> Scan:
        pose = Pose3(np.zeros(3), (1.0 + sign * off) * np.eye(3))
        return Scan(pose, np.eye(3)[:1], np.ones(1))

    for off in (0.0, 0.5e-6, 2e-6, 1.9e-3):
        beams, _ = Beams.from_scans([scan(off)])
        want = 1.0 + sign * off if off < 1e-6 else 1.0  # what is near enough stays as it is
        assert beams.directions[0, 0] == pytest.approx(want, abs=1e-15)
    with pytest.raises(InputError, match="unit vector"):
        Beams.from_scans([scan(2.1e-3)])


def test_a_beam_meets_2_to_the_28_cells_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """Room doubles until then; nothing is listed, so that none of it takes memory."""
    from oddsmap.kernels.trace import cone_cells

    rooms = []

    def none_fits(*arguments: object) -> int:
        rooms.append(len(arguments[-1]))  # type: ignore[arg-type]
        return 0

    monkeypatch.setattr(cone_cells, "list_cells", none_fits)
    model = ForwardModel(cone_deg=10.0, range_max=4.0)
    beams, _ = Beams.from_scans([ahead(1.0)])
    with pytest.raises(MapTooLargeError, match="more than 268435456 cells"):
        next(model.cells(beams, 0.1, (0, 0), (9, 9)))
    assert rooms[-1] == 1 << 28


@pytest.mark.parametrize("fields", [{"kind": BeamSensor}, {"kind": ConeSensor, "cone_deg": 9.0}])
def test_rates_leave_something_for_true_readings(fields: dict[str, Any]) -> None:
    sensor = functools.partial(fields["kind"], **{k: v for k, v in fields.items() if k != "kind"})
    assert sensor(detection=1.0).detection == 1.0
    assert sensor(p_random=0.5, p_dropout=0.5 - 2.0**-40).p_random == 0.5
    wrong: list[dict[str, float]] = [{"p_random": 0.5, "p_dropout": 0.5}, {"detection": 0.0}]
    for rates in wrong:
        with pytest.raises(ConfigError, match="sensor"):
            sensor(**rates)


def test_rates_of_a_forward_model_do_so_as_well() -> None:
    assert ForwardModel(cone_deg=0.0, range_max=1.0, detection=1.0).detection == 1.0
    with pytest.raises(ConfigError, match="p_dropout"):
        ForwardModel(cone_deg=0.0, range_max=1.0, p_random=0.5, p_dropout=0.5)


@pytest.mark.parametrize(("short", "listed"), [(0.12, 5), (0.13, 4)])
def test_cells_are_listed_half_a_bin_beyond_the_reach(short: float, listed: int) -> None:
    """They count from the middle of their bin: what begins behind the reach may lie before it."""
    model = ForwardModel(cone_deg=0.0, range_max=30.0, sigma=0.1, range_bias=0.0)
    # Bins are a quarter of a cell. Cell 5 begins 4.5 m ahead.
    reading = 4.5 - short - 5.0 * 0.1
    beams = Beams(np.array([[0.5, 0.5]]), np.array([[1.0, 0.0]]), np.array([reading]))
    ((_, found),) = model.cells(beams, 1.0, (0, 0), (1, 20))
    assert found.cells.max() == listed
