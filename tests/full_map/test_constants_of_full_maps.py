# SPDX-License-Identifier: Apache-2.0
"""What full-map estimation takes for granted, as its pages and docstrings have it: the numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import (
    Beams,
    BeamSensor,
    ConeSensor,
    ConfigError,
    FullMap,
    FullMapConfig,
    MapTooLargeError,
    Pose2,
    ReflectionMap,
    Scan,
    build_full_map,
    build_reflection_map,
)
from oddsmap.forward import cell_grid as field_module
from oddsmap.full_map.belief_propagation import Propagation

RESOLUTION = 0.1
AHEAD = (0.05, 0.05)
Cells = set[tuple[int, int]]


def beam(z: float, at: tuple[float, float] = AHEAD, heading: float = 0.0) -> Scan:
    way = np.array([[math.cos(heading), math.sin(heading)]])
    return Scan(Pose2(*at, 0.0), way, np.array([z]))


def observed(grid: FullMap) -> Cells:
    return {(int(x), int(y)) for x, y in grid.known_log_odds()[0]}


def estimated(scans: Sequence[Scan], sensor: Any, **settings: Any) -> FullMap:
    chosen = FullMapConfig(**{"coupling": 0.0, "prior": 0.001, **settings})
    return build_full_map(scans, RESOLUTION, sensor=sensor, settings=chosen)


# ---- which cells count as observed ------------------------------------------------------------


@pytest.mark.parametrize("z", [1.0, 1.4, math.inf])
@pytest.mark.parametrize(
    "sensor",
    [
        BeamSensor(range_max=2.0, sigma=0.2),
        ConeSensor(cone_deg=20.0, range_max=2.0, sigma=0.2),
        ConeSensor(cone_deg=3.0, range_max=2.0, sigma=0.07),
    ],
)
def test_a_beam_has_seen_half_cells_up_to_two_sigma_behind_its_reading(
    sensor: BeamSensor | ConeSensor, z: float
) -> None:
    """Of a world thought free, in which a beam comes everywhere."""
    model = sensor.forward_model()
    scan = beam(z)
    beams, _ = Beams.from_scans([scan])
    shape, lo = (60, 60), np.array([-30, -30])
    ((_, listed),) = model.cells(beams, RESOLUTION, lo, shape)
    width = model.bin_width_at(RESOLUTION)
    last = int((min(z, 2.0) + 2.0 * model.sigma) / width)
    inside = (listed.fractions >= 0.5) & (listed.bins <= last)
    assert 0 < np.count_nonzero(inside) < len(inside), "the example shows nothing"
    y, x = np.divmod(listed.cells[inside], shape[1])
    want = {(int(a) - 30, int(b) - 30) for a, b in zip(x, y, strict=True)}
    assert observed(estimated([scan], sensor)) == want


@pytest.mark.parametrize(("detection", "seen"), [(0.88, True), (0.92, False)])
def test_behind_a_wall_that_one_beam_in_ten_passes_is_seen(detection: float, seen: bool) -> None:
    """What is sure to be there lets 1 - detection of the beams through."""
    sensor = BeamSensor(range_max=4.0, detection=detection)
    # The cell from 1.1 m on, and one reading from behind it.
    grid = estimated([*[beam(1.06)] * 40, beam(2.06)], sensor)
    assert grid.probability(((11, 0), (12, 1)))[0, 0] > 0.9999
    assert (11, 0) in observed(grid)
    assert ((15, 0) in observed(grid)) == seen


# ---- how messages move ------------------------------------------------------------------------


def told(schedule: str) -> float:
    """What the first sweep tells the cell of a reading, beyond its prior [nats]."""
    scan = beam(1.0)
    grid = estimated([scan], BeamSensor(range_max=2.0), schedule=schedule, sweeps=1, prior=0.3)
    odds = grid.log_odds(((10, 0), (11, 1)))[0, 0] - math.log(0.3 / 0.7)
    return float(odds)


def test_all_beams_at_once_go_half_the_way() -> None:
    assert abs(told("sequential")) > 0.1
    assert told("parallel") == pytest.approx(told("sequential") / 2, rel=1e-4)


class Watched(Propagation):
    """Notes how it is asked to sweep, and how many beams it takes at a time."""

    settled: list[bool] = []  # noqa: RUF012
    chunks: list[int] = []  # noqa: RUF012

    def sweep(self, *, settling: bool = False) -> float:
        Watched.settled.append(settling)
        return super().sweep(settling=settling)

    def _renewed(self, beams: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
        Watched.chunks.append(len(beams))
        return super()._renewed(beams)


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> type[Watched]:
    monkeypatch.setattr(Watched, "settled", [])
    monkeypatch.setattr(Watched, "chunks", [])
    monkeypatch.setattr(f"{Propagation.__module__}.Propagation", Watched)
    return Watched


def test_messages_settle_after_ten_free_sweeps(watched: type[Watched]) -> None:
    # No tolerance: they may not come to rest before.
    estimated([beam(1.0), beam(1.1)], BeamSensor(range_max=2.0), sweeps=13, tolerance=0.0)
    assert watched.settled[-13:] == [False] * 10 + [True] * 3


@pytest.mark.parametrize(
    ("beams", "chunk", "size"), [(640, 512, 10), (100, 512, 1), (20, 512, 1), (640, 7, 7)]
)
def test_a_chunk_is_one_beam_in_64_at_most(
    watched: type[Watched], beams: int, chunk: int, size: int
) -> None:
    scans = [beam(1.0, (0.05, 0.05 + 0.1 * (k % 9))) for k in range(beams)]
    watched.chunks.clear()
    estimated(scans, BeamSensor(range_max=2.0), sweeps=1, chunk=chunk)
    ours = watched.chunks[-math.ceil(beams / size) :]
    assert max(ours) == size
    assert sum(ours) == beams


# ---- limits -----------------------------------------------------------------------------------


def test_the_strongest_coupling() -> None:
    assert FullMapConfig(coupling=64.0).coupling == 64.0
    with pytest.raises(ConfigError, match="between 0 and 64"):
        FullMapConfig(coupling=math.nextafter(64.0, 65.0))


class Many(dict[Any, int]):
    """Blocks in use, a number of them unnamed."""

    unnamed = 0

    def __len__(self) -> int:
        return super().__len__() + self.unnamed


def test_numbers_of_cells_fit_their_31_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """2^31 cells are 2^21 blocks, and the last number would be 2^31 - 1: one block too many."""
    cells = field_module.CellField(2, 0)
    monkeypatch.setattr(cells, "_number", blocks := Many())
    monkeypatch.setattr(cells, "_grow", lambda new: None)
    blocks.unnamed = (1 << 21) - 2
    assert cells.insert(np.array([[0, 0]])).tolist() == [(1 << 21) - 2]
    with pytest.raises(MapTooLargeError, match=r"up to 2\^31 cells"):
        cells.insert(np.array([[1, 0]]))


def test_a_window_has_2_to_the_28_blocks_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []

    def full(count: int, value: int, dtype: Any) -> npt.NDArray[Any]:
        made.append(count)
        return np.zeros(1, dtype)

    monkeypatch.setattr(np, "full", full)
    cells = field_module.CellField(2, 0)
    side = 1 << 14
    low = np.zeros(2, np.int64)
    field_module.Window(cells, low, np.array([side * 32, side * 32]))
    assert made == [1 << 28]
    with pytest.raises(MapTooLargeError, match="the beams span 524288 x 524320 cells"):
        field_module.Window(cells, low, np.array([side * 32, side * 32 + 1]))


# ---- when a map has converged -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "rest"), [("sum-product", 2e-3), ("gibbs", 0.005), ("map", 5e-324)]
)
def test_a_full_map_has_converged_below_its_limit(method: str, rest: float) -> None:
    grid = estimated([beam(1.0)], BeamSensor(range_max=2.0), method=method)
    for residual, converged in ((0.0, True), (math.nextafter(rest, 0.0), True), (rest, False)):
        grid.residual = residual
        assert grid.converged == converged


def reflected(sigma: float = 0.035, **options: Any) -> ReflectionMap:
    sensor = ConeSensor(cone_deg=20.0, range_max=2.0, sigma=sigma)
    scans = [beam(1.0 + 0.01 * k, (0.05, 0.05 + 0.03 * k), 0.1 * k) for k in range(9)]
    return build_reflection_map(scans, RESOLUTION, sensor=sensor, **options)


def test_a_reflection_map_has_converged_below_1e_4() -> None:
    residuals: list[float] = []
    grid = reflected(progress=lambda _, residual: residuals.append(residual))
    assert residuals[-1] < 1e-4 <= min(residuals[:-1])
    for residual, converged in ((math.nextafter(1e-4, 0.0), True), (1e-4, False)):
        grid.residual = residual
        assert grid.converged == converged


def test_the_noise_of_a_reflection_map_is_a_third_of_a_cell_at_least() -> None:
    third = RESOLUTION / 3.0
    least = reflected(sigma=third)
    assert np.array_equal(reflected(sigma=0.1 * third).mean(), least.mean())
    assert np.array_equal(reflected(sigma=math.nextafter(third, 0.0)).mean(), least.mean())
    assert not np.array_equal(reflected(sigma=1.05 * third).mean(), least.mean())


def test_messages_of_a_reflection_map_keep_half_of_what_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From the second sweep on; the first has nothing to keep."""
    from oddsmap.kernels.infer import beta_factor

    revisit, kept = beta_factor.revisit_beams, []

    def noted(*arguments: Any) -> None:
        kept.append(arguments[-1])
        revisit(*arguments)

    reflected(sweeps=1)  # compiles
    monkeypatch.setattr(beta_factor, "revisit_beams", noted)
    reflected(sweeps=3)
    assert kept == [0.0, 0.5, 0.5]


# ---- the joint posterior ----------------------------------------------------------------------


def test_no_cell_of_a_finite_chain_is_surer_than_1e_12() -> None:
    scans = [beam(1.0, (0.05 + 0.002 * k, 0.05)) for k in range(40)]
    grid = estimated(scans, BeamSensor(range_max=2.0), method="gibbs", samples=4, prior=0.5)
    limit = math.log(1e-12)
    odds = grid.known_log_odds()[1]
    assert odds.min() == np.float32(limit - math.log1p(-1e-12))
    assert odds.max() == pytest.approx(-limit, abs=1e-3)


def test_where_both_states_are_as_good_the_map_decides_by_1e_6() -> None:
    """A prior of one half says nothing, nor does a beam of a cell that it does not meet."""
    grid = estimated([beam(1.0)], BeamSensor(range_max=2.0), method="map", prior=0.5)
    assert np.abs(grid.log_odds(((5, 20), (9, 25)))) == pytest.approx(1e-6, rel=1e-6)
    assert np.abs(grid.known_log_odds()[1]).max() > 1.0


# ---- memory -----------------------------------------------------------------------------------


def test_memory_is_refused_by_the_bytes_of_what_is_kept(
    watched: type[Watched], monkeypatch: pytest.MonkeyPatch
) -> None:
    from oddsmap.forward import beam_rows as rows
    from oddsmap.full_map import joint_samples as joint
    from oddsmap.kernels.infer.incremental_likelihood import count_bins

    made: list[Watched] = []
    run = watched.run

    def noted(self: Watched, *arguments: Any) -> tuple[int, float]:
        made.append(self)
        return run(self, *arguments)

    monkeypatch.setattr(watched, "run", noted)
    scans, sensor = [beam(1.0), beam(1.2)], BeamSensor(range_max=2.0)
    estimated(scans, sensor, method="map")
    work = made[-1]
    # Of each row its cell, bin and fraction, its message and a new one; no cell has a block yet.
    own = sum(a.itemsize for a in (work.rows.cells, work.rows.bins, work.rows.fractions))
    listing = (own + 2 * work.messages.itemsize) * len(work.rows.cells)
    # The rows once more, sorted by cell (number of the beam's bin, fraction), and seven numbers a
    # bin (see BeamBins).
    joining = work.field.nbytes + work.nbytes + 8 * len(work.rows.cells)
    joining += (5 * 8 + 4) * count_bins(work.rows)
    for module, needed, said in ((rows, listing, "beams"), (joint, joining, "hill climbing")):
        for spare, fits in ((0, True), (-1, False)):
            with monkeypatch.context() as patch:
                limit = needed + spare
                patch.setattr(module, "memory_limit", lambda limit=limit: limit)
                if fits:
                    estimated(scans, sensor, method="map")
                else:
                    with pytest.raises(MapTooLargeError, match=said):
                        estimated(scans, sensor, method="map")
