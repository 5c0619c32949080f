# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers import open_log
from tests.readers.clouds import end_points, graph_bytes

A = np.array([[1.0, 2, 3], [4, 5, 6]])
B = np.array([[7.0, 8, 9]])
TURN = (10, 20, 30, 0, 0, 0, 1)  # half a turn about z, w first
STAY = (1, 2, 3, 1, 0, 0, 0)


def write(folder: Path, content: bytes) -> Path:
    path = folder / "a.graph"
    path.write_bytes(content)
    return path


def test_clouds_are_in_the_sensor_frame(tmp_path: Path) -> None:
    scans = [(np.empty((0, 3)), STAY), (A, STAY), (B, TURN)]
    log = open_log(write(tmp_path, graph_bytes(scans, edges=2)))
    assert log.format == "OctoMap scan graph"
    for _ in range(2):
        empty, a, b = log
        assert empty.ranges.shape == (0,)
        np.testing.assert_allclose(end_points(a), A, rtol=1e-15)
        np.testing.assert_array_equal(a.map_from_sensor.translation, [1, 2, 3])
        np.testing.assert_allclose(
            b.map_from_sensor.transform(end_points(b)), [[3, 12, 39]], rtol=1e-14
        )
    assert log.notes == ("2 edges (constraints between poses) were not read",)
    body_from_sensor = Pose3(np.array([0.0, 1, 0]), np.eye(3))
    moved = list(open_log(tmp_path / "a.graph", body_from_sensor=body_from_sensor))[2]
    np.testing.assert_allclose(moved.map_from_sensor.translation, [10, 19, 30])


def test_a_cut_file_says_both_numbers_and_its_whole_scans_can_be_used(tmp_path: Path) -> None:
    content = graph_bytes([(A, STAY), (B, TURN)])
    path = write(tmp_path, content[:-5])
    with pytest.raises(
        InputError, match=r"a\.graph: the header promises 2 scans, the file holds 1 w"
    ):
        open_log(path)
    log = open_log(path, skip_bad=True)
    assert len(list(log)) == 1
    assert log.skipped == {"container.truncated": 1}
    with pytest.raises(InputError, match="the file holds 0 whole ones"):
        open_log(write(tmp_path, content[:90]), skip_bad=True)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        ((1, 2, 3, 2, 0, 0, 0), "scan 2: a rotation needs a unit quaternion, got norm 2"),
        ((1, float("nan"), 3, 1, 0, 0, 0), "scan 2: its pose is not finite"),
    ],
)
def test_a_bad_pose_names_its_scan(tmp_path: Path, pose: tuple[float, ...], message: str) -> None:
    path = write(tmp_path, graph_bytes([(A, STAY), (B, pose)]))
    with pytest.raises(InputError, match=message):
        list(open_log(path))
    log = open_log(path, skip_bad=True)
    assert len(list(log)) == 1
    assert log.skipped == {"scan.unreadable": 1}


def test_a_corrupt_scan_is_not_read(tmp_path: Path) -> None:
    content = bytearray(graph_bytes([(B, STAY), (A, STAY)]))
    content[content.index(np.array([4.0]).tobytes(), 100) - 4] = 2
    with pytest.raises(InputError, match="scan 2: corrupt scan graph"):
        list(open_log(write(tmp_path, bytes(content))))


def test_poses_are_its_own(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="an OctoMap scan graph has poses: leave `poses` out"):
        open_log(write(tmp_path, graph_bytes()), poses="p.txt")


@pytest.mark.realdata
def test_the_graph_of_octomaps_tests(data_folder: Path) -> None:
    log = open_log(data_folder / "octomap" / "spherical_scan.graph")
    (scan,) = log
    assert scan.ranges.shape == (10_201,)  # 101 x 101 directions
    # OctoMap's test turns the point (4.01, 0.01, 0.01): a sphere about the sensor, not the origin.
    np.testing.assert_allclose(scan.ranges, np.sqrt(4.01**2 + 2 * 0.01**2), atol=1e-6)
    np.testing.assert_array_equal(scan.map_from_sensor.translation, [1, 0, -0.5])
    np.testing.assert_array_equal(scan.map_from_sensor.rotation, np.eye(3))
