# SPDX-License-Identifier: Apache-2.0
"""Occupancy mapping: range-sensor readings from known poses in, a probabilistic map out.

    log = oddsmap.open_log("intel.log.gz")
    grid = oddsmap.build_map(log, resolution=0.05)
    grid.log_odds().save_ros("intel.yaml")

Readings become evidence (hits and passes, exact integers), evidence adds up in a sparse map, and
every posterior is a view of it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.errors import (
        ConfigError,
        InputError,
        MapTooLargeError,
        OddsmapError,
        OutputError,
    )
    from oddsmap.evidence import EvidenceMap
    from oddsmap.export.octomap_reader import load_octomap
    from oddsmap.export.ros_reader import load_ros
    from oddsmap.integrate import add_scans, build_map
    from oddsmap.landmarks.landmark_map import LandmarkMap
    from oddsmap.poses import Pose2, Pose3
    from oddsmap.posterior.changed import changed
    from oddsmap.posterior.decay import DecayRate
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.posterior.reflection import Reflection
    from oddsmap.probability_map import ProbabilityMap, State, Thresholds
    from oddsmap.projection import project
    from oddsmap.readers import open_log
    from oddsmap.scan import Log, Scan
    from oddsmap.sensors.beam import BeamSensor
    from oddsmap.sensors.cone import ConeSensor
    from oddsmap.sensors.overhead import GridScan, OverheadSensor
    from oddsmap.store import load_map
    from oddsmap.voxels import VoxelMap

__version__ = "0.1.0"

__all__ = [
    "BeamSensor",
    "ConeSensor",
    "ConfigError",
    "DecayRate",
    "EvidenceMap",
    "GridScan",
    "InputError",
    "LandmarkMap",
    "Log",
    "LogOdds",
    "MapTooLargeError",
    "OddsmapError",
    "OutputError",
    "OverheadSensor",
    "Pose2",
    "Pose3",
    "ProbabilityMap",
    "Reflection",
    "Scan",
    "State",
    "Thresholds",
    "VoxelMap",
    "__version__",
    "add_scans",
    "build_map",
    "changed",
    "load_map",
    "load_octomap",
    "load_ros",
    "open_log",
    "project",
]

# Loaded when first used: `import oddsmap` takes milliseconds and compiles nothing.
_HOME = {
    "BeamSensor": "sensors.beam",
    "ConeSensor": "sensors.cone",
    "ConfigError": "errors",
    "DecayRate": "posterior.decay",
    "EvidenceMap": "evidence",
    "GridScan": "sensors.overhead",
    "InputError": "errors",
    "LandmarkMap": "landmarks.landmark_map",
    "Log": "scan",
    "LogOdds": "posterior.log_odds",
    "MapTooLargeError": "errors",
    "OddsmapError": "errors",
    "OutputError": "errors",
    "OverheadSensor": "sensors.overhead",
    "Pose2": "poses",
    "Pose3": "poses",
    "ProbabilityMap": "probability_map",
    "Reflection": "posterior.reflection",
    "Scan": "scan",
    "State": "probability_map",
    "Thresholds": "probability_map",
    "VoxelMap": "voxels",
    "add_scans": "integrate",
    "build_map": "integrate",
    "changed": "posterior.changed",
    "load_map": "store",
    "load_octomap": "export.octomap_reader",
    "load_ros": "export.ros_reader",
    "open_log": "readers",
    "project": "projection",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'oddsmap' has no attribute {name!r}")
    value = getattr(import_module(f"oddsmap.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
