# SPDX-License-Identifier: Apache-2.0
"""What programs do to make and to judge maps, each in a few tenths of a second.

A workload prepares what it needs in a folder of its own and gives what is to be repeated.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import oddsmap
from oddsmap import simulate

Repeat = Callable[[], object]
Workload = Callable[[Path], Repeat]

CELL = 0.1
# Of full maps: the more cells a beam has, the larger are the arrays that a kernel works in.
FINE = 0.05
SONAR = oddsmap.ConeSensor(cone_deg=25.0, range_max=4.0)
TOF = oddsmap.ConeSensor(cone_deg=8.0, range_max=3.0)
LIDAR = oddsmap.BeamSensor(range_max=20.0, sigma=0.05)
FADING = oddsmap.BeamSensor(fade=0.5, hit_width=0.2)


# ---- what sensors see ------------------------------------------------------------------------


@cache
def truth() -> npt.NDArray[np.bool_]:
    """The office in cells."""
    return simulate.office_plan().rasterise(CELL, (0, 0), (200, 140))


@cache
def sonar() -> list[oddsmap.Scan]:
    """Rings of 24 cones, in a part of the office."""
    ring, rng = simulate.Sonar2D(beam_count=24, range_max=4.0), np.random.default_rng(0)
    return [ring.scan(truth(), CELL, pose, rng) for pose in simulate.office_drive()[:24]]


def few() -> list[oddsmap.Scan]:
    """The first of them: what a kernel loses it loses with each call, however few its beams."""
    return sonar()[:12]


@cache
def lidar() -> list[oddsmap.Scan]:
    """Fans of narrow beams all over the office, two a second."""
    fan, plan, rng = simulate.Lidar2D(), simulate.office_plan(), np.random.default_rng(0)
    poses = enumerate(simulate.office_drive(60))
    return [fan.scan(plan, pose, rng, stamp_ns=i * 500_000_000) for i, pose in poses]


@cache
def depth_images(folder: Path) -> Callable[[], None]:
    """Depth images into a map, one by one."""
    image = np.full((24, 32), 2500, np.uint16)

    def repeat() -> None:
        camera = oddsmap.PinholeCamera(30.0, 30.0, 15.5, 11.5, width=32, height=24)
        grid = oddsmap.EvidenceMap(0.1, ndim=3)
        for i in range(3):
            pose = np.eye(4)
            pose[0, 3] = 0.1 * i
            grid.add(oddsmap.DepthScan.from_depth(pose, image, camera, depth_unit=0.001))

    return repeat


def overhead() -> list[oddsmap.GridScan]:
    """Pictures of the floor."""
    camera, plan = simulate.OverheadCamera(), simulate.office_plan()
    rng = np.random.default_rng(0)
    return [camera.scan(plan, pose, rng) for pose in simulate.office_drive(30)]


@cache
def space(rings: int, columns: int, count: int) -> list[oddsmap.Scan]:
    """Turns of a lidar in a room, a tenth of a second apart."""
    turn = simulate.Lidar3D(ring_count=rings, column_count=columns, range_max=8.0)
    world, rng = simulate.room(), np.random.default_rng(0)
    poses = enumerate(simulate.room_walk(count))
    return [turn.scan(world, pose, rng, stamp_ns=i * 100_000_000) for i, pose in poses]


def turns() -> list[oddsmap.Scan]:
    """Many beams."""
    return space(16, 90, 4)


def tof() -> list[oddsmap.Scan]:
    """Few beams, to be taken as wide."""
    return space(4, 16, 6)


@cache
def images() -> list[Any]:
    """Depth images of 160 x 120 pixels."""
    whole = simulate.DepthCamera().camera
    smaller = {name: getattr(whole, name) / 4 for name in ("fx", "fy", "cx", "cy")}
    camera = dataclasses.replace(whole, width=160, height=120, **smaller)
    world, rng = simulate.room(), np.random.default_rng(0)
    eye = simulate.DepthCamera(camera=camera)
    return [eye.scan(world, pose, rng) for pose in simulate.room_walk(4)]


@cache
def plane() -> oddsmap.EvidenceMap:
    """Evidence of the plane, with lengths."""
    return oddsmap.build_map(lidar(), CELL, votes="beam", path_lengths=True)


@cache
def room() -> oddsmap.EvidenceMap:
    """Evidence of space."""
    return oddsmap.build_map(turns(), 0.2, votes="beam")


@cache
def full_map() -> oddsmap.FullMap:
    """A full map; its `config` is what the other estimators of full maps take, too."""
    settings = oddsmap.FullMapConfig(sweeps=2, burn_in=1)
    return oddsmap.build_full_map(sonar(), FINE, sensor=SONAR, settings=settings)


def view() -> oddsmap.LogOdds:
    """A view of the plane."""
    return plane().log_odds()


# ---- maps ------------------------------------------------------------------------------------


def mapping(scans: Callable[[], list[Any]], **options: Any) -> Workload:
    return lambda _: partial(oddsmap.build_map, scans(), CELL, threads=2, **options)


def adding(_: Path) -> Repeat:
    """The same scans into one map, time and again: counts go up, memory does not."""
    grid = oddsmap.EvidenceMap(CELL)
    return partial(oddsmap.add_scans, grid, lidar(), threads=2)


def merging(_: Path) -> Repeat:
    def repeat() -> None:
        grid = plane().like()
        grid.merge(plane())
        grid.crop((20, 20), (150, 100)).bounds()
        (grid - plane()).bounds()
        room().resample(2 * room().resolution).bounds()
        room().rotated(up="-y").bounds()
        plane().transformed((1.0, 2.0, 0.0)).bounds()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what resampling costs
            room().transformed((0.0, 0.0, 0.3)).bounds()

    return repeat


def full_maps(
    scans: Callable[[], list[Any]], sensor: oddsmap.ConeSensor, **settings: Any
) -> Workload:
    """One of each scan: some kernels are called for each sweep, others once a map."""
    chosen = oddsmap.FullMapConfig(samples=4, burn_in=1, tolerance=0.0, **settings)

    def repeat() -> None:
        for scan in scans():
            oddsmap.build_full_map([scan], FINE, sensor=sensor, settings=chosen, threads=2)

    return lambda _: repeat


def sampling(_: Path) -> Repeat:
    def repeat() -> None:
        estimator = oddsmap.FullMapEstimator(full_map().config, threads=2)
        estimator.add_log(few())
        estimator.sample(2, every=2)

    return repeat


def online_anew(_: Path) -> Repeat:
    def repeat() -> None:
        estimator = oddsmap.OnlineFullMap(full_map().config)
        estimator.add_scans(sonar())
        estimator.view()

    return repeat


def online_on(_: Path) -> Repeat:
    """One estimator where a robot drives the same way, time and again; it keeps four old scans."""
    estimator = oddsmap.OnlineFullMap(full_map().config, reservoir=4)
    return partial(estimator.add_scans, sonar())


def reflection_maps(**options: Any) -> Workload:
    """One of each scan, likewise."""

    def repeat() -> None:
        for scan in few():
            oddsmap.build_reflection_map([scan], FINE, sensor=SONAR, sweeps=4, **options)

    return lambda _: repeat


def calibrating(scans: Callable[[], list[Any]], sensor: Any, **options: Any) -> Workload:
    settings = oddsmap.FullMapConfig(sweeps=2)
    return lambda _: partial(
        oddsmap.calibrate, scans(), CELL, sensor=sensor, settings=settings, updates=2, threads=2,
        **options,
    )  # fmt: skip


def scoring(belief: Callable[[], Any], scans: Callable[[], list[Any]], sensor: Any) -> Workload:
    return lambda _: partial(oddsmap.score_map, belief(), scans(), sensor)


def doubting(_: Path) -> Repeat:
    return partial(oddsmap.check_log, [*lidar()])


def diagnosing(_: Path) -> Repeat:
    return partial(oddsmap.diagnose, [*lidar()][:12])


def asking(grid: Callable[[], Any]) -> Workload:
    """Points and rays, of a view as it stands and as a caster keeps it."""

    def repeat() -> None:
        view = grid().log_odds()
        points = np.random.default_rng(0).uniform(-3.0, 3.0, (200, grid().ndim))
        ways = points / np.linalg.norm(points, axis=1)[:, None]
        view.at(points)
        view.states_at(points)
        view.cast_rays(np.zeros_like(points), ways, 5.0, threads=2)
        view.ray_caster().cast(np.zeros_like(points), ways, 5.0)
        grid().calibrated().at(points)
        grid().calibrated(neighbours=True).at(points)
        view.expected_ranges(np.zeros_like(points), ways, LIDAR)
        view.range_distribution(np.zeros_like(points), ways, LIDAR, bin_width=0.5)
        view.frontiers(min_cells=3)
        stands = [np.eye(grid().ndim + 1)] * 20
        view.information_gain(stands, ways, 5.0, threads=2)
        view.information_gain(stands, ways, 5.0, votes="scan")
        field = view.distance_field(1.0, signed=True, threads=2)
        field.update(view)
        field.at(points)
        view.distance_band(0.5, threads=2).at(points)
        if view.ndim == 2:
            costs = view.costmap(0.3)
            oddsmap.inflate(costs.cost, CELL, inscribed_radius=0.3)

    return lambda _: repeat


def localising(_: Path) -> Repeat:
    """One scan from many poses, of models made anew and of models that are kept."""
    kept = view().likelihood_field(20.0), view().beam_likelihood(20.0)

    def repeat() -> None:
        poses = np.random.default_rng(0).uniform(2.0, 8.0, (400, 3))
        for model in (*kept, view().likelihood_field(20.0), view().beam_likelihood(20.0)):
            model.log_likelihood(poses, lidar()[0], max_beams=60, threads=2)

    return repeat


def cleaning(folder: Path) -> Repeat:
    def repeat() -> None:
        for grid, scans in ((oddsmap.build_map(lidar()[:5], CELL), lidar()[:5]),
                            (oddsmap.build_map(turns(), 0.2), turns())):  # fmt: skip
            cleaner = oddsmap.Cleaner(grid)
            for part in cleaner.label(scans):
                assert isinstance(part, oddsmap.LabelledScan)
                cleaner.dynamic_at(part.points)
            cleaner.static_map()

    return repeat


def asking_why(_: Path) -> Repeat:
    def repeat() -> None:
        oddsmap.why(plane(), lidar(), (3.0, 3.0))
        oddsmap.why(room(), turns(), (1.0, 1.0, 1.0))

    return repeat


def driving(_: Path) -> Repeat:
    return partial(oddsmap.traversable, room(), max_step=0.2)


def evaluating(_: Path) -> Repeat:
    p = np.random.default_rng(0).random((400, 400))
    return partial(oddsmap.evaluate, p, p > 0.4)


def exact(_: Path) -> Repeat:
    rng = np.random.default_rng(0)
    model = SONAR.forward_model()
    ways = np.tile([[1.0, 0.0]], (20, 1))
    origins = np.stack([np.zeros(20), rng.uniform(0.0, 0.4, 20)], axis=1)

    def repeat() -> None:
        window = oddsmap.Window((rng.random((4, 3)) < 0.3).astype(float), CELL, np.array([5, 0]))
        beams = model.simulate(origins, ways, window, rng)
        beams = oddsmap.Beams(beams.origins, beams.directions, beams.ranges)
        posterior = oddsmap.ExactPosterior((4, 3), resolution=CELL, lo=(5, 0), coupling=0.5)
        posterior.update(beams, oddsmap.ForwardModel(cone_deg=25.0, range_max=4.0))
        posterior.marginals()
        posterior.sample(100, rng)

    return repeat
