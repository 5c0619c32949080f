# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import bz2
import gzip
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers import open_log
from oddsmap.readers.registry import READERS
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.log import Log
from tests.readers.clouds import graph_bytes, pcd_bytes, ply_bytes

CARMEN_LINE = b"FLASER 2 1.0 2.0 3 4 0.5 3 4 0.5 10.5 host 11\n"


def npz_bytes() -> bytes:
    file = io.BytesIO()
    np.savez(file, beams=np.array([[1.0, 2.0, 0.0, 3.0]]), range_max=4.0)
    return file.getvalue()


@pytest.mark.parametrize("compress", [bytes, gzip.compress, bz2.compress])
@pytest.mark.parametrize(
    ("content", "name"), [(CARMEN_LINE, "CARMEN"), (npz_bytes(), "NPZ beam log")]
)
def test_the_content_decides_and_the_suffix_does_not(
    tmp_path: Path, compress: Callable[[bytes], bytes], content: bytes, name: str
) -> None:
    for suffix in ("", ".npz", ".log", ".gz"):
        path = tmp_path / f"file{suffix}"
        path.write_bytes(compress(content))
        log: Log = open_log(path)
        assert log.format == name
        assert log.path == str(path)
        assert len(log) == 1
        # An iterator that is started again begins at the beginning.
        assert [s.ranges.tolist() for s in log] == [s.ranges.tolist() for s in log]


def test_each_format_matches_one_reader_only() -> None:
    cloud = np.ones((3, 3))
    for content in (CARMEN_LINE, npz_bytes(), pcd_bytes(cloud), ply_bytes(cloud), graph_bytes()):
        assert sum(reader.matches(content) for reader in READERS) == 1


def test_a_path_may_be_text(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_bytes(CARMEN_LINE)
    assert open_log(str(tmp_path / "a.log")).path == str(tmp_path / "a.log")


@pytest.mark.parametrize(
    "content",
    [b"\x89PNG\r\n", b"hello\nFLASER", b"# a comment with FLASER 3\n", b"\n  \n", b"PK\x03\x04"],
)
def test_an_unknown_type_names_the_known_ones(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "thing.log"
    path.write_bytes(content + b" ")
    if b"\nFLASER" in content:  # the keyword alone on a line is CARMEN, and short
        with pytest.raises(InputError, match="no usable scan"):
            open_log(path)
        return
    with pytest.raises(InputError) as caught:
        open_log(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: unknown file type (it starts with b")
    known = "NPZ beam and grid logs, PCD scans, PLY scans, OctoMap scan graphs, "
    known += "g2o graphs, MRPT rawlogs, PTX scans and CARMEN logs"
    assert f"reads {known}, plain or compressed with gzip or bzip2; KITTI .bin" in message
    assert "\n" not in message


def test_the_readable_part_of_a_cut_log_counts_the_cut(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines = [CARMEN_LINE.replace(b"1.0", b"%.17f" % x) for x in rng.uniform(1, 5, 2000)]
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress(b"".join(lines))[:10_000])
    with pytest.raises(InputError, match="truncated gzip"):
        open_log(path)
    log = open_log(path, skip_bad=True)
    assert 500 < len(log) < 2000
    assert log.skipped["container.truncated"] == 1
    # The line that was cut in two is counted too, unless the cut fell between two lines.
    assert log.skipped["line.short"] <= 1
    assert log.notes[0] == "truncated gzip file: only the readable part was used"


@pytest.mark.parametrize(
    ("content", "name"), [(CARMEN_LINE, "a CARMEN log"), (npz_bytes(), "an NPZ beam log")]
)
@pytest.mark.parametrize(
    ("argument", "value", "why"),
    [
        ("poses", "poses.txt", "has poses"),
        ("times", "times.txt", "has its stamps with its poses"),
        ("body_from_sensor", Pose3(np.zeros(3), np.eye(3)), "has the poses of its sensor"),
        ("camera", PinholeCamera(1, 1, 0, 0, 2, 2), "holds no depth images"),
    ],
)
def test_a_log_with_poses_refuses_what_it_says_itself(
    tmp_path: Path, content: bytes, name: str, argument: str, value: Any, why: str
) -> None:
    path = tmp_path / "file.log"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_log(path, **{argument: value})
    assert str(caught.value) == f"{path}: {name} {why}: leave `{argument}` out for this log"


def test_a_folder_without_scans_says_what_it_holds(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no scans in this folder, found nothing: give a folder"):
        open_log(tmp_path)
    for i in range(7):
        (tmp_path / f"{i}.jpg").write_bytes(b"")
    with pytest.raises(InputError, match=r"found 0\.jpg, 1\.jpg, .*4\.jpg, \.\.\.: give a folder"):
        open_log(tmp_path)


def test_a_folder_of_two_kinds_is_refused(tmp_path: Path) -> None:
    (tmp_path / "0.pcd").write_bytes(pcd_bytes(np.ones((1, 3))))
    (tmp_path / "0.ply").write_bytes(ply_bytes(np.ones((1, 3))))
    with pytest.raises(InputError, match=r"\*\.p.. and \*\.p.. in one folder: leave one kind"):
        open_log(tmp_path)


@pytest.mark.parametrize("tolerance", [-1.0, float("nan"), float("inf")])
def test_a_tolerance_is_a_time(tmp_path: Path, tolerance: float) -> None:
    with pytest.raises(ConfigError, match="tolerance_s is a time of 0 s or more"):
        open_log(tmp_path, tolerance_s=tolerance)
