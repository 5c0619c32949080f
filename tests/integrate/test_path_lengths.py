# SPDX-License-Identifier: Apache-2.0
"""Path lengths: by hand, what must not change a bit. Oracle: kernels/trace/test_hit_region.py."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap.integrate.threads
from oddsmap import BeamSensor, EvidenceMap, Scan, add_scans, build_map, load_map
from oddsmap.errors import ConfigError, InputError
from oddsmap.sensors.cone import ConeSensor
from tests.kit import AS_FOUND, ONE, fan_scan, random_scans, votes_of
from tests.kit3d import random_space_scans

seeds = st.integers(0, 10_000)
dimensions = st.sampled_from([2, 3])
sensors = st.sampled_from([BeamSensor(range_max=5.0), BeamSensor(range_max=5.0, fade=0.7)])
Lengths = dict[tuple[int, ...], int]


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.threads, "_BATCH_BEAMS", 100)


def scans_of(d: int, seed: int, count: int) -> list[Scan]:
    scans = (random_scans if d == 2 else random_space_scans)(seed, count)
    return [dataclasses.replace(scan, stamp_ns=k * 10**9) for k, scan in enumerate(scans)]


def mapped(
    scans: Sequence[Scan],
    d: int,
    sensor: BeamSensor,
    *,
    threads: int = 1,
    side: int | None = None,
    half_life: float | None = None,
) -> EvidenceMap:
    evidence = EvidenceMap(
        0.25, ndim=d, votes="beam", sensor=sensor, path_lengths=True, tile_side=side,
        half_life=half_life, t_ref_ns=None if half_life is None else 30 * 10**9,
    )  # fmt: skip
    add_scans(evidence, scans, threads=threads)
    return evidence


def lengths_of(evidence: EvidenceMap) -> Lengths:
    index, units = evidence.cell_lengths()
    return {tuple(map(int, cell)): int(n) for cell, n in zip(index, units, strict=True)}


def assert_same(one: EvidenceMap, other: EvidenceMap) -> None:
    assert lengths_of(one) == lengths_of(other)
    assert votes_of(one) == votes_of(other)


def test_by_hand() -> None:
    """Along x in cells of 0.5 m, up to the return; a no-return up to where it clears."""
    sensor = BeamSensor(clear_range=1.2)
    scan = fan_scan(0.2, 0.1, 0.0, [1.1, math.inf], step=0.0)
    evidence = EvidenceMap(0.5, votes="beam", sensor=sensor, path_lengths=True)
    add_scans(evidence, [scan])
    got = evidence.region_lengths((0, 0), (4, 1))
    assert got.shape == (1, 4)
    # To 1.3 m and to 1.4 m; both are inside 0..0.5 from 0.2 on.
    assert np.allclose(got[0], [0.6, 1.0, 0.7, 0.0], atol=2 * 0.5 / ONE)
    assert votes_of(evidence) == {
        (0, 0): (0, 2 * ONE), (1, 0): (0, 2 * ONE), (2, 0): (ONE, 0)
    }  # fmt: skip
    bounds = evidence.bounds() or (None, None)
    assert bounds[1] is not None
    assert bounds[1].tolist() == [3, 1]
    assert evidence.nbytes > EvidenceMap(0.5).nbytes


def test_filtered_returns_have_a_length() -> None:
    scan = random_space_scans(1, 1)[0]
    marking, filtered = BeamSensor(), BeamSensor(mark_z_min=100.0)
    assert lengths_of(mapped([scan], 3, marking)) == lengths_of(mapped([scan], 3, filtered))


def test_the_votes_are_those_of_a_map_without() -> None:
    scans = scans_of(2, 4, 5)
    plain = EvidenceMap(0.25, votes="beam")
    add_scans(plain, scans)
    assert votes_of(plain) == votes_of(mapped(scans, 2, BeamSensor()))
    assert plain.lengths is None


@given(seeds, dimensions, sensors, st.randoms(use_true_random=False), st.sampled_from([1, 2, 3]))
@settings(max_examples=15, phases=AS_FOUND)
def test_order_and_threads_change_no_bit(
    seed: int, d: int, sensor: BeamSensor, random: object, threads: int
) -> None:
    scans = scans_of(d, seed, 10)
    for half_life in (None, 5.0):
        want = mapped(scans, d, sensor, half_life=half_life)
        random.shuffle(scans)  # type: ignore[attr-defined]
        assert_same(mapped(scans, d, sensor, threads=threads, half_life=half_life), want)


@given(seeds, dimensions, sensors, st.sampled_from([2, 4, 16]), st.integers(0, 6))
@settings(max_examples=15)
def test_tile_side_and_halves_change_no_bit(
    seed: int, d: int, sensor: BeamSensor, side: int, cut: int
) -> None:
    scans = scans_of(d, seed, 6)
    one = mapped(scans[:cut], d, sensor)
    one.merge(mapped(scans[cut:], d, sensor, side=side))
    assert_same(one, mapped(scans, d, sensor))


@pytest.mark.parametrize("d", [2, 3])
def test_half_lives_weigh_lengths(d: int) -> None:
    """Each scan's length in a cell, times its weight, rounded."""
    scans = scans_of(d, 8, 4)
    want: dict[tuple[int, ...], int] = {}
    for k, scan in enumerate(scans):
        weight = round(ONE * 2.0 ** (-(30 - k) / 5.0))
        for cell, units in lengths_of(mapped([scan], d, BeamSensor())).items():
            want[cell] = want.get(cell, 0) + (units * weight + ONE // 2) // ONE
    got = mapped(scans, d, BeamSensor(), half_life=5.0)
    assert lengths_of(got) == {cell: units for cell, units in want.items() if units}


@pytest.mark.parametrize("d", [2, 3])
def test_save_and_load_is_identity(d: int, tmp_path: Path) -> None:
    # Shorter than the farthest: the last cells that no-returns reach have a length and no vote.
    evidence = mapped(scans_of(d, 5, 4), d, BeamSensor(clear_range=9.0))
    evidence.save(tmp_path / "a.zarr")
    again = load_map(tmp_path / "a.zarr")
    assert again.config == evidence.config
    assert_same(again, evidence)
    lo, hi = np.full(d, -3), np.full(d, 9)
    assert_same(load_map(tmp_path / "a.zarr", lo=lo, hi=hi), evidence.crop(lo, hi))
    assert_same(load_map(tmp_path / "a.zarr", lo=lo), evidence.crop(lo, np.full(d, 99)))
    unvoted = lengths_of(evidence).keys() - votes_of(evidence).keys()
    assert len(unvoted) >= 3


def test_crop_keeps_the_lengths_inside() -> None:
    evidence = mapped(scans_of(2, 5, 4), 2, BeamSensor())
    part = evidence.crop((-4, -2), (5, 3))
    inside = {
        cell: units
        for cell, units in lengths_of(evidence).items()
        if -4 <= cell[0] < 5 and -2 <= cell[1] < 3
    }
    assert lengths_of(part) == inside
    assert len(inside) > 10
    assert evidence.like().config == evidence.config
    assert evidence.like().lengths is not None


def test_a_lost_shard_of_lengths(tmp_path: Path) -> None:
    mapped(scans_of(2, 5, 1), 2, BeamSensor()).save(tmp_path / "a.zarr")
    shard = sorted((tmp_path / "a.zarr" / "lengths" / "c").rglob("*/*"))[0]
    shard.unlink()
    with pytest.raises(InputError, match=r"lengths/c/.* is missing or empty"):
        load_map(tmp_path / "a.zarr")


def test_what_is_refused() -> None:
    scans = random_scans(0, 1)
    with pytest.raises(ConfigError, match=r'needs map\.votes "beam", got "scan"'):
        build_map(scans, 0.25, path_lengths=True)
    for sensor in (BeamSensor(hit_width=0.1), BeamSensor(sigma=0.1)):
        with pytest.raises(ConfigError, match="counts up to the return"):
            build_map(scans, 0.25, sensor=sensor, votes="beam", path_lengths=True)
    cone = ConeSensor(cone_deg=20.0, range_max=5.0)
    with pytest.raises(ConfigError, match="for narrow beams, the sensor is of kind cone"):
        build_map(scans, 0.25, sensor=cone, path_lengths=True)
    plain = build_map(scans, 0.25, votes="beam")
    for method in (plain.cell_lengths, lambda: plain.region_lengths((0, 0), (1, 1))):
        with pytest.raises(InputError, match="keeps no path lengths"):
            method()
    kept = EvidenceMap(0.25, votes="beam", path_lengths=True)
    for one, other in ((plain, kept), (kept, plain)):
        with pytest.raises(InputError, match="different path_lengths"):
            one.merge(other)
