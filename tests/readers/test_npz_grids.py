# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2
from oddsmap.readers import open_log
from oddsmap.readers.compression import Source
from oddsmap.readers.npz_arrays import array_names
from oddsmap.readers.npz_grids import GridLog
from oddsmap.scans.grid_scan import GridScan

LABELS = np.array([[[0, 1, 255], [1, 1, 0]], [[255, 255, 255], [0, 0, 1]]], np.uint8)
POSES = np.array([[1.0, 2.0, 0.5], [1.5, 2.0, -0.5]])
GOOD: dict[str, Any] = {"grids": LABELS, "poses": POSES, "pixel": 0.1}


def write(tmp_path: Path, **arrays: Any) -> Path:
    path = tmp_path / "floor.npz"
    np.savez_compressed(path, **arrays)
    return path


def read(tmp_path: Path, **arrays: Any) -> GridLog:
    log = open_log(write(tmp_path, **arrays))
    assert isinstance(log, GridLog)
    return log


def test_labels_become_scans(tmp_path: Path) -> None:
    log = read(tmp_path, **GOOD, truth=np.zeros((3, 3)))
    assert log.format == "NPZ grid log"
    assert log.path == str(tmp_path / "floor.npz")
    assert log.sensor == {}
    assert log.notes == ("grids of 2 x 3 labels, pixels of 0.1 m",)
    assert not log.skipped
    assert len(log) == 2
    for _ in range(2):  # it can be started again
        first, second = log
        assert isinstance(first, GridScan)
        assert first.map_from_sensor == Pose2(1.0, 2.0, 0.5)
        assert second.map_from_sensor == Pose2(1.5, 2.0, -0.5)
        np.testing.assert_array_equal(first.seen, [[0, 1, np.nan], [1, 1, 0]])
        np.testing.assert_array_equal(second.seen, [[np.nan] * 3, [0, 0, 1]])
        assert first.resolution == 0.1
        assert first.corner == pytest.approx((-0.15, -0.1))
        assert first.stamp_ns is None


def test_corner_and_stamps(tmp_path: Path) -> None:
    stamps = np.array([7, 1_600_000_000_123_456_789])
    log = read(tmp_path, **GOOD, corner=[0.3, -0.1], stamp_ns=stamps)
    assert [scan.corner for scan in log] == [(0.3, -0.1)] * 2
    assert [scan.stamp_ns for scan in log] == stamps.tolist()
    assert type(next(iter(log)).stamp_ns) is int


@pytest.mark.parametrize(
    "kind", ["bool", "int8", "uint8", "int64", "float16", "float32", "float64"]
)
def test_any_type_of_numbers(tmp_path: Path, kind: str) -> None:
    (scan, _) = read(tmp_path, **GOOD | {"grids": (LABELS == 1).astype(kind)})
    np.testing.assert_array_equal(scan.seen, LABELS[0] == 1)


def test_probabilities(tmp_path: Path) -> None:
    grids = np.array([[[0.25, np.nan, 1.0]], [[0.0, 0.5, 0.75]]], np.float32)
    log = read(tmp_path, **GOOD | {"grids": grids})
    assert log.notes == ("grids of 1 x 3 probabilities, pixels of 0.1 m",)
    for scan, grid in zip(log, grids, strict=True):
        np.testing.assert_array_equal(scan.seen, grid)


def test_numbers_are_read_as_the_decimals_they_were(tmp_path: Path) -> None:
    (scan, _) = read(tmp_path, **GOOD | {"pixel": np.array([0.05], np.float32)})
    assert scan.resolution == 0.05
    (scan, _) = read(tmp_path, **GOOD | {"pixel": 1, "poses": np.array([[1, 2, 0], [3, 4, 0]])})
    assert scan.resolution == 1.0
    assert scan.map_from_sensor == Pose2(1.0, 2.0, 0.0)


def test_a_pose_that_is_not_finite_is_left_to_the_sensor_model(tmp_path: Path) -> None:
    poses = POSES.copy()
    poses[1, 2] = np.nan
    log = read(tmp_path, **GOOD | {"poses": poses})
    assert [scan.map_from_sensor.is_finite for scan in log] == [True, False]


def test_beams_go_before_grids(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, **GOOD, beams=np.array([[1.0, 2.0, 0.0, 3.0]])))
    assert log.format == "NPZ beam log"


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"grids": LABELS[0]}, "`grids` has shape (2, 3): it must be (n, h, w)"),
        ({"grids": LABELS[:0]}, "`grids` has shape (0, 2, 3): it must be (n, h, w), none of them"),
        ({"grids": LABELS.astype(str)}, "`grids` holds <U3: it must hold labels or numbers"),
        ({"grids": LABELS.astype(object)}, "an array in the NPZ file cannot be read"),
        (
            {"grids": np.where(LABELS == 0, 2, LABELS)},
            "`grids` holds 2 in grid 0, row 0, column 0: labels are 0 free, 1 occupied, 255 not",
        ),
        ({"grids": -LABELS.astype(np.int16)}, "`grids` holds -1 in grid 0, row 0, column 1"),
        (
            {"grids": LABELS * 1.0},
            "`grids` holds 255 in grid 0, row 0, column 2: probabilities are 0 to 1, NaN where",
        ),
        ({"grids": np.full((2, 1, 1), -np.inf)}, "`grids` holds -inf in grid 0"),
        ({"poses": None}, "no array `poses` in the NPZ file: write x, y, heading of each grid"),
        ({"poses": POSES[:1]}, "`poses` holds float64 of shape (1, 3): it must be real numbers of"),
        ({"poses": POSES.astype(str)}, "`poses` holds <U32"),
        ({"pixel": None}, "no array `pixel` in the NPZ file: write the side of a pixel"),
        ({"pixel": [0.1, 0.1]}, "`pixel` holds float64 of shape (2,): it must be one number"),
        ({"pixel": 0.0}, "`pixel` is 0: it must be positive and finite"),
        ({"pixel": np.nan}, "`pixel` is nan"),
        ({"pixel": np.inf}, "`pixel` is inf"),
        ({"corner": [0.0]}, "`corner` holds float64 of shape (1,)"),
        ({"corner": [0.0, np.nan]}, "`corner` is 0, nan: it must be finite"),
        ({"stamp_ns": [1, 2, 3]}, "`stamp_ns` holds int64 of shape (3,): it must hold one whole"),
        ({"stamp_ns": [1.0, 2.0]}, "`stamp_ns` holds float64"),
        ({"poses": POSES * np.nan}, "no usable scan, none of 2 grids has a finite pose"),
        ({"grids": np.full((2, 1, 1), 255, np.uint8)}, "no usable scan, none of 2 grids"),
        (
            {"grids": LABELS[:, :1], "poses": POSES * [[np.nan], [1.0]]},
            "no usable scan",  # one grid has a pose, the other one sees
        ),
    ],
)
def test_bad_arrays_are_refused(tmp_path: Path, arrays: dict[str, Any], words: str) -> None:
    merged = {key: value for key, value in (GOOD | arrays).items() if value is not None}
    with pytest.raises(InputError) as caught:
        read(tmp_path, **merged)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'floor.npz'}: ")
    assert words in message
    assert "\n" not in message


def test_a_damaged_file_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "floor.npz"
    np.savez(path, **GOOD)
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    with pytest.raises(InputError, match="corrupt or truncated NPZ file"):
        open_log(path)
    content = bytearray(whole)
    content[content.index(LABELS.tobytes())] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match="corrupt or truncated NPZ file"):
        open_log(path)


def test_arrays_it_does_not_know_are_not_opened(tmp_path: Path) -> None:
    assert len(read(tmp_path, **GOOD, notes=np.array([{"a": 1}], dtype=object))) == 2


def test_names_are_at_the_end_of_the_file() -> None:
    file = io.BytesIO()
    np.savez(file, big=np.zeros(100_000), grids=LABELS)
    assert array_names(Source("a.npz", file.getvalue())) == {"big", "grids"}
    for damaged in (file.getvalue()[: 64 * 1024], b"PK\x03\x04"):
        with pytest.raises(InputError, match=r"a\.npz: corrupt or truncated NPZ file"):
            array_names(Source("a.npz", damaged))
