# SPDX-License-Identifier: Apache-2.0
"""The logs of `oddsmap build`, opened: what of them is mapped, and with which configuration."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from oddsmap.cli.sensor_names import check_width, may_be_called, sensor_name

if TYPE_CHECKING:
    from oddsmap.cli.build_plan import BuildPlan
    from oddsmap.config.config import Config
    from oddsmap.plausibility.sample import Sample
    from oddsmap.scans.log import Log
    from oddsmap.sensors.registry import Sensor

__all__ = ["OpenedLog", "OpenedLogs", "checked_logs", "open_logs", "watched"]


@dataclass(frozen=True, slots=True)
class OpenedLog:
    """A log, without the scans that are kept back, its configuration, and a look at its scans.

    Args:
        log: what is mapped.
        config: for its map.
        sample: fills while it is read, where it is watched.
        head: the log as it was opened.
    """

    log: Log
    config: Config
    sample: Sample
    head: Any

    @property
    def is_watched(self) -> bool:
        """Whether the sample fills."""
        return not getattr(self.head, "points_in_map", False)


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenedLogs:
    """All logs of a map.

    Args:
        logs: one or more.
        sensor: what --sensor would call their sensor, the same for all.
        held_out: how many scans are kept back; None where a log does not know its length.
        read_s: how long it took to open them [s].
    """

    logs: list[OpenedLog]
    sensor: str
    held_out: int | None
    read_s: float


def open_logs(plan: BuildPlan) -> OpenedLogs:
    """Open the logs of a plan, and check that they make one map.

    Raises:
        OddsmapError: a log cannot be read, or does not fit the plan or the other logs.
    """
    from oddsmap.scans.log import parts_of

    started = time.perf_counter()
    logs = [part for path in plan.logs for part in parts_of(plan.log_options.open(path))]
    return checked_logs(plan, logs, time.perf_counter() - started)


def checked_logs(plan: BuildPlan, logs: list[Any], read_s: float) -> OpenedLogs:
    """Check that logs make one map.

    Args:
        plan: the plan.
        logs: its logs, in parts.
        read_s: how long it took to open them [s].

    Raises:
        OddsmapError: a log does not fit the plan or the other logs.
    """
    from oddsmap.cli.append_settings import configs_to_append
    from oddsmap.scans.split_log import run_of

    for log in logs:
        check_width(log, plan.settings.sensor)
    if plan.append:
        configs = configs_to_append(plan.output, plan.layers, logs)
    else:
        configs = [plan.layers.resolve(log) for log in logs]
    sensor = _only_sensor(plan, logs, configs)
    every = plan.hold_out_every
    runs = [run_of(log) if plan.blocks else 1 for log in logs]
    return OpenedLogs(
        logs=[
            _watched(log, config, every, run)
            for log, config, run in zip(logs, configs, runs, strict=True)
        ],
        sensor=sensor,
        held_out=_held_out(logs, every, runs),
        read_s=read_s,
    )


def _held_out(logs: list[Log], every: int | None, runs: list[int]) -> int | None:
    from oddsmap.scans.split_log import held_count

    counts = [log.scan_count for log in logs]
    if every is None:
        return 0
    if None in counts:
        return None
    return sum(held_count(n or 0, every, run) for n, run in zip(counts, runs, strict=True))


def _only_sensor(plan: BuildPlan, logs: list[Log], configs: list[Config]) -> str:
    """What the sensor of all logs is called; refused where the plan does not fit it."""
    from oddsmap.errors import ConfigError

    names = {sensor_name(log, config) for log, config in zip(logs, configs, strict=True)}
    name, stated = min(names), plan.settings.sensor
    if len(names) > 1 or (stated is not None and not may_be_called(name, stated)):
        raise ConfigError(
            f"{plan.logs[0]}: the logs are of {' and '.join(sorted(names))}"
            + (f", --sensor says {stated}" if stated else ", one map takes one kind")
        )
    if plan.method == "projective" and name != "depth":
        raise ConfigError(
            f"{plan.logs[0]}: --method projective is for depth images, the scans are {name}"
        )
    return name


def watched(log: Log, sensor: Sensor) -> tuple[Log, Sample]:
    """A log with a sample that fills while it is read.

    Args:
        log: a whole log.
        sensor: the sensor model that it is mapped by.
    """
    from oddsmap.plausibility.doubts import WatchedLog
    from oddsmap.plausibility.sample import Sample

    range_max = getattr(sensor, "range_max", None)
    sample = Sample(log.scan_count, float("inf") if range_max is None else range_max)
    # Points of the map fit together however their poses are.
    return log if getattr(log, "points_in_map", False) else WatchedLog(log, sample), sample


def _watched(log: Log, config: Config, every: int | None, run: int) -> OpenedLog:
    """What is mapped of a log, with its sample."""
    from oddsmap.scans.split_log import hold_out

    whole, sample = watched(log, config.sensor)
    mapped = whole if every is None else hold_out(whole, every, run)[0]
    return OpenedLog(mapped, config, sample, log)
