# SPDX-License-Identifier: Apache-2.0
"""What threads owe each other, seen in one run of fixed scans.

A race shows now and then, as a crash or a vote too few. So it is not the race that is looked for:
whoever touches a map that threads share must hold its lock, whether another is there or not.
"""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from oddsmap import (
    BeamSensor,
    ConeSensor,
    EvidenceMap,
    GridScan,
    OverheadSensor,
    Pose2,
    Pose3,
    Scan,
    add_scans,
)
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from tests.kit import fan_scan, random_scans, votes_of
from tests.kit3d import random_space_scans

# A batch is 2^14 beams: each of these scans but the last is one of its own, so that every thread
# has some, and the last one is no whole batch.
BATCH = 1 << 14
T_REF = 10**12


class OwnedLock:
    """A lock that knows who holds it."""

    made: list[OwnedLock] = []  # noqa: RUF012

    def __init__(self) -> None:
        self._lock = _Lock()
        self.owner: int | None = None
        OwnedLock.made.append(self)

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        got = self._lock.acquire(blocking, timeout)
        if got:
            self.owner = threading.get_ident()
        return got

    def release(self) -> None:
        self.owner = None
        self._lock.release()

    def locked(self) -> bool:
        return self._lock.locked()

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


_Lock = threading.Lock


def held() -> list[int]:
    """Which of the locks made so far this thread holds."""
    me = threading.get_ident()
    return [number for number, lock in enumerate(OwnedLock.made) if lock.owner == me]


def watched(tiles: Any, touches: list[list[int]]) -> None:
    """Note which locks are held each time that somebody asks for the arrays of a store."""

    class Watched(type(tiles)):  # type: ignore[misc]
        @property
        def arrays(self) -> Any:
            touches.append(held())
            return self.__dict__["arrays"]

        @arrays.setter
        def arrays(self, value: Any) -> None:
            touches.append(held())
            self.__dict__["arrays"] = value

    tiles.__class__ = Watched


def large(scan: Scan, at_least: int = BATCH) -> Scan:
    """The beams of a scan again and again, until it is a batch of its own."""
    times = -(-at_least // scan.size)
    return dataclasses.replace(
        scan,
        directions=np.tile(scan.directions, (times, 1)),
        ranges=np.tile(scan.ranges, times),
        stamp_ns=T_REF - 10**9,
    )


def plane(count: int = 8, beams: int = 40) -> list[Scan]:
    *scans, last = random_scans(11, count, beams, reach=3.0)
    return [*map(large, scans), large(last, 1)]


def space(count: int = 8) -> list[Scan]:
    *scans, last = random_space_scans(11, count, reach=3.0)
    return [*map(large, scans), large(last, 1)]


def images() -> list[DepthScan]:
    camera = PinholeCamera(fx=100.0, fy=100.0, cx=63.5, cy=63.5, width=128, height=128)
    depth = np.full((128, 128), 2.0, np.float32)
    return [
        DepthScan(Pose3(np.array([0.3 * k, 0.1, 0.2]), np.eye(3)), depth, camera) for k in range(8)
    ]


def grids() -> list[GridScan]:
    seen = np.random.default_rng(3).integers(0, 2, (128, 128))
    return [GridScan(Pose2(0.3 * k, 0.1, 0.2), seen, 0.05, (0.0, 0.0)) for k in range(8)]


CONE = ConeSensor(cone_deg=20.0, range_max=3.0)
BEAM, WIDE = BeamSensor(range_max=3.0), BeamSensor(range_max=3.0, hit_width=0.5, share_hit=True)
# Scans, sensor, votes, further settings of the map, method.
Kind = tuple[Sequence[Any], Any, str, dict[str, Any], str]
KINDS: dict[str, Kind] = {
    "plane": (plane(), BEAM, "scan", {}, "rays"),
    "plane, wide hits": (plane(), WIDE, "beam", {}, "rays"),
    "plane, lengths": (plane(), BEAM, "beam", {"path_lengths": True}, "rays"),
    "plane, fading": (plane(), BEAM, "scan", {"half_life": 3.0, "t_ref_ns": T_REF}, "rays"),
    "space": (space(), BEAM, "scan", {"ndim": 3}, "rays"),
    "space, wide hits": (space(), WIDE, "beam", {"ndim": 3}, "rays"),
    "space, lengths": (space(), BEAM, "beam", {"ndim": 3, "path_lengths": True}, "rays"),
    "cones": (plane(beams=8), CONE, "beam", {}, "rays"),
    "grids": (grids(), OverheadSensor(), "scan", {}, "rays"),
    "images": (images(), BEAM, "scan", {"ndim": 3}, "rays"),
    "images by projection": (images(), BEAM, "scan", {"ndim": 3}, "projective"),
}


def empty(kind: Kind) -> EvidenceMap:
    _, sensor, votes, settings, _ = kind
    return EvidenceMap(0.25, sensor=sensor, votes=votes, **settings)


@pytest.mark.parametrize("name", KINDS)
def test_whoever_touches_shared_tiles_holds_their_lock(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = KINDS[name]
    add_scans(empty(kind), kind[0], method=kind[4])  # compiles
    monkeypatch.setattr(threading, "Lock", OwnedLock)
    monkeypatch.setattr(OwnedLock, "made", [])
    evidence = empty(kind)
    touches: list[list[int]] = []
    # In the plane threads have tiles of their own, of narrow beams; lengths are shared there too.
    own_tiles = evidence.ndim == 2 and isinstance(evidence.sensor, BeamSensor)
    if not own_tiles:
        watched(evidence.tiles, touches)
    if evidence.lengths is not None:
        watched(evidence.lengths, touches)
    # By one thread: the rule is the same, and a lock that nobody takes is no crash.
    add_scans(evidence, kind[0], method=kind[4])
    if own_tiles and evidence.lengths is None:
        assert not touches
        return
    assert len(touches) > len(kind[0])
    assert all(touches), "tiles were touched without a lock"
    assert len({tuple(locks) for locks in touches}) == 1
    # By many: it is the same lock for all of them.
    touches.clear()
    add_scans(evidence, kind[0], method=kind[4], threads=4)
    by_threads = [set(locks) for locks in touches]
    assert len(by_threads) > len(kind[0])
    assert set.intersection(*by_threads), "threads have locks of their own"


@pytest.mark.parametrize("threads", [2, 3, 8])
@pytest.mark.parametrize("name", KINDS)
def test_threads_add_up_to_one(name: str, threads: int) -> None:
    """Sums of units before single cells: that something is lost shows at once, and how much."""
    kind = KINDS[name]
    one, many = empty(kind), empty(kind)
    reports = [
        add_scans(one, kind[0], method=kind[4]),
        add_scans(many, kind[0], method=kind[4], threads=threads),
    ]
    sums = [[int(units.sum()) for units in evidence.cells()[1:]] for evidence in (one, many)]
    assert min(sums[0]) > 0
    assert sums[1] == sums[0]
    assert votes_of(many) == votes_of(one)
    if one.lengths is not None:
        for ours, theirs in zip(many.cell_lengths(), one.cell_lengths(), strict=True):
            assert np.array_equal(ours, theirs)
    counts = [(report.scans, report.beams, report.skipped) for report in reports]
    assert counts[1] == counts[0]
    assert counts[0][0] == len(kind[0])


def test_every_thread_has_its_share() -> None:
    """Batches go round: scans far apart, of which each thread must have brought in its own."""
    scans = [large(fan_scan(100.0 * k, 0.0, 0.0, [1.0])) for k in range(8)]
    evidence = EvidenceMap(0.25)
    add_scans(evidence, scans, threads=4)
    index, hits, _ = evidence.cells()
    assert index[hits > 0][:, 0].tolist() == [400 * k + 4 for k in range(8)]
