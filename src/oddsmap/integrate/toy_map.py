# SPDX-License-Identifier: Apache-2.0
"""Toy maps that go through the kernels of a real one, to compile them before the clock starts."""

from __future__ import annotations

from typing import Literal

import numpy as np

from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.threads import WorkerPool
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor
from oddsmap.sensors.registry import Sensor
from oddsmap.warm_up import warm_up

__all__ = ["compile_kernels"]


def compile_kernels(evidence: Evidence, sensor: Sensor, method: str) -> float:
    """Compile what a map needs, or load it from the cache; returns the seconds that took."""
    weights = evidence.config.map.forgets or not getattr(sensor, "whole_votes", True)
    return warm_up(
        _map_a_toy,
        evidence.ndim,
        sensor.evidence_from,
        sensor.kind,
        evidence.votes,
        weights,
        evidence.lengths is not None,
        method,
    )


def _map_a_toy(
    ndim: int,
    source: str,
    kind: str,
    votes: Literal["scan", "beam"],
    weights: bool,
    lengths: bool,
    method: str,
) -> None:
    pose = Pose2(0.5, 0.5, 0.0) if ndim == 2 else Pose3(np.full(3, 0.5), np.eye(3))
    scan: Measurement = Scan(pose, np.eye(ndim), np.full(ndim, 3.0))
    sensor: Sensor = BeamSensor(fade=1.0 if weights else 0.0)
    if kind == OverheadSensor.kind and isinstance(pose, Pose2):
        sensor, scan = OverheadSensor(), GridScan(pose, np.eye(2), 1.0, (0.0, 0.0))
    elif source == "cells":
        sensor = ConeSensor(cone_deg=30.0)
    elif method == "projective" and isinstance(pose, Pose3):
        camera = PinholeCamera(2.0, 2.0, 1.5, 1.5, width=4, height=4)
        scan = DepthScan(pose, np.full((4, 4), 3.0, np.float32), camera)
    toy = Evidence(1.0, sensor=sensor, votes=votes, path_lengths=lengths, ndim=ndim)
    for _ in WorkerPool(toy, sensor, 1, method).run([scan]):
        pass
    toy.tiles.merge(toy.tiles)
