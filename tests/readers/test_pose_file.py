# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.readers.pose_file import read_pose_matrix, read_times, read_trajectory

KITTI = "1 0 0 10 0 1 0 20 0 0 1 30"
TURNED = "0 -1 0 1 1 0 0 2 0 0 1 3"  # x ahead becomes y


def write(folder: Path, text: str, name: str = "p.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_kitti_rows_are_row_major(tmp_path: Path) -> None:
    poses = read_trajectory(write(tmp_path, f"# x\n{KITTI}\n\n{TURNED}\n"))
    assert len(poses) == 2
    assert poses.stamps_ns is None
    np.testing.assert_array_equal(poses[1].transform(np.array([[1.0, 0, 0]])), [[1, 3, 3]])
    np.testing.assert_array_equal(poses.positions[0], [10, 20, 30])


def test_times_keep_every_nanosecond(tmp_path: Path) -> None:
    path = write(tmp_path, f"{KITTI}\n{TURNED}\n")
    times = write(tmp_path, "1577836980.099104601\n1.036224e-01\n", "times.txt")
    stamps = read_trajectory(path, times=times).stamps_ns
    assert stamps is not None
    assert stamps.tolist() == [1577836980_099104601, 103_622_400]


def test_tum_has_the_scalar_part_last(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    poses = read_trajectory(write(tmp_path, f"2.5 1 2 3 0 0 {half:.9f} {half:.9f}\n"))
    assert poses.stamps_ns is not None
    assert poses.stamps_ns.tolist() == [2_500_000_000]
    np.testing.assert_allclose(poses[0].transform(np.array([[1.0, 0, 0]])), [[1, 3, 3]], atol=1e-8)


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        (KITTI[:-3], ":1", "11 numbers: a pose has 12 (KITTI: 3 x 4, row-major) or 8"),
        (f"{KITTI}\n\n{KITTI[:-3]}", ":3", "11 numbers where the first pose has 12"),
        (f"{KITTI}\n{KITTI[:-2]}nan", ":2", "'nan' is not a finite number: take the row out"),
        (f"{KITTI}\n{KITTI[:-2]}x", ":2", "'x' is not a number"),
        (f"{KITTI}\n{KITTI[:-2]}1_0", ":2", "'1_0' is not a number"),
        (f"{KITTI}\n-{KITTI}", ":2", "a rotation matrix is left-handed"),
        (f"{KITTI}\n2{KITTI[1:]}", ":2", "a rotation matrix is not orthonormal (off by 3)"),
        (
            "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1.1",
            ":2",
            "a rotation needs a unit quaternion, got norm 1.1",
        ),
        ("1 0 0 0 0 0 0 1\nt 0 0 0 0 0 0 1", ":2", "'t' is not a number"),
        ("1 0 0 0 0 0 0 1\n1e30 0 0 0 0 0 0 1", ":2", "'1e30' is not a time in seconds that fits"),
        ("# nothing\n", "", "no poses"),
    ],
)
def test_a_bad_pose_is_one_line_with_its_place(
    tmp_path: Path, text: str, where: str, message: str
) -> None:
    path = write(tmp_path, text + "\n")
    with pytest.raises(InputError) as caught:
        read_trajectory(path)
    assert str(caught.value).startswith(f"{path}{where}: {message}")
    assert "\n" not in str(caught.value)


def test_times_that_do_not_fit(tmp_path: Path) -> None:
    kitti = write(tmp_path, f"{KITTI}\n{KITTI}\n")
    times = write(tmp_path, "1\n2\n3\n", "times.txt")
    with pytest.raises(InputError, match=r"times\.txt: 3 times for the 2 poses of .*p\.txt"):
        read_trajectory(kitti, times=times)
    tum = write(tmp_path, "1 0 0 0 0 0 0 1\n", "tum.txt")
    with pytest.raises(InputError, match=r"tum\.txt: has stamps of its own .TUM.: leave"):
        read_trajectory(tum, times=times)
    for text, message in (("1 2\n", ":1: 2 values"), ("# 1\n", ": no times"), ("-\n", ":1: '-'")):
        with pytest.raises(InputError, match="times.txt" + message):
            read_times(write(tmp_path, text, "times.txt"))


def test_a_matrix_of_its_own(tmp_path: Path) -> None:
    path = write(tmp_path, "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n")
    np.testing.assert_array_equal(read_pose_matrix(path).translation, [1, 2, 3])
    with pytest.raises(InputError, match=r"p\.txt: a pose needs 12 or 16 numbers .*, got 4"):
        read_pose_matrix(write(tmp_path, "0 -1 0 1\n"))
    with pytest.raises(InputError, match=r"p\.txt:1: '-inf' is not a finite number"):
        read_pose_matrix(write(tmp_path, "-inf -1 0 1\n"))
