# SPDX-License-Identifier: Apache-2.0
"""Poses as programs and people write them: read right, or refused with the reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.readers.pose_file import PoseFile, read_pose_file, read_times
from oddsmap.readers.stamp_words import kind_of_stamps, split_stamp_ns

# Half a turn about z, and a quarter: no two orders of a quaternion agree on both.
TUM = ["0.5 1 2 3 0 0 1 0", "1.5 4 5 6 0 0 0.70710678 0.70710678"]
TURNS = [np.diag([-1.0, -1.0, 1.0]), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])]
PLACES = [[1, 2, 3], [4, 5, 6]]
KITTI = ["-1 0 0 1 0 -1 0 2 0 0 1 3", "0 -1 0 4 1 0 0 5 0 0 1 6"]


def poses_of(folder: Path, text: str, encoding: str = "utf-8") -> PoseFile:
    path = folder / "p.txt"
    path.write_bytes(text.encode(encoding))
    return read_pose_file(path)


def check(file: PoseFile, stamps: list[int] | None) -> None:
    np.testing.assert_array_equal(file.trajectory.positions, PLACES)
    np.testing.assert_allclose(file.trajectory.rotations, TURNS, atol=1e-7)
    found = file.trajectory.stamps_ns
    assert (None if found is None else found.tolist()) == stamps


def rows(lines: list[str], separator: str = " ", before: str = "", behind: str = "") -> str:
    return "".join(f"{before}{separator.join(line.split())}{behind}\n" for line in lines)


@pytest.mark.parametrize(
    "text",
    [
        rows(TUM),
        rows(TUM).replace("\n", "\r"),
        rows(TUM, ","),
        rows(TUM, ", "),
        rows(TUM, " , ", behind=","),
        rows(TUM, ";"),
        rows(TUM, "\t"),
        rows(TUM, behind=" # of the start"),
        "// t x y z\n" + rows(TUM),
        "% by a tool\n" + rows(TUM),
        "timestamp tx ty tz qx qy qz qw\n" + rows(TUM),
        "t,x,y,z,qx,qy,qz,qw\n" + rows(TUM, ","),
        "\ufeff" + rows(TUM),
        "# ground truth\n# 2 poses, in the map frame\n" + rows(TUM),
    ],
)
def test_tum_however_it_is_separated_and_commented(tmp_path: Path, text: str) -> None:
    file = poses_of(tmp_path, text)
    check(file, [500_000_000, 1_500_000_000])
    assert file.notes == ()


def test_a_header_says_which_column_is_what(tmp_path: Path) -> None:
    """EuRoC: nanoseconds, w first, velocities and biases behind."""
    header = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],"
    header += "q_RS_z [],v_RS_R_x [m s^-1]\n"
    body = "1403636579758555392,1,2,3,0,0,0,1,9,9\n1403636579763555392,4,5,6,"
    body += "0.70710678,0,0,0.70710678,9,9\n"
    check(poses_of(tmp_path, header + body), [1403636579758555392, 1403636579763555392])
    # The same for blanks, a unit in seconds, and columns in any order, without a stamp.
    text = "# qw qx qy qz x y z score\n0 0 0 1 1 2 3 9\n0.70710678 0 0 0.70710678 4 5 6 9\n"
    check(poses_of(tmp_path, text), None)
    text = "time (s) position.x position.y position.z orientation.x orientation.y orientation.z "
    text += "orientation.w\n"
    check(poses_of(tmp_path, text + rows(TUM)), [500_000_000, 1_500_000_000])


def test_whole_nanoseconds_need_no_header(tmp_path: Path) -> None:
    text = (
        rows(TUM).replace("0.5 1", "1403636579758555392 1").replace("1.5 4", "1" + "5" * 18 + " 4")
    )
    check(poses_of(tmp_path, text), [1403636579758555392, int("1" + "5" * 18)])


@pytest.mark.parametrize(
    ("text", "stamps", "doubt"),
    [
        (rows([f"{i} {row}" for i, row in enumerate(TUM)]), [500_000_000, 1_500_000_000],
         "the first of 9 numbers"),
        (rows(TUM, behind=" 0.02"), [500_000_000, 1_500_000_000], "the last of 9 numbers"),
        (rows(KITTI, behind=" 0.02"), None, "the last of 13"),
        (rows([f"{i + 0.25} {row}" for i, row in enumerate(KITTI)]), [250_000_000, 1_250_000_000],
         "the first of 13 numbers is taken for the stamp"),
        (rows(KITTI, behind=" 0 0 0 1"), None, ""),
    ],
)  # fmt: skip
def test_a_number_more_is_found_by_the_rotations(
    tmp_path: Path, text: str, stamps: list[int] | None, doubt: str
) -> None:
    file = poses_of(tmp_path, text)
    check(file, stamps)
    assert [note.severity for note in file.notes] == ["warning"] * bool(doubt)
    assert doubt in "".join(file.notes)


def test_numbered_poses(tmp_path: Path) -> None:
    for behind in ("", " 0 0 0 1"):
        text = rows([f"{i} {row}" for i, row in zip((0, 4), KITTI, strict=True)], behind=behind)
        file = poses_of(tmp_path, text)
        check(file, None)
        assert file.numbers == (0, 4)
        assert "is taken for the number of the scan" in file.notes[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,5 1,0 2 3 0 0 0 1\n", r"p\.txt:1: '0,5 1,0 .* has commas within numbers"),
        ("0,5;1,0;2;3;0;0;0;1\n", "has commas within numbers"),
        ("1 2 3 0 0 0 1\n", "7 numbers: a pose has 12 .* write a header that names the columns"),
        ("0 1 2 3 0 0 0 1 0 0\n", "10 numbers: a pose has"),
        # The quaternion may begin at either place.
        ("0 1 0 0 0 1 0 0 0\n", "9 numbers: a pose has"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1\n", "stands column by column: write 4 x 4 matrices row"),
        ("1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 2\n", "do not end with 0 0 0 1: write"),
        (
            "None None None None None None None None\n1 0 0 0 0 0 0 1\n",
            ":1: 'None' is not a number",
        ),
        (
            "# timestamp [ns] x y z qx qy qz qw\n0.5 1 2 3 0 0 0 1\n",
            "'0.5' is not a whole number of",
        ),
        ("1e999999 0 0 0 0 0 0 1\n", "'1e999999' is not a finite number"),
        ("1_0 0 0 0 0 0 0 1\n", "is not a"),
        ("9" * 5000 + " 0 0 0 0 0 0 1\n", "is not a"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        poses_of(tmp_path, text)
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


def test_utf_16_is_refused_by_its_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"p\.txt: the text is UTF-16"):
        poses_of(tmp_path, rows(TUM), "utf-16")


def test_times_of_absurd_size_are_one_line(tmp_path: Path) -> None:
    path = tmp_path / "times.txt"
    for word in ("1e999999", "-1e999999", "1e9999999", "1e99999999999999999999", "nan", "9" * 5000):
        path.write_text(f"0.5\n{word}\n")
        with pytest.raises(InputError, match=r"times\.txt:2: .* is not a time") as caught:
            read_times(path)
        assert len(str(caught.value)) < 250
    path.write_text("1e-999999\n9223372036.854775807\n")
    assert read_times(path).tolist() == [0, 2**63 - 1]


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (["9.25", "9.5", "10.0"], "decimal"),
        (["1600000000.123456", "1600000000.2"], "decimal"),
        (["1600000000.120000000", "1600000000.020000000"], "decimal"),
        (["1600000000.120000000", "1600000000.02"], "decimal"),
        (["1600000000.1200000001", "1600000000.20000000"], "decimal"),
        (["12.5", "x"], "decimal"),
        ([], "decimal"),
        (["1600000000.120000000", "1600000000.20000000"], "split"),
        (["1600000000.123456789", "1600000000.20000"], "split"),
        # Stripped of zeros, or never filled with them.
        (["1600000000.123456789", "1600000000.23456781"], "unclear"),
        (["1600000000.23456780", "1600000000.23456781"], "unclear"),
    ],
)
def test_what_follows_the_point_of_a_stamp(words: list[str], kind: str) -> None:
    assert kind_of_stamps(words) == kind


def test_split_stamps_in_texts(tmp_path: Path) -> None:
    assert split_stamp_ns("1600000000.20000000") == 1600000000_020000000
    text = rows(TUM).replace("0.5 1", "1600000000.20000000 1")
    file = poses_of(tmp_path, text.replace("1.5 4", "1600000000.120000000 4"))
    check(file, [1600000000_020000000, 1600000000_120000000])
    assert [note.code for note in file.notes] == ["stamp.split"]
