# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.readers import open_log
from tests.readers.clouds import end_points, ply_bytes

POINTS = np.array([[1.1, -2.2, 3.3], [40.0, 0.5, -1e-3], [5.0, 6.0, 7.0]])
ENCODINGS = ("ascii", "binary_little_endian", "binary_big_endian")


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_each_encoding_holds_the_same_points(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(POINTS, encoding))
    log = open_log(path)
    (scan,) = log
    expected = POINTS.copy()
    expected[:, [0, 2]] = expected[:, [0, 2]].astype(np.float32)
    np.testing.assert_allclose(end_points(scan), expected, rtol=1e-15, atol=0)
    assert log.format == "PLY scan"


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_header_that_promises_more_says_both_numbers(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(POINTS, encoding, promised=90))
    # The faces below are lines, or bytes, like any others: 39 bytes make 2 vertices.
    expected = "holds 6" if encoding == "ascii" else "holds 5"
    with pytest.raises(InputError) as caught:
        open_log(path)
    assert str(caught.value).startswith(f"{path}: the header promises 90 points, the file ")
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"element vertex", b"element vertices", "0 PLY elements `vertex`"),
        (b"float x", b"float w", "0 x `x` .red w y z nx.: a scan needs"),
        (b"float x", b"int x", "property `x` is int: it must be float or double"),
        (b"element face 3", b"element face " + b"9" * 5000, "is not a line of a PLY header"),
        (
            b"element camera 2",
            b"element camera " + b"9" * 18,
            "promises 3 points, the file holds 0",
        ),
        (b"float x", b"quad x", r"a\.ply:8: 'property quad x' is not a line of a PLY header"),
        (b"short nx", b"list uchar int nx", "a list in the PLY element `vertex`"),
        (b"double focus", b"list uchar int focus", "a list in the PLY element `camera`"),
        (b"end_header\n", b"", "not a line of a PLY header|has no end_header"),
        (b"format binary_little_endian 1.0\n", b"", "has no format line"),
        (b"binary_little_endian", b"binary_middle", "not a line of a PLY header"),
    ],
)
def test_headers(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    path = tmp_path / "a.ply"
    content = ply_bytes(POINTS)
    assert old in content
    path.write_bytes(content.replace(old, new))
    with pytest.raises(InputError, match=message) as caught:
        open_log(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_camera_is_not_read_in_silence(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply_bytes(POINTS, encoding).replace(b"double focus", b"double view_px"))
    log = open_log(path)
    assert [note.code for note in log.notes] == ["cloud.camera", "pose.assumed"]
    path.write_bytes(ply_bytes(POINTS, encoding))
    assert [note.code for note in open_log(path).notes] == ["pose.assumed"]


def test_a_bad_line_of_text_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    content = ply_bytes(POINTS, "ascii")
    path.write_bytes(content.replace(b"200 40.0 ", b"200 forty "))
    line = content[: content.index(b"200 40.0")].count(b"\n") + 1
    with pytest.raises(InputError, match=f"a.ply:{line}: 'forty' is not a number"):
        open_log(path)
