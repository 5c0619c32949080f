# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.readers import open_log
from oddsmap.readers.plain_text import is_number, split_lines, to_number
from tests.readers.clouds import end_points, pcd_bytes, ply_bytes

POINTS = np.array([[1.0, 2.0, 3.0], [4.0, -5.0, 6.0]])
CARMEN = "FLASER 2 1.5 {} 0 0 0 0 0 0 1.0 host 1.0\n"


@pytest.mark.parametrize(
    "word",
    ["nan", "-nan", "NaN", "-nan(ind)", "nan(snan)", "nan(0x7)", "1.#QNAN", "-1.#IND00", "1.#SNAN"],
)
def test_nan_as_c_libraries_spell_it(word: str) -> None:
    assert math.isnan(to_number(word))


@pytest.mark.parametrize(
    ("word", "number"),
    [("1.#INF", math.inf), ("-1.#INF00", -math.inf), ("inf", math.inf), ("-Infinity", -math.inf)],
)
def test_infinities(word: str, number: float) -> None:
    assert to_number(word) == number


@pytest.mark.parametrize("word", ["", "1_0", "x", "nan(", "1.#", "1.#QNANx", "1,5", "٣"])
def test_what_is_no_number(word: str) -> None:
    assert not is_number(word)


def test_each_kind_of_line_end() -> None:
    for end in ("\n", "\r\n", "\r"):
        assert split_lines(f"a{end}{end}b{end}") == ["a", "", "b", ""]


def write(folder: Path, content: bytes) -> Path:
    path = folder / "log"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        pcd_bytes(POINTS, "ascii"),
        pcd_bytes(POINTS, "ascii", newline="\r"),
        pcd_bytes(POINTS, "binary"),
        pcd_bytes(POINTS, "ascii").replace(b"FIELDS x y z", b"FIELDS X Y Z"),
        ply_bytes(POINTS, "ascii"),
        ply_bytes(POINTS, "ascii").replace(b"\n", b"\r"),
        ply_bytes(POINTS, "ascii").replace(b"ply\n", b"ply \n"),
        ply_bytes(POINTS, "ascii").replace(b"end_header\n", b"end_header\n\xef\xbb\xbf"),
        ply_bytes(POINTS, "ascii").replace(b"float x", b"f4 X").replace(b"double y", b"f8 Y"),
        ply_bytes(POINTS, "binary_little_endian").replace(b"\n", b"\r", 15),
        ply_bytes(POINTS, "binary_big_endian").replace(b"short nx", b"i2 nx"),
    ],
)
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_the_same_cloud_however_its_text_is_written(
    tmp_path: Path, content: bytes, mark: bytes
) -> None:
    for packed in (mark + content, gzip.compress(mark + content)):
        (scan,) = open_log(write(tmp_path, packed))
        np.testing.assert_allclose(end_points(scan), POINTS, rtol=1e-12)


def test_a_byte_order_mark_costs_no_line_of_a_log(tmp_path: Path) -> None:
    path = write(tmp_path, b"\xef\xbb\xbf" + (CARMEN.format(2.5) * 2).encode())
    log = open_log(path)
    assert [scan.ranges.tolist() for scan in log] == [[1.5, 2.5]] * 2
    assert not log.skipped


def test_odd_nan_in_texts_is_nan(tmp_path: Path) -> None:
    (scan,) = open_log(write(tmp_path, CARMEN.format("-nan(ind)").encode()))
    np.testing.assert_array_equal(scan.ranges, [1.5, np.nan])
    content = pcd_bytes(POINTS, "ascii").replace(b"4.0 -5.0", b"1.#QNAN -nan(ind)")
    (scan,) = open_log(write(tmp_path, content))
    assert np.isnan(scan.ranges).tolist() == [False, True]


@pytest.mark.parametrize(
    "text",
    [CARMEN.format(1), pcd_bytes(POINTS, "ascii").decode(), ply_bytes(POINTS, "ascii").decode()],
)
@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf_16_is_refused_by_its_name(tmp_path: Path, text: str, encoding: str) -> None:
    path = write(tmp_path, ("\ufeff" + text).encode(encoding))
    with pytest.raises(InputError, match="log: the text is UTF-16: save it as UTF-8"):
        open_log(path)
