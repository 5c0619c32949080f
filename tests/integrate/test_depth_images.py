# SPDX-License-Identifier: Apache-2.0
"""Depth images by projection: against the slow oracle, and what must not change a bit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import BeamSensor, ConeSensor, EvidenceMap, Pose2, Pose3, Scan, add_scans, build_map
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.simulate import DepthCamera, room, room_walk
from tests.kit import AS_FOUND, ONE, fan_scan, votes_of
from tests.naive import projective

HERE = Pose3(np.zeros(3), np.eye(3))
SMALL = PinholeCamera(fx=80.0, fy=80.0, cx=47.5, cy=35.5, width=96, height=72)

SENSORS = [
    BeamSensor(),
    BeamSensor(range_min=0.8, range_max=2.5),
    BeamSensor(range_max=2.0, clear_range=1.5),
    BeamSensor(range_max=2.0, clear_range=3.0),
    BeamSensor(mark_z_min=-0.5, mark_z_max=0.7),
    BeamSensor(body_min=(-0.5, -0.5, 0.0), body_max=(0.5, 0.5, 1.5)),
]


def by_projection(
    scans: Iterable[DepthScan],
    resolution: float = 0.125,
    *,
    sensor: BeamSensor | None = None,
    threads: int = 1,
    side: int | None = None,
) -> EvidenceMap:
    evidence = EvidenceMap(resolution, sensor=sensor, ndim=3, tile_side=side)
    add_scans(evidence, scans, method="projective", threads=threads)
    return evidence


def hits_of(evidence: EvidenceMap) -> set[tuple[int, ...]]:
    index, hits, _ = evidence.cells()
    return set(map(tuple, index[hits > 0].tolist()))


def passes_of(evidence: EvidenceMap) -> set[tuple[int, ...]]:
    index, _, passes = evidence.cells()
    return set(map(tuple, index[passes > 0].tolist()))


@st.composite
def images(draw: st.DrawFn) -> DepthScan:
    """Small images of all sorts of pixels, from any pose."""
    width, height = draw(st.integers(1, 20)), draw(st.integers(1, 14))
    signs = st.sampled_from([-1.0, 1.0])
    focal = st.floats(4.0, 30.0)
    camera = PinholeCamera(
        fx=draw(signs) * draw(focal),
        fy=draw(signs) * draw(focal),
        cx=draw(st.floats(-1.0, width)),
        cy=draw(st.floats(-1.0, height)),
        width=width,
        height=height,
    )
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    depth = rng.uniform(0.2, 3.0, (height, width))
    if draw(st.booleans()):  # a surface, in place of noise
        depth = np.broadcast_to(rng.uniform(1.0, 3.0), depth.shape).copy()
    if draw(st.booleans()):  # 16-bit millimetres
        depth = depth.round(3)
    nothing = rng.random(depth.shape) < draw(st.sampled_from([0.0, 0.1, 0.9]))
    depth[nothing] = rng.choice([0.0, np.nan, np.inf, -np.inf, -1.0], int(nothing.sum()))
    turn = rng.normal(size=4)
    pose = Pose3.from_quaternion_xyzw(rng.uniform(-2.0, 2.0, 3), turn / np.linalg.norm(turn))
    return DepthScan(pose, depth.astype(np.float32), camera)


@given(images(), st.sampled_from(SENSORS), st.sampled_from([0.25, 0.4]), st.sampled_from([4, 8]))
@settings(max_examples=40)
def test_against_the_oracle(
    image: DepthScan, sensor: BeamSensor, resolution: float, side: int
) -> None:
    evidence = by_projection([image], resolution, sensor=sensor, side=side)
    rays = EvidenceMap(resolution, sensor=sensor, ndim=3)
    report = add_scans(rays, [image], method="rays")
    assert hits_of(evidence) == hits_of(rays)
    if sensor.mark_z_min is None and sensor.body_min is None:
        assert hits_of(evidence) == projective.hit_cells(image, resolution, sensor)
    free, doubtful = projective.free_cells(image, resolution, sensor)
    hits = hits_of(rays)
    assert passes_of(evidence) - doubtful == free - hits - doubtful
    assert set(votes_of(evidence).values()) <= {(ONE, 0), (0, ONE)}
    again = add_scans(EvidenceMap(resolution, ndim=3), [image], sensor=sensor, method="projective")
    assert (again.scans, again.beams, again.skipped) == (
        report.scans,
        report.beams,
        report.skipped,
    )


def test_by_hand() -> None:
    # Slopes of -1.5 to 1.5 are seen; free are the layers whose centres are 0.866 before depth 4.
    camera = PinholeCamera(fx=1.0, fy=1.0, cx=1.0, cy=1.0, width=3, height=3)
    evidence = by_projection([DepthScan(HERE, np.full((3, 3), 4.0, np.float32), camera)], 1.0)
    assert hits_of(evidence) == {(x, y, 4) for x in (-4, 0, 4) for y in (-4, 0, 4)}
    want = {
        (x, y, z)
        for z, wide in ((0, 1), (1, 2), (2, 4))
        for x in range(-wide, wide)
        for y in range(-wide, wide)
    }
    assert passes_of(evidence) == want
    # The same through a turn by 90 degrees about y: z of the camera is x of the map.
    turned = Pose3(np.zeros(3), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    evidence = by_projection([DepthScan(turned, np.full((3, 3), 4.0, np.float32), camera)], 1.0)
    assert passes_of(evidence) == {(z, y, -1 - x) for x, y, z in want}


def test_pixels_without_reading_free_nothing() -> None:
    camera = PinholeCamera(fx=8.0, fy=8.0, cx=7.5, cy=7.5, width=16, height=16)
    depth = np.full((16, 16), 3.0, np.float32)
    depth[:, :8] = 0.0
    cells = passes_of(by_projection([DepthScan(HERE, depth, camera)]))
    assert cells
    assert all(x >= 0 for x, _, _ in cells)


def frames(count: int, camera: PinholeCamera = SMALL) -> list[DepthScan]:
    world, sensor = room(), DepthCamera(camera)
    rng = np.random.default_rng(5)
    return [sensor.scan(world, pose, rng) for pose in room_walk(count)]


FRAMES = frames(9)


@pytest.mark.parametrize("side", [1, 2, 4, 16, 32])
def test_tile_side(side: int) -> None:
    # Of one cell, each box is a cell; of 32, nearly all cells are asked one by one.
    assert votes_of(by_projection(FRAMES[:3], side=side)) == votes_of(by_projection(FRAMES[:3]))


@given(st.permutations(range(9)), st.integers(0, 9), st.sampled_from([1, 2, 3]))
@settings(max_examples=10, phases=AS_FOUND)
def test_order_halves_threads(order: Sequence[int], cut: int, threads: int) -> None:
    whole = votes_of(by_projection(FRAMES))
    assert len(whole) > 10_000
    one = by_projection([FRAMES[i] for i in order[:cut]], threads=threads)
    one.merge(by_projection([FRAMES[i] for i in order[cut:]], side=4))
    assert votes_of(one) == whole


def test_threads_report_the_same_counts() -> None:
    reports = []
    for threads in (1, 2, 3):
        evidence = EvidenceMap(0.25, ndim=3)
        report = add_scans(evidence, FRAMES, method="projective", threads=threads)
        reports.append((report.scans, report.beams, report.skipped))
    assert reports[0] == reports[1] == reports[2]
    assert reports[0][0] == 9
    assert sum(frame.depth.size for frame in FRAMES) == reports[0][1] + reports[0][2]["beam.nan"]


def test_cameras_may_change_from_image_to_image() -> None:
    other = frames(2, PinholeCamera(40.0, -40.0, 20.0, 14.0, 41, 30))
    both = by_projection([FRAMES[0], other[0], FRAMES[1], other[1]])
    apart = by_projection(FRAMES[:2])
    apart.merge(by_projection(other))
    assert votes_of(both) == votes_of(apart)


@given(st.tuples(*[st.integers(-(10**8), 10**8)] * 3))
@settings(max_examples=10)
def test_moving_the_world_by_whole_cells_moves_the_map(shift: tuple[int, ...]) -> None:
    def moved(by: Sequence[int]) -> DepthScan:
        rotation = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
        translation = np.array([0.3125, -0.15625, 1.25]) + np.array(by) * 0.125
        return DepthScan(Pose3(translation, rotation), FRAMES[0].depth, SMALL)

    # Far away the ends of rays have fewer bits, but the free cells are asked relative to the pose.
    near, far = by_projection([moved((0, 0, 0))]), by_projection([moved(shift)])
    back = {
        tuple(np.subtract(cell, shift).tolist()): votes for cell, votes in votes_of(far).items()
    }
    here = votes_of(near)
    assert len(here) > 1000
    assert len(here.items() ^ back.items()) <= 2


def test_more_than_255_images() -> None:
    once = votes_of(by_projection(FRAMES[:1], 0.25))
    many = votes_of(by_projection(FRAMES[:1] * 600, 0.25))
    assert many == {cell: (600 * hit, 600 * free) for cell, (hit, free) in once.items()}


@pytest.mark.parametrize("dtype", [np.float16, np.float64])
def test_other_types_of_depth(dtype: npt.DTypeLike) -> None:
    # Of 16 bits, and of 64: as exact as the ray method, whatever the type.
    depth: Any = (np.arange(96 * 72).reshape(72, 96) % 7 / 3 + 1).astype(dtype)
    image = DepthScan(FRAMES[1].map_from_sensor, depth, SMALL)
    evidence = by_projection([image])
    assert hits_of(evidence) == hits_of(build_map([image], 0.125))
    single = DepthScan(image.map_from_sensor, depth.astype(np.float32), SMALL)
    assert len(passes_of(evidence) ^ passes_of(by_projection([single]))) < 20


def test_every_other_row_of_an_image() -> None:
    # Not contiguous in memory.
    image = FRAMES[0]
    camera = PinholeCamera(80.0, 40.0, 47.5, 17.75, 96, 36)
    thin = DepthScan(image.map_from_sensor, image.depth[::2], camera)
    copied = DepthScan(image.map_from_sensor, image.depth[::2].copy(), camera)
    assert votes_of(by_projection([thin])) == votes_of(by_projection([copied]))


def test_surfaces_on_borders_of_cells() -> None:
    # Every end point lies on a border: all of them are done by the exact operations.
    camera = PinholeCamera(fx=32.0, fy=32.0, cx=16.0, cy=16.0, width=33, height=33)
    image = DepthScan(HERE, np.full((33, 33), 2.0, np.float32), camera)
    evidence = by_projection([image], 0.05)
    assert hits_of(evidence) == hits_of(build_map([image], 0.05))


def test_a_far_outlier_and_a_window_of_more_than_2_to_the_31_cells() -> None:
    camera = PinholeCamera(fx=16.0, fy=16.0, cx=16.0, cy=16.0, width=33, height=33)
    depth = np.zeros((33, 33), np.float32)
    depth[0, 0], depth[32, 32], depth[16, 16] = 100.0, 100.0, 1.0
    image = DepthScan(Pose3(np.array([0.01, 0.02, 0.03]), np.eye(3)), depth, camera)
    evidence = by_projection([image], 0.1)
    assert hits_of(evidence) == hits_of(build_map([image], 0.1))
    lo, hi = evidence.bounds() or (None, None)
    assert lo is not None
    assert hi is not None
    assert int((hi - lo).prod()) > 2**31


def test_what_memory_cannot_hold() -> None:
    depth = np.full((72, 96), 1e5, np.float32)
    evidence = EvidenceMap(0.05, ndim=3)
    with pytest.raises(MapTooLargeError, match="range_max"):
        add_scans(evidence, [DepthScan(HERE, depth, SMALL)], method="projective")
    assert evidence.cell_count() == 0


def test_what_is_counted() -> None:
    fine = np.full((72, 96), 2.0, np.float32)
    fine[0, :5] = [0.0, np.nan, np.inf, 0.1, 9.0]
    nowhere = Pose3(np.array([math.nan, 0.0, 0.0]), np.eye(3))
    far = Pose3(np.array([1e300, 0.0, 0.0]), np.eye(3))
    log = [
        DepthScan(HERE, fine, SMALL),
        DepthScan(nowhere, fine, SMALL),
        DepthScan(far, fine, SMALL),
        DepthScan(HERE, np.zeros_like(fine), SMALL),
    ]
    sensor = BeamSensor(range_min=0.5, range_max=5.0)
    reports = []
    for method in ("rays", "projective"):
        evidence = build_map(log, 0.1, sensor=sensor, method=method)
        assert evidence.provenance[0]["method"] == method
        assert evidence.report is not None
        reports.append((evidence.report.scans, evidence.report.beams, evidence.report.skipped))
    assert reports[0] == reports[1]
    assert reports[0][:2] == (1, 72 * 96 - 5)
    assert reports[0][2]["scan.nan_pose"] == reports[0][2]["scan.pose_too_far"] == 1
    assert reports[0][2]["scan.empty"] == 1


def test_rays_of_images_are_those_of_their_beams() -> None:
    rays = votes_of(build_map(FRAMES[:2], 0.125))
    assert votes_of(build_map([frame.to_scan() for frame in FRAMES[:2]], 0.125)) == rays
    assert votes_of(by_projection(FRAMES[:2])) != rays


def test_what_it_cannot_do() -> None:
    image, scan = FRAMES[:1], [FRAMES[0].to_scan()]
    with pytest.raises(ConfigError, match='projective" asks each cell once: it needs votes="scan"'):
        build_map(image, 0.1, votes="beam", method="projective")
    with pytest.raises(ConfigError, match=r"hit_width = 0, got 0\.2"):
        build_map(image, 0.1, sensor=BeamSensor(hit_width=0.2), method="projective")
    with pytest.raises(ConfigError, match='"rays" or "projective", got \'splat\''):
        build_map(image, 0.1, method="splat")
    with pytest.raises(InputError, match="is for depth images"):
        build_map(scan, 0.1, method="projective")
    with pytest.raises(InputError, match=r"is for depth images .* and 3D maps"):
        build_map([fan_scan(0.0, 0.0, 0.0, [1.0])], 0.1, method="projective")
    with pytest.raises(InputError, match="3D maps"):
        add_scans(EvidenceMap(0.1), image, method="projective")
    with pytest.raises(InputError, match="2D and 3D"):
        add_scans(EvidenceMap(0.1), [Scan(Pose2(0, 0, 0), np.eye(2), np.ones(2)), *image])
    flat = DepthScan(Pose3(np.zeros(3), np.zeros((3, 3))), FRAMES[0].depth, SMALL)
    with pytest.raises(InputError, match="not a rotation"):
        build_map([flat], 0.1, method="projective")


def test_wide_beams_are_refused() -> None:
    wide = ConeSensor(cone_deg=3.0)
    with pytest.raises(ConfigError, match='sensor is of kind cone: use method "rays"'):
        add_scans(EvidenceMap(0.1, sensor=wide, ndim=3), [], method="projective")
