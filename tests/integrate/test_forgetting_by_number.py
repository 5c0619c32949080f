# SPDX-License-Identifier: Apache-2.0
"""Evidence that fades by the number of scans: its closed form, any order, and what is refused."""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap.integrate.threads
from oddsmap import BeamSensor, EvidenceMap, Pose2, Scan, add_scans, build_map, load_map, open_log
from oddsmap.errors import ConfigError, InputError
from oddsmap.integrate.forgetting import last_number, numbered, weight_by_number
from oddsmap.poses.pose import Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.split_log import hold_out
from oddsmap.simulate import FloorPlan, Lidar2D, Rectangle, write_carmen
from tests.kit import AS_FOUND, ONE, random_scans, votes_of
from tests.kit3d import random_space_scans

REACH = 5.0
SENSOR = BeamSensor(range_max=REACH)
seeds = st.integers(0, 10_000)


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.threads, "_BATCH_BEAMS", 100)


def scans_of(d: int, seed: int, count: int) -> list[Scan]:
    make = random_scans if d == 2 else random_space_scans
    return [dataclasses.replace(scan, number=k) for k, scan in enumerate(make(seed, count))]


def empty(
    d: int = 2, *, votes: str = "scan", side: int | None = None, last: int = 11
) -> EvidenceMap:
    return EvidenceMap(
        0.25, ndim=d, votes=votes, sensor=SENSOR, half_life_scans=2.5, ref_scan=last, tile_side=side
    )


@given(seeds, st.sampled_from([2, 3]), st.sampled_from(["scan", "beam"]))
@settings(max_examples=8)
def test_each_scan_weighs_what_its_number_says(seed: int, d: int, votes: str) -> None:
    """The closed form: the sum over scans i of 2^(-(N - 1 - i) / H) times what scan i says."""
    scans = scans_of(d, seed, 6)
    want: Counter[tuple[tuple[int, ...], int]] = Counter()
    for i, scan in enumerate(scans):
        weight = round(ONE * 2.0 ** (-(6 - 1 - i) / 2.5))
        alone = EvidenceMap(0.25, ndim=d, votes=votes, sensor=SENSOR)
        add_scans(alone, [scan])
        for cell, vote in votes_of(alone).items():
            for k in (0, 1):
                want[cell, k] += (vote[k] * weight + ONE // 2) // ONE
    got = empty(d, votes=votes, last=5)
    add_scans(got, scans)
    found = {(cell, k): vote[k] for cell, vote in votes_of(got).items() for k in (0, 1) if vote[k]}
    assert found == {key: units for key, units in want.items() if units}


@given(
    seeds,
    st.sampled_from([2, 3]),
    st.randoms(use_true_random=False),
    st.sampled_from([1, 2, 3]),
    st.integers(0, 12),
)
@settings(max_examples=10, phases=AS_FOUND)
def test_order_threads_tiles_and_splitting_change_no_bit(
    seed: int, d: int, random: object, threads: int, cut: int
) -> None:
    scans = scans_of(d, seed, 12)
    want = empty(d)
    add_scans(want, scans)
    random.shuffle(scans)  # type: ignore[attr-defined]
    one, other = empty(d), empty(d, side=4)
    add_scans(one, scans[:cut], threads=threads)
    add_scans(other, scans[cut:])
    one.merge(other)
    assert votes_of(one) == votes_of(want)


def test_scans_one_by_one_with_their_number_given() -> None:
    scans = random_scans(3, 12)
    want = build_map(scans, 0.25, sensor=SENSOR, half_life_scans=2.5)
    assert want.config.map.ref_scan == 11
    grid, counted = empty(), empty()
    for k in (5, 0, 11, *range(1, 5), *range(6, 11)):
        grid.add(scans[k], number=k)
    counted.add(scans[:4], number=0)
    counted.add((scan for scan in scans[4:]), number=4)
    assert votes_of(grid) == votes_of(counted) == votes_of(want)
    assert all(scan.number is None for scan in scans)
    assert grid.provenance[0]["scans"] == 12
    assert (grid.provenance[0]["half_life_scans"], grid.provenance[0]["ref_scan"]) == (2.5, 11)


def test_scans_know_their_number_in_their_log(tmp_path: Path) -> None:
    """What is held out, and what is mapped, keeps its number."""
    write_carmen(tmp_path / "a.log", [dataclasses.replace(scan, stamp_ns=k * 10**9)
                 for k, scan in enumerate(straight(12))])  # fmt: skip
    log = open_log(tmp_path / "a.log")
    assert [scan.number for scan in log] == list(range(12))
    whole = build_map(log, 0.25, half_life_scans=2.5)
    with pytest.raises(ConfigError, match="the scans of a log know their own"):
        empty().add(log, number=3)
    mapped, held = hold_out(log, 3)
    parts = [build_map(part, 0.25, half_life_scans=2.5, ref_scan=11) for part in (mapped, held)]
    assert votes_of(parts[0] + parts[1]) == votes_of(whole)
    assert votes_of(build_map(list(log)[::-1], 0.25, half_life_scans=2.5)) == votes_of(whole)


def straight(count: int) -> list[Scan]:
    angles = np.linspace(-np.pi / 2, np.pi / 2, 7)
    return [Scan.from_angles((0.1 * k, 0.03, 0.1), angles, np.full(7, 2.0)) for k in range(count)]


def test_a_door_shut_for_1000_scans_and_open_for_100() -> None:
    """In a room with a door, by a lidar that stays where it is."""
    walls = [Rectangle(2.0, -3.0, 2.2, -0.5), Rectangle(2.0, 0.5, 2.2, 3.0),
             Rectangle(5.0, -3.0, 5.2, 3.0)]  # fmt: skip
    door = Rectangle(2.0, -0.5, 2.1, 0.5)
    shut, opened = FloorPlan([*walls, door]), FloorPlan(walls)
    lidar, rng = Lidar2D(beam_count=181, range_max=8.0), np.random.default_rng(0)
    scans = [
        lidar.scan(shut if k < 1000 else opened, Pose2(0.03, 0.02, 0.0), rng) for k in range(1100)
    ]
    places = [[2.05, y] for y in (-0.35, 0.02, 0.35)]
    plain = build_map(scans, 0.1, sensor=BeamSensor(range_max=8.0))
    fading = build_map(scans, 0.1, sensor=BeamSensor(range_max=8.0), half_life_scans=50)
    assert plain.log_odds().states_at(places).state.tolist() == [oddsmap.State.OCCUPIED] * 3
    assert fading.log_odds().states_at(places).state.tolist() == [oddsmap.State.FREE] * 3
    beside = [[2.05, y] for y in (-0.8, 0.8)]
    assert fading.log_odds().states_at(beside).state.tolist() == [oddsmap.State.OCCUPIED] * 2


def test_weights() -> None:
    assert [weight_by_number(n, 10.0, 20) for n in (20, 10, 0)] == [ONE, ONE // 2, ONE // 4]
    report = add_scans(empty(last=1000), numbered(random_scans(0, 3)))
    assert report.skipped == {"scan.forgotten": 3}


@pytest.mark.parametrize("d", [2, 3])
def test_save_and_load_is_identity(d: int, tmp_path: Path) -> None:
    grid = empty(d)
    add_scans(grid, scans_of(d, 1, 4))
    grid.save(tmp_path / "a.zarr")
    again = load_map(tmp_path / "a.zarr")
    assert again.config == grid.config
    assert votes_of(again) == votes_of(grid)
    assert grid.crop((-9,) * d, (9,) * d).config == grid.config


# ---- what is refused -------------------------------------------------------------------------


def test_scans_without_a_number_are_refused() -> None:
    scans = random_scans(1, 3)
    grid = empty()
    with pytest.raises(InputError, match=r"a scan has no number: map\.half_life_scans needs"):
        grid.add(scans)
    half = [dataclasses.replace(scans[0], number=0), *scans[1:]]
    with pytest.raises(InputError, match="a scan has no number"):
        build_map(half, 0.25, half_life_scans=5.0)
    with pytest.raises(InputError, match="scan 12 is later than the map's ref_scan 11"):
        grid.add(scans[0], number=12)
    assert grid.cell_count() == 0
    with pytest.raises(ConfigError, match="number 0 says how old a scan is"):
        EvidenceMap(0.25).add(scans, number=0)
    for number in (-1, 1.5):
        with pytest.raises(ConfigError, match="0 or above"):
            grid.add(scans, number=number)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"two scans have the number 1: .* one log"):
        build_map([*numbered(scans), *numbered(scans[:1], 1)], 0.25, half_life_scans=5.0)
    with pytest.raises(InputError, match="no scan"):
        last_number([])


def test_settings_that_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"map\.half_life_scans needs map\.ref_scan"):
        EvidenceMap(0.25, half_life_scans=20.0)
    with pytest.raises(ConfigError, match="counts back from: set both"):
        EvidenceMap(0.25, ref_scan=5)
    with pytest.raises(ConfigError, match="both let evidence fade: set one"):
        EvidenceMap(0.25, half_life=1.0, t_ref_ns=1, half_life_scans=20.0, ref_scan=5)
    for count in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigError, match=r"map\.half_life_scans is a number of scans above 0"):
            EvidenceMap(0.25, half_life_scans=count, ref_scan=5)
    with pytest.raises(ConfigError, match="this map has none"):
        empty().rescaled(5)


def test_maps_of_different_memory_are_not_added() -> None:
    one, plain = empty(), EvidenceMap(0.25, sensor=SENSOR)
    for other, said in (
        (empty(last=12), "different ref_scan .* build both with the later map.ref_scan"),
        (plain, "different half_life_scans"),
        (EvidenceMap(0.25, sensor=SENSOR, half_life=1.0, t_ref_ns=5), "different half_life "),
    ):
        with pytest.raises(InputError, match=said):
            one.merge(other)


def test_projection_takes_none() -> None:
    camera = PinholeCamera(2.0, 2.0, 1.5, 1.5, width=4, height=4)
    image = DepthScan(Pose3(np.eye(3), np.zeros(3)), np.full((4, 4), 1.0, np.float32), camera)
    grid = EvidenceMap(0.25, ndim=3, half_life_scans=20.0, ref_scan=0)
    with pytest.raises(ConfigError, match=r"takes no map\.half_life_scans"):
        grid.add(image, number=0, method="projective")
    grid.add(image, number=0)
    assert grid.cell_count() > 0
