# SPDX-License-Identifier: Apache-2.0
"""Occupancy mapping: from range-sensor readings at known poses to a probabilistic map.

    log = oddsmap.open_log("intel.log.gz")
    grid = oddsmap.build_map(log, resolution=0.05)
    grid.log_odds().save_ros("intel.yaml")

Readings become evidence (hits and passes, exact integers), evidence adds up in a sparse map, and
every posterior is a view of it.
"""

from __future__ import annotations

from importlib import import_module

from oddsmap.version import __version__

# As in `typing`, which would take most of the time of this import: Ctrl-C in these first
# milliseconds would end a command in a traceback.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from oddsmap.cleaning.cleaner import Cleaner, LabelledScan
    from oddsmap.config.full_map import FullMapConfig
    from oddsmap.doctor.diagnosis import diagnose
    from oddsmap.errors import (
        ConfigError,
        InputError,
        MapTooLargeError,
        OddsmapError,
        OutputError,
    )
    from oddsmap.evidence.map_history import MapHistory
    from oddsmap.evidence_map import EvidenceMap, build_map, build_saved_map, load_map
    from oddsmap.forward.beams import Beams
    from oddsmap.forward.model import ForwardModel
    from oddsmap.forward.occupancy_box import Window
    from oddsmap.full_map.estimator import FullMapEstimator, build_full_map
    from oddsmap.full_map.exact import ExactPosterior
    from oddsmap.full_map.full_map import FullMap, load_full_map
    from oddsmap.full_map.online import OnlineFullMap
    from oddsmap.full_map.reflection import build_reflection_map
    from oddsmap.full_map.reflection_map import ReflectionMap
    from oddsmap.integrate.add import add_scans
    from oddsmap.landmarks.landmark_map import LandmarkMap
    from oddsmap.maps.probability_map import ProbabilityMap, load_ros
    from oddsmap.maps.voxel_map import VoxelMap, load_octomap
    from oddsmap.odds import State, Thresholds
    from oddsmap.plausibility.doubts import check_log
    from oddsmap.poses.pose import Pose2, Pose3
    from oddsmap.poses.trajectory import Trajectory
    from oddsmap.posterior.calibrated import Calibrated
    from oddsmap.posterior.changes import changed
    from oddsmap.posterior.comparison import compare
    from oddsmap.posterior.decay_rate import DecayRate
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.posterior.prior import PriorArray
    from oddsmap.posterior.reflection import Reflection
    from oddsmap.projection.floor import Verdict
    from oddsmap.projection.project import project
    from oddsmap.projection.traversable import Traversability, traversable
    from oddsmap.query.beam_likelihood import BeamLikelihood
    from oddsmap.query.costmap import Costmap, inflate
    from oddsmap.query.distance_band import DistanceBand
    from oddsmap.query.distance_field import DistanceField
    from oddsmap.query.frontiers import Frontier
    from oddsmap.query.likelihood_field import LikelihoodField
    from oddsmap.query.predicted_ranges import RangeDistribution
    from oddsmap.query.queries import PointStates
    from oddsmap.query.ray_caster import RayCaster, RayHits
    from oddsmap.readers import open_log
    from oddsmap.scale.saved_map import SavedMap
    from oddsmap.scans.depth_image import DepthScan, PinholeCamera
    from oddsmap.scans.grid_scan import GridScan
    from oddsmap.scans.log import Log
    from oddsmap.scans.scan import Scan
    from oddsmap.scoring.calibration import calibrate
    from oddsmap.scoring.held_out import score_map
    from oddsmap.scoring.truth import evaluate
    from oddsmap.sensors.beam import BeamSensor
    from oddsmap.sensors.cone import ConeSensor
    from oddsmap.sensors.overhead import OverheadSensor
    from oddsmap.witnesses.why import Explanation, ScanVote, why

__all__ = [
    "BeamLikelihood",
    "BeamSensor",
    "Beams",
    "Calibrated",
    "Cleaner",
    "ConeSensor",
    "ConfigError",
    "Costmap",
    "DecayRate",
    "DepthScan",
    "DistanceBand",
    "DistanceField",
    "EvidenceMap",
    "ExactPosterior",
    "Explanation",
    "ForwardModel",
    "Frontier",
    "FullMap",
    "FullMapConfig",
    "FullMapEstimator",
    "GridScan",
    "InputError",
    "LabelledScan",
    "LandmarkMap",
    "LikelihoodField",
    "Log",
    "LogOdds",
    "MapHistory",
    "MapTooLargeError",
    "OddsmapError",
    "OnlineFullMap",
    "OutputError",
    "OverheadSensor",
    "PinholeCamera",
    "PointStates",
    "Pose2",
    "Pose3",
    "PriorArray",
    "ProbabilityMap",
    "RangeDistribution",
    "RayCaster",
    "RayHits",
    "Reflection",
    "ReflectionMap",
    "SavedMap",
    "Scan",
    "ScanVote",
    "State",
    "Thresholds",
    "Trajectory",
    "Traversability",
    "Verdict",
    "VoxelMap",
    "Window",
    "__version__",
    "add_scans",
    "build_full_map",
    "build_map",
    "build_reflection_map",
    "build_saved_map",
    "calibrate",
    "changed",
    "check_log",
    "compare",
    "diagnose",
    "evaluate",
    "inflate",
    "load_full_map",
    "load_map",
    "load_octomap",
    "load_ros",
    "open_log",
    "project",
    "score_map",
    "traversable",
    "why",
]

# Loaded when first used: `import oddsmap` takes milliseconds and compiles nothing.
_HOME = {
    "BeamLikelihood": "query.beam_likelihood",
    "BeamSensor": "sensors.beam",
    "Beams": "forward.beams",
    "Calibrated": "posterior.calibrated",
    "Cleaner": "cleaning.cleaner",
    "ConeSensor": "sensors.cone",
    "ConfigError": "errors",
    "Costmap": "query.costmap",
    "DecayRate": "posterior.decay_rate",
    "DepthScan": "scans.depth_image",
    "DistanceBand": "query.distance_band",
    "DistanceField": "query.distance_field",
    "EvidenceMap": "evidence_map",
    "ExactPosterior": "full_map.exact",
    "Explanation": "witnesses.why",
    "ForwardModel": "forward.model",
    "Frontier": "query.frontiers",
    "FullMap": "full_map.full_map",
    "FullMapConfig": "config.full_map",
    "FullMapEstimator": "full_map.estimator",
    "GridScan": "scans.grid_scan",
    "InputError": "errors",
    "LabelledScan": "cleaning.cleaner",
    "LandmarkMap": "landmarks.landmark_map",
    "LikelihoodField": "query.likelihood_field",
    "Log": "scans.log",
    "LogOdds": "posterior.log_odds",
    "MapHistory": "evidence.map_history",
    "MapTooLargeError": "errors",
    "OddsmapError": "errors",
    "OnlineFullMap": "full_map.online",
    "OutputError": "errors",
    "OverheadSensor": "sensors.overhead",
    "PinholeCamera": "scans.depth_image",
    "PointStates": "query.queries",
    "Pose2": "poses.pose",
    "Pose3": "poses.pose",
    "PriorArray": "posterior.prior",
    "ProbabilityMap": "maps.probability_map",
    "RangeDistribution": "query.predicted_ranges",
    "RayCaster": "query.ray_caster",
    "RayHits": "query.ray_caster",
    "Reflection": "posterior.reflection",
    "ReflectionMap": "full_map.reflection_map",
    "SavedMap": "scale.saved_map",
    "Scan": "scans.scan",
    "ScanVote": "witnesses.why",
    "State": "odds",
    "Thresholds": "odds",
    "Trajectory": "poses.trajectory",
    "Traversability": "projection.traversable",
    "Verdict": "projection.floor",
    "VoxelMap": "maps.voxel_map",
    "Window": "forward.occupancy_box",
    "add_scans": "integrate.add",
    "build_full_map": "full_map.estimator",
    "build_map": "evidence_map",
    "build_reflection_map": "full_map.reflection",
    "build_saved_map": "evidence_map",
    "calibrate": "scoring.calibration",
    "changed": "posterior.changes",
    "compare": "posterior.comparison",
    "check_log": "plausibility.doubts",
    "diagnose": "doctor.diagnosis",
    "evaluate": "scoring.truth",
    "inflate": "query.costmap",
    "load_full_map": "full_map.full_map",
    "load_map": "evidence_map",
    "load_octomap": "maps.voxel_map",
    "load_ros": "maps.probability_map",
    "open_log": "readers",
    "project": "projection.project",
    "score_map": "scoring.held_out",
    "traversable": "projection.traversable",
    "why": "witnesses.why",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'oddsmap' has no attribute {name!r}")
    value = getattr(import_module(f"oddsmap.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
