# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.readers import open_log
from oddsmap.readers.npz_beams import matches
from oddsmap.scans.log import Log

# Three positions, the last like the first.
BEAMS = np.array(
    [
        [1.0, 2.0, 0.0, 3.0],
        [1.0, 2.0, math.pi / 2, 4.0],
        [1.0, 2.5, 0.5, 1.0],
        [1.0, 2.0, 1.0, 5.0],
    ]
)


def read(tmp_path: Path, **arrays: Any) -> Log:
    path = tmp_path / "room.npz"
    np.savez_compressed(path, **arrays)
    return open_log(path)


def refused(tmp_path: Path, **arrays: Any) -> str:
    with pytest.raises(InputError) as caught:
        read(tmp_path, **arrays)
    message = str(caught.value)
    path = str(tmp_path / "room.npz")
    assert message.startswith(path + ": ")
    assert "\n" not in message
    return message.removeprefix(path + ": ")


def test_consecutive_beams_of_one_position_are_one_scan(tmp_path: Path) -> None:
    log = read(tmp_path, beams=BEAMS, range_max=4.0, truth=np.zeros((3, 3), bool), resolution=0.1)
    assert log.format == "NPZ beam log"
    assert [len(scan.ranges) for scan in log] == [2, 1, 1]
    first, second, third = log
    assert first.map_from_sensor == third.map_from_sensor == Pose2(1.0, 2.0, 0.0)
    assert second.map_from_sensor == Pose2(1.0, 2.5, 0.0)
    np.testing.assert_allclose(first.directions, [[1, 0], [0, 1]], atol=1e-15)
    np.testing.assert_allclose(second.directions, [[math.cos(0.5), math.sin(0.5)]])
    assert [scan.stamp_ns for scan in log] == [None] * 3
    assert not log.skipped


def test_ranges_at_or_above_range_max_are_nothing_seen(tmp_path: Path) -> None:
    log = read(tmp_path, beams=BEAMS, range_max=4.0)
    assert [scan.ranges.tolist() for scan in log] == [[3.0, math.inf], [1.0], [math.inf]]
    assert log.sensor == {"range_max": 4.0}
    assert log.notes == ("2 of 4 ranges are at or above range_max 4 m: read as 'nothing seen'",)


@pytest.mark.parametrize("beam_type", ["float32", "float64"])
@pytest.mark.parametrize("limit_type", ["float32", "float64"])
@pytest.mark.parametrize("range_max", [4.1, 81.83])  # as float32 one is less, the other more
def test_range_max_is_met_in_any_precision(
    tmp_path: Path, beam_type: str, limit_type: str, range_max: float
) -> None:
    beams = np.zeros((2, 4), dtype=beam_type)
    beams[:, 3] = [range_max, range_max - 0.01]
    (scan,) = log = read(tmp_path, beams=beams, range_max=np.array(range_max, limit_type))
    assert np.isinf(scan.ranges).tolist() == [True, False]
    assert log.sensor == {"range_max": range_max}


def test_without_range_max_nothing_is_far(tmp_path: Path) -> None:
    log = read(tmp_path, beams=BEAMS)
    assert np.concatenate([scan.ranges for scan in log]).tolist() == [3.0, 4.0, 1.0, 5.0]
    assert log.sensor == {}
    assert log.notes == ("no `range_max` in the file: every finite range is read as a return",)


def test_other_special_ranges_survive(tmp_path: Path) -> None:
    beams = np.zeros((3, 4))
    beams[:, 3] = [np.nan, -np.inf, np.inf]
    (scan,) = read(tmp_path, beams=beams, range_max=4.0)
    np.testing.assert_array_equal(scan.ranges, [np.nan, -np.inf, np.inf])


def test_rates_are_read_as_the_decimals_they_were(tmp_path: Path) -> None:
    log = read(
        tmp_path,
        beams=BEAMS.astype(np.float32),
        range_max=np.float32(4),
        p_random=np.float32(0.03),
        p_dropout=np.array([0.1]),
        cone_deg=1.0,
    )
    assert log.sensor == {"range_max": 4.0, "p_random": 0.03, "p_dropout": 0.1}


def test_scan_numbers_group_beams_in_order_of_first_occurrence(tmp_path: Path) -> None:
    beams = np.zeros((5, 4))
    beams[:, 3] = [1, 2, 3, 4, 5]
    beams[[1, 3], 0] = 7.0
    log = read(tmp_path, beams=beams, scan=np.array([9, 2, 9, 2, 4]))
    assert [scan.ranges.tolist() for scan in log] == [[1, 3], [2, 4], [5]]
    assert [scan.map_from_sensor.translation[0] for scan in log] == [0.0, 7.0, 0.0]


def test_beams_of_a_scan_keep_their_order(tmp_path: Path) -> None:
    # Enough of them that a sort that is not stable would mix them up.
    beams = np.zeros((2000, 4))
    beams[:, 3] = np.arange(2000)
    even, odd = read(tmp_path, beams=beams, scan=np.arange(2000) % 2)
    assert even.ranges.tolist() == list(range(0, 2000, 2))
    assert odd.ranges.tolist() == list(range(1, 2000, 2))


def test_a_scan_at_two_positions_is_named(tmp_path: Path) -> None:
    message = refused(tmp_path, beams=BEAMS, scan=np.array([3, 3, 3, 8]))
    assert message.startswith("scan 3 has beams at two positions, (1, 2) and (1, 2.5): ")
    assert "give beams" in message


@pytest.mark.parametrize("kind", ["int64", "uint64"])
def test_stamps(tmp_path: Path, kind: str) -> None:
    """Beams of one place are scans of their own where their times differ."""
    standing = np.repeat(BEAMS[:1], 5, axis=0)
    standing[2, 0] = np.nan
    stamps = np.array([5, 5, 6, 7, 5], kind) + np.array(10**18, kind)
    log = read(tmp_path, beams=standing, stamp_ns=stamps)
    assert [(scan.stamp_ns, scan.size) for scan in log] == [
        (10**18 + 5, 2),
        (10**18 + 7, 1),
        (10**18 + 5, 1),
    ]
    assert all(type(scan.stamp_ns) is int for scan in log)
    # Given numbers, beams of one scan lie anywhere in the file.
    log = read(tmp_path, beams=standing, stamp_ns=stamps, scan=np.array([2, 2, 9, 1, 2]))
    assert [(scan.stamp_ns, scan.size) for scan in log] == [(10**18 + 5, 3), (10**18 + 7, 1)]
    cone = np.array([[0, 0, 0, 1, 0, 0, 2], [0, 0, 0, 0, 1, 0, 2]], float)
    (scan,) = read(tmp_path, beams=cone, stamp_ns=np.array([3, 3], kind))
    assert scan.stamp_ns == 3


def test_a_scan_of_two_stamps_is_named(tmp_path: Path) -> None:
    same = np.repeat(BEAMS[:1], 3, axis=0)
    numbers, stamps = np.array([4, 3, 3]), np.array([1, 2, 7])
    assert refused(tmp_path, beams=same, scan=numbers, stamp_ns=stamps) == (
        "scan 3 has beams of two stamps, 2 and 7 ns: give beams of different times different "
        "numbers"
    )


def test_beams_without_pose_or_heading_are_counted(tmp_path: Path) -> None:
    beams = np.repeat(BEAMS[:1], 6, axis=0)
    beams[1, 0] = np.nan
    beams[2, 1] = np.inf
    beams[3, 2] = np.nan
    beams[2, 2] = np.nan  # counted once
    beams[:, 3] = [0, 1, 2, 3, 4, 5]
    for ids in ({}, {"scan": np.array([7, 8, 8, 8, 7, 7])}):
        log = read(tmp_path, beams=beams, range_max=5.0, **ids)
        assert log.skipped == {"scan.nan_pose": 2, "beam.nan_heading": 1}
        assert [scan.ranges.tolist() for scan in log] == [[0.0, 4.0, math.inf]]
        assert log.notes[0].startswith("1 of 3 ranges")
    message = refused(tmp_path, beams=np.full((2, 4), np.nan))
    assert message.startswith("no usable scan, none of 2 beams has a finite position and heading")


def test_integer_beams_are_read(tmp_path: Path) -> None:
    (scan,) = read(tmp_path, beams=np.array([[1, 2, 0, 3]]), range_max=3)
    assert scan.ranges.tolist() == [math.inf]


def test_wide_beams_say_their_angle(tmp_path: Path) -> None:
    log = read(tmp_path, beams=BEAMS, range_max=4.0, cone_deg=np.float32(22.5), p_random=0.1)
    assert log.sensor == {"range_max": 4.0, "cone_deg": 22.5, "p_random": 0.1}
    assert read(tmp_path, beams=BEAMS, cone_deg=1.01).sensor == {"cone_deg": 1.01}
    for narrow in (0.0, 0.25, 1.0):
        assert read(tmp_path, beams=BEAMS, cone_deg=narrow).sensor == {}


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_beams_of_space(tmp_path: Path, kind: str) -> None:
    beams = np.array(
        [
            [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 3.0],
            [1.0, 2.0, 3.0, 0.0, 0.6, 0.8, 4.0],
            [1.0, 2.0, 3.5, 0.0, 0.0, -1.0, 1.0],
            [np.nan, 2.0, 3.5, 0.0, 0.0, -1.0, 1.0],
            [1.0, 2.0, 3.5, 0.0, np.nan, -1.0, 1.0],
        ],
        kind,
    )
    log = read(tmp_path, beams=beams, range_max=4.0, cone_deg=20.0)
    assert log.sensor == {"range_max": 4.0, "cone_deg": 20.0}
    assert log.skipped == {"scan.nan_pose": 1, "beam.nan_heading": 1}
    assert [scan.ranges.tolist() for scan in log] == [[3.0, math.inf], [1.0]]
    first, second = log
    for scan, z in ((first, 3.0), (second, 3.5)):
        assert isinstance(scan.map_from_sensor, Pose3)
        np.testing.assert_array_equal(scan.map_from_sensor.rotation, np.eye(3))
        np.testing.assert_array_equal(scan.map_from_sensor.translation, [1.0, 2.0, z])
    want = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    np.testing.assert_allclose(first.directions, want, atol=1e-15, rtol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(first.directions, axis=1), 1.0, rtol=1e-15)


def test_a_direction_that_is_none_is_named(tmp_path: Path) -> None:
    beams = np.zeros((3, 7))
    beams[:, 3] = 1.0
    beams[0, 0] = np.nan
    beams[2, 3:6] = [1.0, 1.0, 0.0]
    assert refused(tmp_path, beams=beams) == (
        "the direction of beam 2 has length 1.41421: dx, dy, dz must be a unit vector"
    )


def test_a_scan_of_space_at_two_positions_is_named(tmp_path: Path) -> None:
    beams = np.zeros((2, 7))
    beams[:, 3] = 1.0
    beams[1, 2] = 0.5
    message = refused(tmp_path, beams=beams, scan=np.array([3, 3]))
    assert message.startswith("scan 3 has beams at two positions, (0, 0, 0) and (0, 0, 0.5): ")


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"points": BEAMS}, "no array `beams` in the NPZ file, found points: write beams (n, 4)"),
        ({"beams": BEAMS[:, :3]}, "`beams` has shape (4, 3): it must be beams (n, 4)"),
        ({"beams": BEAMS[0]}, "`beams` has shape (4,)"),
        ({"beams": np.zeros((0, 4))}, "`beams` has shape (0, 4)"),
        ({"beams": np.full((2, 4), "x")}, "`beams` holds <U1: it must hold real numbers"),
        ({"beams": np.zeros((2, 4), complex)}, "`beams` holds complex128"),
        ({"beams": np.full((2, 4), None)}, "an array in the NPZ file cannot be read"),
        ({"beams": BEAMS, "scan": np.zeros(3, int)}, "`scan` holds int64 of shape (3,)"),
        ({"beams": BEAMS, "scan": np.zeros(4)}, "`scan` holds float64 of shape (4,)"),
        ({"beams": BEAMS, "stamp_ns": np.zeros(3, int)}, "`stamp_ns` holds int64 of shape (3,)"),
        ({"beams": BEAMS, "stamp_ns": np.zeros(4)}, "`stamp_ns` holds float64 of shape (4,)"),
        ({"beams": BEAMS, "range_max": [1.0, 2.0]}, "`range_max` holds float64 of shape (2,)"),
        ({"beams": BEAMS, "range_max": "far"}, "`range_max` holds <U3"),
        ({"beams": BEAMS, "range_max": 0.0}, "`range_max` is 0: it must be positive"),
        ({"beams": BEAMS, "range_max": np.nan}, "`range_max` is nan: it must be positive"),
        ({"beams": BEAMS, "range_max": np.inf}, "`range_max` is inf: it must be positive"),
        ({"beams": BEAMS, "p_random": 1.5}, "`p_random` is 1.5: it must be from 0 to 1"),
        ({"beams": BEAMS, "cone_deg": -1.0}, "`cone_deg` is -1: it must be from 0 to 180"),
    ],
)
def test_bad_arrays_are_refused(tmp_path: Path, arrays: dict[str, Any], words: str) -> None:
    assert words in refused(tmp_path, **arrays)


def test_a_cut_file_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "room.npz"
    np.savez(path, beams=BEAMS)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match=r"room\.npz: corrupt or truncated NPZ file .* again"):
        open_log(path)


def test_a_damaged_member_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "room.npz"
    np.savez(path, beams=BEAMS)
    content = bytearray(path.read_bytes())
    start = content.index(BEAMS.tobytes()[:24])
    content[start] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(InputError, match="corrupt or truncated NPZ file"):
        open_log(path)


def test_arrays_it_does_not_know_are_not_opened(tmp_path: Path) -> None:
    log = read(tmp_path, beams=BEAMS, notes=np.array([{"a": 1}], dtype=object))
    assert len(log) == 3


def test_only_a_zip_of_arrays_is_an_npz() -> None:
    file = io.BytesIO()
    np.savez(file, beams=BEAMS)
    assert matches(file.getvalue()[:100])
    assert not matches(file.getvalue()[:100].replace(b".npy", b".xml"))
    assert not matches(b"")


@pytest.mark.realdata
def test_real_cones(data_folder: Path) -> None:
    path = data_folder / "sonar_bench" / "E1_nominal_24x25deg_A_seed0.npz"
    log = open_log(path)
    assert len(log) == 9288 // 24
    assert {len(scan.ranges) for scan in log} == {24}
    assert log.sensor == {"range_max": 4.0, "cone_deg": 25.0, "p_random": 0.03, "p_dropout": 0.03}
    with np.load(path) as file:
        far = np.count_nonzero(file["beams"][:, 3] == 4.0)
    assert sum(int(np.isinf(scan.ranges).sum()) for scan in log) == far


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_direction_may_be_a_thousandth_off_unit_length(tmp_path: Path, sign: float) -> None:
    beams = np.zeros((1, 7))
    beams[0, 3], beams[0, 6] = 1.0 + sign * 0.99e-3, 2.0
    (scan,) = read(tmp_path, beams=beams)
    assert scan.directions.tolist() == [[1.0, 0.0, 0.0]]
    beams[0, 3] = 1.0 + sign * 1.01e-3
    assert "must be a unit vector" in refused(tmp_path, beams=beams)
