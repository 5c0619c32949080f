# SPDX-License-Identifier: Apache-2.0
"""Which scans an online estimator keeps and sweeps again, against plain lists of all of them."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import ConfigError, MapTooLargeError, Pose2, Scan
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map.full_map import FullMap
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.full_map.online_beliefs import OnlineBeliefs
from oddsmap.full_map.online_prior import settle_new_blocks
from oddsmap.full_map.replay import KeptScan, Reservoir, Schedule
from oddsmap.kernels.infer.beam_factor import NAT, BeamRows
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.usable_beams import usable_beams
from oddsmap.simulate import Sonar2D
from tests.naive.replay import beliefs

SENSOR = ConeSensor(cone_deg=25.0, range_max=1.5)
RESOLUTION = 0.1


def drive(count: int, seed: int = 0, beam_count: int = 4) -> list[Scan]:
    """Scans along a corridor of blocks, back and forth."""
    truth = np.zeros((40, 100), np.bool_)
    truth[[8, 30]] = truth[20:24, ::30] = True
    rng = np.random.default_rng(seed)
    sonar = Sonar2D(beam_count=beam_count, range_max=1.5, p_random=0.1, p_dropout=0.1)
    xs = 5.0 + 4.0 * np.sin(np.arange(count) * 0.4)
    return [sonar.scan(truth, RESOLUTION, Pose2(float(x), 1.53, float(x)), rng) for x in xs]


def online(scans: list[Scan], seed: int = 0, **options: int | None) -> OnlineFullMap:
    config = Config(
        map=MapConfig(resolution=RESOLUTION), sensor=SENSOR, full_map=FullMapConfig(seed=seed)
    )
    estimator = OnlineFullMap(config, **options)  # type: ignore[arg-type]
    estimator.add_scans(scans)
    return estimator


def same(one: FullMap, other: FullMap) -> bool:
    """Equal to the bit."""
    return bool(np.array_equal(one.values, other.values)) and one.residual == other.residual


def scan_number(number: int) -> KeptScan:
    """Stands in for a scan of `number` bytes."""
    rows = BeamRows(
        np.empty(0), np.zeros(0, np.int64), np.empty(0, np.int32), np.empty(0, np.uint16),
        np.empty(0, np.float32),
    )  # fmt: skip
    return KeptScan(rows, np.empty(0, np.int32), np.zeros(number, np.uint8))


# ---- the schedule ----------------------------------------------------------------------------


@settings(max_examples=40)
@given(
    st.integers(0, 4), st.integers(0, 4), st.none() | st.integers(1, 5), st.integers(1, 4),
    st.sampled_from([0.0, 0.8]), st.sampled_from([0.0, 2e-3, 0.5]), st.integers(0, 99),
)  # fmt: skip
def test_beliefs_are_those_of_plain_lists(
    window: int,
    replay: int,
    reservoir: int | None,
    prior_every: int,
    coupling: float,
    tolerance: float,
    seed: int,
) -> None:
    """Every scan kept, each sweep beam by beam, blocks in sets: the same bits."""
    schedule = Schedule(window=window, replay=replay, reservoir=reservoir, prior_every=prior_every)
    chosen = FullMapConfig(coupling=coupling, tolerance=tolerance, seed=seed)
    model = SENSOR.forward_model()
    scans = [usable_beams([scan], SENSOR, RESOLUTION)[0] for scan in drive(11, seed)]
    ours = OnlineBeliefs(2, model, RESOLUTION, chosen, schedule)
    for beams in scans:
        ours.add(beams)
    theirs = beliefs(
        scans, model, RESOLUTION, schedule,
        seed=seed, start=round(math.log(0.475 / 0.525) * NAT), coupling=coupling,
        tolerance=tolerance,
    )  # fmt: skip
    field = ours._field
    assert np.array_equal(field.coords, theirs.coords)
    assert np.array_equal(field.belief, theirs.belief)
    assert np.array_equal(field.received, theirs.received)


def test_a_reservoir_is_a_uniform_sample() -> None:
    """Of 40 offered each is among the 5 held in an eighth of 2000 runs, within 5 sigma."""
    scans = [scan_number(i) for i in range(40)]
    held = np.zeros(40)
    for seed in range(2000):
        reservoir = Reservoir(5, seed)
        for scan in scans:
            reservoir.offer(scan)
        assert len(reservoir.scans) == 5
        held[[len(scan.blocks) for scan in reservoir.scans]] += 1
    assert held.sum() == 10_000
    assert abs(held - 250.0).max() < 5.0 * math.sqrt(2000 * 7 / 64)


def test_draws_are_uniform_and_without_repetition() -> None:
    reservoir = Reservoir(None, 1)
    assert reservoir.draw(3) == []
    for i in range(12):
        reservoir.offer(scan_number(i))
    drawn = np.zeros(12)
    for _ in range(2000):
        numbers = [len(scan.blocks) for scan in reservoir.draw(3)]
        assert len(set(numbers)) == 3
        drawn[numbers] += 1
    assert abs(drawn - 500.0).max() < 5.0 * math.sqrt(2000 * 3 / 16)
    assert len(reservoir.draw(99)) == 12


@given(st.none() | st.integers(1, 6), st.lists(st.integers(0, 50), max_size=30))
def test_the_bytes_of_a_reservoir_are_those_of_its_scans(
    capacity: int | None, sizes: list[int]
) -> None:
    reservoir = Reservoir(capacity, 0)
    for size in sizes:
        reservoir.offer(scan_number(size))
        assert reservoir.nbytes == sum(scan.nbytes for scan in reservoir.scans)
    assert len(reservoir.scans) == min(len(sizes), capacity or len(sizes))


# ---- in the estimator ------------------------------------------------------------------------


def test_replay_options_and_seed_matter() -> None:
    scans = drive(30)
    plain = online(scans).view()
    assert same(plain, online(scans).view())
    assert same(plain, online(scans, reservoir=None).view())
    assert not same(plain, online(scans, replay=2).view())
    assert not same(plain, online(scans, reservoir=8).view())
    assert not same(plain, online(scans, seed=1).view())
    # Without replay nothing is drawn.
    assert same(online(scans, replay=0).view(), online(scans, seed=1, replay=0).view())
    noted = online(scans, reservoir=8).view().provenance[0]
    assert [noted[name] for name in ("window", "replay", "reservoir")] == [2, 10, 8]


def test_old_scans_are_kept_as_the_reservoir_says() -> None:
    scans = drive(40)
    every, some, none = (
        online(scans, reservoir=None), online(scans, reservoir=5), online(scans, replay=0)
    )  # fmt: skip
    assert none.reservoir_nbytes == 0
    assert 0 < some.reservoir_nbytes < every.reservoir_nbytes / 3
    for estimator in (every, some, none):
        kept = estimator.window_nbytes + estimator.reservoir_nbytes
        assert estimator.nbytes - kept == none.nbytes - none.window_nbytes


def test_a_pickled_or_copied_estimator_goes_on_as_the_first() -> None:
    """Into new blocks, too: a copy whose arrays grow apart would lose what it was told."""
    scans = drive(40)
    for split in (1, 6, 23):
        first = online(scans[:split], reservoir=6)
        others = [pickle.loads(pickle.dumps(first)), copy.deepcopy(first)]
        first.add_scans(scans[split:])
        for other in others:
            other.add_scans(scans[split:])
            assert same(first.view(), other.view())
            assert other.nbytes == first.nbytes
            assert other.report.beams == first.report.beams


def test_what_memory_does_not_hold_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    scans = drive(30)
    estimator = online(scans[:20], reservoir=None)
    held = estimator.nbytes
    monkeypatch.setattr("oddsmap.full_map.online_beliefs.memory_limit", lambda: held + 100)
    with pytest.raises(MapTooLargeError, match=r"and 18 old scans .* keep fewer of them"):
        estimator.add_scans(scans[20:])
    assert estimator.view().observed(((0, 0), (100, 40))).any()


def test_what_replay_refuses() -> None:
    with pytest.raises(ConfigError, match="replay: at least 0 is needed, got -1"):
        online([], replay=-1)
    with pytest.raises(ConfigError, match="reservoir: at least 1 is needed, got 0"):
        online([], reservoir=0)


# ---- the prior of new blocks -----------------------------------------------------------------


@pytest.mark.parametrize("d", [2, 3])
def test_new_blocks_rest_and_others_hear_of_them_only(d: int) -> None:
    """One more pass changes next to nothing; a block that was there is told across the border."""
    corner = np.zeros((1, d), np.int64)
    old, new = CellField(d, -round(0.1 * NAT)), CellField(d, -round(0.1 * NAT))
    old.insert(corner)
    settle_new_blocks(old, 0, 0.7, 1e-6)
    new.insert(corner)
    settle_new_blocks(new, 0, 0.7, 1e-6)
    before = new.belief.copy()
    assert np.array_equal(before, old.belief)
    assert (before < -round(0.1 * NAT)).all()
    new.insert(corner + np.eye(d, dtype=np.int64)[0])
    settle_new_blocks(new, 1, 0.7, 1e-6)
    changed = (new.belief[: len(before)] != before).reshape((new.side,) * d)
    assert changed[..., -1].all()
    assert not changed[..., :-1].any()
    again = new.belief.copy()
    settle_new_blocks(new, 1, 0.7, math.inf)
    assert np.abs(again - new.belief).max() < 1e-3 * NAT
    settle_new_blocks(new, 0, 0.0, 0.0)
    settle_new_blocks(new, 2, 0.7, 0.0)
