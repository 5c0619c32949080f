# SPDX-License-Identifier: Apache-2.0
"""What a file says, from reading it to a small map of it, as something to compare."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import oddsmap
from oddsmap.errors import OddsmapError
from oddsmap.recordings.ros_recording import open_ros_recording
from oddsmap.recordings.summary import describe

__all__ = [
    "Answer",
    "of_config",
    "of_full_map_config",
    "of_landmark_map",
    "of_landmarks",
    "of_log",
    "of_map",
    "of_octomap",
    "of_recording",
    "of_ros",
]

_RESOLUTION = 0.25


class Answer(NamedTuple):
    digest: str
    """Of all values."""
    said: tuple[str, ...]
    """What the reader counted as skipped and what it warned of."""


def of_log(path: Path, **options: Any) -> Answer:
    """A log, what `info` says of it, and a map of it."""
    from oddsmap.cli.info import _of_log

    log = oddsmap.open_log(path, **options)
    values: list[Any] = [dict(log.sensor)]
    for scan in log:
        pose = scan.map_from_sensor
        values += [pose.translation, pose.rotation, scan.stamp_ns]
        values += [getattr(scan, name, None) for name in ("directions", "ranges", "depth", "seen")]
    json.dumps(_of_log(log, lambda _: None))
    grid = oddsmap.build_map(log, _RESOLUTION)
    assert grid.report is not None  # its counts are those of the log and of the sensor
    said = [f"{reason} {count}" for reason, count in sorted(grid.report.skipped.items())]
    said += [note for note in log.notes if note.severity == "warning"]
    return Answer(_digest([*values, *grid.cells()]), tuple(said))


def of_recording(path: Path) -> Answer:
    """A recording as a log, and what `info` says of it; where it is refused, what can be salvaged.

    What is said of the latter is not looked at: that it is an answer or one line is enough.
    """
    try:
        answer = of_log(path)
        describe(open_ros_recording(str(path)))
    except OddsmapError:
        with suppress(OddsmapError):
            describe(open_ros_recording(str(path), skip_bad=True))
        with suppress(OddsmapError):
            for _ in oddsmap.open_log(path, skip_bad=True):
                pass
        raise
    return answer


def of_map(path: Path) -> Answer:
    """A saved map of either kind, as `info` and `export` read it."""
    from oddsmap.cli.info import _of_full_map, _of_map
    from oddsmap.full_map.store import is_full_map

    if is_full_map(path):
        full = oddsmap.load_full_map(path)
        facts = _of_full_map(full, path)
        values = [*full.known_log_odds(), full.marks_of()]
    else:
        grid = oddsmap.load_map(path)
        facts = _of_map(path)
        values = [*grid.cells(), grid.log_odds().probability()]
    return Answer(_digest([json.dumps(facts), *values]), ())


def of_octomap(path: Path) -> Answer:
    """An OctoMap, and what `info` says of it."""
    from oddsmap.cli.info import _of_octomap

    voxels = oddsmap.load_octomap(path)
    facts = json.dumps(_of_octomap(voxels, path))
    return Answer(_digest([facts, voxels.index, voxels.log_odds, voxels.level]), ())


def of_ros(path: Path) -> Answer:
    """A ROS map."""
    grid = oddsmap.load_ros(path)
    values = [grid.probability, grid.state(), grid.resolution, grid.origin, grid.yaw]
    return Answer(_digest(values), tuple(grid.notes))


def of_landmarks(path: Path) -> Answer:
    """A table of observations, and the landmarks of it."""
    from oddsmap.landmarks import read_observations

    table = read_observations(path)
    noise = {
        "range-bearing": {"sigma_range": 0.1, "sigma_bearing": 0.02},
        "bearing": {"sigma_bearing": 0.02},
        "position": {"sigma_xy": 0.1},
    }[table.kind]
    marks = oddsmap.LandmarkMap()
    for scan in table.scans(**noise):
        marks.add(scan)
    said = [f"{reason} {n}" for reason, n in sorted((table.skipped + marks.skipped).items())]
    return Answer(_landmarks(marks), tuple(said))


def of_landmark_map(path: Path) -> Answer:
    """A map of landmarks."""
    marks = oddsmap.LandmarkMap.load(path)
    return Answer(_landmarks(marks), ())


def _landmarks(marks: oddsmap.LandmarkMap) -> str:
    values: list[Any] = [marks.tentative, marks.unlocated]
    for mark in marks.landmarks:
        values += [mark.id, mark.count, mark.mean, mark.covariance]
    return _digest(values)


def of_config(path: Path, scans: Sequence[Any]) -> Answer:
    """A configuration, and a map of some scans made with it."""
    from oddsmap.config.config import read_toml, resolve

    config = resolve(("file", read_toml(path)))
    grid = oddsmap.build_map(
        scans,
        config.map.resolution,
        sensor=config.sensor,
        votes=config.map.votes,
        half_life=config.map.half_life,
        t_ref_ns=config.map.t_ref_ns,
        path_lengths=config.map.path_lengths,
    )
    probability = grid.log_odds(prior=config.posterior.prior).probability()
    return Answer(_digest([json.dumps(config.to_dict()), *grid.cells(), probability]), ())


def of_full_map_config(path: Path, scans: Sequence[oddsmap.Scan]) -> Answer:
    """A configuration, and a full map of some scans made with it."""
    from oddsmap.config.config import read_toml, resolve

    config = resolve(("file", read_toml(path)))
    full = oddsmap.build_full_map(
        scans, config.map.resolution, sensor=config.sensor, settings=config.full_map
    )
    return Answer(_digest([json.dumps(config.to_dict()), *full.known_log_odds()]), ())


def _digest(values: Iterable[Any]) -> str:
    whole = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            whole.update(
                f"{value.dtype} {value.shape}".encode() + np.ascontiguousarray(value).tobytes()
            )
        else:
            whole.update(repr(value).encode())
    return whole.hexdigest()
