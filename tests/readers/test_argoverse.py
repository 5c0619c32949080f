# SPDX-License-Identifier: Apache-2.0
"""Logs of Argoverse 2: two LIDARs in one sweep, points without the motion of the car."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import open_log
from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from tests.readers.argoverse_files import CAR, LIDARS, STAMP, argoverse_log, sweep_columns

pytest.importorskip("pyarrow")


def change(path: Path, **columns: Any) -> None:
    """Replace columns of a Feather file, or drop them (None)."""
    import pyarrow as pa
    import pyarrow.feather

    table = pyarrow.feather.read_table(path).to_pydict() | columns
    kept = {name: values for name, values in table.items() if values is not None}
    pyarrow.feather.write_feather(pa.table(kept), path)


def sweep(folder: Path, i: int = 0) -> Path:
    return folder / "sensors" / "lidar" / f"{STAMP + i * 10**8}.feather"


def test_rays_start_at_their_own_lidar_at_their_own_time(tmp_path: Path) -> None:
    """By hand: the place of the LIDAR on the car, on the way of the car, in the map."""
    log = open_log(argoverse_log(tmp_path))
    assert "their rays start where the LIDAR was" in log.notes[0]
    for i, scan in enumerate(log):
        stamp = STAMP + i * 10**8
        columns = sweep_columns()
        assert scan.stamp_ns == stamp
        assert scan.beam_times_ns is not None
        assert scan.beam_origins is not None
        assert scan.measured_points is not None
        assert scan.beam_times_ns.tolist() == [stamp + t for t in columns["offset_ns"]]
        pose: Any = scan.map_from_sensor
        starts = pose.transform(scan.beam_origins)
        expected = []
        for laser, offset in zip(columns["laser_number"], columns["offset_ns"], strict=True):
            place, turn = CAR(stamp + offset)
            lidar = LIDARS["up_lidar" if laser < 32 else "down_lidar"]
            expected.append(Pose3.from_quaternion_xyzw(place, turn).transform(lidar[None])[0])
        np.testing.assert_allclose(starts, expected, atol=1e-6)
        points = np.stack([columns[axis] for axis in "xyz"], axis=1)
        ends = pose.transform(scan.beam_origins + scan.measured_points)
        np.testing.assert_allclose(ends, pose.transform(points), atol=1e-9)


def test_times_without_a_pose(tmp_path: Path) -> None:
    """Of a beam: it says nothing. Of all of a sweep: an error, or a counted skip."""
    folder = argoverse_log(tmp_path)
    offsets = sweep_columns()["offset_ns"]
    change(sweep(folder), offset_ns=[900_000_000, *offsets[1:]])
    scan = next(iter(open_log(folder)))
    assert np.isnan(scan.ranges).tolist() == [True] + [False] * (len(offsets) - 1)
    change(sweep(folder), offset_ns=[900_000_000] * len(offsets))
    with pytest.raises(InputError, match="no pose at the times of the sweep"):
        list(open_log(folder))
    log = open_log(folder, skip_bad=True)
    assert len(list(log)) == 1
    assert log.skipped == {"scan.no_pose": 1}


def test_what_is_missing_or_makes_no_sense_is_one_line(tmp_path: Path) -> None:
    n = len(sweep_columns()["x"])
    cases: list[tuple[str, dict[str, Any], str]] = [
        ("sweep", {"laser_number": [64] * n}, "laser_number beyond 0 to 63"),
        ("sweep", {"laser_number": [None] * n}, "laser_number"),
        ("sweep", {"offset_ns": [10**9] * n}, "offset_ns of a second and more"),
        ("sweep", {"laser_number": None}, "no column laser_number: is it of Argoverse 2?"),
        ("sweep", {"x": ["a"] * n}, "column x cannot be read"),
        ("poses", {"qw": [0.1] * 41}, "row 1: a rotation needs a unit quaternion"),
        ("poses", {"tx_m": [float("nan")] * 41}, "row 1 is not finite"),
        ("poses", {"timestamp_ns": [0.5] * 41}, "column timestamp_ns cannot be read"),
        ("calibration", {"sensor_name": ["up_lidar", "a", "b"]}, "0 sensors down_lidar"),
        ("calibration", {"sensor_name": ["up_lidar", "up_lidar", "b"]}, "2 sensors up_lidar"),
    ]
    for number, (name, columns, message) in enumerate(cases):
        folder = argoverse_log(tmp_path / str(number))
        paths = {
            "sweep": sweep(folder),
            "poses": folder / "city_SE3_egovehicle.feather",
            "calibration": folder / "calibration" / "egovehicle_SE3_sensor.feather",
        }
        change(paths[name], **columns)
        with pytest.raises(InputError, match=message) as caught:
            list(open_log(folder))
        assert "\n" not in str(caught.value)
    folder = argoverse_log(tmp_path / "x")
    with pytest.raises(InputError, match="leave `poses` out"):
        open_log(folder, poses=folder)
    (folder / "sensors" / "lidar" / "noon.feather").write_bytes(b"ARROW1")
    with pytest.raises(InputError, match="named by its time in nanoseconds"):
        list(open_log(folder))
    (folder / "calibration" / "egovehicle_SE3_sensor.feather").unlink()
    with pytest.raises(InputError, match=r"has no calibration/egovehicle_SE3_sensor\.feather"):
        open_log(folder)


def test_damage_and_a_missing_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = argoverse_log(tmp_path)
    path = sweep(folder)
    path.write_bytes(path.read_bytes()[:-300])
    with pytest.raises(InputError, match="the Feather file cannot be read"):
        list(open_log(folder))
    monkeypatch.setitem(sys.modules, "pyarrow.feather", None)
    with pytest.raises(InputError, match=r'pip install "oddsmap\[av\]"'):
        open_log(folder)


@pytest.mark.realdata
def test_a_street(data_folder: Path) -> None:
    """Seen from their own LIDAR, the beams of a laser rise by one angle; from the other, not."""
    folder = data_folder / "av" / "av2_7fab2350"
    scans = list(open_log(folder))
    assert [scan.size for scan in scans] == [99_229, 99_466]
    import pyarrow.feather

    name = f"{scans[0].stamp_ns}.feather"
    table = pyarrow.feather.read_table(folder / "sensors" / "lidar" / name)
    lasers = table["laser_number"].to_numpy()
    assert scans[0].measured_points is not None
    points: FloatArray = scans[0].measured_points
    far = np.linalg.norm(points, axis=1) > 5.0
    rise = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    spread = [rise[far & (lasers == k)].std() for k in range(32) if (far & (lasers == k)).any()]
    assert np.median(spread) < 0.1
