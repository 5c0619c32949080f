# SPDX-License-Identifier: Apache-2.0
"""The forward model against plain Python, against enumeration, and against its own draws."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.errors import ConfigError, InputError
from oddsmap.forward import beams as cone_beams
from oddsmap.forward.beams import Beams
from oddsmap.forward.model import ForwardModel
from oddsmap.forward.occupancy_box import Window
from oddsmap.kernels.trace.cone3d import RADIUS
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.scan import Scan
from tests.naive import forward as naive

FloatArray = npt.NDArray[np.float64]

CELL = 0.1
SONAR = ForwardModel(cone_deg=25.0, range_max=1.2, bin_width=0.05)


def one_beam(
    origin: tuple[float, ...], direction: tuple[float, ...], reading: float = np.inf
) -> Beams:
    return Beams(np.array([origin]), np.array([direction]), np.array([reading]))


def naive_cells(
    model: ForwardModel, origin: FloatArray, axis: FloatArray, window: Window
) -> list[tuple[int, float]]:
    """Bin and chance of an echo of the occupied cells of a cone, one cell after the other."""
    half = math.radians(model.cone_deg) / 2
    at = [float(x) / CELL for x in origin]
    width = model.bin_width_at(CELL)
    found = []
    for place in np.ndindex(window.shape):
        cell = tuple(int(i) + int(o) for i, o in zip(place[::-1], window.first, strict=True))
        if cell == tuple(math.floor(x) for x in at):
            continue
        if len(cell) == 2:
            turn = math.atan2(axis[1], axis[0])
            fraction = naive.plane_fraction(at, turn, half, cell)
        else:
            fraction = naive.space_fraction(at, axis.tolist(), half, cell, RADIUS)
        away = naive.nearest(at, cell) * CELL + model.range_bias
        chance = float(window.detection_or(model.detection)[0])
        if window.detection is not None:
            chance = float(window.detection[place])
        d = chance * fraction * float(window.occupancy[place])
        if d > 0 and away < model.range_max + 5 * model.sigma + width:
            found.append((int(away / width), d))
    return found


readings = st.one_of(st.sampled_from([0.0, 0.6, 1.2, math.inf]), st.floats(0.0, 1.3))


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), readings, st.booleans(), st.sampled_from([2, 3]))
def test_likelihood_is_the_formula(seed: int, reading: float, per_cell: bool, d: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (7,) * d if d == 2 else (4, 4, 4)
    window = Window(
        rng.random(shape) * (rng.random(shape) < 0.4),
        CELL,
        lo=rng.integers(-4, 1, d),
        detection=rng.random(shape) if per_cell else None,
    )
    origin, axis = rng.uniform(-0.5, 0.5, d), rng.normal(size=d)
    axis /= np.linalg.norm(axis)
    beam = one_beam(tuple(origin), tuple(axis), reading)
    got = SONAR.likelihood(beam, window)[0]
    cells = naive_cells(SONAR, origin, axis, window)
    # Bins far behind the reading are cut off, fractions are rounded to float32.
    want = naive.likelihood(SONAR, reading, cells, CELL / 2)
    assert got == pytest.approx(want, rel=1e-2 if d == 3 else 2e-4, abs=3e-6)
    assert SONAR.log_likelihood(beam, window)[0] == pytest.approx(math.log(got))


def test_first_echoes_are_those_of_every_outcome() -> None:
    """Each of the 2^n outcomes of which cells return the beam, and the nearest that does."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        window = Window((rng.random((5, 5)) < 0.4) * rng.choice([0.3, 1.0], (5, 5)), CELL)
        origin = rng.uniform(0.0, 0.5, 2)
        turn = rng.uniform(-3, 3)
        axis = np.array([math.cos(turn), math.sin(turn)])
        beam = one_beam(tuple(origin), tuple(axis))
        want = naive.first_echo(naive_cells(SONAR, origin, axis, window))
        ((_, echo, none),) = SONAR.first_echoes(beam, window)
        assert none[0] == pytest.approx(want.pop(None), abs=1e-6)
        for k in range(SONAR.bin_count(CELL)):
            assert echo[0, k] == pytest.approx(want.get(k, 0.0), abs=1e-6)
        assert echo.sum() + none[0] == pytest.approx(1.0)


def test_three_cells_by_hand() -> None:
    """A ray, cells at 0.1, 0.2 and 0.3 m of which the middle is free: two echoes or none."""
    model = ForwardModel(
        cone_deg=0.0, range_max=1.0, detection=0.8, p_random=0.1, p_dropout=0.2, sigma=0.02,
        range_bias=0.01, bin_width=0.1,
    )  # fmt: skip
    world = Window(np.array([[0.0, 1.0, 0.0, 1.0]]), CELL)
    # From the left border of cell 0: it is the sensor's own. Ranges .11 and .31: bins 1 and 3.
    ((_, echo, none),) = model.first_echoes(one_beam((0.0, 0.05), (1.0, 0.0)), world)
    assert echo[0, :5] == pytest.approx([0, 0.8, 0, 0.2 * 0.8, 0])
    assert none[0] == pytest.approx(0.2 * 0.2)
    bell = math.exp(-0.5) / 0.02 / math.sqrt(2 * math.pi) * 0.1  # one sigma beside bin 1's middle
    got = model.likelihood(one_beam((0.0, 0.05), (1.0, 0.0), 0.17), world)
    assert got == pytest.approx([0.8 * 0.7 * bell + 0.1 * 0.1])
    got = model.likelihood(one_beam((0.0, 0.05), (1.0, 0.0)), world)
    assert got == pytest.approx([0.96 * 0.2 + 0.04 * 0.9])


def test_bin_likelihoods_are_the_formula() -> None:
    for z in (0.0, 0.31, 1.19, 1.2, math.inf):
        given_k, none = SONAR.bin_likelihoods(z, CELL)
        assert len(given_k) * 0.05 > 1.2 + 5 * 0.035
        assert none == pytest.approx(naive.bin_likelihood(SONAR, z, None, 0.05))
        for k in range(len(given_k)):
            assert given_k[k] == pytest.approx(naive.bin_likelihood(SONAR, z, k, 0.05), rel=1e-12)
    assert SONAR.bin_likelihoods(math.inf, CELL)[1] == 1 - SONAR.p_random


@pytest.mark.parametrize("range_min", [0.0, 0.2])
def test_all_readings_together_are_certain(range_min: float) -> None:
    """Over z, no return, and what noise takes below range_min, p(z | first echo) adds up to 1."""
    model = ForwardModel(cone_deg=25.0, range_max=1.2, range_min=range_min, bin_width=0.05)
    count = 4800
    step = (1.2 - range_min) / count
    z = range_min + step * (np.arange(count) + 0.5)
    columns = [model.bin_likelihoods(float(x), CELL) for x in z]
    total = np.sum([k for k, _ in columns], axis=0) * step / 0.05
    at_infinity = model.bin_likelihoods(math.inf, CELL)
    middle = (np.arange(len(total)) + 0.5) * 0.05
    below = [0.5 * math.erfc((m - range_min) / 0.035 / math.sqrt(2)) for m in middle]
    assert total + at_infinity[0] + 0.96 * np.array(below) == pytest.approx(1.0, abs=1e-6)
    assert sum(n for _, n in columns) * step / 0.05 + at_infinity[1] == pytest.approx(1.0)


def test_readings_that_are_drawn_have_the_likelihoods_distribution() -> None:
    model = ForwardModel(
        cone_deg=40.0, range_max=1.0, range_min=0.1, p_random=0.1, p_dropout=0.05, detection=0.6,
        bin_width=0.05,
    )  # fmt: skip
    occupancy = np.zeros((6, 12))
    occupancy[4, 4:6] = occupancy[0:3, 8] = 1.0
    occupancy[3, 1] = 0.5  # near enough for noise to take the echo below range_min
    occupancy[2, 10] = 1.0
    window = Window(occupancy, CELL, lo=np.array([2, -3]))
    n = 100_000
    origins, directions = np.tile([0.22, 0.02], (n, 1)), np.tile([1.0, 0.0], (n, 1))
    drawn = model.simulate(origins, directions, window, np.random.default_rng(5)).ranges
    assert np.array_equal(
        drawn,
        model.simulate(origins, directions, window, np.random.default_rng(5)).ranges,
        equal_nan=True,
    )
    assert ((drawn >= 0.1) | np.isnan(drawn)).all()
    assert ((drawn < 1.0) | np.isinf(drawn) | np.isnan(drawn)).all()
    fine = 20
    borders = np.linspace(0.1, 1.0, 37)
    z = np.asarray(0.1 + 0.9 / (36 * fine) * (np.arange(36 * fine) + 0.5), np.float64)
    every = Beams(origins[: len(z)], directions[: len(z)], z)
    mass = model.likelihood(every, window) * (0.9 / (36 * fine)) / 0.05
    expected = mass.reshape(36, fine).sum(axis=1)
    unseen = model.likelihood(Beams(origins[:1], directions[:1], np.array([np.inf])), window)[0]
    counts, _ = np.histogram(drawn[np.isfinite(drawn)], borders)
    share = np.append(counts, np.isinf(drawn).sum()) / n
    want = np.append(expected, unseen)
    # Five standard deviations of a share, and what cutting the bins off at five sigma leaves.
    np.testing.assert_array_less(np.abs(share - want), 5 * np.sqrt(want / n) + 1e-4)
    lost = 1 - want.sum()
    assert 0.01 < lost < 0.2, "no echo near range_min: this test does not test that"
    assert abs(np.isnan(drawn).mean() - lost) < 5 * math.sqrt(lost / n) + 1e-4


def test_the_likelihood_is_the_mean_over_maps() -> None:
    """Linear in each cell: probabilities in place of maps give the expected likelihood."""
    rng = np.random.default_rng(1)
    p = rng.random((2, 3))
    beam = one_beam((-0.15, 0.1), (1.0, 0.0), 0.3)
    mean = 0.0
    for number in range(64):
        m = ((number >> np.arange(6)) & 1).reshape(2, 3).astype(float)
        weight = np.prod(np.where(m == 1, p, 1 - p))
        mean += weight * SONAR.likelihood(beam, Window(m, CELL))[0]
    assert SONAR.likelihood(beam, Window(p, CELL))[0] == pytest.approx(mean, rel=1e-9)


def test_detection_of_each_cell() -> None:
    occupancy = np.ones((1, 5))
    everywhere = Window(occupancy, CELL, detection=np.full((1, 5), SONAR.detection))
    beam = one_beam((0.05, 0.05), (1.0, 0.0), 0.2)
    assert SONAR.likelihood(beam, everywhere) == SONAR.likelihood(beam, Window(occupancy, CELL))
    # A cell that never returns the beam is as good as free.
    glass, gone = np.full((1, 5), SONAR.detection), occupancy.copy()
    glass[0, 1] = gone[0, 1] = 0.0
    assert SONAR.likelihood(beam, Window(occupancy, CELL, detection=glass)) == SONAR.likelihood(
        beam, Window(gone, CELL)
    )


def test_the_bins_go_with_the_cells_unless_given() -> None:
    assert ForwardModel(cone_deg=25.0, range_max=1.2).bin_width_at(0.2) == pytest.approx(0.05)
    assert SONAR.bin_width_at(0.2) == 0.05


def test_no_information_is_likelihood_one() -> None:
    model = ForwardModel(cone_deg=25.0, range_max=1.2, range_min=0.1)
    window = Window(np.ones((3, 9)), CELL)
    z = np.array([np.nan, -np.inf, 0.05, 0.1, 1.2, 5.0, np.inf])
    beams = Beams(np.tile([0.05, 0.15], (7, 1)), np.tile([1.0, 0.0], (7, 1)), z)
    got = model.likelihood(beams, window)
    assert (got[:3] == 1.0).all()
    assert (got[3:] < 1.0).all()
    assert got[4] == got[5] == got[6]  # range_max and beyond: no return
    assert model.bin_likelihoods(math.nan, CELL)[1] == 1.0
    assert np.isnan(model.reach(z)[:3]).all()


def test_blocks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    turns = rng.uniform(-3, 3, 50)
    origins = rng.uniform(0, 2, (50, 2))
    beams = Beams(origins, np.stack([np.cos(turns), np.sin(turns)], 1), rng.uniform(0, 1.4, 50))
    window = Window(rng.random((20, 20)) * 0.1, CELL)
    whole = SONAR.likelihood(beams, window)
    drawn = SONAR.simulate(beams.origins, beams.directions, window, np.random.default_rng(0))
    monkeypatch.setattr(cone_beams, "_BLOCK_CELLS", 16)
    monkeypatch.setattr(cone_beams, "_BLOCK_BEAMS", 7)
    blocks = list(SONAR.cells(beams, CELL, (0, 0), (20, 20)))
    assert len(blocks) > 7
    assert [part.start for part, _ in blocks[1:]] == [part.stop for part, _ in blocks[:-1]]
    assert np.array_equal(SONAR.likelihood(beams, window), whole)
    again = SONAR.simulate(beams.origins, beams.directions, window, np.random.default_rng(0))
    assert np.array_equal(again.ranges, drawn.ranges, equal_nan=True)
    monkeypatch.setattr(cone_beams, "_MAX_CELLS", 16)
    with pytest.raises(MemoryError, match="lower range_max or cone_deg"):
        SONAR.likelihood(beams, window)


def test_scans_become_beams_in_the_map_frame() -> None:
    ahead, ranges = np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([0.5, np.inf])
    scans = [
        Scan(Pose2(1.0, 2.0, math.pi / 2), ahead, ranges),
        Scan(Pose2(math.nan, 0.0, 0.0), ahead, ranges),
        Scan(Pose2(3.0, 4.0, 0.0), ahead, ranges),
    ]
    beams, skipped = Beams.from_scans(scans)
    assert skipped == Counter({"scan.nan_pose": 1})
    np.testing.assert_allclose(beams.origins, [[1, 2], [1, 2], [3, 4], [3, 4]])
    np.testing.assert_allclose(beams.directions, [[0, 1], [-1, 0], [1, 0], [0, 1]], atol=1e-15)
    assert beams.ranges.tolist() == [0.5, math.inf, 0.5, math.inf]
    assert (len(beams), beams.ndim) == (4, 2)
    space = Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3), np.ones(3))
    with pytest.raises(InputError, match="all 2D or all 3D"):
        Beams.from_scans([scans[0], space])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"p_random": 0.0}, "one bad reading would veto a cell for ever"),
        ({"p_random": math.nan}, "p_random"),
        ({"p_random": 0.5, "p_dropout": 0.5}, "below 1, got 0.5"),
        ({"p_dropout": -0.1}, "p_dropout"),
        ({"cone_deg": 181.0}, "from 0 to 180, got 181.0"),
        ({"cone_deg": -1.0}, "from 0 to 180"),
        ({"range_max": None}, "range_max is needed"),
        ({"range_max": math.inf}, "range_min < range_max, finite"),
        ({"range_min": 2.0}, "range_min < range_max"),
        ({"detection": 0.0}, "detection"),
        ({"detection": 1.1}, "detection"),
        ({"sigma": 0.0}, "sensor.sigma"),
        ({"bin_width": -1.0}, "sensor.bin_width"),
        ({"range_bias": math.nan}, "range_bias"),
    ],
)
def test_a_bad_model(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        ForwardModel(**{"cone_deg": 25.0, "range_max": 1.0, **fields})


def test_bad_input() -> None:
    beam = one_beam((0.0, 0.0), (1.0, 0.0), 0.5)
    with pytest.raises(InputError, match="occupancy lies between 0 and 1"):
        Window(np.full((2, 2), 1.5), CELL)
    with pytest.raises(InputError, match="occupancy lies between 0 and 1"):
        Window(np.full((2, 2), np.nan), CELL)
    with pytest.raises(InputError, match="detection has the shape of occupancy"):
        Window(np.ones((2, 2)), CELL, detection=np.ones((1, 2)))
    with pytest.raises(InputError, match="is 2 indices, x first"):
        Window(np.ones((2, 2)), CELL, lo=np.zeros(3, np.int64))
    with pytest.raises(InputError, match="positive resolution"):
        Window(np.ones((2, 2)), 0.0)
    with pytest.raises(InputError, match=r"shape \(ny, nx\)"):
        Window(np.ones(2), CELL)
    with pytest.raises(InputError, match="2D beams"):
        SONAR.likelihood(beam, Window(np.ones((2, 2, 2)), CELL))
    with pytest.raises(InputError, match="unit vector"):
        one_beam((0.0, 0.0), (2.0, 0.0))
    with pytest.raises(InputError, match="beam 0 needs a finite origin"):
        one_beam((math.nan, 0.0), (1.0, 0.0))
    with pytest.raises(InputError, match="got \\(1, 2\\), \\(1, 2\\) and \\(2,\\)"):
        Beams(np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.zeros(2))


@pytest.mark.parametrize("change", [{"range_max": 1e308}, {"sigma": 1e300}, {"bin_width": 1e-300}])
def test_bins_beyond_all_memory_are_refused(change: dict[str, float]) -> None:
    model = ForwardModel(**{"range_max": 4.0, "cone_deg": 20.0, **change})
    with pytest.raises(ConfigError, match=r"reach over .* bins of .* m: set a smaller range_max"):
        model.bin_count(0.1)
