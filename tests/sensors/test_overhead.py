# SPDX-License-Identifier: Apache-2.0
"""Grids seen at poses: which cell gets what, and the confusion model."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap import BeamSensor, EvidenceMap, GridScan, OverheadSensor, Pose2, build_map
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.integrate.add import add_scans
from oddsmap.odds import logit, sigmoid
from tests.kit import ONE, Votes, fan_scan, votes_of
from tests.naive.grids import Cell, readings

SENSOR = OverheadSensor()
ORIGIN = Pose2(0.0, 0.0, 0.0)


def cells_of(scan: GridScan, resolution: float) -> dict[Cell, tuple[int, int]]:
    """Cell -> (hits, passes), of one scan; a cell must not be listed twice."""
    parts, skipped = SENSOR.votes([scan], resolution)
    said: dict[Cell, tuple[int, int]] = {}
    for votes in parts:
        assert votes.offsets.tolist() == [0, len(votes.index)]
        assert votes.beams == len(votes.index)
        for cell, hits, passes in zip(votes.index.tolist(), votes.hits, votes.passes, strict=True):
            assert tuple(cell) not in said
            said[cell[0], cell[1]] = int(hits), int(passes)
    assert bool(said) != bool(skipped)
    return said


def box_around(scan: GridScan, resolution: float) -> list[Cell]:
    pose, (height, width) = scan.map_from_sensor, scan.seen.shape
    reach = abs(scan.corner[0]) + abs(scan.corner[1]) + (height + width) * scan.resolution
    columns, rows = (
        range(math.floor((at - reach) / resolution) - 1, math.ceil((at + reach) / resolution) + 2)
        for at in (pose.x, pose.y)
    )
    return list(itertools.product(columns, rows))


def random_grids(seed: int, count: int, *, labels: bool = False) -> list[GridScan]:
    rng = np.random.default_rng(seed)
    scans = []
    for _ in range(count):
        seen = rng.random((12, 17))
        if labels:
            seen = np.rint(seen)
        seen[rng.random(seen.shape) < 0.1] = np.nan
        x, y, theta = rng.uniform((-2.0, -2.0, -4.0), (2.0, 2.0, 4.0))
        pose = Pose2(float(x), float(y), float(theta))
        scans.append(GridScan(pose, seen, 0.13, (-0.4, -0.9)))
    return scans


SIDES = st.sampled_from([0.05, 0.1, 0.15, 0.2, 0.3])
# Along the cells and at other angles; on cells' corners, centres and anywhere.
ANGLES = st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi / 2, math.pi / 4]) | st.floats(-7, 7)
PLACES = st.sampled_from([0.0, 0.05, 0.1, -0.25, 500000.15]) | st.floats(-3, 3)
VALUES = st.sampled_from([0.0, 1.0, 0.5, math.nan]) | st.floats(0, 1)


@given(
    st.builds(Pose2, PLACES, PLACES, ANGLES),
    st.lists(st.lists(VALUES, min_size=3, max_size=3), min_size=1, max_size=5),
    SIDES,
    st.tuples(PLACES.map(lambda at: math.fmod(at, 1.0)), st.floats(-0.5, 0.1)),
    SIDES,
)
def test_equals_the_oracle(
    pose: Pose2,
    rows: list[list[float]],
    pixel: float,
    corner: tuple[float, float],
    resolution: float,
) -> None:
    scan = GridScan(pose, np.array(rows), pixel, corner)
    want = readings(scan, resolution, box_around(scan, resolution))
    got = cells_of(scan, resolution)
    assert got.keys() == want.keys()
    for cell, said in want.items():
        assert got[cell] == tuple(int(part) for part in SENSOR.weights(said))


@pytest.mark.parametrize("turns", range(4))
def test_pixels_on_cells_are_those_cells(turns: int) -> None:
    seen = np.array([[1, 0, 0], [1, 1, 0]])
    scan = GridScan(Pose2(0.5, -0.3, turns * math.pi / 2), seen, 0.1, (0.2, -0.1))
    want: Votes = {}
    for row, column in np.ndindex(2, 3):
        # In cells: column 0 begins 2 ahead of the sensor, row 0 ends at its left.
        x, y = column + 2.5, row - 0.5
        for _ in range(turns):
            x, y = -y, x
        label = int(seen[row, column])
        want[math.floor(x) + 5, math.floor(y) - 3] = label * ONE, (1 - label) * ONE
    assert cells_of(scan, 0.1) == want


@pytest.mark.parametrize("at", [0.05, 123.45, 500000.05, -4_000_000.15])
@pytest.mark.parametrize("theta", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_rounding_does_not_decide_on_borders(at: float, theta: float) -> None:
    # Borders of pixels on centres of cells, as where a camera with an even grid stands on one.
    seen = np.linspace(0.2, 0.8, 64).reshape(8, 8)
    scan = GridScan(Pose2(at, at, theta), seen, 0.1, (-0.4, -0.4))
    assert len(set(cells_of(scan, 0.1).values())) == len(cells_of(scan, 0.1)) == 64


def test_labels_are_whole_votes() -> None:
    hits, passes = SENSOR.weights([0.0, 1.0, 1.0])
    assert hits.tolist() == [0, ONE, ONE]
    assert passes.tolist() == [ONE, 0, 0]
    # The same with a probability beside them, which takes the way by logarithms.
    hits, passes = SENSOR.weights([0.0, 1.0, 0.6])
    assert hits[:2].tolist() == [0, ONE]
    assert passes[:2].tolist() == [ONE, 0]


@given(st.floats(0.02, 0.98), st.floats(0.55, 0.99), st.floats(0.01, 0.45))
def test_a_probability_is_the_part_of_a_vote_with_its_bayes_factor(
    p: float, true_rate: float, false_rate: float
) -> None:
    sensor = OverheadSensor(true_positive_rate=true_rate, false_positive_rate=false_rate)
    hits, passes = sensor.weights(p)
    gain, loss = float(logit(sensor.p_hit)), float(logit(sensor.p_miss))
    factor = (gain * int(hits) + loss * int(passes)) / ONE
    want = min(max(float(logit(p)), loss), gain)
    assert factor == pytest.approx(want, abs=max(gain, -loss) / ONE)
    assert min(hits, passes) == 0
    assert max(hits, passes) <= ONE


def test_one_half_says_nothing_and_no_probability_says_more_than_a_label() -> None:
    assert [int(part) for part in SENSOR.weights(0.5)] == [0, 0]
    chances = np.array([0.0, 1e-300, 0.05, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 1 - 1e-16, 1.0])
    hits, passes = SENSOR.weights(chances)
    assert (np.diff(hits - passes) >= 0).all()
    assert (hits[chances >= 0.9] == ONE).all()
    assert (passes[chances <= 0.1] == ONE).all()
    assert 0 < hits[6] < ONE
    grid = build_map([GridScan(ORIGIN, np.array([[0.5, 1.0]]), 1.0, (0.0, 0.0))], 1.0)
    assert votes_of(grid) == {(1, 0): (ONE, 0)}
    assert grid.report is not None
    assert grid.report.beams == 2


def test_bayes_factors_are_those_of_the_confusion_model() -> None:
    sensor = OverheadSensor(true_positive_rate=0.8, false_positive_rate=0.3)
    assert float(logit(sensor.p_hit)) == pytest.approx(math.log(0.8 / 0.3), abs=1e-15)
    assert float(logit(sensor.p_miss)) == pytest.approx(math.log(0.2 / 0.7), abs=1e-15)
    view = build_map([GridScan(ORIGIN, np.eye(2), 1.0, (0.0, 0.0))], 1.0, sensor=sensor).log_odds()
    assert (view.p_hit, view.p_miss) == (sensor.p_hit, sensor.p_miss)


@pytest.mark.parametrize(
    "change",
    [{"true_positive_rate": 0.6}, {"false_positive_rate": 0.3}],
    ids=lambda c: next(iter(c)),
)
@pytest.mark.parametrize("labels", [True, False])
def test_each_field_changes_the_result(change: dict[str, float], labels: bool) -> None:
    scans = random_grids(9, 3, labels=labels)
    grids = [build_map(scans, 0.1, sensor=sensor)
             for sensor in (SENSOR, dataclasses.replace(SENSOR, **change))]  # fmt: skip
    first, second = (grid.log_odds().probability() for grid in grids)
    assert not np.array_equal(first, second)
    # Labels are whole votes under any rates: these can be changed after mapping.
    assert (votes_of(grids[0]) == votes_of(grids[1])) == labels


def test_saving_and_loading_keeps_all(tmp_path: Path) -> None:
    sensor = OverheadSensor(true_positive_rate=0.7)
    grid = build_map(random_grids(8, 3), 0.1, sensor=sensor)
    grid.save(tmp_path / "floor.zarr")
    again = EvidenceMap.load(tmp_path / "floor.zarr")
    assert again.config == grid.config
    assert again.sensor == sensor
    assert votes_of(again) == votes_of(grid)


Maps = npt.NDArray[np.bool_]


def joint_posterior(
    scans: Sequence[GridScan], cells: list[Cell], prior: npt.NDArray[np.float64]
) -> tuple[Maps, npt.NDArray[np.float64]]:
    """p(m | z_1:t) of every map, from p(m) and p(z | m) alone: no log odds, no independence."""
    maps = np.array(list(itertools.product([False, True], repeat=len(cells))))
    chance = np.where(maps, prior, 1 - prior).prod(axis=1)
    for scan in scans:
        for cell, seen in readings(scan, 1.0, cells).items():
            occupied = maps[:, cells.index(cell)]
            seen_occupied = np.where(
                occupied, SENSOR.true_positive_rate, SENSOR.false_positive_rate
            )
            chance *= seen_occupied if seen == 1.0 else 1 - seen_occupied
    return maps, chance / chance.sum()


@pytest.mark.parametrize("shape", [(3, 3), (2, 4)])
@pytest.mark.parametrize("prior", [0.5, 0.2, "map"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_filter_is_the_exact_joint_posterior(
    shape: tuple[int, int], prior: float | str, seed: int
) -> None:
    """The Markov assumption holds: marginals *and* their product are those of all 2^n maps."""
    from oddsmap.posterior.prior import PriorArray

    rng = np.random.default_rng(seed)
    rows, columns = shape
    cells = [(x, y) for y in range(rows) for x in range(columns)]
    scans = []
    for _ in range(7):
        # A pixel's diagonal of 0.85 cells: it holds the centre of one cell at most.
        seen = np.rint(rng.random((4, 4)))
        seen[rng.random(seen.shape) < 0.2] = np.nan
        x, y, theta = rng.uniform((0.5, 0.5, -4.0), (2.5, 2.5, 4.0))
        pose = Pose2(float(x), float(y), float(theta))
        scans.append(GridScan(pose, seen, 0.6, (-1.2, -1.2)))
    counts = [sum(cell in readings(scan, 1.0, cells) for scan in scans) for cell in cells]
    assert max(counts) >= 3, "observations overlap"
    chances = rng.uniform(0.05, 0.95, shape) if prior == "map" else np.full(shape, float(prior))
    maps, exact = joint_posterior(scans, cells, chances.ravel())

    grid = build_map(scans, 1.0)
    view = grid.log_odds(prior=PriorArray(chances, (0, 0)) if prior == "map" else float(prior))
    region = ((0, 0), (columns, rows))
    marginals = sigmoid(view.log_odds(region)).ravel()
    np.testing.assert_allclose(marginals, exact @ maps, rtol=0, atol=1e-12)
    product = np.where(maps, marginals, 1 - marginals).prod(axis=1)
    np.testing.assert_allclose(product, exact, rtol=0, atol=1e-12)
    assert np.abs(marginals - chances.ravel()).max() > 0.1


def test_probabilities_are_calibrated() -> None:
    """Of the cells with a posterior near p, a share of p is occupied; a wrong model is seen."""
    rng = np.random.default_rng(3)
    sensor = OverheadSensor(true_positive_rate=0.75, false_positive_rate=0.3)
    prior, side = 0.3, 120
    truth = rng.random((side, side)) < prior
    scans = []
    for _ in range(9):
        # Each sees another half of the world, so that cells differ in their counts.
        rate = np.where(truth, sensor.true_positive_rate, sensor.false_positive_rate)
        seen = np.where(rng.random(truth.shape) < 0.5, rng.random(truth.shape) < rate, np.nan)
        scans.append(GridScan(ORIGIN, seen, 1.0, (0.0, 0.0)))
    grid = build_map(scans, 1.0, sensor=sensor)
    region = ((0, 0), (side, side))

    def worst(model: OverheadSensor) -> float:
        """Largest miss of a bin, in standard deviations of its share."""
        view = grid.log_odds(prior=prior, p_hit=model.p_hit, p_miss=model.p_miss)
        p = view.probability(region).ravel()
        group = np.unique(np.round(p, 9), return_inverse=True)[1]
        n = np.bincount(group)
        said = np.bincount(group, p) / n
        share = np.bincount(group, truth.ravel()) / n
        miss = np.abs(share - said) / np.sqrt(said * (1 - said) / n)
        assert np.count_nonzero(n >= 100) >= 10
        return float(miss[n >= 100].max())

    assert worst(sensor) < 4
    assert worst(OverheadSensor(true_positive_rate=0.9, false_positive_rate=0.1)) > 20


@pytest.mark.parametrize("labels", [True, False])
def test_order_threads_tiles_and_kind_of_votes_change_no_bit(labels: bool) -> None:
    scans = random_grids(5, 30, labels=labels)
    want = votes_of(build_map(scans, 0.1))
    assert len(want) > 500
    assert votes_of(build_map(scans[::-1], 0.1, threads=2)) == want
    assert votes_of(build_map(scans, 0.1, votes="beam")) == want  # a cell is seen once a scan
    for side in (4, 100):
        grid = EvidenceMap(0.1, sensor=SENSOR, tile_side=side)
        for scan in scans:
            add_scans(grid, [scan])
        assert votes_of(grid) == want


def test_moving_the_world_by_whole_cells_moves_the_map() -> None:
    scans = random_grids(6, 5)
    moved = [
        GridScan(
            Pose2(scan.map_from_sensor.x + 64.0, scan.map_from_sensor.y - 32.0,
                  scan.map_from_sensor.theta),
            scan.seen, scan.resolution, scan.corner,
        )
        for scan in scans
    ]  # fmt: skip
    here, there = (votes_of(build_map(some, 0.125)) for some in (scans, moved))
    assert {(x + 512, y - 256): vote for (x, y), vote in here.items()} == there


def test_what_is_skipped_is_counted_and_what_was_not_seen_is_not() -> None:
    one = np.array([[1.0, np.nan]])
    scans = [
        GridScan(ORIGIN, one, 1.0, (0.0, 0.0)),
        GridScan(Pose2(math.nan, 0.0, 0.0), one, 1.0, (0.0, 0.0)),
        GridScan(Pose2(0.0, 0.0, math.inf), one, 1.0, (0.0, 0.0)),
        GridScan(Pose2(0.0, -1e15, 0.0), one, 1.0, (0.0, 0.0)),
        GridScan(ORIGIN, np.full((2, 2), np.nan), 1.0, (0.0, 0.0)),
        GridScan(ORIGIN, one, 0.1, (0.6, 0.6)),  # between centres of cells
    ]
    for threads in (1, 2):
        report = build_map(scans, 1.0, threads=threads).report
        assert report is not None
        assert (report.scans, report.beams) == (1, 1)
        assert report.skipped == {"scan.nan_pose": 2, "scan.pose_too_far": 1, "scan.empty": 2}
    with pytest.raises(InputError, match=r"no usable scan \(2 x scan\.empty\)"):
        build_map(scans[4:], 1.0)


def test_a_scan_that_memory_cannot_hold_is_refused() -> None:
    scan = GridScan(ORIGIN, np.zeros((10, 10)), 100.0, (0.0, 0.0))
    with pytest.raises(MapTooLargeError, match=r"10 x 10 pixels of 100 m spans 1\.0e\+10 cells"):
        build_map([scan], 0.01)


def test_sensor_and_scans_must_fit() -> None:
    beams, grid = fan_scan(0.0, 0.0, 0.0, [1.0]), random_grids(0, 1)[0]
    with pytest.raises(InputError, match="has ranges and sees no cells"):
        build_map([beams], 0.1, sensor=SENSOR)
    with pytest.raises(InputError, match="sees cells, not ranges"):
        build_map([grid], 0.1, sensor=BeamSensor())
    with pytest.raises(InputError, match="2 dimensions cannot go into a map of 3"):
        add_scans(EvidenceMap(0.1, sensor=SENSOR, ndim=3), [grid])


@pytest.mark.parametrize("kind", [bool, np.uint8, np.int64, np.float32])
def test_labels_of_any_type(kind: Any) -> None:
    scan = GridScan(ORIGIN, np.array([[0, 1]], kind), 1.0, (0.0, 0.0))
    assert scan.seen.dtype == np.float64
    assert scan.size == 2
    assert cells_of(scan, 1.0) == {(0, 0): (0, ONE), (1, 0): (ONE, 0)}


@pytest.mark.parametrize(
    ("seen", "resolution", "corner", "words"),
    [
        (np.zeros(3), 1.0, (0, 0), "numbers of shape (h, w), at least one, got float64 of shape"),
        (np.zeros((0, 3)), 1.0, (0, 0), "got float64 of shape (0, 3)"),
        (np.array([["x"]]), 1.0, (0, 0), "got <U1 of shape (1, 1)"),
        (np.array([[0.0, 1.5]]), 1.0, (0, 0), "got 1.5 in row 0, column 1"),
        (np.array([[0], [255]]), 1.0, (0, 0), "got 255 in row 1, column 0"),
        (np.array([[-np.inf]]), 1.0, (0, 0), "got -inf in row 0, column 0"),
        (np.zeros((1, 1)), 0.0, (0, 0), "need a side above 0 m, got 0.0"),
        (np.zeros((1, 1)), math.nan, (0, 0), "need a side above 0 m, got nan"),
        (np.zeros((1, 1)), math.inf, (0, 0), "need a side above 0 m, got inf"),
        (np.zeros((1, 1)), 1.0, (0, math.inf), "is a point x, y [m], got (0, inf)"),
        (np.zeros((1, 1)), 1.0, (0,), "is a point x, y [m], got (0,)"),
    ],
)
def test_bad_grids_are_refused(seen: Any, resolution: float, corner: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        GridScan(ORIGIN, seen, resolution, corner)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("true_rate", "false_rate", "words"),
    [
        (0.3, 0.3, "false_positive_rate must lie below true_positive_rate, got 0.3 and 0.3"),
        (0.3, 0.4, "must lie below"),
        (0.3, math.nextafter(0.3, 0.0), "must lie below"),
        (1.0, 0.1, "sensor.true_positive_rate lies between 0 and 1, got 1.0"),
        (0.9, 0.0, "sensor.false_positive_rate lies between 0 and 1, got 0.0"),
        (math.nan, 0.1, "got nan"),
    ],
)
def test_bad_rates_are_refused(true_rate: float, false_rate: float, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        OverheadSensor(true_positive_rate=true_rate, false_positive_rate=false_rate)
