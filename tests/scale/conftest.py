# SPDX-License-Identifier: Apache-2.0
"""Logs for clusters, a cluster within this process, and what is compared with one machine."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import Scan, simulate
from tests.readers.clouds import pcd_bytes


def write_clouds(folder: Path, scans: list[Scan]) -> None:
    """A folder of PCD files in the sensor frame, with KITTI poses and times."""
    folder.mkdir(parents=True)
    poses = []
    for number, scan in enumerate(scans):
        seen = np.isfinite(scan.ranges)
        points = scan.directions[seen] * scan.ranges[seen, None]
        (folder / f"{number:06d}.pcd").write_bytes(pcd_bytes(points))
        pose = scan.map_from_sensor
        poses.append(np.column_stack([pose.rotation, pose.translation]).ravel())
    np.savetxt(folder / "poses.txt", np.array(poses), fmt="%.17g")
    np.savetxt(folder / "times.txt", 0.1 * np.arange(len(scans)), fmt="%.9f")


@pytest.fixture(scope="session")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten turns of a lidar in a room, as files."""
    turn = simulate.Lidar3D(ring_count=8, column_count=60, range_max=8.0)
    world, rng = simulate.room(), np.random.default_rng(0)
    folder = tmp_path_factory.mktemp("clouds") / "room"
    write_clouds(folder, [turn.scan(world, pose, rng) for pose in simulate.room_walk(10)])
    return folder


@pytest.fixture(scope="session")
def damaged(clouds: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, of which three files cannot be read."""
    import shutil

    folder = tmp_path_factory.mktemp("damaged") / "room"
    shutil.copytree(clouds, folder)
    for number in (2, 3, 9):
        (folder / f"{number:06d}.pcd").write_bytes(b"VERSION 0.7\nnonsense\n")
    return folder


@pytest.fixture(scope="session")
def drives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two CARMEN logs of an office."""
    rng, plan = np.random.default_rng(1), simulate.office_plan()
    lidar = simulate.Lidar2D(p_dropout=0.05)
    folder, poses = tmp_path_factory.mktemp("drives"), simulate.office_drive(24)
    paths = [folder / "monday.log", folder / "tuesday.log"]
    for path, part in zip(paths, (poses[:14], poses[14:]), strict=True):
        simulate.write_carmen(path, [lidar.scan(plan, pose, rng) for pose in part])
    return paths


@pytest.fixture(scope="module")
def threads_of_dask() -> Iterator[Any]:
    """A client of two workers, each a thread of this process."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):  # fmt: skip
        yield client


def files_of(folder: Path) -> dict[str, Any]:
    """Every file of a saved map; of those that say which save it was, all but that."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        if path.name == "zarr.json":
            said = json.loads(path.read_text())
            for name in ("save", "digest"):
                said.get("attributes", {}).pop(name, None)
            found[str(path.relative_to(folder))] = said
        elif path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found
