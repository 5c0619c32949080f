# SPDX-License-Identifier: Apache-2.0
"""Evidence with a half-life: its closed form, in any order, and what is refused."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap.integrate.threads
from oddsmap import BeamSensor, EvidenceMap, Pose2, Scan, add_scans, build_map, load_map
from oddsmap.errors import ConfigError, InputError
from oddsmap.integrate.forgetting import last_stamp, scan_weight
from oddsmap.poses.pose import Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import Sensor
from tests.kit import AS_FOUND, ONE, Votes, random_scans, votes_of
from tests.kit3d import random_space_scans

SECOND = 1_000_000_000
LAST = 1_700_000_000 * SECOND  # a time of our days [ns]

Kind = tuple[int, str, BeamSensor]
KINDS: list[Kind] = [
    (2, "scan", BeamSensor(range_max=5.0)),
    (2, "beam", BeamSensor(range_max=5.0, sigma=0.1, fade=0.5)),
    (3, "scan", BeamSensor(range_max=5.0)),
    (3, "beam", BeamSensor(range_max=5.0, hit_width=0.4, share_hit=True)),
]
kinds = st.sampled_from(KINDS)
seeds = st.integers(0, 10_000)


def stamped(scans: Sequence[Scan], step_s: float = 7.3) -> list[Scan]:
    """Scans `step_s` apart, the last one at LAST."""
    count = len(scans)
    return [
        dataclasses.replace(scan, stamp_ns=LAST - int((count - 1 - k) * step_s * SECOND))
        for k, scan in enumerate(scans)
    ]


def scans_of(kind: Kind, seed: int, count: int) -> list[Scan]:
    make = random_scans if kind[0] == 2 else random_space_scans
    return stamped(make(seed, count))


def mapped(
    scans: Sequence[Measurement],
    kind: Kind,
    *,
    half_life: float | None = 20.0,
    threads: int = 1,
    side: int | None = None,
) -> EvidenceMap:
    d, votes, sensor = kind
    evidence = EvidenceMap(
        0.25, ndim=d, votes=votes, sensor=sensor, tile_side=side,
        half_life=half_life, t_ref_ns=None if half_life is None else LAST,
        path_lengths=votes == "beam" and sensor.half_width == 0.0,
    )  # fmt: skip
    add_scans(evidence, scans, threads=threads)
    return evidence


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.threads, "_BATCH_BEAMS", 100)


def weighed(votes: Votes, weight: int) -> Votes:
    return {
        cell: ((hit * weight + ONE // 2) // ONE, (free * weight + ONE // 2) // ONE)
        for cell, (hit, free) in votes.items()
    }


@given(seeds, kinds)
@settings(max_examples=20)
def test_each_scan_weighs_what_its_age_says(seed: int, kind: Kind) -> None:
    """The closed form: the sum over scans of 2^(-age / half-life) times what the scan says."""
    scans = scans_of(kind, seed, 6)
    want: Counter[tuple[tuple[int, ...], int]] = Counter()
    for k, scan in enumerate(scans):
        weight = round(ONE * 2.0 ** (-(5 - k) * 7.3 / 20.0))
        assert weight == scan_weight(scan.stamp_ns, 20.0, LAST)
        for cell, vote in weighed(votes_of(mapped([scan], kind, half_life=None)), weight).items():
            want[cell, 0] += vote[0]
            want[cell, 1] += vote[1]
    got = votes_of(mapped(scans, kind))
    assert {(cell, k): vote[k] for cell, vote in got.items() for k in (0, 1) if vote[k]} == {
        key: units for key, units in want.items() if units
    }


@given(seeds, kinds, st.randoms(use_true_random=False), st.sampled_from([1, 2, 3]))
@settings(max_examples=20, phases=AS_FOUND)
def test_order_and_threads_change_no_bit(
    seed: int, kind: Kind, random: object, threads: int
) -> None:
    scans = scans_of(kind, seed, 12)
    want = votes_of(mapped(scans, kind))
    random.shuffle(scans)  # type: ignore[attr-defined]
    assert votes_of(mapped(scans, kind, threads=threads)) == want


@given(seeds, kinds, st.sampled_from([4, 16]), st.integers(0, 8))
@settings(max_examples=15)
def test_tile_side_and_halves_change_no_bit(seed: int, kind: Kind, side: int, cut: int) -> None:
    scans = scans_of(kind, seed, 8)
    want = votes_of(mapped(scans, kind))
    one, other = mapped(scans[:cut], kind), mapped(scans[cut:], kind, side=side)
    one.merge(other)
    assert votes_of(one) == want


def test_the_last_scan_is_whole_and_one_half_life_is_half() -> None:
    kind = KINDS[0]
    scan = random_scans(1, 1)[0]
    whole = votes_of(mapped([scan], kind, half_life=None))
    for age_s, weight in ((0.0, ONE), (20.0, ONE // 2), (40.0, ONE // 4), (200.0, ONE // 1024)):
        old = dataclasses.replace(scan, stamp_ns=LAST - int(age_s * SECOND))
        assert votes_of(mapped([old], kind)) == weighed(whole, weight)


def test_a_world_that_changes() -> None:
    """A door seen shut 50 times, then open 5 times: the filter forgets that it was shut."""
    beam = np.array([[1.0, 0.0]])
    scans = stamped(
        [Scan(Pose2(0.05, 0.05, 0.0), beam, np.array([r])) for r in [1.0] * 50 + [2.0] * 5],
        step_s=10.0,
    )
    door = ((10, 0), (11, 1))
    plain = build_map(scans, 0.1)
    fading = build_map(scans, 0.1, half_life=20.0)
    assert plain.log_odds().probability(door)[0, 0] > 0.99
    assert fading.log_odds().probability(door)[0, 0] < 0.5


# ------------------------------------------------------------------------------- counts


def test_underflow_is_counted() -> None:
    sensor = BeamSensor(fade=4.0)
    reading = Scan(Pose2(0.5, 0.5, 0.0), np.array([[1.0, 0.0]]), np.array([2.0]))
    # Passes of 0.4375 and 0.25, and a hit of one.
    ages = {0: Counter(), 16: Counter({"vote.underflow": 2}), 20: Counter({"scan.forgotten": 1})}
    for half_lives, want in ages.items():
        evidence = EvidenceMap(1.0, sensor=sensor, votes="beam", half_life=1.0, t_ref_ns=LAST)
        old = dataclasses.replace(reading, stamp_ns=LAST - half_lives * SECOND)
        report = add_scans(evidence, [old])
        assert report.skipped == want
        if half_lives == 16:  # a whole vote is one unit
            assert votes_of(evidence) == {(2, 0): (1, 0)}


def test_a_log_that_is_all_forgotten() -> None:
    scans = stamped(random_scans(0, 3))
    with pytest.raises(InputError, match=r"no usable scan \(3 x scan.forgotten\)"):
        build_map(scans, 0.25, half_life=1e-3, t_ref_ns=LAST + 60 * SECOND)


def test_threads_count_the_same() -> None:
    scans = scans_of(KINDS[1], 3, 30)
    reports = []
    for threads in (1, 2):
        evidence = EvidenceMap(0.25, votes="beam", sensor=KINDS[1][2], half_life=7.0, t_ref_ns=LAST)
        reports.append(add_scans(evidence, scans, threads=threads))
    assert reports[0].skipped == reports[1].skipped
    assert reports[0].skipped["vote.underflow"] > 0
    assert reports[0].skipped["scan.forgotten"] > 0
    assert reports[0].scans == reports[1].scans


# ------------------------------------------------------------------------------- t_ref


def test_t_ref_is_by_default_the_last_stamp() -> None:
    scans = scans_of(KINDS[0], 2, 5)
    for log in (scans, iter(scans), reversed(scans)):
        evidence = build_map(log, 0.25, half_life=20.0, sensor=KINDS[0][2])
        assert evidence.config.map.t_ref_ns == LAST
        assert votes_of(evidence) == votes_of(mapped(scans, KINDS[0]))
        assert evidence.provenance[0]["half_life"] == 20.0
        assert evidence.provenance[0]["t_ref_ns"] == LAST
    with pytest.raises(InputError, match="no scan"):
        build_map([], 0.25, half_life=20.0)


def test_later_stamps_are_refused() -> None:
    scans = scans_of(KINDS[0], 2, 2)
    evidence = mapped(scans, KINDS[0])
    before = votes_of(evidence)
    later = dataclasses.replace(scans[0], stamp_ns=LAST + 1)
    with pytest.raises(InputError, match=f"stamp {LAST + 1} ns is later than .* {LAST}: .*rescale"):
        add_scans(evidence, [later])
    assert votes_of(evidence) == before


def test_scans_without_stamps_are_refused() -> None:
    scans = random_scans(1, 2)
    with pytest.raises(InputError, match=r"a scan has no stamp: map\.half_life needs"):
        build_map(scans, 0.25, half_life=20.0)
    with pytest.raises(InputError, match="a scan has no stamp"):
        add_scans(EvidenceMap(0.25, half_life=20.0, t_ref_ns=LAST), scans)
    assert last_stamp(stamped(scans)) == LAST


def test_what_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"map\.half_life needs map\.t_ref_ns"):
        EvidenceMap(0.25, half_life=20.0)
    with pytest.raises(ConfigError, match="counts back from: set both"):
        EvidenceMap(0.25, t_ref_ns=5)
    for half_life in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigError, match=r"map\.half_life is a time above 0 s"):
            EvidenceMap(0.25, half_life=half_life, t_ref_ns=5)


def test_projection_takes_no_half_life() -> None:
    camera = PinholeCamera(2.0, 2.0, 1.5, 1.5, width=4, height=4)
    image = DepthScan(Pose3(np.zeros(3), np.eye(3)), np.full((4, 4), 1.0, np.float32), camera, LAST)
    evidence = EvidenceMap(0.25, ndim=3, half_life=20.0, t_ref_ns=LAST)
    with pytest.raises(ConfigError, match=r"takes no map\.half_life"):
        add_scans(evidence, [image], method="projective")
    for sensor in (BeamSensor(fade=0.1), BeamSensor(sigma=0.1)):
        with pytest.raises(ConfigError, match=r"needs sensor\.(fade|sigma) = 0, got 0\.1"):
            add_scans(EvidenceMap(0.25, ndim=3, sensor=sensor), [image], method="projective")


def test_merging_maps_of_different_memory_is_refused() -> None:
    sensor: Sensor = BeamSensor()
    maps = [
        EvidenceMap(0.25, sensor=sensor),
        EvidenceMap(0.25, half_life=20.0, t_ref_ns=LAST),
        EvidenceMap(0.25, half_life=10.0, t_ref_ns=LAST),
        EvidenceMap(0.25, half_life=20.0, t_ref_ns=LAST + 1),
    ]
    for one in maps:
        for other in maps:
            if one is not other:
                with pytest.raises(InputError, match=r"different (half_life|t_ref_ns)"):
                    one.merge(other)


# ------------------------------------------------------------------------------- rescaling


@pytest.mark.parametrize("kind", KINDS)
def test_rescaling_to_a_later_time(kind: Kind) -> None:
    scans = scans_of(kind, 5, 6)
    evidence = mapped(scans, kind)
    before, notes = votes_of(evidence), list(evidence.provenance)
    later = evidence.rescaled(LAST + 20 * SECOND)
    assert later.config.map.t_ref_ns == LAST + 20 * SECOND
    after = votes_of(later)
    for cell, (hit, free) in before.items():
        mine = after.get(cell, (0, 0))
        assert abs(mine[0] - hit / 2) <= 0.5
        assert abs(mine[1] - free / 2) <= 0.5
    assert votes_of(evidence) == before
    assert later.provenance[:-1] == notes
    assert later.provenance[-1]["rescaled_from_t_ref_ns"] == LAST
    # It goes on with later scans, as a map made for that time would, but for roundings.
    new = dataclasses.replace(scans[0], stamp_ns=LAST + 20 * SECOND)
    add_scans(later, [new])
    fresh = later.like()
    add_scans(fresh, [*scans, new])
    ours, theirs = votes_of(later), votes_of(fresh)
    for cell in ours.keys() | theirs.keys():
        # Weights of scans are rounded, too: to 1/65536, of no less than 0.1.
        for a, b in zip(ours.get(cell, (0, 0)), theirs.get(cell, (0, 0)), strict=True):
            assert abs(a - b) <= 2 * len(scans) + 2 + 1e-4 * max(a, b)


def test_rescaling_counts_what_is_lost() -> None:
    evidence = EvidenceMap(1.0, half_life=1.0, t_ref_ns=0)
    evidence.add_cells(np.array([[0, 0], [1, 0]]), np.array([ONE, 1]), np.array([0, 5]))
    later = evidence.rescaled(4 * SECOND)
    assert votes_of(later) == {(0, 0): (ONE // 16, 0)}
    assert later.provenance[-1]["vote.underflow"] == 2
    assert evidence.rescaled(0).cell_count() == 2


def test_rescaling_is_refused() -> None:
    with pytest.raises(ConfigError, match="this map has none"):
        EvidenceMap(1.0).rescaled(5)
    with pytest.raises(ConfigError, match="4 is earlier than the map's 5"):
        EvidenceMap(1.0, half_life=1.0, t_ref_ns=5).rescaled(4)


@pytest.mark.parametrize("kind", KINDS)
def test_save_and_load_is_identity(kind: Kind, tmp_path: Path) -> None:
    evidence = mapped(scans_of(kind, 9, 4), kind)
    evidence.save(tmp_path / "a.zarr")
    again = load_map(tmp_path / "a.zarr")
    assert again.config == evidence.config
    assert votes_of(again) == votes_of(evidence)
