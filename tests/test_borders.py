# SPDX-License-Identifier: Apache-2.0
"""Which side of a border belongs to what, as docs/conventions.md has it: on the number itself.

Next to it, one bit away, lies the other side.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import (
    BeamSensor,
    ConeSensor,
    EvidenceMap,
    LogOdds,
    MapTooLargeError,
    Pose2,
    Pose3,
    Scan,
    State,
    Thresholds,
    VoxelMap,
    build_map,
    load_ros,
    project,
)
from oddsmap.integrate.to_cells import check_size
from oddsmap.odds import logit
from oddsmap.projection.ground_plane import GroundPlane
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from tests.cli.conftest import Run
from tests.cli.conftest import run as run  # a fixture
from tests.kit import ONE
from tests.test_reasons import (
    RESOLUTION,
    Counts,
    filtered,
    full,
    online,
    projected,
    reflected,
    scored,
)


def below(value: float) -> float:
    return math.nextafter(value, -math.inf)


def above(value: float) -> float:
    return math.nextafter(value, math.inf)


# ---- readings ---------------------------------------------------------------------------------

MIN, MAX = 0.125, 3.0


def scan(d: int, *ranges: float, ahead: int = 0) -> Scan:
    pose = Pose2(0.25, 0.25, 0.0) if d == 2 else Pose3(np.full(3, 0.25), np.eye(3))
    return Scan(pose, np.eye(d)[[ahead] * len(ranges)], np.array(ranges))


# A single pixel, on the axis of the camera: its depth is its range.
PIXEL = PinholeCamera(fx=1.0, fy=1.0, cx=0.0, cy=0.0, width=1, height=1)


def image(depth: float) -> DepthScan:
    # Of 64 bits: in 32 there is no number next to these.
    pixels: Any = np.array([[depth]])
    return DepthScan(Pose3(np.full(3, 0.25), np.eye(3)), pixels, PIXEL)


LIMITS: dict[str, Any] = {"range_min": MIN, "range_max": MAX}
BEAM, CONE = BeamSensor(**LIMITS), ConeSensor(cone_deg=10.0, **LIMITS)
CLEARING = BeamSensor(**LIMITS, clear_range=2.0)

Way = tuple[Callable[..., Counts], Callable[[float], Any], Any, bool]
# A way to a map, a reading, the sensor, and whether range_max itself is skipped there.
WAYS: dict[str, Way] = {
    "plane": (filtered, lambda z: scan(2, z), BEAM, True),
    "space": (filtered, lambda z: scan(3, z), BEAM, True),
    "cones": (filtered, lambda z: scan(2, z), CONE, True),
    "cones of space": (filtered, lambda z: scan(3, z), CONE, True),
    "images": (filtered, image, BEAM, True),
    "images by projection": (projected, image, BEAM, True),
    "full map": (full, lambda z: scan(2, z), BEAM, True),
    "full map of cones": (full, lambda z: scan(2, z), CONE, False),
    "online": (online, lambda z: scan(2, z), BEAM, True),
    "reflection map": (reflected, lambda z: scan(2, z), CONE, False),
    "scores": (scored, lambda z: scan(2, z), BEAM, True),
    "clearing": (filtered, lambda z: scan(2, z), CLEARING, False),
    "full map, clearing": (full, lambda z: scan(2, z), CLEARING, False),
}


@pytest.mark.parametrize("name", WAYS)
def test_limits_of_range(name: str) -> None:
    """range_min is a reading, range_max is none any more."""
    way, reading, sensor, skipped_at_max = WAYS[name]
    nothing: dict[str, int] = {}
    short = {"beam.below_range_min": 1, "scan.empty": 1}
    long = {"beam.no_return": 1, "scan.empty": 1} if skipped_at_max else nothing
    for z, want in (
        (below(MIN), short),
        (MIN, nothing),
        (below(MAX), nothing),
        (MAX, long),
        (above(MAX), long),
    ):
        assert dict(way([reading(1.0), reading(z)], sensor)) == want, z


def hits_of(scan: Any, sensor: Any, **more: Any) -> int:
    return int(build_map([scan], 0.5, sensor=sensor, **more).cells()[1].sum())


@pytest.mark.parametrize("sensor", [BEAM, CLEARING, CONE])
def test_a_return_just_short_of_range_max_marks(sensor: Any) -> None:
    assert hits_of(scan(2, below(MAX)), sensor) > 0
    assert hits_of(scan(2, 1.0, MAX), sensor) == hits_of(scan(2, 1.0), sensor)


# ---- filters ----------------------------------------------------------------------------------

# The return is 1 m from a sensor at 0.25 m.
FILTERS: list[tuple[dict[str, float], bool]] = [
    ({"mark_z_max": 1.25}, True),
    ({"mark_z_max": below(1.25)}, False),
    ({"mark_z_min": 1.25}, True),
    ({"mark_z_min": above(1.25)}, False),
]
SENSORS: dict[str, tuple[Callable[..., Any], str]] = {
    "beams": (BeamSensor, "rays"),
    "cones": (lambda **fields: ConeSensor(cone_deg=10.0, **fields), "rays"),
}
IMAGES: dict[str, tuple[Callable[..., Any], str]] = {
    "images": (BeamSensor, "rays"),
    "images by projection": (BeamSensor, "projective"),
}


@pytest.mark.parametrize(("heights", "marks"), FILTERS)
@pytest.mark.parametrize("name", [*SENSORS, *IMAGES])
def test_a_return_at_the_limit_of_heights_marks(
    name: str, heights: dict[str, float], marks: bool
) -> None:
    make, method = (SENSORS | IMAGES)[name]
    reading = image(1.0) if name in IMAGES else scan(3, 1.0, ahead=2)
    counts = (projected if method == "projective" else filtered)([reading], make(**heights))
    assert dict(counts) == ({} if marks else {"hit.outside_heights": 1})
    assert (hits_of(reading, make(**heights), method=method) > 0) == marks


@pytest.mark.parametrize("name", [*SENSORS, *IMAGES])
def test_a_return_on_the_border_of_the_body_does_not_mark(name: str) -> None:
    make, method = (SENSORS | IMAGES)[name]
    way = projected if method == "projective" else filtered
    for axis in (2,) if name in IMAGES else (0, 1, 2):
        reading = image(1.0) if name in IMAGES else scan(3, 1.0, ahead=axis)
        for low, high, on_body in (
            (-1.0, 1.0, True),
            (-1.0, below(1.0), False),
            (1.0, 2.0, True),
            (above(1.0), 2.0, False),
        ):
            corners = np.array([[-1.0] * 3, [1.0] * 3])
            corners[:, axis] = low, high
            body = {"body_min": tuple(corners[0].tolist()), "body_max": tuple(corners[1].tolist())}
            counts = way([reading], make(**body))
            assert dict(counts) == ({"hit.on_body": 1} if on_body else {}), (axis, low, high)
            # The other two coordinates are 0: on the border of a box that begins or ends there.
            other = (axis + 1) % 3
            for place in (0, 1):
                corners[place, other] = 0.0
                body = {
                    "body_min": tuple(corners[0].tolist()), "body_max": tuple(corners[1].tolist())
                }  # fmt: skip
                assert dict(way([reading], make(**body))) == dict(counts)
                corners[place, other] = 2.0 * place - 1.0


# ---- bands of heights -------------------------------------------------------------------------


def stairs() -> EvidenceMap:
    """Column x has one cell, at height x: its centre is at 0.5 x + 0.25 m."""
    evidence = EvidenceMap(0.5, ndim=3)
    places = np.array([[k, 0, k] for k in range(6)])
    evidence.add_cells(places, np.full(6, 4 * ONE), np.zeros(6, np.int64))
    return evidence


# z_min, z_max, and the steps that are between them.
BANDS: list[tuple[float, float, list[int]]] = [
    (0.75, 1.75, [1, 2]),
    (above(0.75), 1.75, [2]),
    (below(0.75), 1.75, [1, 2]),
    (0.75, above(1.75), [1, 2, 3]),
    (0.75, below(1.75), [1, 2]),
    (0.25, 2.75, [0, 1, 2, 3, 4]),
]


@pytest.mark.parametrize(("z_min", "z_max", "steps"), BANDS)
def test_a_band_has_its_lower_end_and_not_its_upper(
    z_min: float, z_max: float, steps: list[int], run: Run, tmp_path: Path
) -> None:
    evidence = stairs()
    want = [x in steps for x in range(6)]
    for source in (evidence, evidence.log_odds(), evidence.log_odds().to_voxels()):
        assert project(source, z_min, z_max).observed.tolist() == [want]
    for ground in (GroundPlane(0.0), lambda x, y: 0.0 * x):
        assert project(evidence, z_min, z_max, ground=ground).observed.tolist() == [want]
    # A ground half a metre up lifts the band by a step.
    lifted = project(evidence, z_min, z_max, ground=GroundPlane(0.5)).observed
    assert lifted.tolist() == [[False, *want[:-1]]]
    evidence.save(tmp_path / "stairs.zarr")
    # As text, to the last bit: "0.75" and its neighbours.
    words = ("export", tmp_path / "stairs.zarr", tmp_path / "out.yaml")
    assert run(*words, "--z-min", repr(z_min), "--z-max", repr(z_max)).status == 0
    state = load_ros(tmp_path / "out.yaml").state()
    assert state.tolist() == [[State.OCCUPIED if inside else State.UNKNOWN for inside in want]]


def test_bands_share_no_cell_and_leave_none_out() -> None:
    evidence = stairs()
    edges = [-math.inf, 0.25, 0.75, 1.0, 1.75, math.inf]
    bands = [
        project(evidence, low, high).observed.astype(int) for low, high in itertools.pairwise(edges)
    ]
    assert np.sum(bands, axis=0).tolist() == [[1] * 6]


# ---- probabilities ----------------------------------------------------------------------------


def test_thresholds_belong_to_free_and_occupied() -> None:
    limits = Thresholds(0.25, 0.75)
    p = np.array([0.25, above(0.25), below(0.75), 0.75, 0.0, 1.0, 0.1])
    seen = np.array([True] * 6 + [False])
    assert limits.state(p, seen).tolist() == [
        State.FREE, State.UNDECIDED, State.UNDECIDED, State.OCCUPIED, State.FREE, State.OCCUPIED,
        State.UNKNOWN,
    ]  # fmt: skip


@pytest.mark.parametrize("clamp", [(0.2, 0.6), (0.4, 0.9), (0.45, 0.55), (1e-6, 1.0 - 1e-6)])
@pytest.mark.parametrize("ndim", [2, 3])
def test_a_clamp_bounds_a_view_on_both_sides(clamp: tuple[float, float], ndim: int) -> None:
    """Whichever way the view is asked, and the prior of unseen cells with it."""
    evidence = EvidenceMap(1.0, ndim=ndim)
    places = np.zeros((6, ndim), np.int64)
    places[:, 0] = 2 * np.arange(6)  # every other cell is unseen
    evidence.add_cells(
        places, ONE * np.array([9, 1, 0, 0, 0, 3]), ONE * np.array([0, 0, 1, 9, 0, 3])
    )
    low, high = (float(value) for value in logit(np.array(clamp)))
    for prior in (0.05, 0.5, 0.95):
        free, bound = evidence.log_odds(prior=prior), evidence.log_odds(prior=prior, clamp=clamp)
        box = ([-1] * ndim, [12] * ndim)
        for ways in (
            (free.log_odds(), bound.log_odds()),
            (free.log_odds(box), bound.log_odds(box)),
            (free.known_log_odds()[1], bound.known_log_odds()[1]),
            (free.log_odds_at(places), bound.log_odds_at(places)),
            (free.of_votes([0, 9, 0], [9, 0, 0]), bound.of_votes([0, 9, 0], [9, 0, 0])),
        ):
            assert np.array_equal(np.clip(ways[0], low, high), ways[1])
        p = bound.probability(box)
        assert clamp[0] - 1e-12 <= p.min() <= p.max() <= clamp[1] + 1e-12


# ---- poses ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_pose_is_too_far_from_2_to_the_45_cells_on(name: str, sign: float) -> None:
    way, reading, sensor, _ = WAYS[name]
    limit = 2.0**45 * RESOLUTION

    def moved(x: float) -> Any:
        scan = reading(1.0)
        pose = scan.map_from_sensor
        there = (
            Pose2(x, pose.y, pose.theta)
            if isinstance(pose, Pose2)
            else Pose3(np.array([x, *pose.translation[1:]]), pose.rotation)
        )
        return dataclasses.replace(scan, map_from_sensor=there)

    far, near = moved(sign * limit), moved(sign * math.nextafter(limit, 0.0))
    assert dict(way([reading(1.0), far], sensor)) == {"scan.pose_too_far": 1}
    assert dict(way([reading(1.0), near], sensor)) == {}


# ---- the size of a scan -----------------------------------------------------------------------


def fits(extent: tuple[int, int], most: int = 1 << 40, beams: int = 1, way: float = 1.0) -> bool:
    """Whether a scan of such a window may be done."""
    try:
        check_size(np.array([beams]), np.array([way]), np.array([extent], float), 0.5, 32, most)
    except MapTooLargeError:
        return False
    return True


def test_a_scan_is_less_than_2_to_the_22_cells_long() -> None:
    long = 1 << 22
    assert fits((long - 32, 32))
    for extent in ((long, 32), (32, long)):
        assert not fits(extent)


def test_a_window_may_have_as_many_cells_as_it_may_have() -> None:
    for extent in ((320, 640), (640, 320)):
        assert fits(extent, most=320 * 640)
        assert not fits(extent, most=320 * 640 - 1)


def test_a_scan_is_refused_by_the_memory_of_its_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two bytes a cell, of the tiles that beams can reach or of the window, whichever is less."""
    for needed, beams, way in (
        (2 * 32 * 32 * (10 + 2 * 3), 3, 320.0),  # 10 tiles of way, and a corner's 2 a beam
        (2 * 3200 * 3200, 10**6, 1e9),
    ):
        for limit, enough in ((needed, True), (needed - 1, False)):
            with monkeypatch.context() as patch:
                patch.setattr(f"{check_size.__module__}.memory_limit", lambda limit=limit: limit)
                assert fits((3200, 3200), beams=beams, way=way) == enough


def test_a_plane_has_2_to_the_31_columns_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    """One row more than that is too many; memory for so many is not taken here."""

    class TakenError(Exception):
        pass

    def taken(count: int, value: float) -> None:
        assert count == 1 << 31
        raise TakenError

    for rows, error in ((1 << 15, TakenError), ((1 << 15) + 1, MapTooLargeError)):
        evidence = EvidenceMap(0.5, ndim=3)
        corners = np.array([[0, 0, 0], [(1 << 16) - 1, rows - 1, 0]])
        evidence.add_cells(corners, np.full(2, ONE), np.zeros(2, np.int64))
        with monkeypatch.context() as patch:
            view = evidence.log_odds()
            patch.setattr(np, "full", taken)
            with pytest.raises(error):
                project(view, -1.0, 1.0)


# ---- what a projection asks -------------------------------------------------------------------


def test_a_ground_is_asked_at_the_centres_of_columns() -> None:
    evidence = EvidenceMap(0.5, ndim=3)
    places = np.array([[-3, 7, 0], [-3, 7, 2], [4, 7, 1], [-3, 9, 5]])
    evidence.add_cells(places, np.full(4, ONE), np.zeros(4, np.int64))
    asked: list[tuple[float, float]] = []

    def ground(x: np.ndarray[Any, Any], y: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        asked.extend(zip(x.tolist(), y.tolist(), strict=True))
        return 0.0 * x

    project(evidence, -9.0, 9.0, ground=ground)
    assert asked == [(-1.25, 3.75), (2.25, 3.75), (-1.25, 4.75)]


def test_columns_that_no_voxel_is_in_have_one_half() -> None:
    voxels = VoxelMap(np.array([[0, 0, 0], [2, 0, 0]]), np.array([3.0, -3.0]), 0.5)
    grid = project(voxels, -1.0, 1.0)
    assert grid.observed.tolist() == [[True, False, True]]
    assert grid.probability[0, 1] == 0.5


def test_ground_is_looked_for_among_what_the_view_calls_occupied_and_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    evidence = EvidenceMap(0.5, ndim=3)
    places = np.array([[k, 0, 0] for k in range(4)])
    evidence.add_cells(places, ONE * np.array([2, 1, 0, 0]), ONE * np.array([0, 0, 1, 2]))
    p = evidence.log_odds().cells()[1]
    told: list[Any] = []

    def fitted(occupied: Any, resolution: float, free: Any) -> GroundPlane:
        told.append((occupied[:, 0].tolist(), resolution, free[:, 0].tolist()))
        return GroundPlane(0.0)

    monkeypatch.setattr(f"{project.__module__}.fit_ground_surface", fitted)
    monkeypatch.setattr(GroundPlane, "at", lambda self, x, y: 0.0 * x)
    for occupied, free, want in (
        (p[0], p[3], ([0], 0.5, [3])),
        (p[1], p[2], ([0, 1], 0.5, [2, 3])),
        (above(p[1]), below(p[2]), ([0], 0.5, [3])),
    ):
        limits = Thresholds(float(free), float(occupied))
        project(LogOdds(evidence, thresholds=limits), -9.0, 9.0, ground="relative")
        assert told.pop() == want
