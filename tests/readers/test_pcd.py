# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.readers import open_log
from oddsmap.readers.lzf import decompress
from tests.readers.clouds import end_points, lzf_literals, pcd_bytes

ENCODINGS = ("ascii", "binary", "binary_compressed")
POINTS = np.array([[1.1, -2.2, 3.3], [np.nan, 1.0, 2.0], [0.0, 0.0, 0.0], [40.0, 0.5, -1e-3]])
FIELDS = (
    ("rgb", "U", 4, 1),
    ("z", "F", 8, 1),
    ("_", "U", 1, 3),
    ("x", "F", 4, 1),
    ("_", "I", 2, 1),
    ("y", "F", 4, 1),
)
TURN = "10 20 30 0 0 0 1"  # half a turn about z, w first


def write(folder: Path, content: bytes) -> Path:
    path = folder / "cloud.pcd"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_each_encoding_holds_the_same_points(tmp_path: Path, encoding: str, newline: str) -> None:
    path = write(tmp_path, pcd_bytes(POINTS, encoding, fields=FIELDS, newline=newline))
    (scan,) = open_log(path)
    expected = POINTS.copy()
    expected[:, :2] = expected[:, :2].astype(np.float32)
    points = end_points(scan)
    np.testing.assert_allclose(points[[0, 2, 3]], expected[[0, 2, 3]], rtol=1e-15, atol=0)
    assert np.isnan(scan.ranges).tolist() == [False, True, False, False]
    assert scan.ranges[2] == 0.0
    np.testing.assert_array_equal(scan.directions[1:3], [[1, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(scan.map_from_sensor.translation, [0, 0, 0])


def test_text_of_a_4_byte_field_is_rounded_to_4_bytes(tmp_path: Path) -> None:
    content = pcd_bytes(np.ones((1, 3)), "ascii").replace(b"1.0 1.0 1.0", b"0.1 0 0")
    (scan,) = open_log(write(tmp_path, content))
    assert scan.ranges[0] == np.float32(0.1)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_header_that_promises_more_says_both_numbers(tmp_path: Path, encoding: str) -> None:
    path = write(tmp_path, pcd_bytes(POINTS, encoding, promised=9))
    with pytest.raises(InputError) as caught:
        open_log(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: the header promises 9 points")
    assert "the file holds 4" in message.replace("48 bytes of them (4 points)", "4")
    assert "the file again" in message
    assert "\n" not in message


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_file_that_holds_more_than_promised_says_both_numbers(
    tmp_path: Path, encoding: str
) -> None:
    path = write(tmp_path, pcd_bytes(POINTS, encoding, promised=2))
    with pytest.raises(InputError, match="the header promises 2 points, the file holds 4"):
        open_log(path)


@pytest.mark.parametrize("pad", [1, 11, 12, 4096])
def test_zeros_after_the_last_point_are_padding(tmp_path: Path, pad: int) -> None:
    """PCL before 1.9 fills binary files to a whole page."""
    plain = pcd_bytes(POINTS, fields=FIELDS)
    (expected,) = open_log(write(tmp_path, plain))
    log = open_log(write(tmp_path, plain + bytes(pad)))
    (scan,) = log
    np.testing.assert_array_equal(scan.ranges, expected.ranges)
    assert [note.code for note in log.notes] == ["cloud.padding", "pose.assumed"]
    assert log.notes[0].startswith(f"{pad} zero bytes after the last point were left out")
    with pytest.raises(InputError, match="the header promises 4 points, the file holds"):
        open_log(write(tmp_path, plain + bytes(4095) + b"\x01"))
    with pytest.raises(InputError, match="the header promises 4 points, the file holds 3"):
        open_log(write(tmp_path, plain[:-1]))


def test_the_padding_of_a_folder_is_one_note(tmp_path: Path) -> None:
    for i in range(3):
        content = pcd_bytes(POINTS) + bytes(100 * (i > 0))
        (tmp_path / f"{i}.pcd").write_bytes(content)
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    log = open_log(tmp_path)
    for _ in range(2):
        assert len(list(log)) == 3
    (note,) = log.notes
    assert note == (
        f"2 files, the first {tmp_path / '1.pcd'}: 100 zero bytes after the last point were left "
        "out: PCL before 1.9 adds them"
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("encoding", ENCODINGS[1:])
def test_bytes_that_are_a_signalling_nan_are_nan(tmp_path: Path, encoding: str) -> None:
    content = pcd_bytes(np.full((2, 3), 7.0), encoding)
    seven = struct.pack("<f", 7.0)
    assert seven in content
    (scan,) = open_log(write(tmp_path, content.replace(seven, b"\x01\x00\xa0\x7f")))
    assert np.isnan(scan.ranges).all()


def test_headers_of_absurd_sizes_are_one_line(tmp_path: Path) -> None:
    many = b"9" * 5000
    for old, new in (
        (b"WIDTH 4", b"WIDTH " + many),
        (b"COUNT 1 1 1", b"COUNT 1 1 " + many),
        (b"SIZE 4 4 4", b"SIZE 4 4 " + many),
    ):
        for encoding in ENCODINGS:
            path = write(tmp_path, pcd_bytes(POINTS, encoding).replace(old, new))
            with pytest.raises(
                InputError, match="whole numbers are expected, of up to 18"
            ) as caught:
                open_log(path)
            assert len(str(caught.value)) < 250
    # A record longer than any file, which nothing bounds where there are no points.
    fields = ("x", "F", 4, 1), ("y", "F", 4, 1), ("z", "F", 4, 1), ("w", "F", 8, 10**17)
    for encoding in ENCODINGS:
        content = pcd_bytes(np.empty((0, 3)), encoding, fields=fields)
        (scan,) = open_log(write(tmp_path, content))
        assert scan.size == 0
        path = write(tmp_path, content.replace(b"WIDTH 0", b"WIDTH 5").replace(b"S 0", b"S 5"))
        with pytest.raises(InputError, match="promises 5 points"):
            open_log(path)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_no_points_are_an_empty_scan(tmp_path: Path, encoding: str) -> None:
    (scan,) = open_log(write(tmp_path, pcd_bytes(np.empty((0, 3)), encoding)))
    assert scan.ranges.shape == (0,)


def test_viewpoint_is_the_pose_and_w_comes_first(tmp_path: Path) -> None:
    path = write(tmp_path, pcd_bytes(np.array([[1.0, 2, 3]]), viewpoint=TURN))
    log = open_log(path, points_in="sensor")
    (scan,) = log
    np.testing.assert_allclose(
        scan.map_from_sensor.transform(end_points(scan)), [[9.0, 18.0, 33.0]], rtol=1e-12
    )
    assert log.notes[0].startswith("VIEWPOINT is taken for the pose of the sensor")


@pytest.mark.parametrize("viewpoint", [None, "0 0 0 1 0 0 0", "0 0 0 0 0 0 0"])
def test_no_viewpoint_is_said(tmp_path: Path, viewpoint: str | None) -> None:
    log = open_log(write(tmp_path, pcd_bytes(POINTS, viewpoint=viewpoint)))
    assert log.notes == ("no pose: the frame of the sensor is taken for the map frame",)


def test_a_pose_file_wins_over_viewpoint(tmp_path: Path) -> None:
    path = write(tmp_path, pcd_bytes(POINTS, viewpoint=TURN))
    poses = tmp_path / "p.txt"
    poses.write_text("12.5 1 2 3 0 0 0 1\n")
    (scan,) = open_log(path, poses=poses)
    np.testing.assert_array_equal(scan.map_from_sensor.translation, [1, 2, 3])
    assert scan.stamp_ns == 12_500_000_000
    poses.write_text("12.5 1 2 3 0 0 0 1\n" * 2)
    with pytest.raises(InputError, match=r"1 scans and 2 poses in .*p\.txt"):
        open_log(path, poses=poses)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"FIELDS x y z", b"FIELDS x y i", "0 x `z`: a scan needs x, y and z"),
        (b"FIELDS x y z", b"FIELDS x x y", "2 x `x`"),
        (b"TYPE F F F", b"TYPE F F I", "field `z` has TYPE I SIZE 4 COUNT 1: it must be one float"),
        (b"TYPE F F F", b"TYPE F F", "TYPE has 2 values for 3 FIELDS"),
        (b"TYPE F F F", b"TYPE F F " + b"9" * 5000, "field `z` has TYPE 9{20} SIZE 4 COUNT 1: it"),
        (b"SIZE 4 4 4", b"SIZE 4 4 2", "field `z` has TYPE F SIZE 2"),
        (b"SIZE 4 4 4", b"SIZE 4 4 -4", "whole numbers are expected"),
        (b"SIZE 4 4 4\n", b"", "no SIZE line"),
        (b"COUNT 1 1 1", b"COUNT 1 1", "COUNT has 2 values for 3 FIELDS"),
        (b"HEIGHT 1", b"HEIGHT 3", "POINTS 4, but WIDTH x HEIGHT is 12"),
        (b"DATA binary", b"DATA zip", "DATA 'zip' is unknown: write ascii"),
        (b"0 0 0 1 0 0 0", b"0 0 0 1 0 0", "seven numbers are expected"),
        (b"0 0 0 1 0 0 0", b"0 0 0 2 0 0 0", "VIEWPOINT .* unit quaternion, got norm 2"),
        (b"0 0 0 1 0 0 0", b"nan 0 0 1 0 0 0", "VIEWPOINT is not finite"),
        (b"WIDTH 4\nHEIGHT 1\n", b"", None),
        (b"POINTS 4\n", b"", None),
    ],
)
def test_headers(tmp_path: Path, old: bytes, new: bytes, message: str | None) -> None:
    content = pcd_bytes(POINTS)
    assert old in content
    path = write(tmp_path, content.replace(old, new))
    if message is None:
        assert len(next(iter(open_log(path))).ranges) == 4
        return
    with pytest.raises(InputError, match=message) as caught:
        open_log(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_bad_line_of_text_is_named(tmp_path: Path) -> None:
    content = pcd_bytes(np.ones((3, 3)), "ascii")
    line = content.count(b"\n")  # the last
    rows = content.rsplit(b"\n", 2)[0] + b"\n"
    for bad, message in (
        (b"1 2\n", "2 values where the header announces 3"),
        (b"1 2 x\n", "'x' is not a number"),
        (b"1 2 1_0\n", "'1_0' is not"),
    ):
        path = write(tmp_path, rows + bad)
        with pytest.raises(InputError) as caught:
            open_log(path)
        assert str(caught.value).startswith(f"{path}:{line}: {message}")


def test_a_header_without_end(tmp_path: Path) -> None:
    path = write(tmp_path, pcd_bytes(POINTS).split(b"DATA")[0])
    with pytest.raises(InputError, match="the PCD header has no DATA line"):
        open_log(path)


def test_a_truncated_gzip_is_refused(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(5000, 3))
    path = write(tmp_path, gzip.compress(pcd_bytes(points))[:20_000])
    with pytest.raises(InputError, match="truncated gzip"):
        open_log(path)
    with pytest.raises(InputError, match="promises 5000 points, the file holds 1"):
        open_log(path, skip_bad=True)


def test_corrupt_compressed_points(tmp_path: Path) -> None:
    content = pcd_bytes(POINTS, "binary_compressed")
    head, body = content.split(b"binary_compressed\n")
    packed = bytearray(body)
    packed[8] = 0xFF  # a reference to bytes before the start
    for bad, message in (
        (body[:-3], r"announces 50 compressed bytes, the file holds 47"),
        (body[:5], r"promises 4 points of 12 bytes, the file holds 0 bytes"),
        (bytes(packed), "corrupt compressed points .it refers to bytes before its start."),
    ):
        path = write(tmp_path, head + b"binary_compressed\n" + bad)
        with pytest.raises(InputError, match=message):
            open_log(path)


def test_lzf_undoes_what_liblzf_wrote() -> None:
    # By python-lzf 0.2.6 (liblzf): short, long and overlapping runs.
    packed = bytes.fromhex(
        "086f6464736d6170206fe0ff07e176070061e0ff00e01a001f000102030405060708090a0b0c0d0e0f1011121314"
        "15161718191a1b1c1d1e1f072021222324252627c1d322e7"
    )
    plain = b"oddsmap " * 50 + b"a" * 300 + bytes(range(40)) + b"oddsmap map"
    assert decompress(packed, len(plain)).tobytes() == plain
    with pytest.raises(ValueError, match="more than 300 bytes, 300 are announced"):
        decompress(packed, 300)
    with pytest.raises(ValueError, match="it holds 9 bytes, 10 are announced"):
        decompress(lzf_literals(b"123456789"), 10)
    for cut in (5, 11, 12):
        with pytest.raises(ValueError, match="it ends within a run"):
            decompress(packed[:cut], len(plain))


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "scans", "beams", "first_stamp", "farthest"),
    [
        ("hku1_avia", 105, 536_276, 1577836980_099104600, 245.5135),
        ("hall_os0", 30, 756_991, 1630577758_569490000, 52.1219),
    ],
)
def test_real_folders(
    data_folder: Path, name: str, scans: int, beams: int, first_stamp: int, farthest: float
) -> None:
    log = open_log(data_folder / "lidar3d" / name)
    assert log.format == "folder of PCD scans"
    assert len(log) == scans
    read = list(log)
    assert sum(len(scan.ranges) for scan in read) == beams
    assert read[0].stamp_ns == first_stamp
    assert max(float(scan.ranges.max()) for scan in read) == pytest.approx(farthest, abs=1e-4)
    assert all(np.isfinite(scan.ranges).all() for scan in read)
    assert not log.skipped
    # Against a reader in two lines: the header ends at DATA, x y z come first.
    path = data_folder / "lidar3d" / name / "000007.pcd"
    body = path.read_bytes().split(b"DATA binary\n", 1)[1]
    n = len(read[7].ranges)
    raw = np.array([struct.unpack_from("<3f", body, i * (len(body) // n)) for i in range(0, n, 97)])
    np.testing.assert_allclose(end_points(read[7])[::97], raw, rtol=1e-15, atol=1e-15)
    rows = np.loadtxt(data_folder / "lidar3d" / name / "poses_kitti.txt").reshape(-1, 3, 4)
    np.testing.assert_array_equal(read[7].map_from_sensor.translation, rows[7, :, 3])
