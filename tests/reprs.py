# SPDX-License-Identifier: Apache-2.0
"""What each public thing says and shows of itself: `python -m tests.reprs` prints all of it."""

from __future__ import annotations

import inspect
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import oddsmap
from oddsmap import EvidenceMap, LogOdds, Scan, simulate
from oddsmap.landmarks import Observations
from oddsmap.scans.note import Note
from oddsmap.scans.split_log import hold_out

ANGLES = np.linspace(-2.0, 2.0, 180)
SCANS = [
    Scan.from_angles((0.1 * i, 0.0, 0.1), ANGLES, np.full(180, 2.0 + 0.1 * i), stamp_s=1.7e9 + i)
    for i in range(20)
]
TIMES = 5_000_000_000 + np.arange(180) * 1000
CONES = [Scan.from_cone((0.2 * i, 0, 0), 0.1 * i, 1.5, cone_deg=20) for i in range(3)]
SENSOR = oddsmap.BeamSensor(range_max=30.0, sigma=0.02)
CONE = oddsmap.ConeSensor(cone_deg=20.0, range_max=4.0)
CAMERA = oddsmap.PinholeCamera(10.0, 10.0, 1.5, 1.5, width=4, height=4)


def things(folder: Path) -> dict[str, Any]:
    """One of each kind of public thing, and what public functions return, by a name for the table.

    Args:
        folder: where logs are written.
    """
    plane = oddsmap.build_map(SCANS, 0.1, votes="beam", path_lengths=True)
    rng = np.random.default_rng(0)
    points = rng.uniform(-2.0, 2.0, (300, 3))
    clouds = [Scan.from_points(np.eye(4), points)]
    space = oddsmap.build_map(clouds, 0.2)
    plane.save(folder / "saved.zarr")
    return {
        "MapHistory": oddsmap.EvidenceMap.history(folder / "kept.icechunk"),
        "SavedMap": oddsmap.EvidenceMap.open(folder / "saved.zarr"),
        **_of_readings(), **_of_logs(folder), **_of_maps(plane, space), **_of_views(plane, space),
        **_of_queries(plane.log_odds(), space.log_odds()), **_of_several(plane, space, clouds),
        **_of_full_maps(),
    }  # fmt: skip


def _of_readings() -> dict[str, Any]:
    turn = simulate.room_walk(3)[1].rotation
    times = np.arange(100) * 100_000_000 + 1_700_000_000_000_000_000
    tilted = oddsmap.Pose3(np.array([1.0, 2.0, 0.5]), turn)
    return {
        "Scan": SCANS[0],
        "Scan of points": Scan.from_points(tilted, np.ones((5000, 3))),
        "Scan of moving beams": Scan(
            oddsmap.Pose2(0.0, 0.0, 0.0), SCANS[0].directions, ANGLES**2, beam_times_ns=TIMES
        ),
        "Scan of a cone": CONES[1],
        "DepthScan": oddsmap.DepthScan.from_depth(np.eye(4), np.ones((4, 4)), CAMERA),
        "PinholeCamera": CAMERA,
        "GridScan": oddsmap.GridScan((0, 0, 0), np.eye(20), 0.1, (0, 0)),  # type: ignore[arg-type]
        "Pose2": oddsmap.Pose2(3445678.123456789, 2.0, 1.0 / 3.0),
        "Pose3": tilted,
        "Trajectory": oddsmap.Trajectory(np.zeros((100, 3)), np.stack([np.eye(3)] * 100), times),
        "BeamSensor": oddsmap.BeamSensor(),
        "BeamSensor, set": oddsmap.BeamSensor(range_max=30.0, sigma=0.02, p_hit=0.8),
        "ConeSensor": CONE,
        "OverheadSensor": oddsmap.OverheadSensor(),
        "Thresholds": oddsmap.Thresholds(),
        "State": oddsmap.State.FREE,
        "Verdict": oddsmap.Verdict(1),
        "Beams": oddsmap.Beams.from_scans(SCANS)[0],
        "ForwardModel": CONE.forward_model(),
        "Window": oddsmap.Window(np.zeros((30, 40)), 0.1, np.array([0, 5])),
        "InputError": oddsmap.InputError("hall.log:812: FLASER announces 180 ranges"),
    }


def _of_logs(folder: Path) -> dict[str, Any]:
    rows = [[0.1 * i, 0.0, 0.1, 0.01 * j, 2.0] for i in range(50) for j in range(20)]
    np.savez(folder / "log.npz", beams=np.array(rows)[:, [0, 1, 3, 4]])
    loaded = oddsmap.open_log(folder / "log.npz")
    (folder / "clouds").mkdir()
    for i in range(3):
        np.array([[1.0 + i, 0.5, 0.2, 0.0]], np.float32).tofile(folder / "clouds" / f"{i}.bin")
    (folder / "clouds" / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    return {
        "Log in memory": loaded,
        "Log read on demand": oddsmap.open_log(folder / "clouds", columns="x,y,z,intensity"),
        "Log, a part of it": hold_out(loaded, 10)[0],
        "check_log": oddsmap.check_log(loaded),
        "Note": Note("some scans have no stamp", code="x.y"),
        "Diagnosis": oddsmap.diagnose(loaded),
    }


def _of_maps(plane: EvidenceMap, space: EvidenceMap) -> dict[str, Any]:
    landmarks = oddsmap.LandmarkMap()
    places = np.array([[1.0, 0.5], [3.0, -1.0]])
    here = oddsmap.Pose2(0.0, 0.0, 0.0)
    landmarks.add(Observations.position(here, places, sigma_xy=0.1, ids=np.arange(2)))
    return {
        "EvidenceMap, empty": EvidenceMap(0.05),
        "EvidenceMap": plane,
        "EvidenceMap, 3D": space,
        "EvidenceMap, forgetting": oddsmap.build_map(SCANS[:3], 0.1, half_life=60.0),
        "Report": plane.report,
        "Config": plane.config,
        "LandmarkMap": landmarks,
        "LandmarkMap, empty": oddsmap.LandmarkMap(),
    }


def _of_views(plane: EvidenceMap, space: EvidenceMap) -> dict[str, Any]:
    old = plane.log_odds().to_probability_map()
    return {
        "LogOdds": plane.log_odds(),
        "LogOdds, 3D": space.log_odds(p_hit=0.9, clamp=(0.1, 0.9)),
        "LogOdds with a prior map": plane.log_odds(prior=old),
        "LogOdds, empty": EvidenceMap(0.05).log_odds(),
        "Calibrated": plane.calibrated(),
        "CountModel": plane.calibrated().model,
        "Reflection": plane.reflection(),
        "DecayRate": plane.decay_rate(),
        "PriorArray": oddsmap.PriorArray(np.full((30, 40), 0.3), (0, 0)),
        "ProbabilityMap": old,
        "VoxelMap": space.log_odds().to_voxels(),
        "project": oddsmap.project(space.log_odds(), -0.2, 0.8),
    }


def _of_queries(view: LogOdds, space: LogOdds) -> dict[str, Any]:
    return {
        "PointStates": view.states_at([[1.0, 0.5], [1.0, 1.0]]),
        "RayHits": view.cast_rays([[0.5, 0.0]], [[1.0, 0.0]], 30.0),
        "RayCaster": view.ray_caster(),
        "DistanceField": view.distance_field(2.0),
        "DistanceField, 3D": space.distance_field(1.0, signed=True),
        "DistanceBand": view.distance_band(0.5),
        "Costmap": view.costmap(0.2),
        "LikelihoodField": view.likelihood_field(20.0),
        "BeamLikelihood": view.beam_likelihood(20.0),
        "Frontier": view.frontiers()[0],
        "RangeDistribution": view.range_distribution(
            [[0.5, 0.0]], [[1.0, 0.0]], SENSOR, bin_width=0.5
        ),
    }


def _of_several(plane: EvidenceMap, space: EvidenceMap, clouds: list[Scan]) -> dict[str, Any]:
    later = oddsmap.build_map(SCANS[:5], 0.1, votes="beam", path_lengths=True)
    cleaner, witnesses = oddsmap.Cleaner(space), oddsmap.why(plane, SCANS, (1.0, 0.5))
    return {
        "compare": oddsmap.compare(plane.log_odds(), later.log_odds()),
        "changed": oddsmap.changed(plane.log_odds(), later.log_odds()),
        "Traversability": oddsmap.traversable(space, max_step=0.2),
        "Cleaner": cleaner,
        "LabelledScan": next(iter(cleaner.label(clouds))),
        "Explanation": witnesses,
        "ScanVote": witnesses.scans[0],
        "evaluate": oddsmap.evaluate(np.full((4, 4), 0.3), np.eye(4) > 0),
    }


def _of_full_maps() -> dict[str, Any]:
    settings = oddsmap.FullMapConfig(sweeps=2, burn_in=1)
    full = oddsmap.build_full_map(CONES, 0.2, sensor=CONE, settings=settings)
    estimator = oddsmap.FullMapEstimator(full.config)
    estimator.add_log(CONES)
    online = oddsmap.OnlineFullMap(full.config)
    online.add_scans(CONES)
    return {
        "FullMap": full,
        "FullMapConfig": oddsmap.FullMapConfig(),
        "FullMapEstimator": estimator,
        "OnlineFullMap": online,
        "ReflectionMap": oddsmap.build_reflection_map(CONES, 0.2, sensor=CONE, sweeps=3),
        "ExactPosterior": oddsmap.ExactPosterior((4, 3), resolution=0.1),
        "score_map": oddsmap.score_map(full, CONES, CONE),
    }


def help_of(thing: object) -> str:
    """The first line of what `help` says of its kind."""
    return (inspect.getdoc(type(thing)) or "").partition("\n")[0]


def plotted(thing: Any) -> str:
    """What `plot` does: "yes", why not, or "-" where there is none."""
    if not hasattr(thing, "plot"):
        return "-"
    from matplotlib.figure import Figure

    try:
        thing.plot(Figure().subplots())
    except oddsmap.InputError as error:
        return str(error)
    return "yes"


def pictured(thing: Any) -> str:
    """Whether it shows itself in a notebook; "-" where it does not try."""
    if not hasattr(thing, "_repr_png_"):
        return "-"
    return "no" if thing._repr_png_() is None else "yes"


def main() -> None:
    """Print what each says, its length, its help, and whether it has a picture and a plot."""
    with tempfile.TemporaryDirectory() as folder:
        for name, thing in things(Path(folder)).items():
            text = repr(thing)
            sys.stdout.write(
                f"{name}\n    help    {help_of(thing)}\n    repr    {text}  ({len(text)})\n"
                f"    picture {pictured(thing)}\n    plot    {plotted(thing)}\n"
            )


if __name__ == "__main__":
    main()
