# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.scan import Scan
from oddsmap.simulate import Lidar2D, office_drive, office_plan, write_carmen


def some_scans(lidar: Lidar2D | None = None, count: int = 12) -> list[Scan]:
    lidar = lidar or Lidar2D(p_dropout=0.1, p_random=0.05)
    plan, rng = office_plan(), np.random.default_rng(4)
    return [lidar.scan(plan, pose, rng) for pose in office_drive(count)]


def one(ranges: list[float], stamp_ns: int | None = None) -> Scan:
    lidar = Lidar2D(beam_count=len(ranges), angle_step=math.pi / (len(ranges) // 2 * 2))
    return Scan(Pose2(1.0, 2.0, 0.5), lidar.directions, np.array(ranges), stamp_ns)


def flaser_lines(path: Path) -> list[list[str]]:
    data = path.read_bytes()
    text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
    assert text.endswith("\n")
    lines = [line for line in text.splitlines() if not line.startswith(("#", "PARAM "))]
    assert all(line.startswith("FLASER ") for line in lines)
    return [line.split(" ") for line in lines]


@pytest.mark.parametrize("name", ["office.log", "office.log.gz"])
@pytest.mark.parametrize("beams", [180, 181, 360, 361])
def test_what_is_written_reads_back_as_the_same_numbers(
    tmp_path: Path, name: str, beams: int
) -> None:
    step = math.pi / (beams // 2 * 2)
    scans = some_scans(Lidar2D(beam_count=beams, angle_step=step, p_dropout=0.1, p_random=0.05))
    path = tmp_path / name
    write_carmen(path, iter(scans))
    lines = flaser_lines(path)
    assert len(lines) == len(scans)
    for words, scan in zip(lines, scans, strict=True):
        n = int(words[1])
        assert n == beams
        assert len(words) == 2 + n + 9
        ranges = np.array(words[2 : 2 + n], dtype=np.float64)
        ranges[ranges == 81.83] = np.inf
        assert np.array_equal(ranges, scan.ranges)
        pose, odometry = ([float(word) for word in words[2 + n + k :][:3]] for k in (0, 3))
        assert Pose2(*pose) == scan.map_from_sensor
        assert odometry == pose
    assert [float(words[-3]) for words in lines] == pytest.approx(0.2 * np.arange(len(scans)))
    assert all(words[-1] == words[-3] for words in lines)


def test_stamps_are_written_to_the_nanosecond(tmp_path: Path) -> None:
    stamps = [1_071_078_718_462_310_001, None, 1_071_078_719_000_000_000, -1_500_000_000]
    write_carmen(tmp_path / "a.log", [one([1.0, 2.0], stamp) for stamp in stamps])
    assert [words[-1] for words in flaser_lines(tmp_path / "a.log")] == [
        "1071078718.462310001",
        "1071078718.662310001",
        "1071078719.000000000",
        "-1.500000000",
    ]


def test_another_code_for_no_return(tmp_path: Path) -> None:
    write_carmen(tmp_path / "a.log", [one([0.0, np.inf])], no_return=50.0)
    assert flaser_lines(tmp_path / "a.log")[0][:4] == ["FLASER", "2", "0.0", "50.0"]


def test_the_same_scans_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.log.gz", "b.log.gz"):
        write_carmen(tmp_path / name, some_scans())
    assert (tmp_path / "a.log.gz").read_bytes() == (tmp_path / "b.log.gz").read_bytes()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (one([1.0, math.nan]), "scan 1, beam 1: a range must be .* got nan"),
        (one([1.0, -math.inf]), "beam 1: .* got -inf"),
        (one([-0.5, 1.0]), "beam 0: .* got -0.5"),
        (one([1.0, 81.83]), "beam 1: .* got 81.83"),
        (Scan(Pose2(0, 0, 0), np.array([[1.0, 0.0]]), np.ones(1)), "at least 2 beams, got 1"),
        (Scan(Pose2(0, 0, 0), np.empty((0, 2)), np.ones(0)), "at least 2 beams, got 0"),
        (some_scans(Lidar2D(angle_min=-1.5), 2)[0], "takes 180 beams .* 1 degrees apart"),
        (some_scans(Lidar2D(beam_count=181, angle_step=0.01), 2)[0], "takes 181 beams"),
        (Scan(Pose2(0, math.nan, 0), np.array([[0, -1], [1, 0.0]]), np.ones(2)), "not finite"),
        (Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3), np.ones(3)), "this one is 3D"),
    ],
)
def test_what_a_carmen_log_cannot_hold_is_refused(tmp_path: Path, bad: Scan, message: str) -> None:
    path = tmp_path / "a.log"
    with pytest.raises(InputError, match=message) as caught:
        write_carmen(path, [one([1.0, 2.0]), bad])
    assert str(caught.value).startswith(f"{path}: scan 1")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_no_scan_and_a_bad_code_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no scan to write"):
        write_carmen(tmp_path / "a.log", [])
    with pytest.raises(ConfigError, match="no_return must be positive"):
        write_carmen(tmp_path / "a.log", [one([1.0, 2.0])], no_return=math.nan)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.log", "a.log.gz"])
def test_a_failure_in_the_middle_leaves_the_old_file_or_none(tmp_path: Path, name: str) -> None:
    def failing() -> Iterator[Scan]:
        yield one([1.0, 2.0])
        raise RuntimeError("the lidar fell off")

    path = tmp_path / name
    with pytest.raises(RuntimeError, match="fell off"):
        write_carmen(path, failing())
    assert list(tmp_path.iterdir()) == []

    write_carmen(path, [one([3.0, 4.0])])
    before = path.read_bytes()
    with pytest.raises(RuntimeError, match="fell off"):
        write_carmen(path, failing(), force=True)
    with pytest.raises(OutputError, match="exists already"):
        write_carmen(path, [one([5.0, 6.0])])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]

    write_carmen(str(path), [one([5.0, 6.0])], force=True)
    assert flaser_lines(path)[0][2:4] == ["5.0", "6.0"]


def test_scans_are_not_held(tmp_path: Path) -> None:
    """Each scan is written before the next one is asked for: no list is made."""
    alive = 0

    class Counted(np.ndarray[tuple[int, ...], np.dtype[np.float64]]):
        def __del__(self) -> None:
            nonlocal alive
            alive -= 1

    def scans() -> Iterator[Scan]:
        nonlocal alive
        for _ in range(50):
            ranges = np.array([1.0, 2.0]).view(Counted)
            alive += 1
            yield Scan(Pose2(0, 0, 0), one([1.0, 1.0]).directions, ranges)
            assert alive <= 4

    write_carmen(tmp_path / "a.log", scans())
