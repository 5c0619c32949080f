# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers import open_log
from oddsmap.readers.pose_file import read_trajectory
from tests.readers.clouds import end_points, pcd_bytes, ply_bytes

BODY_FROM_SENSOR = Pose3(np.array([0.0, 0, 2]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))


def kitti(n: int) -> str:
    return "".join(f"1 0 0 {i} 0 1 0 0 0 0 1 0\n" for i in range(n))


def tum(stamps: list[float]) -> str:
    return "".join(f"{stamp} {stamp} 0 0 0 0 0 1\n" for stamp in stamps)


def fill(folder: Path, names: list[str]) -> None:
    """Clouds of one point each, at x = 1, 2, ... in the order of `names`."""
    for i, name in enumerate(names):
        points = np.array([[i + 1.0, 0, 0]])
        content = {
            "pcd": pcd_bytes,
            "ply": ply_bytes,
            "bin": lambda p: np.array([[*p[0], 9.0]], "<f4").tobytes(),
        }[name[-3:]](points)
        (folder / name).write_bytes(content)


def first_coordinates(folder: Path, **options: object) -> list[tuple[float, float]]:
    """(x of the pose, range) of each scan."""
    log = open_log(folder, **options)  # type: ignore[arg-type]
    return [(float(s.map_from_sensor.translation[0]), float(s.ranges[0])) for s in log]


@pytest.mark.parametrize("suffix", ["pcd", "ply", "bin"])
@pytest.mark.parametrize("poses", ["poses.txt", "poses_kitti.txt"])
def test_scans_and_poses_match_in_the_order_of_numbers(
    tmp_path: Path, suffix: str, poses: str
) -> None:
    fill(tmp_path, [f"scan{i}.{suffix}" for i in (2, 9, 10, 100)])
    (tmp_path / poses).write_text(kitti(4))
    assert first_coordinates(tmp_path) == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert [scan.stamp_ns for scan in open_log(tmp_path)] == [None] * 4
    (tmp_path / "times.txt").write_text("1\n2\n3\n4.5\n")
    assert [scan.stamp_ns for scan in open_log(tmp_path)][3] == 4_500_000_000


def test_counts_that_differ_are_both_named(tmp_path: Path) -> None:
    fill(tmp_path, ["a0.pcd", "a1.pcd", "a2.pcd"])
    poses = tmp_path / "poses.txt"
    poses.write_text(kitti(4))
    with pytest.raises(InputError) as caught:
        open_log(tmp_path, skip_bad=True)
    assert str(caught.value).startswith(f"{tmp_path}: 3 scans and 4 poses in {poses}: ")
    poses.write_text(kitti(3))
    times = tmp_path / "t.txt"
    times.write_text("1\n2\n")
    with pytest.raises(InputError, match=r"t\.txt has 2 times for 3 scans: give one time for each"):
        open_log(tmp_path, times=times)
    poses.write_text(tum([1, 2]))
    with pytest.raises(InputError, match=r"3 scans and 2 poses in .*give one time for each scan"):
        open_log(tmp_path)


def test_poses_by_stamp_are_interpolated_within_the_tolerance(tmp_path: Path) -> None:
    fill(tmp_path, ["0.pcd", "1.pcd"])
    (tmp_path / "groundtruth.txt").write_text(tum([1, 1.02, 1.04, 9]))
    (tmp_path / "times.txt").write_text("1.01\n1.035\n")
    np.testing.assert_allclose(first_coordinates(tmp_path), [(1.01, 1), (1.035, 2)], rtol=1e-12)
    (tmp_path / "times.txt").write_text("1.01\n1.07\n")
    with pytest.raises(InputError, match=r"no pose within 0\.02 s of stamp 1\.07, .* 0\.03 s away"):
        first_coordinates(tmp_path)
    assert len(first_coordinates(tmp_path, tolerance_s=0.03)) == 2
    log = open_log(tmp_path, skip_bad=True)
    assert len(list(log)) == 1
    assert log.skipped == {"scan.no_pose": 1}


def test_stamps_come_from_names_that_are_times(tmp_path: Path) -> None:
    # 9.25 is before 9.5, though 25 is more than 5.
    fill(tmp_path, ["9.25.pcd", "9.5.pcd", "10.0.pcd"])
    (tmp_path / "poses_tum.txt").write_text(tum([9, 9.5, 10]))
    found = first_coordinates(tmp_path, tolerance_s=0.3)
    assert found == [(9.25, 1), (9.5, 2), (10, 3)]
    # KITTI poses at times of their own.
    (tmp_path / "poses_tum.txt").unlink()
    (tmp_path / "poses.txt").write_text(kitti(2))
    (tmp_path / "times.txt").write_text("9\n10\n")
    found = first_coordinates(tmp_path, tolerance_s=0.5)
    assert found == [(0.25, 1), (0.5, 2), (1, 3)]


def test_names_of_seconds_and_nanoseconds_without_the_zeros_between(tmp_path: Path) -> None:
    fill(tmp_path, ["1600000000.20000000.pcd", "1600000000.120000000.pcd", "1600000001.3.pcd"])
    (tmp_path / "poses.txt").write_text(
        "1600000000.02 1 0 0 0 0 0 1\n1600000000.12 2 0 0 0 0 0 1\n1600000001 3 0 0 0 0 0 1\n"
    )
    assert first_coordinates(tmp_path) == [(1, 1), (2, 2), (3, 3)]
    assert [scan.stamp_ns for scan in open_log(tmp_path)] == [
        1600000000_020000000, 1600000000_120000000, 1600000001_000000003
    ]  # fmt: skip
    # Filled with zeros, or stripped of them: fractions.
    for name in ("1600000000.050000000", "1600000000.05"):
        folder = tmp_path / name
        folder.mkdir()
        fill(folder, ["1600000000.123456789.pcd", f"{name}.pcd"])
        (folder / "poses.txt").write_text(kitti(2))
        stamps = [scan.stamp_ns for scan in open_log(folder)]
        assert stamps == [1600000000_050000000, 1600000000_123456789]


def test_names_that_may_be_either_are_a_question(tmp_path: Path) -> None:
    fill(tmp_path, ["1600000000.123456789.pcd", "1600000000.23456781.pcd"])
    (tmp_path / "poses.txt").write_text(kitti(2))
    with pytest.raises(InputError, match=r"nanoseconds without the zeros between: say .* --times"):
        open_log(tmp_path)
    (tmp_path / "times.txt").write_text("1\n2\n")
    assert [scan.stamp_ns for scan in open_log(tmp_path)] == [10**9, 2 * 10**9]


def test_names_of_whole_nanoseconds_are_times(tmp_path: Path) -> None:
    fill(tmp_path, ["1600000000120000000.pcd", "1600000000220000000.pcd"])
    (tmp_path / "poses.txt").write_text(tum([1600000000, 1600000001]))
    with pytest.raises(InputError, match=r"no pose within 0\.02 s of stamp 1600000000\.12"):
        first_coordinates(tmp_path)
    assert len(first_coordinates(tmp_path, tolerance_s=1.0)) == 2


def test_a_part_of_a_sequence_is_matched_by_the_numbers_in_its_names(tmp_path: Path) -> None:
    fill(tmp_path, ["000004.pcd", "000002.pcd"])
    (tmp_path / "poses.txt").write_text(kitti(6))
    (tmp_path / "times.txt").write_text("0\n1\n2\n3\n4.5\n5\n")
    assert first_coordinates(tmp_path) == [(2, 2), (4, 1)]
    log = open_log(tmp_path)
    assert [scan.stamp_ns for scan in log] == [2_000_000_000, 4_500_000_000]
    assert [note.code for note in log.notes] == ["pose.by_number"]
    (tmp_path / "times.txt").unlink()
    (tmp_path / "poses.txt").write_text(kitti(4))
    with pytest.raises(InputError, match="2 scans and 4 poses"):
        open_log(tmp_path)
    # As many poses as scans: their order, as ever.
    (tmp_path / "poses.txt").write_text(kitti(2))
    assert first_coordinates(tmp_path) == [(0, 2), (1, 1)]
    # Poses that are numbered themselves: of these scans, whatever the counts.
    (tmp_path / "poses.txt").write_text("2 1 0 0 7 0 1 0 0 0 0 1 0\n4 1 0 0 9 0 1 0 0 0 0 1 0\n")
    assert first_coordinates(tmp_path) == [(7, 2), (9, 1)]
    fill(tmp_path, ["000003.pcd"])
    with pytest.raises(InputError, match=r"no pose of the number of 000003\.pcd"):
        first_coordinates(tmp_path)
    log = open_log(tmp_path, skip_bad=True)
    assert len(list(log)) == 2
    assert log.skipped == {"scan.no_pose": 1}


def test_stamped_poses_and_unstamped_scans_match_by_order_and_say_so(tmp_path: Path) -> None:
    fill(tmp_path, ["000005.pcd", "000006.pcd"])
    (tmp_path / "poses.txt").write_text(tum([3, 4]))
    log = open_log(tmp_path)
    assert [scan.stamp_ns for scan in log] == [3_000_000_000, 4_000_000_000]
    assert log.notes == ("the scans have no stamps: poses are taken in their order, one per scan",)


def test_extrinsics_and_poses_given_by_hand(tmp_path: Path) -> None:
    fill(tmp_path, ["0.pcd", "1.pcd"])
    (tmp_path / "elsewhere.txt").write_text(kitti(2))
    for poses in (tmp_path / "elsewhere.txt", read_trajectory(tmp_path / "elsewhere.txt")):
        scan = list(open_log(tmp_path, poses=poses, body_from_sensor=BODY_FROM_SENSOR))[1]
        end = scan.map_from_sensor.transform(end_points(scan))
        np.testing.assert_allclose(end, [[1.0, 2.0, 2.0]], atol=1e-15)


def test_viewpoints_are_poses_where_there_is_no_file(tmp_path: Path) -> None:
    fill(tmp_path, ["0.pcd", "1.pcd"])
    with pytest.raises(InputError, match=r"2 scans without poses .*VIEWPOINT is the identity"):
        open_log(tmp_path)
    (tmp_path / "1.pcd").write_bytes(pcd_bytes(np.ones((1, 3)), viewpoint="5 0 0 1 0 0 0"))
    log = open_log(tmp_path, body_from_sensor=BODY_FROM_SENSOR, points_in="sensor")
    assert [s.map_from_sensor.translation.tolist() for s in log] == [[0, 0, 2], [5, 0, 2]]
    assert log.notes[0].startswith("VIEWPOINT is taken")
    (tmp_path / "poses.txt").write_text(kitti(2))
    assert [x for x, _ in first_coordinates(tmp_path)] == [0, 1]


def test_two_files_of_poses_are_a_question(tmp_path: Path) -> None:
    fill(tmp_path, ["0.ply"])
    with pytest.raises(
        InputError, match=r"1 scans without poses \(poses\.txt or .*would be read\)"
    ):
        open_log(tmp_path)
    for name in ("poses.txt", "groundtruth.txt"):
        (tmp_path / name).write_text(kitti(1))
    with pytest.raises(InputError, match=r"poses in poses\.txt and groundtruth\.txt: say which"):
        open_log(tmp_path)
    assert len(open_log(tmp_path, poses=tmp_path / "poses.txt")) == 1


def test_one_broken_file_is_an_error_or_a_counted_skip(tmp_path: Path) -> None:
    fill(tmp_path, ["0.bin", "1.bin", "2.bin"])
    (tmp_path / "poses.txt").write_text(kitti(3))
    (tmp_path / "1.bin").write_bytes(bytes(20))
    log = open_log(tmp_path)
    scans = iter(log)
    next(scans)
    with pytest.raises(InputError) as caught:
        next(scans)
    assert str(caught.value).startswith(
        f"{tmp_path / '1.bin'}: 20 bytes, which is not a multiple of 16"
    )
    log = open_log(tmp_path, skip_bad=True)
    assert not log.skipped  # nothing has been read yet
    for _ in range(2):  # read again, it is not counted again
        assert [scan.ranges[0] for scan in log] == [1, 3]
        assert log.skipped == {"scan.unreadable": 1}
    assert len(log) == 3
    assert log.notes[0].startswith("1 scan was skipped: ")


def test_a_scan_is_read_when_it_is_asked_for(tmp_path: Path) -> None:
    fill(tmp_path, ["0.pcd", "1.pcd"])
    (tmp_path / "poses.txt").write_text(kitti(2))
    log = open_log(tmp_path)
    (tmp_path / "1.pcd").write_bytes(pcd_bytes(np.array([[7.0, 0, 0]])))
    assert [scan.ranges[0] for scan in log] == [1, 7]
    (tmp_path / "0.pcd").unlink()
    with pytest.raises(InputError, match=r"0\.pcd: no such file"):
        next(iter(log))


def test_points_that_are_all_nan_are_counted_by_the_sensor(tmp_path: Path) -> None:
    from oddsmap.sensors.beam import BeamSensor

    fill(tmp_path, ["0.pcd"])
    (tmp_path / "1.pcd").write_bytes(pcd_bytes(np.full((5, 3), np.nan)))
    (tmp_path / "poses.txt").write_text(kitti(2))
    _, skipped = BeamSensor().segments(list(open_log(tmp_path)))
    assert skipped == {"beam.nan": 5, "scan.empty": 1}
