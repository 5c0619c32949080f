# SPDX-License-Identifier: Apache-2.0
"""Where a robot can drive, against columns one by one and against simulated truth."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, InputError, VoxelMap
from oddsmap.projection.floor import Verdict
from oddsmap.projection.ground_plane import GroundPlane
from oddsmap.simulate import Box, Ground, Lidar3D, World3D
from tests.naive.floors import FREE, OCCUPIED, UNDECIDED, verdict_of

LEVEL = GroundPlane(0.0, 0.0, 0.0)
LOG_ODDS = {FREE: -4.0, UNDECIDED: 0.0, OCCUPIED: 4.0}
SIDE = 0.1
PAGE = Path(__file__).resolve().parents[2] / "docs" / "driving.md"


def voxels(columns: dict[tuple[int, int], dict[int, int]], side: float = SIDE) -> VoxelMap:
    cells = [((x, y, z), s) for (x, y), column in columns.items() for z, s in column.items()]
    index = np.array([cell for cell, _ in cells], np.int64).reshape(-1, 3)
    return VoxelMap(index, np.array([LOG_ODDS[state] for _, state in cells]), side)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), heavy=st.booleans())
def test_columns_one_by_one(seed: int, heavy: bool) -> None:
    rng = np.random.default_rng(seed)
    columns: dict[tuple[int, int], dict[int, int]] = {}
    for cell in np.ndindex(9, 7):
        column: dict[int, int] = {}
        if rng.random() < 0.8:
            level = int(rng.choice([-1, -1, -1, 0, 1, -2]))
            column |= {level: OCCUPIED}
            column |= {z: FREE for z in range(level + 1, 14) if rng.random() < 0.7}
        for z in rng.integers(-12, 16, 4 if heavy else 1):
            column[int(z)] = int(rng.choice([FREE, UNDECIDED, OCCUPIED]))
        if rng.random() < 0.9:
            columns[(int(cell[0]) - 4, int(cell[1]))] = column
    columns[(-4, 0)] = {-1: OCCUPIED}  # the corners of the box
    columns[(4, 6)] = {-1: OCCUPIED}
    found = oddsmap.traversable(
        voxels(columns), robot_height=0.8, max_step=0.15, max_slope_deg=12.0, ground=LEVEL
    )
    assert found.verdict.shape == (7, 9)
    assert found.origin == (-0.4, 0.0)
    for x, y in np.ndindex(9, 7):
        want = verdict_of(
            columns, x - 4, y, ground=0.0, side=SIDE, height=0.8, step=0.15,
            slope=math.tan(math.radians(12.0)), half=5,
        )  # fmt: skip
        assert Verdict(int(found.verdict[y, x])).name == want, (x, y)


def test_a_robot_keeps_its_radius() -> None:
    """All cells within it are free, and none is outside the map."""
    columns = {(x, y): {-1: OCCUPIED, 0: FREE} for x in range(30) for y in range(30)}
    columns[(15, 15)] |= dict.fromkeys(range(8), OCCUPIED)
    found = oddsmap.traversable(voxels(columns), robot_radius=0.45, ground=LEVEL)
    assert (found.verdict == Verdict.BLOCKED).sum() == 1
    y, x = np.mgrid[0:30, 0:30]
    away = np.minimum.reduce([np.hypot(x - 15, y - 15), x + 1, y + 1, 30 - x, 30 - y])
    assert np.array_equal(found.fits, away > 4.5)


def scene() -> World3D:
    """A floor with what robots meet, 12 x 8 m."""
    return World3D(
        [
            Box(3.0, 4.0, 0.4, 3.0, 0.0, 2.0),  # a wall
            Box(5.5, 2.0, 1.2, 0.8, 0.6, 0.7),  # a table, without its legs
            Box(5.5, 6.0, 1.6, 1.6, 1.4, 1.6),  # a beam overhead
            Box(8.5, 2.0, 1.6, 1.6, 0.0, 0.1),  # a sill
            Box(8.5, 6.0, 1.6, 1.6, 0.0, 0.26),  # a platform
        ],
        Ground(),
    )


def test_simulated_truth() -> None:
    """Scanned by a lidar: free floor is called free, and what is in the way is called so."""
    lidar = Lidar3D(
        ring_count=64, column_count=360, elevation_min=-1.2, elevation_max=0.5, range_max=15.0,
        sigma=0.005,
    )  # fmt: skip
    rng = np.random.default_rng(0)
    stands = [(x, y) for x in (1.0, 4.2, 7.0, 10.5) for y in (1.0, 4.0, 7.0)]
    scans = [
        lidar.scan(scene(), oddsmap.Pose3(np.eye(3), np.array([x, y, 1.2])), rng) for x, y in stands
    ]
    grid = oddsmap.build_map(scans, SIDE, sensor=oddsmap.BeamSensor(range_max=15.0))
    view = grid.log_odds(thresholds=oddsmap.Thresholds(0.45, 0.65))
    low = oddsmap.traversable(view, robot_height=1.0, max_step=0.15)
    tall = oddsmap.traversable(view, robot_height=1.8, max_step=0.15)

    def at(found: Any, x0: float, y0: float, x1: float, y1: float) -> Any:
        corner = np.array(found.origin)
        i0, j0 = np.rint((np.array([x0, y0]) - corner) / SIDE).astype(int)
        i1, j1 = np.rint((np.array([x1, y1]) - corner) / SIDE).astype(int)
        return found.verdict[j0:j1, i0:i1]

    def share(found: Any, verdict: Verdict, *box: float) -> float:
        return float((at(found, *box) == verdict).mean())

    for floor in ((0.5, 0.5, 2.5, 7.5), (3.5, 3.0, 12.0, 4.8), (9.8, 0.5, 12.0, 7.5)):
        assert share(low, Verdict.FREE, *floor) >= 0.99
    assert share(low, Verdict.FREE, 2.8, 2.6, 3.2, 5.4) == 0.0  # its inside nobody sees
    assert share(low, Verdict.BLOCKED, 2.8, 2.6, 3.2, 5.4) >= 0.4
    assert share(low, Verdict.FREE, 5.0, 1.7, 6.0, 2.3) <= 0.02  # under the table
    assert share(low, Verdict.FREE, 4.8, 5.3, 6.2, 6.7) >= 0.97  # under the beam
    assert share(tall, Verdict.BLOCKED, 4.8, 5.3, 6.2, 6.7) >= 0.7
    assert share(tall, Verdict.FREE, 0.5, 0.5, 2.5, 7.5) >= 0.99
    assert share(low, Verdict.FREE, 7.4, 0.9, 9.6, 3.1) >= 0.93  # over the sill
    rim = [(7.7, 5.2, 9.3, 5.3), (7.7, 5.2, 7.8, 6.8), (9.2, 5.2, 9.3, 6.8), (7.7, 6.7, 9.3, 6.8)]
    assert np.mean([share(low, Verdict.FREE, *side) for side in rim]) <= 0.1  # of the platform
    floor = low.floor[~np.isnan(low.floor) & (low.verdict == Verdict.FREE)]
    assert np.abs(floor).max() <= 0.3 + 1e-9


@pytest.mark.parametrize(("degrees", "drives"), [(8.0, True), (15.0, True), (28.0, False)])
def test_ramps(degrees: float, drives: bool) -> None:
    rise = math.tan(math.radians(degrees))
    columns = {}
    for x in range(60):
        level = math.floor(rise * (x + 0.5))
        for y in range(40):
            columns[(x, y)] = {level - 1: OCCUPIED} | {level + z: FREE for z in range(12)}
    found = oddsmap.traversable(
        voxels(columns), ground=GroundPlane(0.0, rise, 0.0), max_step=0.2, max_slope_deg=20.0
    )
    middle = found.verdict[6:-6, 6:-6]
    assert (middle == (Verdict.FREE if drives else Verdict.SLOPE)).all()


def test_saved_as_a_ros_map(tmp_path: Path) -> None:
    columns = {(x, 0): {-1: OCCUPIED, 0: FREE} for x in range(5)}
    columns[(1, 0)] |= {3: OCCUPIED}
    columns[(2, 0)] = {8: FREE}
    columns[(3, 0)] = {-1: OCCUPIED, 3: UNDECIDED}
    found = oddsmap.traversable(voxels(columns), ground=LEVEL)
    names = [Verdict(int(v)).name for v in found.verdict[0]]
    assert names == ["FREE", "BLOCKED", "UNKNOWN", "UNDECIDED", "FREE"]
    found.save_ros(tmp_path / "floor.yaml")
    back = oddsmap.load_ros(tmp_path / "floor.yaml")
    state = back.states_at([[0.05 + 0.1 * x, 0.05] for x in range(5)]).state
    free, unknown, occupied = (oddsmap.State[name] for name in ("FREE", "UNKNOWN", "OCCUPIED"))
    assert state.tolist() == [free, occupied, unknown, unknown, free]
    with pytest.raises(oddsmap.OutputError):
        found.save_ros(tmp_path / "floor.yaml")


def test_what_is_refused() -> None:
    flat = voxels({(0, 0): {-1: OCCUPIED}})
    wrong: tuple[tuple[dict[str, Any], str], ...] = (
        ({"robot_height": 0.0}, "robot_height is a length"),
        ({"robot_radius": math.nan}, "robot_radius is a length"),
        ({"max_step": 0.05}, "max_step 0.05 m is below the side of a cell, 0.1 m"),
        ({"max_slope_deg": 90.0}, "max_slope_deg lies between"),
    )
    for options, says in wrong:
        with pytest.raises(ConfigError, match=says):
            oddsmap.traversable(flat, **options)
    with pytest.raises(InputError, match="3D map"):
        oddsmap.traversable(oddsmap.EvidenceMap(0.1))
    reflection: Any = oddsmap.EvidenceMap(0.1, votes="beam", ndim=3).reflection()
    with pytest.raises(InputError, match="got Reflection"):
        oddsmap.traversable(reflection)
    with pytest.raises(InputError, match="no ground"):
        oddsmap.traversable(voxels({(0, 0): {0: FREE}}))
    assert oddsmap.traversable(oddsmap.EvidenceMap(0.1, ndim=3)).verdict.shape == (0, 0)


def test_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    names: dict[str, Any] = {"__name__": "__main__"}
    exec(compile(block, PAGE.name, "exec"), names)
    found = names["found"]
    assert (found.verdict == Verdict.FREE).mean() > 0.05
    assert (found.verdict == Verdict.BLOCKED).any()
    assert found.fits.any()
    assert Path("street.pgm").exists()
    verdicts = set(re.findall(r"^\| `([A-Z]+)` \|", PAGE.read_text(encoding="utf-8"), re.M))
    assert verdicts == set(Verdict.__members__)
