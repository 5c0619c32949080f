# SPDX-License-Identifier: Apache-2.0
"""What people hold goes to other processes and back."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import Scan
from oddsmap.evidence.tiles import TileStore

ANGLES = np.linspace(-1.0, 1.0, 20)
SCANS = [
    Scan.from_angles((0.1 * i, 0.0, 0.1), ANGLES, np.full(20, 2.0), stamp_s=i) for i in range(3)
]
CONE = oddsmap.ConeSensor(cone_deg=20.0, range_max=4.0)
CAMERA = oddsmap.PinholeCamera(10.0, 10.0, 1.5, 1.5, width=4, height=4)


NAMES = [
    "BeamSensor", "Beams", "Calibrated", "ConeSensor", "Costmap", "DecayRate", "DepthScan",
    "DistanceBand", "DistanceField", "EvidenceMap", "ForwardModel", "FullMap", "FullMapConfig",
    "GridScan", "LogOdds", "OnlineFullMap", "OverheadSensor", "PinholeCamera", "Pose2", "Pose3",
    "ProbabilityMap", "Reflection", "Scan", "State", "Thresholds", "Trajectory", "VoxelMap",
]  # fmt: skip


@pytest.fixture(scope="module")
def held() -> dict[str, Any]:
    """One of each kind of public thing, by the name of its class."""
    grid = oddsmap.build_map(SCANS, 0.2, votes="beam", path_lengths=True)
    cones = [Scan.from_cone((0, 0, 0), 0.0, 1.0, cone_deg=20)]
    full = oddsmap.build_full_map(cones, 0.5, sensor=CONE)
    online = oddsmap.OnlineFullMap(full.config, window=1)
    online.add_scans(cones * 3)
    space = oddsmap.build_map([Scan.from_points(np.eye(4), [[1.0, 0.5, 0.2]])], 0.2)
    return {
        "BeamSensor": oddsmap.BeamSensor(),
        "Beams": oddsmap.Beams.from_scans(SCANS)[0],
        "Calibrated": grid.calibrated(),
        "NeighbourView": grid.calibrated(neighbours=True),
        "ConeSensor": CONE,
        "Costmap": grid.log_odds().costmap(0.2),
        "DecayRate": grid.decay_rate(),
        "DepthScan": oddsmap.DepthScan.from_depth(np.eye(4), np.ones((4, 4)), CAMERA),
        "DistanceBand": grid.log_odds().distance_band(0.5),
        "DistanceField": grid.reflection().distance_field(1.0),
        "EvidenceMap": grid,
        "ForwardModel": CONE.forward_model(),
        "FullMap": full,
        "FullMapConfig": oddsmap.FullMapConfig(),
        "GridScan": oddsmap.GridScan((0, 0, 0), np.eye(2), 0.1, (0, 0)),  # type: ignore[arg-type]
        "LogOdds": grid.log_odds(),
        "OnlineFullMap": online,
        "OverheadSensor": oddsmap.OverheadSensor(),
        "PinholeCamera": CAMERA,
        "Pose2": oddsmap.Pose2(1.0, 2.0, 0.5),
        "Pose3": oddsmap.Pose3(np.ones(3), np.eye(3)),
        "ProbabilityMap": grid.log_odds().to_probability_map(),
        "Reflection": grid.reflection(),
        "Scan": SCANS[0],
        "State": oddsmap.State.FREE,
        "Thresholds": oddsmap.Thresholds(),
        "Trajectory": oddsmap.Trajectory(np.zeros((1, 3)), np.eye(3)[None], np.array([5])),
        "VoxelMap": space.log_odds().to_voxels(),
    }


def parts(thing: Any, seen: dict[int, Any] | None = None) -> Any:
    """What a thing holds, as plain values that can be compared; arrays by their bytes."""
    seen = {} if seen is None else seen
    if isinstance(thing, np.ndarray):
        return thing.dtype.str, thing.shape, thing.tobytes()
    if thing is None or isinstance(thing, str | int | float | bool | bytes):
        return repr(thing)
    if id(thing) in seen:
        return "again"
    seen[id(thing)] = thing  # kept, so that no other thing gets its number
    if isinstance(thing, dict):
        return {repr(key): parts(value, seen) for key, value in thing.items()}
    if isinstance(thing, list | tuple):
        return [parts(value, seen) for value in thing]
    if isinstance(thing, TileStore):  # whose spare rows are not taken along
        return parts(thing.__getstate__(), seen)
    names = [n for kind in type(thing).__mro__ for n in getattr(kind, "__slots__", ())]
    names += list(getattr(thing, "__dict__", ()))
    return type(thing).__name__, {
        name: parts(getattr(thing, name), seen) for name in names if hasattr(thing, name)
    }


@pytest.mark.parametrize("name", NAMES)
def test_public_things_come_back_the_same(name: str, held: dict[str, Any]) -> None:
    thing = held[name]
    assert type(thing).__name__ == name
    for again in (pickle.loads(pickle.dumps(thing)), copy.deepcopy(thing)):
        assert type(again) is type(thing)
        assert parts(again) == parts(thing)


def test_maps_and_views_go_on_working(held: dict[str, Any]) -> None:
    grid = pickle.loads(pickle.dumps(held["EvidenceMap"]))
    grid.add(SCANS)
    twice = oddsmap.build_map(SCANS * 2, 0.2, votes="beam", path_lengths=True)
    lo, hi = twice.bounds() or ((0, 0), (0, 0))
    for ours, theirs in zip(grid.region(lo, hi), twice.region(lo, hi), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    view = pickle.loads(pickle.dumps(held["LogOdds"]))
    np.testing.assert_array_equal(view.probability(), held["LogOdds"].probability())


def test_logs_that_are_held_in_memory(tmp_path: Path) -> None:
    beams = np.array([[0.0, 0.0, 0.0, 2.0], [1.0, 0.0, 1.0, 3.0]])
    np.savez(tmp_path / "log.npz", beams=beams)
    log = oddsmap.open_log(tmp_path / "log.npz")
    again = pickle.loads(pickle.dumps(log))
    assert [parts(scan) for scan in again] == [parts(scan) for scan in log]
    assert again.notes == log.notes


def test_logs_that_are_read_on_demand_are_opened_again(tmp_path: Path) -> None:
    for i in range(3):
        np.array([[1.0 + i, 0.5, 0.2, 0.0]], np.float32).tofile(tmp_path / f"{i}.bin")
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    log = oddsmap.open_log(tmp_path, columns="x,y,z,intensity")
    pickled = pickle.dumps(log)
    assert len(pickled) < 2000
    for again in (pickle.loads(pickled), copy.deepcopy(log)):
        assert type(again) is type(log)
        assert [parts(scan) for scan in again] == [parts(scan) for scan in log]
        assert (again.format, again.notes) == (log.format, log.notes)
    for path in tmp_path.iterdir():
        path.unlink()
    with pytest.raises(oddsmap.InputError, match=tmp_path.name):
        pickle.loads(pickled)
