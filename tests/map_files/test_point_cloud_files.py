# SPDX-License-Identifier: Apache-2.0
"""Points as PLY, PCD and LAS, read back by what else reads such files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.map_files.point_cloud import LabelledPoints, save_points

RNG = np.random.default_rng(0)
PARTS: list[LabelledPoints] = [
    (RNG.uniform(-50.0, 50.0, (n, 3)), RNG.random(n) < 0.3) for n in (4, 0, 7)
]
POINTS = np.concatenate([points for points, _ in PARTS])
LABELS = np.concatenate([label for _, label in PARTS])


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("labels", [False, True])
def test_they_open_as_a_log(suffix: str, labels: bool, tmp_path: Path) -> None:
    folder = tmp_path / "log"
    folder.mkdir()
    assert save_points(iter(PARTS), folder / f"000000{suffix}", labels=labels) == 11
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    (scan,) = oddsmap.open_log(folder, poses=tmp_path / "poses.txt", points_in="sensor")
    assert scan.measured_points is not None
    np.testing.assert_allclose(scan.measured_points, POINTS, atol=1e-14 if suffix == ".ply" else
                               4e-6)  # fmt: skip
    tail = (folder / f"000000{suffix}").read_bytes()
    if labels:
        kind = np.dtype([("p", "<f8" if suffix == ".ply" else "<f4", 3),
                         ("label", "u1" if suffix == ".ply" else "<u4")])  # fmt: skip
        rows = np.frombuffer(tail[-11 * kind.itemsize :], kind)
        assert rows["label"].tolist() == LABELS.astype(int).tolist()


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las(suffix: str, tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    far = np.array([4.5e5, 5.4e6, 300.0])
    parts = [(points + far, label) for points, label in [PARTS[1], *PARTS]]
    assert save_points(parts, tmp_path / f"a{suffix}", labels=True) == 11
    read = laspy.read(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(read.xyz, POINTS + far, atol=5.1e-5)
    assert np.asarray(read.user_data).tolist() == LABELS.astype(int).tolist()
    assert save_points([], tmp_path / f"none{suffix}") == 0
    assert laspy.read(tmp_path / f"none{suffix}").header.point_count == 0
    with pytest.raises(InputError, match="up to 200 km from the first"):
        save_points([*PARTS, *parts], tmp_path / f"b{suffix}")
    assert not (tmp_path / f"b{suffix}").exists()


def test_points_of_the_plane_lie_at_zero(tmp_path: Path) -> None:
    save_points([(POINTS[:, :2], LABELS)], tmp_path / "a.ply")
    rows = np.frombuffer((tmp_path / "a.ply").read_bytes()[-11 * 24 :], "<f8").reshape(-1, 3)
    assert np.array_equal(rows, np.pad(POINTS[:, :2], ((0, 0), (0, 1))))


def test_what_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"points are named \.ply, \.pcd"):
        save_points(PARTS, tmp_path / "a.xyz")
    with pytest.raises(InputError, match=r"off by 1 mm or more at the 20000 m"):
        save_points([(np.array([[20_000.0, 0.0, 0.0]]), LABELS[:1])], tmp_path / "a.pcd")
    assert list(tmp_path.iterdir()) == []
    save_points(PARTS, tmp_path / "a.ply")
    with pytest.raises(OutputError, match="exists already"):
        save_points(PARTS, tmp_path / "a.ply")
    save_points(PARTS, tmp_path / "a.ply", force=True)
