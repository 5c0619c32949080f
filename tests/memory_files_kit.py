# SPDX-License-Identifier: Apache-2.0
"""What programs do with maps and files, as `memory_kit.py` has it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import oddsmap
from oddsmap import simulate
from oddsmap.landmarks import Observations
from tests.memory_kit import CELL, Repeat, full_map, lidar, plane, room, view


def views(_: Path) -> Repeat:
    old = oddsmap.build_map(lidar()[::2], CELL)
    known = oddsmap.PriorArray(np.full((140, 200), 0.3), (0, 0))
    state = oddsmap.Thresholds(0.2, 0.7)

    def repeat() -> None:
        for prior in (0.3, old, old.log_odds(), old.log_odds().to_probability_map(), known):
            posterior = plane().log_odds(prior=prior)
            posterior.state()
            state.state(posterior.probability(), posterior.observed())
        oddsmap.changed(old.log_odds(), view()).to_probability_map()
        oddsmap.compare(old.log_odds(), view())
        for kind in ("equal-tailed", "highest-density"):
            plane().reflection(kind=kind).interval()
        plane().reflection().state()
        plane().decay_rate().interval()
        plane().decay_rate().p_pass()

    return repeat


def views_of_space(_: Path) -> Repeat:
    def repeat() -> None:
        voxels = room().log_odds().to_voxels()
        posterior = room().log_odds(prior=voxels)
        posterior.probability()
        oddsmap.project(posterior, 0.2, 1.8)
        oddsmap.project(voxels, 0.2, 1.8, ground="relative")
        room().reflection().mean()

    return repeat


def files(folder: Path) -> Repeat:
    def repeat() -> None:
        plane().save(folder / "plane.zarr", force=True)
        oddsmap.load_map(folder / "plane.zarr").cells()
        oddsmap.EvidenceMap.history(folder / "kept.icechunk")
        saved = oddsmap.EvidenceMap.open(folder / "plane.zarr")
        saved.at([(3.0, 3.0)])
        saved.crop_box((2.0, 2.0), (4.0, 4.0)).bounds()
        saved.overview(50)
        oddsmap.build_saved_map(lidar()[:5], CELL, folder / "disk.zarr", force=True)
        full_map().save(folder / "full.zarr", force=True)
        oddsmap.load_full_map(folder / "full.zarr").cells()
        for each in (view(), plane().reflection(), plane().decay_rate(), full_map()):
            each.save_npz(folder / "cells.npz", force=True)
        view().save_ros(folder / "plane.yaml", force=True)
        oddsmap.load_ros(folder / "plane.yaml")

    return repeat


def pictures(folder: Path) -> Repeat:
    def repeat() -> None:
        for each in (view(), plane().reflection()):
            each.save_png(folder / "plane.png", force=True)
            each._repr_html_()

    return repeat


def files_of_space(folder: Path) -> Repeat:
    corner = room().crop((0, 0, 0), (16, 16, 16))  # of one shard

    def repeat() -> None:
        corner.save(folder / "room.zarr", force=True)
        oddsmap.load_map(folder / "room.zarr").cells()
        room().log_odds().save_ply(folder / "room.ply", force=True)
        for name in ("room.bt", "room.ot"):
            room().log_odds().save_octomap(folder / name, force=True)
            oddsmap.load_octomap(folder / name).cells()

    return repeat


def logs(folder: Path) -> Repeat:
    simulate.write_carmen(folder / "office.log.gz", lidar(), force=True)
    rng = np.random.default_rng(0)
    beams, scan = rng.uniform(0.0, 3.0, (20_000, 4)), np.arange(20_000) // 20
    beams[:, :2] = beams[scan, :2]
    np.savez(folder / "sonar.npz", beams=beams, scan=scan, range_max=4.0)
    labels, poses = rng.integers(0, 2, (50, 60, 80), np.uint8), rng.uniform(0.0, 9.0, (50, 3))
    np.savez(folder / "floor.npz", grids=labels, poses=poses, pixel=0.1)
    clouds = folder / "velodyne"
    clouds.mkdir(exist_ok=True)
    points = rng.uniform(-9.0, 9.0, (20_000, 4))
    points[:, 3] = np.abs(points[:, 3])  # an intensity, by which the columns are known
    points.astype(np.float32).tofile(clouds / "000000.bin")
    (clouds / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0", encoding="utf-8")

    def repeat() -> None:
        for name in ("office.log.gz", "sonar.npz", "floor.npz", "velodyne"):
            assert sum(scan.size for scan in oddsmap.open_log(folder / name)) > 0

    return repeat


def landmarks(folder: Path) -> Repeat:
    rng = np.random.default_rng(0)
    marks = rng.uniform(-10.0, 10.0, (20, 2))

    def seen(known: bool) -> Iterator[Observations]:
        for angle in np.linspace(0.0, 2.0 * math.pi, 12):
            pose = oddsmap.Pose2(2.0 * math.cos(angle), 2.0 * math.sin(angle), angle)
            x, y = (pose.inverse().transform(marks) + rng.normal(0.0, 0.05, marks.shape)).T
            yield Observations.range_bearing(
                pose, np.hypot(x, y), np.arctan2(y, x), sigma_range=0.1, sigma_bearing=0.03,
                ids=np.arange(len(marks)) if known else None,
            )  # fmt: skip

    def repeat() -> None:
        for known in (True, False):
            grid = oddsmap.LandmarkMap()
            for observations in seen(known):
                grid.add(observations)
            grid.save(folder / "marks.json", force=True)
            assert oddsmap.LandmarkMap.load(folder / "marks.json").landmarks

    return repeat
