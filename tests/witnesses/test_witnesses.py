# SPDX-License-Identifier: Apache-2.0
"""What scans said of a cell adds up to what it has, and is what each says mapped by itself."""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import BeamSensor, ConeSensor, DepthScan, InputError, OverheadSensor, Scan
from oddsmap.scans.scan_part import part_of
from oddsmap.scans.split_log import hold_out
from tests import memory_kit
from tests.kit import random_scans
from tests.kit3d import random_space_scans

CELL = 0.25


def stamped(scans: list[Any]) -> list[Any]:
    return [dataclasses.replace(scan, stamp_ns=i * 10**9) for i, scan in enumerate(scans)]


def from_points(scans: list[Scan]) -> list[Scan]:
    """Points, and each beam from a place of its own."""
    found = []
    for scan in scans:
        ends = scan.directions * np.where(np.isfinite(scan.ranges), scan.ranges, np.nan)[:, None]
        found.append(Scan.from_points(scan.map_from_sensor, ends))
    return found


def moving(scans: list[Scan]) -> list[Scan]:
    rng = np.random.default_rng(3)
    return [
        dataclasses.replace(scan, beam_origins=rng.uniform(-0.5, 0.5, scan.directions.shape))
        for scan in scans
    ]


FLAT, SPACE = random_scans(1, 8), random_space_scans(1, 8)
MAPS: dict[str, tuple[Any, dict[str, Any]]] = {
    "scan": (FLAT, {}),
    "beam": (FLAT, {"votes": "beam"}),
    "lengths": (FLAT, {"votes": "beam", "path_lengths": True}),
    "limits": (FLAT, {"sensor": BeamSensor(range_max=4.0, clear_range=5.0, range_min=0.5)}),
    "width": (FLAT, {"sensor": BeamSensor(hit_width=0.8, share_hit=True, fade=0.5)}),
    "sigma": (FLAT, {"sensor": BeamSensor(sigma=0.2), "votes": "beam"}),
    "window": (FLAT, {"sensor": BeamSensor(angle_min=-1.0, angle_max=2.0)}),
    "body": (FLAT, {"sensor": BeamSensor(body_min=(-2.0, -2.0), body_max=(2.0, 1.0))}),
    "half-life": (stamped(FLAT), {"half_life": 2.0}),
    "half-life in scans": (FLAT, {"half_life_scans": 3.0}),
    "points": (from_points(FLAT), {}),
    "moving": (moving(FLAT), {"votes": "beam"}),
    "cones": (FLAT, {"sensor": ConeSensor(cone_deg=20.0, range_max=5.0, clear_range=4.0)}),
    "wide cones": (FLAT, {"sensor": ConeSensor(cone_deg=180.0, hit_width=1.0, share_hit=False)}),
    "3D scan": (SPACE, {}),
    "3D beam": (SPACE, {"votes": "beam", "sensor": BeamSensor(hit_width=0.5, mark_z_min=-1.0)}),
    "3D moving": (moving(SPACE), {}),
    "3D cones": (SPACE, {"sensor": ConeSensor(cone_deg=30.0)}),
    "images": (memory_kit.images(), {}),
    "images by projection": (memory_kit.images(), {"method": "projective"}),
    "labels": (memory_kit.overhead()[:6], {"sensor": OverheadSensor()}),
}


def cells_of(grid: oddsmap.EvidenceMap, count: int) -> Iterator[Any]:
    """Cells with evidence, some with a lot and some with hits, and one without."""
    index, hits, passes = grid.cells()
    rng = np.random.default_rng(0)
    yield index[np.argmax(hits + passes)]
    yield from index[rng.choice(np.flatnonzero(hits), count)]
    yield from index[rng.integers(len(index), size=count)]
    yield index.max(axis=0) + 3


@pytest.mark.parametrize("name", MAPS)
def test_scans_add_up_to_the_map(name: str) -> None:
    scans, options = MAPS[name]
    grid = oddsmap.build_map(scans, CELL, **options)
    for cell in cells_of(grid, 6):
        found = oddsmap.why(grid, scans, grid.centre_of([cell])[0])
        assert found.cell.tolist() == cell.tolist()
        assert found.complete, (cell, found)
        assert found.notes == ()
        assert found.looked_at == len(scans)
        hits, passes = grid.region(cell, cell + 1)
        assert (found.map_hits, found.map_passes) == (hits.item(), passes.item())
        for vote in found.scans:
            assert (vote.hits, vote.passes) != (0.0, 0.0)
            beams = zip(vote.beam_hits, vote.beam_passes, strict=True)
            assert all(any(said) for said in beams)
    assert found.scans == ()


@pytest.mark.parametrize("name", ["scan", "3D scan", "3D moving", "images"])
def test_where_beams_lie(name: str) -> None:
    """Each passes through the cell, on a ray that is its own."""
    scans, options = MAPS[name]
    grid = oddsmap.build_map(scans, CELL, **options)
    for cell in cells_of(grid, 3):
        found = oddsmap.why(grid, scans, grid.centre_of([cell])[0])
        for vote in found.scans:
            scan = scans[vote.index]
            scan = scan.to_scan() if isinstance(scan, DepthScan) else scan
            pose = scan.map_from_sensor
            for beam, start, way in zip(vote.beams, vote.starts, vote.directions, strict=True):
                origin = (
                    np.zeros(len(cell)) if scan.beam_origins is None else scan.beam_origins[beam]
                )
                assert np.allclose(start, pose.rotation @ origin + pose.translation)
                assert np.allclose(way, pose.rotation @ scan.directions[beam])
                aside = (found.centre - start) - ((found.centre - start) @ way) * way
                assert np.linalg.norm(aside) <= CELL * np.sqrt(len(cell)) / 2 + 1e-9


@pytest.mark.parametrize("name", ["scan", "cones", "3D scan", "images"])
def test_what_was_tried_is_forgotten(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The map in which scans are tried is emptied from time to time."""
    scans, options = MAPS[name]
    grid = oddsmap.build_map(scans, CELL, **options)
    point = grid.centre_of([next(cells_of(grid, 1))])[0]
    kept = oddsmap.why(grid, scans, point)
    monkeypatch.setattr(sys.modules["oddsmap.witnesses.why"], "_TILES", 0)
    forgot = oddsmap.why(grid, scans, point)
    assert kept.complete
    assert forgot.complete
    for one, two in zip(kept.scans, forgot.scans, strict=True):
        assert (one.index, one.hits, one.passes) == (two.index, two.hits, two.passes)
        assert np.array_equal(one.beams, two.beams)


@pytest.mark.parametrize("name", ["scan", "width", "moving", "cones", "3D beam"])
def test_each_scan_and_beam_alone(name: str) -> None:
    """The whole scan and, one by one, all of its beams, each in a map of its own."""
    scans, options = MAPS[name]
    grid = oddsmap.build_map(scans, CELL, **options)
    votes: dict[str, Any] = {"votes": grid.votes, "sensor": grid.sensor, "ndim": grid.ndim}

    def alone(scan: Scan, cell: Any) -> list[float]:
        trial = oddsmap.EvidenceMap(CELL, **votes)
        trial.add([scan])
        return [kind.item() for kind in trial.region(cell, cell + 1)]

    for cell in [*cells_of(grid, 2)][:4]:
        found = {
            vote.index: vote for vote in oddsmap.why(grid, scans, grid.centre_of([cell])[0]).scans
        }
        for index, scan in enumerate(scans):
            said = alone(scan, cell)
            assert (index in found) == any(said)
            if index not in found:
                continue
            vote = found[index]
            assert [vote.hits, vote.passes] == said
            each = np.array([alone(part_of(scan, np.array([i])), cell) for i in range(scan.size)])
            speak = np.flatnonzero(each.any(axis=1))
            assert vote.beams.tolist() == speak.tolist()
            assert np.array_equal(vote.ranges, scan.ranges[speak])
            assert np.array_equal(np.stack([vote.beam_hits, vote.beam_passes], 1), each[speak])


def test_a_part_of_a_scan_keeps_all_that_it_has() -> None:
    """Were a field added to scans, a part would have to have it, too."""
    scan = moving(stamped(from_points(FLAT)))[0]
    names = {field.name for field in dataclasses.fields(Scan)}
    assert names == {
        "map_from_sensor", "directions", "ranges", "stamp_ns", "sensor_id", "number",
        "beam_times_ns", "beam_origins", "measured_points", "own_vectors", "stated",
    }  # fmt: skip
    whole = part_of(scan, np.arange(scan.size))
    for name in names:
        one, two = getattr(scan, name), getattr(whole, name)
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, two, equal_nan=True)
        else:
            assert one == two


def test_what_does_not_add_up_is_said() -> None:
    grid = oddsmap.build_map(FLAT, CELL)
    index, hits, passes = grid.cells()
    point = grid.centre_of(index[[np.argmax(hits + passes)]])[0]
    assert oddsmap.why(grid, FLAT, point).complete
    some = oddsmap.why(grid, FLAT[:4], point)
    assert not some.complete
    (note,) = some.notes
    assert note.severity == "warning"
    assert f"{some.hits:g} hits and {some.passes:g} passes" in note
    assert "read in another way then" in note
    assert "resampled" in oddsmap.why(grid.resample(2 * CELL), FLAT, point).notes[0]
    bare = oddsmap.EvidenceMap(CELL)
    bare.add_cells(grid.cell_of([point]), np.array([1 << 16]), np.array([0]))
    assert "does not say what" in oddsmap.why(bare, FLAT[:1], point).notes[0]


class Named:
    """A log with a path."""

    def __init__(self, path: str, scans: list[Scan]) -> None:
        self.path, self._scans = path, scans
        self.format, self.sensors = "list", {"": None}
        self.sensor: dict[str, float] = {}
        self.skipped, self.notes, self.scan_count = Counter[str](), (), len(scans)

    def __iter__(self) -> Iterator[Scan]:
        return iter(self._scans)


def test_runs_held_out_are_none_of_the_map() -> None:
    log: Any = Named("a.log", FLAT)
    grid = oddsmap.EvidenceMap(CELL)
    grid.add(hold_out(log, 2, 2)[0])
    grid.provenance[-1] |= {"hold_out_every": 2, "hold_out_run": 2}
    index, hits, passes = grid.cells()
    found = oddsmap.why(grid, log, grid.centre_of(index[[np.argmax(hits + passes)]])[0])
    assert found.complete
    assert {vote.index % 4 for vote in found.scans} <= {0, 1}


def test_scans_held_out_are_none_of_the_map() -> None:
    log: Any = Named("a.log", FLAT)
    grid = oddsmap.EvidenceMap(CELL)
    grid.add(hold_out(log, 3)[0])
    grid.provenance[-1]["hold_out_every"] = 3
    index, hits, passes = grid.cells()
    found = oddsmap.why(grid, log, grid.centre_of(index[[np.argmax(hits + passes)]])[0])
    assert found.complete
    assert found.looked_at == 6
    assert {vote.index for vote in found.scans} <= {0, 1, 3, 4, 6, 7}
    assert any(vote.index > 2 for vote in found.scans)
    other: Any = Named("b.log", FLAT)
    grid.add(other)
    point = found.centre
    assert "it was also made of b.log" in oddsmap.why(grid, log, point).notes[0]
    third: Any = Named("c.log", FLAT)
    assert "made of a.log, b.log, not of this log" in oddsmap.why(grid, third, point).notes[0]
    grid.add(log)
    assert "more than once" in oddsmap.why(grid, log, point).notes[0]


def test_what_is_refused() -> None:
    grid = oddsmap.build_map(FLAT, CELL)
    wrong: tuple[tuple[Any, Any, str], ...] = (
        (SPACE, [0.0, 0.0], "scan 0 is 3D, the map 2D"),
        (FLAT, [0.0, 0.0, 0.0], "shape"),
        (FLAT, [np.nan, 0.0], "no cell"),
        ([1.0], [0.0, 0.0], "scan 0 is"),
        (FLAT, [[0.0, 0.0], [1.0, 0.0]], "one point"),
    )
    for scans, point, says in wrong:
        with pytest.raises(InputError, match=says):
            oddsmap.why(grid, scans, point)
    fading = oddsmap.build_map(stamped(FLAT), CELL, half_life=2.0)
    with pytest.raises(InputError, match="stamp"):
        oddsmap.why(fading, FLAT, [0.0, 0.0])


def test_images_name_their_pixels() -> None:
    (image, *_), _options = MAPS["images"]
    assert isinstance(image, DepthScan)
    grid = oddsmap.build_map([image], CELL)
    index, hits, _ = grid.cells()
    found = oddsmap.why(grid, [image], grid.centre_of(index[[np.argmax(hits)]])[0])
    (vote,) = found.scans
    rows, columns = np.divmod(vote.beams[vote.beam_hits > 0], image.camera.width)
    depth = image.depth[rows, columns]
    assert len(depth)
    assert np.allclose(
        vote.ranges[vote.beam_hits > 0], depth * image.camera.range_per_depth[rows, columns]
    )


def test_what_is_no_map_with_counts() -> None:
    scans = random_scans(1, 2)
    grid = oddsmap.build_map(scans, CELL)
    for wrong in (grid.log_odds(), scans, "hall.zarr"):
        with pytest.raises(InputError, match="of a map that counts hits and passes, an EvidenceM"):
            oddsmap.why(wrong, scans, (0.0, 0.0))  # type: ignore[arg-type]
