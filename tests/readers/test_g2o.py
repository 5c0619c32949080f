# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2
from oddsmap.readers import open_log


def laser(
    laser_pose: str = "5 6 0.5",
    robot_pose: str = "5 6 0.5",
    ranges: str = "1 2 3",
    stamp: float = 1,
) -> str:
    n = len(ranges.split())
    head = f"ROBOTLASER1 0 -1.5707963 3.1415926 1.5707963 50.0 0.1 0 {n} {ranges} 0 "
    return f"{head}{laser_pose} {robot_pose} 0 0 0 0 0 {stamp} host {stamp}"


def write(folder: Path, *lines: str) -> Path:
    path = folder / "a.g2o"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_poses_are_those_of_the_vertices(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "# optimised",
        "VERTEX_SE2 7 1.5 -2 0.25",
        laser(stamp=3.5),
        "VERTEX_SE2 8 2.5 -2 0.75",
        laser(ranges="4 5 6"),
        laser(ranges="7 8 9"),
        "EDGE_SE2 7 8 1 0 0.5 1 0 0 1 0 1",
        "FIX 7",
    )
    log = open_log(path)
    assert log.format == "g2o graph"
    assert [scan.map_from_sensor for scan in log] == [
        Pose2(1.5, -2.0, 0.25), Pose2(2.5, -2.0, 0.75), Pose2(2.5, -2.0, 0.75)
    ]  # fmt: skip
    assert [scan.ranges.tolist() for scan in log] == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert next(iter(log)).stamp_ns == 3_500_000_000
    np.testing.assert_allclose(next(iter(log)).directions, [[0, -1], [1, 0], [0, 1]], atol=1e-6)
    assert log.sensor == {"range_max": 50.0}
    assert log.notes == (
        "the log states a maximum range of 50 m: 0 readings at or above it",
        "1 edges (constraints between poses) were not read",
    )
    path.write_bytes(gzip.compress(path.read_bytes()))
    assert len(open_log(path)) == 3


def test_the_laser_keeps_its_place_on_the_robot(tmp_path: Path) -> None:
    """The robot looks along y, the laser sits 0.3 m ahead of it and looks to its left."""
    turned = f"5 6.3 {math.pi!r}"
    path = write(tmp_path, "VERTEX_SE2 0 10 20 0", laser(turned, f"5 6 {math.pi / 2!r}"))
    (scan,) = open_log(path)
    pose = scan.map_from_sensor
    assert isinstance(pose, Pose2)
    assert (pose.x, pose.y, pose.theta) == pytest.approx((10.3, 20.0, math.pi / 2), abs=1e-12)


def test_what_belongs_to_no_vertex_is_counted(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        laser(),
        "VERTEX_SE2 0 1 2 0",
        laser(),
        "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1",
        laser(),
        "VERTEX_SE2 1 1 x 0",
        laser(),
        "VERTEX_SE2 2 1 2",
        "VERTEX_SE2 3 nan 2 0",
        "VERTEX_SE2 4 1 2 0",
        laser(robot_pose="nan 0 0"),
        laser(ranges="1 2 3")[:60],
    )
    log = open_log(path)
    assert len(log) == 1
    assert log.skipped == {
        "scan.no_pose": 3, "line.malformed": 1, "line.short": 2, "scan.nan_pose": 2,
    }  # fmt: skip
    assert log.notes[0] == (
        f"8 lines were skipped, the first: {path}:1: ROBOTLASER1 does not follow a VERTEX_SE2 line"
    )


def test_a_graph_that_was_not_optimised_is_doubtful(tmp_path: Path) -> None:
    vertices = ["VERTEX_SE2 0 5 6 0.5", "VERTEX_SE2 1 5.0005 6 6.7831853"]
    log = open_log(write(tmp_path, vertices[0], laser(), vertices[1], laser()))
    assert "all vertices are where odometry has them" in log.notes[-1]
    assert log.notes[-1].severity == "warning"
    log = open_log(write(tmp_path, vertices[0], laser(), "VERTEX_SE2 1 5.5 6 0.5", laser()))
    assert not any("odometry" in note for note in log.notes)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 1 0 0", "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1"],
         r"without laser lines .*; found VERTEX_SE2 \(2\), EDGE_SE2 \(1\): give a graph"),
        (["VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1"], r"found VERTEX_SE3:QUAT \(1\)"),
        (["VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1", laser()],
         r"no usable scan .*\(scan.no_pose 1\), the first: .*:2: ROBOTLASER1 does not follow"),
    ],
)  # fmt: skip
def test_what_holds_no_scan_says_what_it_holds(
    tmp_path: Path, lines: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        open_log(write(tmp_path, *lines))
    assert "\n" not in str(caught.value)


def test_a_log_of_lasers_alone_is_carmen(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, laser(), laser()))
    assert log.format == "CARMEN"
    assert next(iter(log)).map_from_sensor == Pose2(5.0, 6.0, 0.5)


def test_poses_are_not_taken_from_elsewhere(tmp_path: Path) -> None:
    path = write(tmp_path, "VERTEX_SE2 0 1 2 0", laser())
    with pytest.raises(InputError, match="a g2o graph has poses: leave `poses` out"):
        open_log(path, poses=path)
