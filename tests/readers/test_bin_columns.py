# SPDX-License-Identifier: Apache-2.0
"""The columns of `.bin` scans: found, said, or refused; never mixed."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.readers import open_log
from tests.readers.clouds import end_points

FloatArray = npt.NDArray[np.float64]


def spinning(n: int = 840, seed: int = 0) -> FloatArray:
    """x y z intensity ring of a LIDAR of 16 beams among walls at 4 to 40 m."""
    rng = np.random.default_rng(seed)
    ring, heading = np.arange(n) % 16, 2 * np.pi * np.arange(n) / n
    across = 22.0 + 18.0 * np.sin(3 * heading) + rng.normal(0.0, 0.05, n)
    height = across * np.tan(np.radians(ring - 8.0)) * 0.2
    intensity = rng.integers(0, 256, n)
    columns = (across * np.cos(heading), across * np.sin(heading), height, intensity, ring)
    return np.stack(columns, axis=1)


def write(folder: Path, *scans: FloatArray, poses: int | None = None) -> Path:
    for i, scan in enumerate(scans):
        (folder / f"{i:06}.bin").write_bytes(scan.astype("<f4").tobytes())
    (folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * len(scans))
    return folder


def check(folder: Path, scans: list[FloatArray], **options: Any) -> tuple[str, ...]:
    log = open_log(folder, **options)
    read = list(log)
    assert len(read) == len(scans)
    for found, expected in zip(read, scans, strict=True):
        points = expected[:, :3].astype(np.float32)
        np.testing.assert_allclose(end_points(found), points, rtol=1e-12, atol=1e-12)
    return tuple(log.notes)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_the_columns_of_one_file_are_found(tmp_path: Path, count: int) -> None:
    """840 points: of any count of columns from 3 to 8 the size is a multiple."""
    scan = spinning()[:, :count]
    notes = check(write(tmp_path, scan), [scan])
    names = ["x", "y", "z", "intensity", "ring"][:count]
    wanted = f"points of {count} float32 are seen in the .bin files: {' '.join(names)}"
    assert notes == (() if count == 4 else (wanted,))
    (tmp_path / "000000.bin").write_bytes(gzip.compress(scan.astype("<f4").tobytes()))
    assert check(tmp_path, [scan]) == notes


def test_points_that_are_not_finite_hide_no_columns(tmp_path: Path) -> None:
    scan = spinning()
    missing = np.random.default_rng(1).random(840) < 0.3
    scan[missing, :3] = np.nan
    log = open_log(write(tmp_path, scan))
    np.testing.assert_array_equal(np.isnan(next(iter(log)).ranges), missing)
    assert "points of 5" in log.notes[0]


def test_sizes_of_many_files_decide_where_nothing_else_does(tmp_path: Path) -> None:
    """Points of one kind in all columns: but the sizes are multiples of 16 bytes alone."""
    rng = np.random.default_rng(0)
    scans = [rng.uniform(0.0, 9.0, (n, 4)) for n in (101, 103, 107, 109)]
    assert check(write(tmp_path, *scans), scans) == ()
    (tmp_path / "000003.bin").unlink()
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    with pytest.raises(InputError, match=r"cannot be told \(by size, 4 float32 a point are poss"):
        open_log(tmp_path)


def test_one_broken_file_of_many_changes_no_columns(tmp_path: Path) -> None:
    scans = [spinning(n, seed=n)[:, :4] for n in (840, 101, 820, 103)]
    write(tmp_path, *scans)
    (tmp_path / "000001.bin").write_bytes(scans[1].astype("<f4").tobytes()[:-7])
    log = open_log(tmp_path, skip_bad=True)
    assert len(list(log)) == 3
    assert log.skipped == {"scan.unreadable": 1}
    assert "which is not a multiple of 16 (float32 x y z intensity)" in log.notes[0]


@pytest.mark.parametrize(
    ("more", "seen"),
    [
        (1, "6 columns are seen that are not those of KITTI or nuScenes"),
        (2, "7 columns are seen"),
        (3, "8 columns are seen"),
        (7, "12 columns are seen"),
    ],
)
def test_other_columns_have_to_be_said(tmp_path: Path, more: int, seen: str) -> None:
    rng = np.random.default_rng(0)
    scan = np.hstack([spinning(1680), 0.1 * rng.random((1680, more))])
    write(tmp_path, scan)
    with pytest.raises(InputError, match=seen) as caught:
        open_log(tmp_path)
    assert "say it with --columns x,y,z,intensity,ring (columns=)" in str(caught.value)
    names = ["x", "y", "z", "i", "ring", *(f"c{i}" for i in range(more))]
    check(tmp_path, [scan], columns=names)
    check(tmp_path, [scan], columns=",".join(names))


def test_a_signed_fourth_column_is_no_intensity(tmp_path: Path) -> None:
    scan = spinning()[:, :4]
    scan[:, 3] = np.linspace(-0.1, 0.0, 840)
    with pytest.raises(InputError, match="4 columns are seen that are not those of KITTI"):
        open_log(write(tmp_path, scan))
    check(tmp_path, [scan], columns="x,y,z,t")


def test_columns_in_another_order(tmp_path: Path) -> None:
    scan = spinning()
    write(tmp_path, scan[:, [4, 2, 0, 1]])
    check(tmp_path, [scan], columns=("ring", "z", "x", "y"))


def test_columns_that_do_not_fit(tmp_path: Path) -> None:
    write(tmp_path, spinning()[:101, :4])
    log = open_log(tmp_path, columns="x,y,z")
    with pytest.raises(InputError, match="1616 bytes, which is not a multiple of 12"):
        list(log)
    for wrong in ("x,y", "x,y,z,x", ""):
        with pytest.raises(ConfigError, match="columns are names with x, y and z once each"):
            open_log(tmp_path, columns=wrong)
    (tmp_path / "a.pcd").write_bytes(b"VERSION 0.7\n")
    with pytest.raises(InputError, match=r"a PCD file has no \.bin columns: leave `columns` out"):
        open_log(tmp_path / "a.pcd", columns="x,y,z")


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "columns"),
    [("kitti_000008.bin", 4), ("nuscenes_LIDAR_TOP_1532402927647951.pcd.bin", 5)],
)
def test_real_scans_whatever_is_left_of_their_columns(
    data_folder: Path, tmp_path: Path, name: str, columns: int
) -> None:
    whole = np.fromfile(data_folder / "av" / name, "<f4").reshape(-1, columns).astype(np.float64)
    for kept in range(3, columns + 1):
        scan = whole[: len(whole) // 840 * 840, :kept]
        check(write(tmp_path, scan), [scan])
