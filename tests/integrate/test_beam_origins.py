# SPDX-License-Identifier: Apache-2.0
"""A scan whose beams start in several places is still one measurement: one vote a cell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.evidence_map import EvidenceMap, build_map
from oddsmap.full_map.estimator import build_full_map
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from tests.kit import ONE, Votes, votes_of

SENSORS = [
    BeamSensor(),
    BeamSensor(hit_width=0.5),
    BeamSensor(sigma=0.1, fade=0.6),
    BeamSensor(range_max=5.0, clear_range=4.0),
]


def moving_scan(ndim: int, groups: int, seed: int, beams: int = 40) -> Scan:
    """Beams in all directions, taken by groups from places along a way."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(beams, ndim))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    places = np.repeat(rng.uniform(-1.5, 1.5, (groups, ndim)), -(-beams // groups), axis=0)[:beams]
    pose: Pose2 | Pose3 = Pose2(0.3, -0.2, 0.7)
    if ndim == 3:
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        pose = Pose3(np.array([0.3, -0.2, 0.1]), turn)
    ranges = rng.uniform(0.2, 6.0, beams)
    ranges[::7] = np.inf
    return Scan(pose, directions, ranges, beam_origins=places)


def one_by_one(scan: Scan) -> list[Scan]:
    """Each beam as a scan of its own, whose pose is where the beam starts."""
    assert scan.beam_origins is not None
    origins = scan.map_from_sensor.transform(scan.beam_origins)
    found = []
    for i, origin in enumerate(origins):
        own = scan.map_from_sensor
        pose: Pose2 | Pose3
        if isinstance(own, Pose2):
            pose = Pose2(origin[0], origin[1], own.theta)
        else:
            pose = Pose3(origin, own.rotation)
        found.append(Scan(pose, scan.directions[i : i + 1], scan.ranges[i : i + 1]))
    return found


def one_vote(parts: list[Votes]) -> Votes:
    """What one measurement says: the largest hit, and only without one the largest pass."""
    merged: Votes = {}
    for cell in {cell for part in parts for cell in part}:
        weights = [part.get(cell, (0, 0)) for part in parts]
        hit = max(weight[0] for weight in weights)
        merged[cell] = (hit, 0 if hit else max(weight[1] for weight in weights))
    return merged


def mapped(scans: list[Scan], sensor: BeamSensor, votes: str = "scan", **more: Any) -> EvidenceMap:
    return build_map(scans, 0.25, sensor=sensor, votes=votes, **more)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("groups", [1, 3, 40])
def test_a_moving_scan_is_one_measurement(ndim: int, groups: int, sensor: BeamSensor) -> None:
    scan = moving_scan(ndim, groups, seed=groups)
    got = votes_of(mapped([scan], sensor))
    apart = [votes_of(part) for part in map_each(scan, sensor)]
    assert got == one_vote(apart)
    assert got != votes_of(mapped(one_by_one(scan), sensor)), "which would be many"


def map_each(scan: Scan, sensor: BeamSensor) -> list[EvidenceMap]:
    maps = []
    for part in one_by_one(scan):
        if sensor.range_max is None and np.isinf(part.ranges[0]):
            continue  # a no-return that clears nothing
        maps.append(mapped([part], sensor))
    return maps


@pytest.mark.parametrize("ndim", [2, 3])
def test_beams_that_vote_by_themselves_add_up(ndim: int) -> None:
    scan, sensor = moving_scan(ndim, 5, seed=1), SENSORS[3]
    more: dict[str, Any] = {"path_lengths": True}
    together = mapped([scan], sensor, "beam", **more)
    apart = mapped(one_by_one(scan), sensor, "beam", **more)
    assert votes_of(together) == votes_of(apart)
    for here, there in zip(together.cell_lengths(), apart.cell_lengths(), strict=True):
        assert np.array_equal(here, there)


@pytest.mark.parametrize("ndim", [2, 3])
def test_threads_batches_and_neighbours_change_no_bit(ndim: int) -> None:
    scans = [moving_scan(ndim, 1 + seed % 4, seed) for seed in range(6)]
    still = moving_scan(ndim, 1, 9)
    scans.insert(3, Scan(still.map_from_sensor, still.directions, still.ranges))
    whole = mapped(scans, SENSORS[0])
    assert votes_of(mapped(scans[::-1], SENSORS[0], threads=3)) == votes_of(whole)
    total = mapped(scans[:1], SENSORS[0])
    for scan in scans[1:]:
        total.merge(mapped([scan], SENSORS[0]))
    assert votes_of(total) == votes_of(whole)


def spinning_scan(seed: int, motion: float, columns: int = 96, rings: int = 10) -> Scan:
    """Rings of beams, column by column, while the sensor goes a way of so many cells."""
    rng = np.random.default_rng(seed)
    azimuth = np.repeat(np.arange(columns) * (2 * np.pi / columns), rings)
    up = np.tile(np.linspace(-1.2, 1.2, rings), columns)
    flat = np.cos(up)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(up)], axis=1)
    way = rng.normal(size=3)
    way *= motion * 0.25 / np.linalg.norm(way)
    places = np.repeat(np.linspace(-0.5, 0.5, columns), rings)[:, None] * way
    order = np.arange(columns * rings) if seed % 3 else rng.permutation(columns * rings)
    pose = Pose3(rng.uniform(-3, 3, 3), np.eye(3))
    ranges = rng.uniform(1.0, 8.0, columns * rings)
    return Scan(pose, directions[order], ranges, beam_origins=places)


@pytest.mark.parametrize("motion", [1e-9, 0.7, 3.0, 12.0])
@pytest.mark.parametrize("seed", range(6))
def test_skipping_what_is_marked_changes_no_bit(seed: int, motion: float) -> None:
    """Rays of one direction start in several places; against votes of beams, which skip nothing."""
    scan = spinning_scan(seed, motion)
    counted = votes_of(mapped([scan], SENSORS[0], "beam"))
    once = {cell: (min(h, ONE), 0 if h else min(p, ONE)) for cell, (h, p) in counted.items()}
    assert votes_of(mapped([scan], SENSORS[0])) == once


def test_filters_by_body_are_of_the_sensor_frame() -> None:
    """A return 0.3 m ahead of a place 1 m ahead lies 1.3 m ahead of the sensor, off the body."""
    sensor = BeamSensor(body_min=(-0.5, -0.5, -0.5), body_max=(0.5, 0.5, 0.5))
    scan = Scan(
        Pose3(np.zeros(3), np.eye(3)),
        np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]),
        np.array([0.3, 0.3]),
        beam_origins=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    )
    grid = build_map([scan], 0.25, sensor=sensor)
    assert grid.report is not None
    assert grid.report.skipped == {"hit.on_body": 1}
    assert [cell for cell, (hits, _) in votes_of(grid).items() if hits] == [(5, 0, 0)]


def test_full_maps_start_beams_where_they_start() -> None:
    scan = moving_scan(2, 4, seed=2)
    sensor = BeamSensor(range_max=8.0)
    together = build_full_map([scan], 0.25, sensor=sensor)
    apart = build_full_map(one_by_one(scan), 0.25, sensor=sensor)
    assert np.array_equal(together.blocks, apart.blocks)
    assert np.array_equal(together.values, apart.values)


def test_cones_take_none() -> None:
    sensor = ConeSensor(cone_deg=20.0, range_max=8.0)
    for build in (build_map, build_full_map):
        with pytest.raises(InputError, match="beam_origins, which are for narrow beams"):
            build([moving_scan(2, 2, 0)], 0.25, sensor=sensor)


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_a_beam_from_nowhere_says_nothing(nothing: float) -> None:
    scan = moving_scan(2, 4, seed=2)
    assert scan.beam_origins is not None
    origins = scan.beam_origins.copy()
    origins[5, 0] = nothing
    lost = Scan(scan.map_from_sensor, scan.directions, scan.ranges, beam_origins=origins)
    sensor = BeamSensor(range_max=8.0)
    for report in (
        mapped([lost], sensor).report,
        build_full_map([lost], 0.25, sensor=sensor).report,
    ):
        assert report is not None
        assert (report.scans, report.beams, report.skipped) == (1, 39, {"beam.nan": 1})


def test_a_scan_too_far_away_is_counted_on_each_way() -> None:
    pose, directions, ranges = Pose2(0.0, 0.0, 0.0), np.eye(2), np.ones(2)
    far = Scan(pose, directions, ranges, beam_origins=np.array([[0.0, 0.0], [2.0**47, 0.0]]))
    back = Scan(
        Pose2(2.0**46, 0.0, 0.0), directions, ranges, beam_origins=np.full((2, 2), [-(2.0**46), 0])
    )
    sensor = BeamSensor(range_max=8.0)
    for report in (
        mapped([far, back], sensor).report,
        build_full_map([far, back], 0.25, sensor=sensor).report,
    ):
        assert report is not None
        assert (report.scans, report.beams, report.skipped) == (1, 2, {"scan.pose_too_far": 1})


def test_lists_will_do() -> None:
    scan = Scan(
        Pose2(0.0, 0.0, 0.0),
        np.eye(2),
        np.ones(2),
        beam_origins=[[0, 0], [1, 0]],  # type: ignore[arg-type]
    )
    assert len(votes_of(mapped([scan], SENSORS[0]))) > 4


def test_shapes_are_checked() -> None:
    scan = moving_scan(2, 2, 0)
    odd: list[dict[str, Any]] = [
        {"beam_origins": np.zeros((40, 3))},
        {"beam_times_ns": np.zeros(39, np.int64)},
    ]
    for more in odd:
        with pytest.raises(InputError, match=f"{next(iter(more))} of this scan has shape"):
            Scan(scan.map_from_sensor, scan.directions, scan.ranges, **more)
