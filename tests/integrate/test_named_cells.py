# SPDX-License-Identifier: Apache-2.0
"""Wide beams into maps: what changes no bit, and what the textbook's cone does to a door."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap.integrate.named_cells
import oddsmap.integrate.threads
import oddsmap.sensors.cone
from oddsmap import EvidenceMap, Pose2, Scan, add_scans, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.sensors.cone import ConeSensor
from tests.kit import ONE, Votes, random_scans, votes_of
from tests.sensors.test_cone import listed

CONE = ConeSensor(cone_deg=25.0, range_max=5.0)
KINDS = [
    ("beam", CONE),
    ("scan", CONE),
    ("beam", dataclasses.replace(CONE, angular_falloff=0.7, range_falloff=0.4, pass_falloff=0.9)),
    ("scan", dataclasses.replace(CONE, share_hit=False, hit_width=0.6, pass_falloff=0.5)),
]
kinds = st.sampled_from(KINDS)
seeds = st.integers(0, 10_000)


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.threads, "_BATCH_BEAMS", 50)
    monkeypatch.setattr(oddsmap.sensors.cone, "_ENTRIES", 1 << 12)


def wide_scans(seed: int, count: int, ndim: int = 2) -> list[Scan]:
    """Scans of 8 wide beams from random poses with all sorts of readings."""
    flat = random_scans(seed, count, beams=8, reach=4.0 if ndim == 2 else 1.5)
    if ndim == 2:
        return flat
    rng = np.random.default_rng(seed)
    scans = []
    for scan in flat:
        axes = rng.normal(size=(8, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        ranges = np.where(np.isinf(scan.ranges), 1.0, scan.ranges)
        pose = Pose3(np.append(scan.map_from_sensor.translation / 4, 0.3), np.eye(3))
        scans.append(Scan(pose, axes, ranges))
    return scans


def mapped(
    scans: Iterable[Scan],
    kind: tuple[str, ConeSensor],
    *,
    threads: int = 1,
    side: int | None = None,
    ndim: int = 2,
) -> EvidenceMap:
    evidence = EvidenceMap(0.125, votes=kind[0], sensor=kind[1], tile_side=side, ndim=ndim)
    add_scans(evidence, scans, threads=threads)
    return evidence


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_votes_of_beams_become_votes_of_scans(kind: tuple[str, ConeSensor], ndim: int) -> None:
    """Added up, or the largest of each and hits before passes, scan by scan in dictionaries."""
    scans = wide_scans(4, 10, ndim)
    want: Counter[tuple[tuple[int, ...], str]] = Counter()
    for scan in scans:
        hits: Counter[tuple[int, ...]] = Counter()
        passes: Counter[tuple[int, ...]] = Counter()
        for i in range(scan.size):
            part = slice(i, i + 1)
            beam = Scan(scan.map_from_sensor, scan.directions[part], scan.ranges[part])
            for votes in listed(kind[1], [beam], 0.125):
                for cell, (hit, passed) in votes.items():
                    if kind[0] == "beam":
                        hits[cell] += hit
                        passes[cell] += passed
                    else:
                        hits[cell] = max(hits[cell], hit)
                        passes[cell] = max(passes[cell], passed)
        for cell in hits.keys() | passes.keys():
            want[cell, "hits"] += hits[cell]
            if kind[0] == "beam" or hits[cell] == 0:
                want[cell, "passes"] += passes[cell]
    got = votes_of(mapped(scans, kind, ndim=ndim))
    assert len(got) > 500
    cells = {cell for (cell, _), weight in want.items() if weight > 0}
    assert got == {cell: (want[cell, "hits"], want[cell, "passes"]) for cell in cells}


@given(seeds, kinds, st.randoms(use_true_random=False))
@settings(max_examples=15)
def test_order_of_scans(seed: int, kind: tuple[str, ConeSensor], random: object) -> None:
    scans = wide_scans(seed, 12)
    want = votes_of(mapped(scans, kind))
    assert len(want) > 100
    random.shuffle(scans)  # type: ignore[attr-defined]
    assert votes_of(mapped(scans, kind)) == want


@pytest.mark.parametrize("kind", KINDS)
def test_order_of_beams(kind: tuple[str, ConeSensor]) -> None:
    scan = random_scans(3, 1, beams=60)[0]
    order = np.random.default_rng(1).permutation(60)
    mixed = Scan(scan.map_from_sensor, scan.directions[order], scan.ranges[order])
    assert votes_of(mapped([mixed], kind)) == votes_of(mapped([scan], kind))


@given(seeds, kinds, st.sampled_from([5, 8, 16, 100]))
@settings(max_examples=15)
def test_tile_side(seed: int, kind: tuple[str, ConeSensor], side: int) -> None:
    scans = wide_scans(seed, 6)
    assert votes_of(mapped(scans, kind, side=side)) == votes_of(mapped(scans, kind))


@pytest.mark.parametrize("side", [3, 16])
def test_tile_side_in_space(side: int) -> None:
    scans = wide_scans(2, 6, ndim=3)
    want = votes_of(mapped(scans, KINDS[2], ndim=3))
    assert votes_of(mapped(scans, KINDS[2], ndim=3, side=side)) == want


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_threads(kind: tuple[str, ConeSensor], ndim: int) -> None:
    scans = wide_scans(8, 60, ndim)
    want = mapped(scans, kind, ndim=ndim)
    for threads in (2, 3):
        got = mapped(scans, kind, ndim=ndim, threads=threads)
        assert votes_of(got) == votes_of(want)


@given(seeds, kinds, st.integers(0, 12), st.sampled_from([5, 16, 32]))
@settings(max_examples=15)
def test_halves_add_up(seed: int, kind: tuple[str, ConeSensor], cut: int, side: int) -> None:
    scans = wide_scans(seed, 12)
    one, other = mapped(scans[:cut], kind), mapped(scans[cut:], kind, side=side)
    one.merge(other)
    assert votes_of(one) == votes_of(mapped(scans, kind))


@given(seeds, kinds, st.tuples(st.integers(-(10**8), 10**8), st.integers(-(10**8), 10**8)))
@settings(max_examples=15)
def test_moving_the_world_by_whole_cells_moves_the_map(
    seed: int, kind: tuple[str, ConeSensor], shift: tuple[int, int]
) -> None:
    def votes(dx: int, dy: int) -> Votes:
        moved = []
        for scan in wide_scans(seed, 4):
            x, y = np.round(scan.map_from_sensor.translation * 2.0**16) / 2.0**16
            pose = Pose2(float(x) + dx * 0.125, float(y) + dy * 0.125, 0.0)
            # Few bits: positions stay exact 10^8 cells away.
            ranges = np.round(scan.ranges * 256) / 256
            directions = np.round(scan.directions * 256) / 256
            moved.append(Scan(pose, directions, ranges, trusted=True))
        return votes_of(mapped(moved, kind))

    want = {(x + shift[0], y + shift[1]): vote for (x, y), vote in votes(0, 0).items()}
    assert votes(*shift) == want


def test_every_return_gives_one_hit() -> None:
    scans = wide_scans(5, 30)
    evidence = mapped(scans, KINDS[2])
    returns = sum(int((scan.ranges < 5.0).sum()) for scan in scans)
    assert int(evidence.cells()[1].sum()) == returns * ONE


def test_the_report() -> None:
    scans = wide_scans(6, 20)
    scans[3] = Scan(Pose2(math.nan, 0.0, 0.0), scans[3].directions, scans[3].ranges)
    used = [scan for i, scan in enumerate(scans) if i != 3]
    lost = sum(int(np.isnan(scan.ranges).sum()) for scan in used)
    reports = []
    for threads in (1, 3):
        report = add_scans(EvidenceMap(0.125, sensor=CONE), scans, threads=threads)
        reports.append((report.scans, report.beams, dict(report.skipped)))
    assert reports == [(19, 19 * 8 - lost, {"beam.nan": lost, "scan.nan_pose": 1})] * 2
    assert lost > 0


def test_a_map_of_the_plane_takes_no_cones_of_space() -> None:
    with pytest.raises(InputError, match="scans of 3 dimensions cannot go into a map of 2"):
        mapped(wide_scans(1, 2, ndim=3), KINDS[0])


def test_cones_vote_by_beam_unless_told() -> None:
    assert build_map(wide_scans(1, 3), 0.125, sensor=CONE).votes == "beam"
    assert build_map(wide_scans(1, 3), 0.125, sensor=CONE, votes="scan").votes == "scan"


def doorway(path: Path, sensor: ConeSensor) -> npt.NDArray[np.float64]:
    """p(occupied) of the cells of the doorway that are free in truth."""
    grid = build_map(open_log(path), 0.1, sensor=sensor, votes="beam")
    with np.load(path) as file:
        truth, (x0, x1), (y0, y1) = file["truth"], file["door_x"], file["door_y"]
    centres = (np.arange(max(truth.shape)) + 0.5) * 0.1
    rows = (centres[: truth.shape[0]] > y0) & (centres[: truth.shape[0]] < y1)
    columns = (centres[: truth.shape[1]] > x0) & (centres[: truth.shape[1]] < x1)
    cells = rows[:, None] & columns & ~truth
    assert cells.any()
    view, region = grid.log_odds(prior=0.5), ((0, 0), truth.shape[::-1])
    assert view.observed(region)[cells].all(), "an unknown door is neither open nor shut"
    chance: npt.NDArray[np.float64] = view.probability(region)[cells]
    return chance


@pytest.mark.realdata
def test_the_textbook_cone_shuts_the_door(data_folder: Path) -> None:
    """A known limit of treating cells alone: a wide echo from the door post counts against the gap.

    The values are Probabilistic Robotics' l_occ = .85 and l_free = -.4 as probabilities. A map of
    all cells together (full-map estimation) keeps the door open.
    """
    logs = sorted((data_folder / "sonar_doors").glob("door*.npz"))
    assert len(logs) == 9
    shut = 0
    for path in logs:
        with np.load(path) as file:
            cone_deg, range_max = float(file["cone_deg"]), float(str(file["range_max"]))
        textbook = ConeSensor(
            cone_deg=cone_deg,
            range_max=range_max,
            share_hit=False,
            p_hit=1 / (1 + math.exp(-0.85)),
            p_miss=1 / (1 + math.exp(0.4)),
        )
        # Open only when all of it is: a robot does not fit through half a door.
        shut += bool((doorway(path, textbook) >= 0.5).any())
    assert shut >= 8


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("blocks", [0, 1, 40, 1 << 12])
def test_how_many_scans_share_a_window_changes_no_bit(
    blocks: int, ndim: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scans without a vote among them, and one that is far away."""
    scans = wide_scans(9, 30, ndim)
    nothing = Scan(scans[0].map_from_sensor, scans[0].directions, np.full(8, math.nan))
    far = Pose2(9000.0, 1.0, 0.0) if ndim == 2 else Pose3(np.full(3, 9000.0), np.eye(3))
    scans[3:3] = [nothing, Scan(far, scans[0].directions, scans[0].ranges), nothing]
    want = Counter[tuple[int, ...]]()
    for scan in scans:
        for cell, (hits, passes) in votes_of(mapped([scan], KINDS[2], ndim=ndim)).items():
            want[(*cell, 0)] += hits
            want[(*cell, 1)] += passes
    monkeypatch.setattr(oddsmap.integrate.named_cells, "_MOST_BLOCKS", blocks)
    got = votes_of(mapped(scans, KINDS[2], ndim=ndim))
    assert got == {cell: (want[(*cell, 0)], want[(*cell, 1)]) for cell in got}
    assert {key[:-1] for key, weight in want.items() if weight} == got.keys()
