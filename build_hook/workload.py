# SPDX-License-Identifier: Apache-2.0
"""Toy jobs that together go through all kernels: what runs here is compiled into a wheel."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import oddsmap
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.kernels.units import ONE
from oddsmap.poses.at_times import PoseTrack
from oddsmap.poses.trajectory import Trajectory
from oddsmap.posterior.count_pairs import count_pairs
from oddsmap.posterior.neighbour_codes import TileCodes
from oddsmap.posterior.neighbour_model import pairs_of_classes
from oddsmap.readers.carmen_messages import beam_directions
from oddsmap.readers.lzf import decompress
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.deskew import deskew
from oddsmap.simulate import write_carmen

__all__ = ["run"]

RESOLUTION = 0.5
Scans = list[Any]
_RAYS: tuple[tuple[oddsmap.BeamSensor, dict[str, Any]], ...] = (
    (oddsmap.BeamSensor(), {}),
    (oddsmap.BeamSensor(), {"votes": "beam"}),
    (oddsmap.BeamSensor(), {"half_life": 5.0}),
    (oddsmap.BeamSensor(), {"votes": "beam", "path_lengths": True}),
    (oddsmap.BeamSensor(hit_width=0.6), {"threads": 2}),
    (oddsmap.BeamSensor(fade=1.0), {}),
    (oddsmap.BeamSensor(sigma=0.2), {}),
)


def run() -> None:
    """Run all of them: two minutes where everything is compiled."""
    with tempfile.TemporaryDirectory() as folder:
        _read(Path(folder) / "toy.log")
        for number, grid in enumerate(_maps()):
            _use(grid, Path(folder) / f"{number}.zarr")
    for sensor, options in _RAYS:  # codes of cells in 8 bytes instead of 4
        oddsmap.build_map(_far_scan(), RESOLUTION, sensor=sensor, **options)
    for ndim in (2, 3):
        _full_maps(scans_of(ndim))


def _read(log: Path) -> None:
    directions = beam_directions(-np.pi / 2, np.pi / 180, 180)
    ranges = np.linspace(1.0, 2.0, 180)
    scans = [oddsmap.Scan(_pose(2, 0.0), directions, ranges, stamp_ns=0)] * 3
    write_carmen(log, scans)
    for _ in oddsmap.open_log(log):
        pass
    decompress(b"\0a", 1)


def scans_of(ndim: int, count: int = 3) -> Scans:
    """Fans of beams, one second apart; one of each does not return."""
    angle = np.linspace(-1.0, 1.0, 8)
    fan = np.stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(3 * angle)][:ndim], axis=1)
    fan /= np.linalg.norm(fan, axis=1, keepdims=True)
    ranges = np.where(np.arange(8) == 5, np.inf, 2.0 + 0.1 * np.arange(8))
    return [
        oddsmap.Scan(_pose(ndim, 0.1 * step), fan, ranges, stamp_ns=step * 10**9)
        for step in range(count)
    ]


def _moving_scans(ndim: int) -> Scans:
    """The same, taken while the sensor turns."""
    start, end = _pose(3, 0.0), _turned(0.5)
    track = PoseTrack(
        Trajectory(
            np.stack([start.translation, end.translation]),
            np.stack([start.rotation, end.rotation]),
            np.array([0, 10**10]),
        )
    )
    moved = []
    for scan in scans_of(ndim):
        times = scan.stamp_ns + np.arange(scan.size) * 10**7
        taken = oddsmap.Scan(
            scan.map_from_sensor, scan.directions, scan.ranges, scan.stamp_ns, beam_times_ns=times
        )
        moved.append(deskew(taken, start, lambda times: track.at(times, 10**10))[0])
    return moved


def _turned(angle: float) -> oddsmap.Pose3:
    turn = (0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))
    return oddsmap.Pose3.from_quaternion_xyzw(np.zeros(3), turn)


def _far_scan() -> Scans:
    """Two beams in space, to opposite corners of a box of more than 2^31 cells."""
    corner = np.full(3, 3**-0.5)
    return [oddsmap.Scan(_pose(3, 0.0), np.stack([corner, -corner]), np.full(2, 700.0), stamp_ns=0)]


def _pose(ndim: int, x: float) -> Any:
    if ndim == 2:
        return oddsmap.Pose2(x, 0.5, 0.1)
    return oddsmap.Pose3(np.array([x, 0.5, 1.0]), np.eye(3))


def _maps() -> Iterator[oddsmap.EvidenceMap]:
    for ndim in (2, 3):
        scans = scans_of(ndim)
        for sensor, options in _RAYS:
            yield oddsmap.build_map(scans, RESOLUTION, sensor=sensor, **options)
        yield oddsmap.build_map(_moving_scans(ndim), RESOLUTION)
        for share in (True, False):
            cone = oddsmap.ConeSensor(cone_deg=25.0, range_max=5.0, share_hit=share)
            yield oddsmap.build_map(scans, RESOLUTION, sensor=cone)
    camera = PinholeCamera(20.0, 20.0, 7.5, 5.5, width=16, height=12)
    images = [DepthScan(_pose(3, 0.0), np.full((12, 16), 2.5, np.float32), camera)]
    for method in ("rays", "projective"):
        yield oddsmap.build_map(images, RESOLUTION, method=method)
    for ndim in (2, 3):
        for weight in (1, 300, 70_000):  # counts are saved in 1, 2 or 4 bytes
            yield _filled(oddsmap.EvidenceMap(RESOLUTION, ndim=ndim), weight)
    seen = [oddsmap.GridScan(_pose(2, 0.0), np.eye(4), 0.5, (0.0, 0.0))]
    yield oddsmap.build_map(seen, RESOLUTION, sensor=oddsmap.OverheadSensor())


def _filled(grid: oddsmap.EvidenceMap, weight: int) -> oddsmap.EvidenceMap:
    """A map with so many tiles that the table of tiles has to grow."""
    tiles = 2000 if weight == 1 else 2
    cells = np.zeros((tiles, grid.ndim), np.int64)
    cells[:, :2] = 64 * np.stack(np.divmod(np.arange(tiles), 50), axis=1)
    votes = np.full(tiles, weight * ONE)
    grid.add_cells(cells, votes, votes)
    return grid


def _use(grid: oddsmap.EvidenceMap, path: Path) -> None:
    grid.save(path)
    loaded = oddsmap.load_map(path)
    bounds = loaded.bounds()
    if bounds is None:
        raise RuntimeError(f"{path}: a toy map is empty")
    lo = np.maximum(bounds[0], -8)
    hi = np.minimum(bounds[1], lo + 16)
    oddsmap.load_map(path, lo=lo, hi=hi)
    loaded.census()
    count_pairs(loaded)
    pairs_of_classes(loaded)
    loaded.cells()
    loaded.crop(lo, hi).merge(grid)
    loaded.region(lo, hi)
    TileCodes(loaded.tiles).region(lo, hi)
    view = loaded.log_odds()
    view.probability((lo, hi))
    view.at(np.ones((2, grid.ndim)))
    view.cast_rays(np.ones(grid.ndim), np.eye(grid.ndim), 5.0)
    scan = scans_of(grid.ndim)[0]
    for model in (view.likelihood_field(5.0), view.beam_likelihood(5.0)):
        model.log_likelihood([scan.map_from_sensor], scan)
    view.frontiers()
    pose = np.eye(grid.ndim + 1)
    for votes in ("scan", "beam"):
        view.information_gain([pose], np.eye(grid.ndim), 5.0, votes=votes)
    view.distance_field(signed=True)
    view.distance_field(region=(hi + 50_000, hi + 50_001))  # squares in 8 bytes instead of 4
    if grid.lengths is not None:
        grid.cell_lengths()
        loaded.decay_rate().mean((lo, hi))
    if grid.ndim == 3:
        view.save_octomap(path.with_suffix(".bt"))
        view.save_octomap(path.with_suffix(".ot"))
        for suffix in (".bt", ".ot"):
            oddsmap.load_octomap(path.with_suffix(suffix)).cells()
        oddsmap.project(view, 0.0, 2.0)
    else:
        view.save_ros(path.with_suffix(".yaml"))


def _full_maps(scans: Scans) -> None:
    sensor = oddsmap.ConeSensor(cone_deg=25.0, range_max=5.0)
    for method in ("sum-product", "gibbs", "map"):
        for schedule in ("chunks", "sequential"):
            settings = FullMapConfig(
                method=method, schedule=schedule, sweeps=2, burn_in=1, samples=2
            )
            oddsmap.build_full_map(scans, RESOLUTION, sensor=sensor, settings=settings)
    if scans[0].directions.shape[1] == 2:
        settings = FullMapConfig(method="gibbs", prior_model="windows", burn_in=1, samples=2)
        oddsmap.build_full_map(scans, RESOLUTION, sensor=sensor, settings=settings)
    sensor.forward_model().bin_likelihoods(1.0, RESOLUTION)
    oddsmap.build_reflection_map(scans, RESOLUTION, sensor=sensor)
    online = OnlineFullMap(
        Config(map=MapConfig(resolution=RESOLUTION), sensor=sensor, full_map=FullMapConfig()),
        window=1,
        prior_every=1,
    )
    online.add_scans(scans)
    oddsmap.score_map(online.view(), scans, sensor)
    oddsmap.calibrate(scans, RESOLUTION, sensor=sensor, updates=1)


if __name__ == "__main__":
    run()
