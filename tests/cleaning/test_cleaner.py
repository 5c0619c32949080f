# SPDX-License-Identifier: Apache-2.0
"""What moved is found, what stands stays, and the rule is what it is said to be."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import BeamSensor, Cleaner, ConeSensor, EvidenceMap, Scan, build_map
from oddsmap.cleaning.seen_through import dynamic_cells
from oddsmap.errors import ConfigError, InputError
from oddsmap.simulate import Cylinder, Ground, Lidar3D, Mover, MovingWorld, World3D
from oddsmap.simulate.solids import Box
from tests.kit import ONE, votes_of
from tests.naive.cleaning import is_dynamic

REACH = 20.0
SENSOR = BeamSensor(range_max=REACH)


@given(
    st.integers(2, 3),
    st.lists(st.tuples(st.integers(0, 6), st.integers(0, 9)), min_size=27, max_size=27),
    st.sampled_from([0.3, 0.5, 0.8, 0.95]),
    st.sampled_from([1, 2, 3]),
)
@settings(max_examples=15)
def test_the_rule(d: int, weights: list[tuple[int, int]], level: float, parts: int) -> None:
    """Also of parts of votes, as a half-life makes them."""
    index = np.stack(np.unravel_index(np.arange(27), (3, 3, 3)), axis=1)[:, :d] - 1
    index, first = np.unique(index, axis=0, return_index=True)
    units = np.array(weights)[first] * ONE // parts
    evidence = EvidenceMap(0.5, ndim=d)
    evidence.add_cells(index, units[:, 0], units[:, 1])
    counts = {
        tuple(cell): (hit / ONE, free / ONE)
        for cell, (hit, free) in zip(index.tolist(), units.tolist(), strict=True)
    }
    around = np.stack(np.meshgrid(*[np.arange(-2, 3)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    want = [is_dynamic(counts, tuple(cell), level) for cell in around.tolist()]
    assert dynamic_cells(evidence, around, level).tolist() == want


# ---- a street with a walker ------------------------------------------------------------------


@cache
def street(*, sigma: float = 0.0) -> tuple[list[Scan], list[np.ndarray], MovingWorld]:
    """Scans of a walker between two walls, and which of their returns are of him."""
    walls = [Box(0.0, 5.0, 16.0, 0.4, -0.5, 4.0), Box(0.0, -5.0, 16.0, 0.4, -0.5, 4.0)]
    walker = Mover(Cylinder(0.0, 0.0, 0.25, 0.0, 1.7), np.array([[-6.0, 2.0], [6.0, 2.0]]), 1.5)
    world = MovingWorld(World3D(walls, Ground()), [walker])
    lidar = Lidar3D(36, 120, range_max=REACH, sigma=0.01)
    rng = np.random.default_rng(0)
    scans, truth = [], []
    for k in range(16):
        pose = oddsmap.Pose3(np.eye(3), np.array([-1.53 + 0.2 * k, 0.07, 1.23]))
        scan = lidar.scan(world.at(0.5 * k), pose, rng)
        truth.append(world.meets_movers(scan, 0.5 * k))
        off = oddsmap.Pose3(np.eye(3), pose.translation + rng.normal(0.0, sigma, 3))
        scans.append(dataclasses.replace(scan, map_from_sensor=off, trusted=True))
    return scans, truth, world


@pytest.mark.parametrize(("sigma", "static_share"), [(0.0, 0.99), (0.02, 0.95)])
def test_a_walker_is_found_and_the_street_stays(sigma: float, static_share: float) -> None:
    scans, truth, _ = street(sigma=sigma)
    cleaner = Cleaner(build_map(scans, 0.2, sensor=SENSOR))
    found = list(cleaner.label(scans))
    for part, scan in zip(found, scans, strict=True):
        assert np.array_equal(part.beam, np.flatnonzero(np.isfinite(scan.ranges)))
        ends = scan.directions[part.beam] * scan.ranges[part.beam, None]
        np.testing.assert_allclose(part.points, scan.map_from_sensor.transform(ends), atol=1e-9)
    dynamic = np.concatenate([part.dynamic for part in found])
    really = np.concatenate([of[part.beam] for of, part in zip(truth, found, strict=True)])
    assert really.sum() > 150
    assert (~dynamic[~really]).mean() > static_share
    assert dynamic[really].mean() > 0.9


def test_the_clean_map_has_the_evidence_of_the_world_at_rest() -> None:
    scans, _, _ = street()
    grid = build_map(scans, 0.2, sensor=SENSOR)
    before = votes_of(grid)
    cleaner = Cleaner(grid)
    clean = cleaner.static_map()
    after = votes_of(clean)
    assert votes_of(grid) == before
    changed = {cell for cell in before if before[cell] != after.get(cell, (0, 0))}
    said = clean.provenance[-1]
    assert said["cleaned_cells"] == len(changed) > 0
    assert said["cleaned_hits"] * ONE == sum(before[cell][0] for cell in changed)
    # Hits go, passes stay: the cells are free, not unknown.
    assert all(after[cell] == (0, before[cell][1]) for cell in changed)
    centres = grid.centre_of(sorted(changed))
    assert cleaner.dynamic_at(centres).all()
    assert (np.abs(centres[:, 1] - 2.0) < 0.5).mean() > 0.9
    assert clean.config == grid.config
    assert (clean.log_odds().at(centres) < 0.3).all()


def test_a_map_that_keeps_lengths_keeps_them() -> None:
    scans = [
        Scan.from_angles((0.03, 0.04, 0.0), [0.0, 0.2], [r, 3.0]) for r in (1.0, 3.0, 3.0, 3.0)
    ]
    grid = build_map(scans, 0.1, votes="beam", path_lengths=True)
    with pytest.warns(UserWarning, match='votes "beam"'):
        clean = Cleaner(grid).static_map()
    assert clean.provenance[-1]["cleaned_cells"] == 1
    for mine, theirs in zip(clean.cell_lengths(), grid.cell_lengths(), strict=True):
        assert np.array_equal(mine, theirs)


def test_a_walker_in_the_plane() -> None:
    angles = np.linspace(-np.pi, np.pi, 361)
    scans = []
    for k in range(12):
        ranges = 4.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))  # a square room
        here = np.abs(angles - (-1.0 + 0.17 * k)) < 0.05
        scans.append(Scan.from_angles((0.03, 0.04, 0.0), angles, np.where(here, 2.0, ranges)))
    parts = list(Cleaner(build_map(scans, 0.1)).label(scans))
    for part, scan in zip(parts, scans, strict=True):
        assert part.dynamic.tolist() == (scan.ranges == 2.0).tolist()


def test_a_map_of_before_tells_what_has_come() -> None:
    """What the map never met, and saw through, is dynamic in another log."""
    scans, truth, world = street()
    lidar, rng, poses = Lidar3D(36, 120, range_max=REACH), np.random.default_rng(1), []
    for scan in scans:
        assert isinstance(scan.map_from_sensor, oddsmap.Pose3)
        poses.append(scan.map_from_sensor)
    empty = [lidar.scan(world.still, pose, rng) for pose in poses]
    cleaner = Cleaner(build_map(empty, 0.2, sensor=SENSOR))
    (part,) = cleaner.label(scans[5])
    assert part.dynamic[truth[5][part.beam]].mean() > 0.9
    assert part.dynamic[~truth[5][part.beam]].mean() < 0.01


def test_only_returns_that_mark_are_labelled() -> None:
    sensor = BeamSensor(range_min=0.5, range_max=5.0, angle_min=-1.0, angle_max=1.0,
                        body_min=(0.0, -0.1), body_max=(1.5, 0.1))  # fmt: skip
    angles = [-2.0, -0.9, -0.5, 0.0, 0.2, 0.4, 0.9]
    ranges = [2.0, np.inf, 3.0, 1.0, 0.1, np.nan, 2.0]
    scan = Scan.from_angles((0.0, 0.0, 0.0), angles, ranges)
    cleaner = Cleaner(build_map([scan], 0.1, sensor=sensor))
    (part,) = cleaner.label([scan])
    assert part.beam.tolist() == [2, 6]
    assert cleaner.skipped["hit.on_body"] == 1
    nowhere = Scan.from_angles((np.nan, 0.0, 0.0), angles, ranges)
    (part,) = cleaner.label(nowhere)
    assert part.points.shape == (0, 2)
    assert cleaner.skipped["scan.nan_pose"] == 1


def test_the_window_is_told_where_the_sensor_was_at_the_time_of_a_beam() -> None:
    angles = np.array([-2.0, -1.5, -0.5, 0.0, 0.5, 0.9])
    scan = Scan.from_angles((0.0, 0.0, 0.0), angles, np.full(6, 2.0))
    earlier = Scan.from_angles((0.0, 0.0, 0.0), angles + 0.8, np.full(6, 2.0))
    object.__setattr__(scan, "own_vectors", earlier.directions)  # as scans of a turn have them
    cleaner = Cleaner(build_map([scan], 0.1, sensor=BeamSensor(angle_min=-1.0, angle_max=1.0)))
    (part,) = cleaner.label([scan])
    assert part.beam.tolist() == [1, 2, 3]
    np.testing.assert_allclose(part.points, 2.0 * scan.directions[1:4], atol=1e-12)


def test_what_is_refused() -> None:
    scans, _, _ = street()
    grid = build_map(scans[:2], 0.5, sensor=SENSOR)
    with pytest.raises(InputError, match="an EvidenceMap is needed"):
        Cleaner(grid.log_odds())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="narrow beams is needed, got one of kind cone"):
        Cleaner(EvidenceMap(0.1, sensor=ConeSensor(cone_deg=20.0)))
    with pytest.raises(InputError, match="nothing stands in this map"):
        Cleaner(EvidenceMap(0.1, ndim=3))
    for level in (0.0, 1.0, float("nan")):
        with pytest.raises(ConfigError, match="level of a credible interval"):
            Cleaner(grid, level=level)
    with pytest.raises(ConfigError, match="ground_margin is a height of 0 m or more"):
        Cleaner(grid, ground_margin=-0.1)
    with pytest.raises(ConfigError, match=r"for 3D maps, got 0\.1 for a 2D map"):
        Cleaner(EvidenceMap(0.1), ground_margin=0.1)
    with pytest.warns(UserWarning, match='votes "beam"'):
        Cleaner(build_map(scans[:2], 0.5, sensor=SENSOR, votes="beam"))
    with pytest.raises(InputError, match="scan 0 is 2D, the map 3D"):
        list(Cleaner(grid).label(Scan.from_angles((0, 0, 0), [0.0], [1.0])))
