# SPDX-License-Identifier: Apache-2.0
"""What the tests of maps of space share: scans in cells, their exact votes, scans in metres."""

from __future__ import annotations

import threading
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.evidence_map import EvidenceMap
from oddsmap.integrate.block_window import BlockWindow
from oddsmap.integrate.rays3d import Integrator3D
from oddsmap.integrate.to_cells import to_cells
from oddsmap.poses.pose import Pose3
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.segments import Segments
from tests.kit import ONE, Votes
from tests.naive.mapping3d import Beam, Cell, Point, edge_distance, map_scan

FloatArray = npt.NDArray[np.float64]


def add_rays(
    evidence: EvidenceMap,
    origin: Point,
    beams: Sequence[Beam],
    *,
    skip: bool = True,
    fades: Sequence[Point] | None = None,
) -> Integrator3D:
    """Add one scan of beams given in cells; `skip` False: by the kernel that skips nothing.

    Passes fade from the points `fades` on. The resolution is a power of 2, so that cells become
    metres and back without rounding.
    """
    assert isinstance(evidence.sensor, BeamSensor)
    integrator = Integrator3D(evidence, evidence.sensor, evidence.tiles, threading.Lock())
    if not skip:
        integrator._gathers = "weights"
        integrator._window = BlockWindow(2, np.int64, integrator._bits)
    ends = np.array([end for end, _, _ in beams], np.float64).reshape(-1, 3)
    tips = np.array([tip for _, tip, _ in beams], np.float64).reshape(-1, 3)
    segments = Segments(
        origins=np.array([origin], np.float64) * evidence.resolution,
        bundles=np.array([0, 1]),
        offsets=np.array([0, len(beams)]),
        ends=ends * evidence.resolution,
        tips=tips * evidence.resolution,
        fades=(ends if fades is None else np.array(fades)) * evidence.resolution,
        hit=np.array([hit for _, _, hit in beams], np.bool_),
    )
    cells = to_cells(segments, evidence.resolution, evidence.tiles.side, 1 << 50)
    integrator._integrate(cells, 0)
    return integrator


def exact_votes(origin: Point, beams: Sequence[Beam], votes: str, share: bool = False) -> Votes:
    """What the oracle says, in units of 1/65536 vote."""
    exact = map_scan(origin, beams, votes, share)
    return {cell: (round(hit * ONE), round(free * ONE)) for cell, (hit, free) in exact.items()}


def near_edge(origin: Point, beams: Sequence[Beam], cell: Cell) -> bool:
    """Whether a ray comes so near to an edge of the cell that kernels may take another cell.

    The rules allow 1/1000 cell, for fixed point. Kernels of space reckon in double precision.
    """
    ways = [(origin, end) for end, _, _ in beams] + [(end, tip) for end, tip, _ in beams]
    return min(edge_distance(a, b, cell) for a, b in ways) < 1e-6


def assert_same(
    got: Votes, want: Votes, origin: Point, beams: Sequence[Beam], *, strict_hits: bool = True
) -> int:
    """Equal but for passes next to an edge; returns how many of those differ."""
    off = 0
    for cell in got.keys() | want.keys():
        mine, exact = got.get(cell, (0, 0)), want.get(cell, (0, 0))
        if mine == exact:
            continue
        assert near_edge(origin, beams, cell), (cell, mine, exact)
        if strict_hits:
            assert mine[0] == exact[0], f"end cell {cell} differs"
        off += 1
    return off


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """Any rotation."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(q * np.sign(np.linalg.det(q)))


def random_space_scans(seed: int, count: int, beams: int = 40, reach: float = 6.0) -> list[Scan]:
    """Scans from random poses in all directions with all sorts of readings."""
    rng = np.random.default_rng(seed)
    scans = []
    for _ in range(count):
        ranges = rng.uniform(0.0, reach, beams)
        ranges[rng.random(beams) < 0.1] = np.inf
        ranges[rng.random(beams) < 0.05] = np.nan
        directions = rng.normal(size=(beams, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        pose = Pose3(rotation=random_rotation(rng), translation=rng.uniform(-4.0, 4.0, 3))
        scans.append(Scan(pose, directions, ranges))
    return scans


def dense_fan(seed: int, count: int, *, rows: int = 16, reach: float = 40.0) -> FloatArray:
    """End points around the origin [cells] as a spinning LIDAR lists them, shape (count, 3)."""
    rng = np.random.default_rng(seed)
    column, row = np.divmod(np.arange(count), rows)
    azimuth = column * (2 * np.pi * rows / count)
    height = (row / rows - 0.5) * 0.9
    smooth = reach * (0.6 + 0.4 * np.sin(3 * azimuth + rng.uniform(0, 6)))
    length = np.where(rng.random(count) < 0.1, rng.uniform(0, reach, count), smooth)
    directions = np.stack(
        [np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)], axis=1
    )
    return np.asarray(directions * length[:, None])
