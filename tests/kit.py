# SPDX-License-Identifier: Apache-2.0
"""What several tests of the core need: scans at will, and maps as plain dictionaries."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from hypothesis import Phase

from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.rays2d import Integrator2D
from oddsmap.poses.pose import Pose2
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.segments import Segments
from tests.naive.mapping import Beam, Point

ONE = 65536
# For examples by several threads: what went wrong between them does not come back at will, so to
# look for a smaller example takes minutes and finds none.
AS_FOUND = (Phase.explicit, Phase.reuse, Phase.generate)
Votes = dict[tuple[int, ...], tuple[int, int]]


def votes_of(evidence: Evidence) -> Votes:
    """Cell -> (hits, passes) in units of 1/65536 vote."""
    index, hits, passes = evidence.cells()
    votes = {
        tuple(map(int, cell)): (int(hit), int(free))
        for cell, hit, free in zip(index, hits, passes, strict=True)
    }
    assert len(votes) == len(index), "a cell is listed twice"
    return votes


def add_votes(evidence: Evidence, votes: Votes) -> None:
    """The inverse of `votes_of`."""
    d = evidence.ndim
    index = np.array(list(votes), np.int64).reshape(-1, d)
    hits = np.array([hit for hit, _ in votes.values()], np.int64)
    passes = np.array([free for _, free in votes.values()], np.int64)
    evidence.add_cells(index, hits, passes)


def add_beams(
    evidence: Evidence,
    origin: Point,
    beams: Sequence[Beam],
    *,
    marks: bool | None = None,
    fades: Sequence[Point] | None = None,
) -> None:
    """Add one scan of beams given in cells; `marks` False: by the kernel that skips nothing.

    Passes fade from the points `fades` on.
    """
    ends = np.array([end for end, _, _ in beams], np.float64).reshape(-1, 2)
    tips = np.array([tip for _, tip, _ in beams], np.float64).reshape(-1, 2)
    segments = Segments(
        origins=np.array([origin]) * evidence.resolution,
        bundles=np.array([0, 1]),
        offsets=np.array([0, len(beams)]),
        ends=ends * evidence.resolution,
        tips=tips * evidence.resolution,
        fades=(ends if fades is None else np.array(fades)) * evidence.resolution,
        hit=np.array([hit for _, _, hit in beams], np.bool_),
    )
    assert isinstance(evidence.sensor, BeamSensor)
    integrator = Integrator2D(evidence, evidence.sensor, evidence.tiles)
    if marks is not None:
        integrator._whole = marks
    scans = integrator._in_cells(segments)
    integrator._integrate(scans)


def fan_scan(
    x: float, y: float, theta: float, ranges: npt.ArrayLike, step: float = math.pi / 180
) -> Scan:
    """A scan of beams `step` [rad] apart, the first straight ahead."""
    reading = np.asarray(ranges, np.float64)
    angles = np.arange(len(reading)) * step
    return Scan(Pose2(x, y, theta), np.stack([np.cos(angles), np.sin(angles)], axis=1), reading)


def random_scans(seed: int, count: int, beams: int = 40, reach: float = 6.0) -> list[Scan]:
    """Scans from random poses with all sorts of readings."""
    rng = np.random.default_rng(seed)
    scans = []
    for _ in range(count):
        ranges = rng.uniform(0.0, reach, beams)
        ranges[rng.random(beams) < 0.1] = np.inf
        ranges[rng.random(beams) < 0.05] = np.nan
        x, y, theta = rng.uniform(-4.0, 4.0, 3)
        scans.append(fan_scan(float(x), float(y), float(theta), ranges, step=2 * math.pi / beams))
    return scans
