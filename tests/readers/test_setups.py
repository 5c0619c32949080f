# SPDX-License-Identifier: Apache-2.0
"""Scanners on tripods: E57 and PTX with a pose a setup, and clouds of one stated place."""

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
from oddsmap.scans.scan import Scan
from tests.readers.clouds import pcd_bytes, ply_bytes
from tests.readers.setups import Setup, e57_file, ptx_text

POINTS = np.array([[4.0, 0.5, 0.25], [0.0, 0.0, 0.0], [1.0, -3.0, 0.5], [2.0, 2.0, 2.0]])
SEEN = np.array([[True], [False], [True], [True]])
HALF = np.sqrt(0.5)
# A quarter turn about z.
POSE = Pose3.from_quaternion_xyzw([10.0, 20.0, 5.0], [0.0, 0.0, HALF, HALF])
OTHER = Pose3.from_quaternion_xyzw([-3.0, 1.0, 5.0], [0.0, HALF, 0.0, HALF])


def ends(scan: Scan) -> FloatArray:
    assert scan.measured_points is not None
    return scan.map_from_sensor.transform(scan.measured_points)


def check(scan: Scan, pose: Pose3) -> None:
    np.testing.assert_allclose(scan.map_from_sensor.translation, pose.translation, atol=1e-9)
    np.testing.assert_allclose(ends(scan)[[0, 2, 3]], pose.transform(POINTS)[[0, 2, 3]], atol=1e-6)
    assert scan.ranges[1] == 0.0


class TestE57:
    def test_each_setup_has_its_pose(self, tmp_path: Path) -> None:
        path = e57_file(tmp_path / "a.e57", [Setup(POINTS, POSE), Setup(POINTS, OTHER)])
        log = open_log(path)
        assert len(log) == 2
        for scan, pose in zip(log, (POSE, OTHER), strict=True):
            check(scan, pose)
        assert log.notes == ()

    def test_a_part_of_a_pose(self, tmp_path: Path) -> None:
        """What is left out of one is none of it."""
        still = Pose3(POSE.translation, np.eye(3))
        turned = Pose3(np.zeros(3), POSE.rotation)
        for parts, pose in (("translation", still), ("rotation", turned)):
            path = tmp_path / f"{parts}.e57"
            (scan,) = open_log(e57_file(path, [Setup(POINTS, POSE, parts=(parts,))]))
            check(scan, pose)

    def test_invalid_points_and_spherical_ones(self, tmp_path: Path) -> None:
        invalid = np.array([0, 2, 0, 0])
        wrong = POINTS + np.eye(3)[[0, 0, 0, 0]] * (invalid[:, None] > 0)
        (scan,) = open_log(e57_file(tmp_path / "a.e57", [Setup(wrong, POSE, invalid=invalid)]))
        check(scan, POSE)
        (scan,) = open_log(e57_file(tmp_path / "b.e57", [Setup(POINTS, POSE, spherical=True)]))
        check(scan, POSE)

    def test_no_pose(self, tmp_path: Path) -> None:
        """Said, as one place or as poses; or refused."""
        path = e57_file(tmp_path / "a.e57", [Setup(POINTS, None)])
        with pytest.raises(InputError, match=r"its scans have no poses: .* --origin X Y Z"):
            open_log(path)
        (scan,) = open_log(path, origin=(0.0, 0.0, 1.0))
        np.testing.assert_array_equal(scan.map_from_sensor.translation, [0, 0, 1])
        np.testing.assert_allclose(ends(scan)[[0, 2, 3]], POINTS[[0, 2, 3]])
        poses = tmp_path / "poses.txt"
        poses.write_text("0 -1 0 10 1 0 0 20 0 0 1 5\n")
        (scan,) = open_log(path, poses=poses)
        check(scan, POSE)
        two = e57_file(tmp_path / "b.e57", [Setup(POINTS, POSE), Setup(POINTS, None)])
        with pytest.raises(InputError, match="scan 2 has no pose, others have"):
            list(open_log(two))
        log = open_log(two, skip_bad=True)
        assert len(list(log)) == 1
        assert log.skipped == {"scan.no_pose": 1}

    def test_what_the_file_says_is_not_said_again(self, tmp_path: Path) -> None:
        path = e57_file(tmp_path / "a.e57", [Setup(POINTS, POSE)])
        for options in ({"origin": (0, 0, 0)}, {"points_in": "map"}, {"columns": "x,y,z"}):
            with pytest.raises(InputError, match="leave `"):
                open_log(path, **options)

    def test_damage_and_a_missing_package(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = e57_file(tmp_path / "a.e57", [Setup(POINTS, POSE)])
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])
        with pytest.raises(InputError, match=r"a\.e57: the E57 file cannot be read"):
            open_log(path)
        assert path.exists()
        empty = e57_file(tmp_path / "b.e57", [])
        with pytest.raises(InputError, match="it holds no scans"):
            open_log(empty)
        monkeypatch.setitem(sys.modules, "pye57", None)
        with pytest.raises(InputError, match=r'pip install "oddsmap\[survey\]"'):
            open_log(path)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


class TestPtx:
    @pytest.mark.parametrize("tail", ["", " 0.5", " 0.5 10 20 30"])
    def test_each_setup_has_its_pose(self, tmp_path: Path, tail: str) -> None:
        text = ptx_text(POINTS, POSE, tail) + "\n" + ptx_text(POINTS, OTHER, tail)
        for content in (text, text.rstrip("\n"), text.replace("\n", "\r\n")):
            log = open_log(write(tmp_path / "a.ptx", content))
            assert log.format == "PTX scans"
            for scan, pose in zip(log, (POSE, OTHER), strict=True):
                check(scan, pose)
            assert log.notes == ()

    def test_points_that_are_in_the_map(self, tmp_path: Path) -> None:
        """A matrix that moves nothing, and a scanner that stood elsewhere."""
        points = np.where(SEEN, POSE.transform(POINTS), 0.0)
        identity = Pose3(np.zeros(3), np.eye(3))
        text = ptx_text(points, identity, place=POSE.translation)
        log = open_log(write(tmp_path / "a.ptx", text))
        (scan,) = log
        check(scan, POSE)
        assert "its matrix moves nothing" in log.notes[0]

    def test_far_points_and_a_scanner_at_the_origin(self, tmp_path: Path) -> None:
        place = np.array([637_000.0, 849_000.0, 400.0])
        points = np.where(SEEN, POINTS + place, 0.0)
        path = write(tmp_path / "a.ptx", ptx_text(points, Pose3(np.zeros(3), np.eye(3))))
        with pytest.raises(InputError, match=r"nearest point is 1061 km away: .* --origin X Y Z"):
            list(open_log(path))
        (scan,) = open_log(path, origin=place.tolist())
        check(scan, Pose3(place, np.eye(3)))

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda t: "5" + t[1:], r":1: the header announces 10 points, the file has 4 more"),
            (lambda t: t.replace("4 0.5", "x 0.5"), r":11: 'x' is not a number"),
            (
                lambda t: t.replace("4 0.5 0.25 0.5", "4 0.5"),
                r":11: 2 values: a point of PTX has 3,",
            ),
            (
                lambda t: t.replace("1 -3 0.5", "1 -3"),
                r":13: 3 values where the header announces 4",
            ),
            (lambda t: t.replace("10 20 5\n", "11 20 5\n", 1), r":3: the scanner is at 11 20 5"),
            (lambda t: t + "7\n", r":16: 0 words where line 2 of a PTX header has 1"),
            (lambda t: t.replace("0 0 1 0\n", "0 0 2 0\n"), r":7: a rotation matrix is not ortho"),
        ],
    )
    def test_what_makes_no_sense_is_one_line(
        self, tmp_path: Path, change: Any, message: str
    ) -> None:
        path = write(tmp_path / "a.ptx", change(ptx_text(POINTS, POSE)))
        with pytest.raises(InputError, match=message) as caught:
            list(open_log(path))
        assert "\n" not in str(caught.value)

    def test_poses_are_not_given(self, tmp_path: Path) -> None:
        path = write(tmp_path / "a.ptx", ptx_text(POINTS, POSE))
        with pytest.raises(InputError, match=r"a PTX file with poses says .* leave `origin`"):
            open_log(path, origin=(0, 0, 0))
        with pytest.raises(InputError, match="leave `poses`"):
            open_log(path, poses=path)


class TestOneStatedPlace:
    @pytest.mark.parametrize("points_in", [None, "map"])
    def test_a_cloud_in_the_map(self, tmp_path: Path, points_in: Any) -> None:
        place = np.array([1.0, 2.0, 3.0])
        (tmp_path / "a.ply").write_bytes(ply_bytes(POINTS + place))
        (tmp_path / "a.pcd").write_bytes(pcd_bytes(POINTS + place, viewpoint="9 9 9 1 0 0 0"))
        for name in ("a.ply", "a.pcd"):
            (scan,) = open_log(tmp_path / name, origin=place.tolist(), points_in=points_in)
            check(scan, Pose3(place, np.eye(3)))

    def test_a_folder_seen_from_one_place(self, tmp_path: Path) -> None:
        for i in range(2):
            (tmp_path / f"{i}.ply").write_bytes(ply_bytes(POINTS))
        scans = list(open_log(tmp_path, origin=(0, 0, 1)))
        assert [scan.map_from_sensor.translation.tolist() for scan in scans] == [[0, 0, 1]] * 2
        arm = Pose3(np.zeros(3), np.eye(3))
        with pytest.raises(InputError, match="leave `body_from_sensor` out"):
            open_log(tmp_path, origin=(0, 0, 1), body_from_sensor=arm)


@pytest.mark.realdata
def test_files_of_others(data_folder: Path) -> None:
    folder = data_folder / "survey"
    (scan,) = open_log(folder / "translationWithoutRotation.e57")
    assert scan.map_from_sensor.translation.tolist() == [4, 5, 6]
    np.testing.assert_array_equal(ends(scan)[0], [4, 5, 6])
    for name, count in (("pumpAVisualReferenceImage.e57", 155_201), ("A4.e57", 4)):
        with pytest.raises(InputError, match="its scans have no poses"):
            open_log(folder / name)
        (scan,) = open_log(folder / name, origin=(0, 0, 0))
        assert scan.size == count
    colours = folder / "1.2-with-color.ptx"
    with pytest.raises(InputError, match=r"km away: the points are in the map already"):
        list(open_log(colours))
    (scan,) = open_log(colours, origin=(637_000, 849_000, 2000))
    assert scan.size == 15 * 71
