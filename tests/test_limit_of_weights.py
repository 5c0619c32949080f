# SPDX-License-Identifier: Apache-2.0
"""The most that a cell may hold, 2^62 units: wherever weights are added, to the unit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import (
    BeamSensor,
    ConeSensor,
    EvidenceMap,
    GridScan,
    MapTooLargeError,
    OverheadSensor,
    Pose2,
    Pose3,
    Scan,
    add_scans,
)
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from tests.kit import ONE, Votes, fan_scan, votes_of

MAX_UNITS = 1 << 62
"""As docs/conventions.md has it."""


def ints(*values: int) -> npt.NDArray[np.int64]:
    return np.array(values, np.int64)


def whole(evidence: EvidenceMap) -> tuple[Votes, list[Any], list[Any]]:
    lengths = [array.tolist() for array in evidence.cell_lengths()]
    return votes_of(evidence), lengths, list(evidence.provenance)


# ---- cells and maps ---------------------------------------------------------------------------

# The check before adding takes the most that the narrow level can hold, 255 votes, for granted.
NARROW = 255 * ONE


def filled(units: int, *, channel: int = 0, **settings: Any) -> EvidenceMap:
    """A map with that many units in cell (0, 0), however many, and a few in another one."""
    evidence = EvidenceMap(1.0, **settings)
    ndim = evidence.ndim
    weights = [0, 0]
    weights[channel] = units
    # Far away, so that tiles have been made before; 1 unit has to go to the wide level.
    evidence.add_cells(np.full((1, ndim), 900), ints(1), ints(1))
    evidence.add_cells(np.zeros((1, ndim), np.int64), ints(1), ints(1))
    wide = evidence.tiles.arrays.wide
    row, cell = (int(i) for i in np.argwhere(wide[:, 0] == 1)[1])
    wide[row, :, cell] = weights
    assert votes_of(evidence)[(0,) * ndim] == tuple(weights)
    return evidence


def add_single(evidence: EvidenceMap, units: int, channel: int) -> None:
    weights = [ints(0), ints(0)]
    weights[channel] = ints(units)
    evidence.add_cells(np.zeros((1, evidence.ndim), np.int64), *weights)


def merge_same_side(evidence: EvidenceMap, units: int, channel: int) -> None:
    evidence.merge(filled(units, channel=channel, ndim=evidence.ndim))


def merge_other_side(evidence: EvidenceMap, units: int, channel: int) -> None:
    evidence.merge(filled(units, channel=channel, ndim=evidence.ndim, tile_side=4))


@pytest.mark.parametrize("ndim", [2, 3])
@pytest.mark.parametrize("channel", [0, 1])
@pytest.mark.parametrize(
    ("add", "spare"),
    [(add_single, NARROW), (merge_same_side, 2 * NARROW), (merge_other_side, NARROW)],
)
def test_the_limit_is_kept_to_the_unit(
    add: Callable[[EvidenceMap, int, int], None], spare: int, channel: int, ndim: int
) -> None:
    """Up to the limit, less what narrow levels may hold; a unit more is refused, without a trace.

    The check takes the largest weights of both, wherever they are: those of the other kind, too.
    """
    for already in (1, 5 * ONE, MAX_UNITS // 2):
        most = MAX_UNITS - spare - already
        for kind in (channel, 1 - channel):
            evidence = filled(already, channel=kind, ndim=ndim)
            add(evidence, most, channel)
            total = [0, 0]
            total[kind] += already
            total[channel] += most
            assert votes_of(evidence)[(0,) * ndim] == tuple(total)
            evidence = filled(already, channel=kind, ndim=ndim)
            evidence.record("hall.log")
            before = (votes_of(evidence), list(evidence.provenance))
            for more in (most + 1, MAX_UNITS - 1, MAX_UNITS, MAX_UNITS + 1):
                with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
                    add(evidence, more, channel)
                assert (votes_of(evidence), evidence.provenance) == before


def test_lengths_have_the_same_limit() -> None:
    cell, lengths = np.zeros((1, 2), np.int64), np.array([[0, MAX_UNITS // 2]])
    one, other = (EvidenceMap(1.0, votes="beam", path_lengths=True) for _ in range(2))
    assert one.lengths is not None
    assert other.lengths is not None
    one.lengths.add_cells(cell, lengths)
    other.lengths.add_cells(cell, lengths - 2 * np.array([[0, NARROW]]))
    one.merge(other)
    assert one.cell_lengths()[1].tolist() == [MAX_UNITS - 2 * NARROW]
    before = whole(one)
    other.lengths.add_cells(cell, np.array([[0, 1]]))
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        one.merge(other)
    assert whole(one) == before


def test_rescaling_keeps_to_the_limit() -> None:
    for spare, fits in ((NARROW, True), (0, True), (-1024, False)):  # doubles are 1024 apart there
        evidence = filled(MAX_UNITS - spare, half_life=1.0, t_ref_ns=0)
        if fits:
            assert votes_of(evidence.rescaled(0)) == votes_of(evidence)
            continue
        with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
            evidence.rescaled(0)
        # A half-life later there is room.
        assert evidence.rescaled(10**9).cells()[1].max() == (MAX_UNITS - spare) // 2


# ---- scans ------------------------------------------------------------------------------------

AHEAD = fan_scan(0.3, 0.3, 0.0, [2.1])
AHEAD_IN_SPACE = Scan(Pose3(np.full(3, 0.3), np.eye(3)), np.eye(3)[:1], np.array([2.1]))
IMAGE = DepthScan(
    Pose3(np.full(3, 0.3), np.eye(3)),
    np.full((1, 1), 2.1, np.float32),
    PinholeCamera(fx=1.0, fy=1.0, cx=0.0, cy=0.0, width=1, height=1),
)
SHARED = BeamSensor(hit_width=1.5, share_hit=True)
BEAM, CONE, GRID = BeamSensor(), ConeSensor(cone_deg=60.0), OverheadSensor()
# Scan, sensor, further settings of the map, method.
Kind = tuple[Any, Any, dict[str, Any], str]
PARTS: dict[str, Kind] = {
    "plane": (AHEAD, SHARED, {}, "rays"),
    "plane, each beam": (AHEAD, SHARED, {"votes": "beam"}, "rays"),
    "space": (AHEAD_IN_SPACE, SHARED, {"ndim": 3}, "rays"),
    "space, each beam": (AHEAD_IN_SPACE, SHARED, {"ndim": 3, "votes": "beam"}, "rays"),
    "cones": (AHEAD, CONE, {}, "rays"),
    "cones of space": (AHEAD_IN_SPACE, CONE, {"ndim": 3}, "rays"),
    "grids": (GridScan(Pose2(0.3, 0.3, 0.0), np.full((1, 1), 0.7), 1.0, (0, 0)), GRID, {}, "rays"),
}
WHOLE: dict[str, Kind] = {
    "plane": (AHEAD, BEAM, {}, "rays"),
    "plane, each beam": (AHEAD, BEAM, {"votes": "beam"}, "rays"),
    "space": (AHEAD_IN_SPACE, BEAM, {"ndim": 3}, "rays"),
    "space, each beam": (AHEAD_IN_SPACE, BEAM, {"ndim": 3, "votes": "beam"}, "rays"),
    "grids": (GridScan(Pose2(0.3, 0.3, 0.0), np.ones((1, 1)), 1.0, (0, 0)), GRID, {}, "rays"),
    "images by projection": (IMAGE, BEAM, {"ndim": 3}, "projective"),
}


def heaviest(kind: Kind) -> tuple[tuple[int, ...], int]:
    """The cell that one scan gives the largest hit, and that hit."""
    scan, sensor, more, method = kind
    evidence = EvidenceMap(0.5, sensor=sensor, **more)
    add_scans(evidence, [scan], method=method)
    votes = votes_of(evidence)
    cell = max(votes, key=lambda at: votes[at][0])
    return cell, votes[cell][0]


def holding(kind: Kind, units: int) -> EvidenceMap:
    """A map for such scans with that many units of hits in their heaviest cell."""
    evidence = EvidenceMap(0.5, sensor=kind[1], **kind[2])
    cell, _ = heaviest(kind)
    # One unit goes to the wide level, where any number can be put in its place.
    evidence.add_cells(np.array([cell]), ints(1), ints(0))
    wide = evidence.tiles.arrays.wide
    wide[wide == 1] = units
    assert votes_of(evidence) == {cell: (units, 0)}
    return evidence


@pytest.mark.parametrize("name", PARTS)
def test_a_scan_of_parts_of_votes_may_fill_a_cell(name: str) -> None:
    kind = PARTS[name]
    cell, hit = heaviest(kind)
    assert 0 < hit < ONE
    evidence = holding(kind, MAX_UNITS - hit)
    add_scans(evidence, [kind[0]], method=kind[3])
    assert votes_of(evidence)[cell][0] == MAX_UNITS
    for more in (1, 2, hit):
        with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
            add_scans(holding(kind, MAX_UNITS - hit + more), [kind[0]], method=kind[3])


@pytest.mark.parametrize("name", WHOLE)
def test_scans_of_whole_votes_may_fill_a_cell(name: str) -> None:
    """255 of them are counted in a byte: so far a cell may be beyond the limit unnoticed."""
    kind = WHOLE[name]
    cell, hit = heaviest(kind)
    assert hit == ONE
    evidence = holding(kind, MAX_UNITS - NARROW)
    add_scans(evidence, [kind[0]] * 255, method=kind[3])
    assert votes_of(evidence)[cell][0] == MAX_UNITS
    add_scans(evidence, [kind[0]] * 255, method=kind[3])
    assert votes_of(evidence)[cell][0] == MAX_UNITS + NARROW
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        add_scans(holding(kind, MAX_UNITS - NARROW + 1), [kind[0]] * 510, method=kind[3])


@pytest.mark.parametrize("ndim", [2, 3])
def test_lengths_of_beams_may_fill_a_cell(ndim: int) -> None:
    scan = AHEAD if ndim == 2 else AHEAD_IN_SPACE
    settings: dict[str, Any] = {"ndim": ndim, "votes": "beam", "path_lengths": True}
    once = EvidenceMap(0.5, **settings)
    add_scans(once, [scan])
    index, lengths = once.cell_lengths()
    cell, length = index[:1], int(lengths[0])
    for already, fits in ((MAX_UNITS - length, True), (MAX_UNITS - length + 1, False)):
        evidence = EvidenceMap(0.5, **settings)
        assert evidence.lengths is not None
        evidence.lengths.add_cells(cell, np.array([[0, 1]]))
        wide = evidence.lengths.arrays.wide
        wide[wide == 1] = already
        if fits:
            add_scans(evidence, [scan])
            assert evidence.cell_lengths()[1].max() == MAX_UNITS
        else:
            with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
                add_scans(evidence, [scan])


def test_threads_of_the_plane_add_up_to_the_limit() -> None:
    """Each has tiles of its own, which are merged: the check is that of maps."""
    kind = WHOLE["plane"]
    cell, _ = heaviest(kind)
    # A batch is 2^14 beams, of which this scan has one: many times the same beam.
    times = 1 << 14
    scan = Scan(AHEAD.map_from_sensor, np.tile(AHEAD.directions, (times, 1)), np.full(times, 2.1))
    evidence = holding(kind, MAX_UNITS - 2 * NARROW)
    add_scans(evidence, [scan] * 4, threads=2)
    assert votes_of(evidence)[cell][0] == MAX_UNITS - 2 * NARROW + 4 * ONE
    with pytest.raises(MapTooLargeError, match=r"2\^46 votes"):
        add_scans(holding(kind, MAX_UNITS - 2 * NARROW + 1), [scan] * 4, threads=2)
