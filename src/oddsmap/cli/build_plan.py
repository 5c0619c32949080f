# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap build` is to do: all of its options, checked before a log is opened."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import typer

from oddsmap.cli.log_options import LogOptions
from oddsmap.cli.sensor_names import check_name, sensor_names
from oddsmap.cli.setting_layers import Layer, SettingLayers, read_layers

__all__ = ["EXPORTED", "BuildPlan", "MapSettings"]

EXPORTED = (
    ".yaml", ".yml", ".mcap", ".bag", ".png", ".pdf", ".svg", ".npz", ".tif", ".tiff", ".bt", ".ot",
    ".ply", ".las", ".laz", ".rrd",
)  # fmt: skip
"""The suffixes of what `oddsmap export` makes of a map."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings:
    """The options that set fields of the configuration; None: not stated."""

    resolution: float | None = None
    votes: Literal["scan", "beam"] | None = None
    half_life_scans: float | None = None
    sensor: str | None = None
    range_max: float | None = None
    clear_range: float | None = None
    sweeps: int | None = None
    config: Path | None = None
    settings: list[str] | None = None

    def layers(self) -> SettingLayers:
        """What they set, in layers.

        Raises:
            ConfigError: the file cannot be read, or a word of --set is of another form.
        """
        kind = None if self.sensor is None else sensor_names()[self.sensor]
        options: Layer = {
            "map": {
                "resolution": self.resolution,
                "votes": self.votes,
                "half_life_scans": self.half_life_scans,
            },
            "sensor": {
                "range_max": self.range_max,
                "clear_range": self.clear_range,
                "kind": kind,
            },
            "full_map": {"sweeps": self.sweeps},
        }
        return read_layers(self.config, self.settings, options)


@dataclass(frozen=True, kw_only=True)
class BuildPlan:
    """All options of one call of `oddsmap build`.

    Args:
        logs: the paths of the logs.
        log_options: how to read them.
        output: the map to write.
        force: whether it may replace an existing map.
        append: whether the logs are added to the map that is there.
        settings: the options that set fields of the configuration.
        estimator: what makes the map.
        method: how depth images clear.
        threads: how many work.
        hold_out: the share of scans to keep back; None: no scan.
        blocks: whether these are whole runs of scans.
        auto: whether the sensor is fitted to the logs.
        memory: what the map may take in memory, as "4GB"; None: half of what is free.
        quiet: whether to show no progress.
        dask: whose workers make the map: the address of a scheduler, or "local"; None: this
            process.
        chunk_scans: how many scans a worker takes at a time; None: by their number.

    Raises:
        ConfigError: options do not go together, or the map cannot be written there.
        typer.BadParameter: there is no resolution.
    """

    logs: list[Path]
    log_options: LogOptions = field(default_factory=LogOptions)
    output: Path
    force: bool = False
    append: bool = False
    settings: MapSettings = field(default_factory=MapSettings)
    estimator: Literal["filter", "full-map"] = "filter"
    method: Literal["rays", "projective"] = "rays"
    threads: int = 1
    hold_out: float | None = None
    blocks: bool = False
    auto: bool = False
    memory: str | None = None
    quiet: bool = False
    dask: str | None = None
    chunk_scans: int | None = None

    def __post_init__(self) -> None:
        from oddsmap.errors import ConfigError

        check_name(self.settings.sensor)
        self._check_estimator()
        self._check_dask()
        _ = self.hold_out_every, self.memory_bytes
        if self.blocks and self.hold_out is None:
            raise ConfigError("--blocks says which scans are kept back: add --hold-out 0.1")
        self._check_append()
        self._check_settings()
        self._check_files()

    @cached_property
    def layers(self) -> SettingLayers:
        """The layers of settings; the file of --config is read once."""
        return self.settings.layers()

    @property
    def hold_out_every(self) -> int | None:
        """Which scan is kept back, each k-th; None: no scan."""
        from oddsmap.scans.split_log import every_of

        return None if self.hold_out is None else every_of(self.hold_out)

    def _check_append(self) -> None:
        from oddsmap.errors import ConfigError

        if not self.append:
            return
        for given, option, why in (
            (self.force, "--force", "replaces the map that --append adds to"),
            (self.memory, "--memory", "bounds a new map: what is added is held in memory"),
            (self.auto, "--auto", "fits the sensor to all logs of a map"),
            (self.estimator == "full-map", "--estimator full-map", "makes maps that do not add up"),
        ):
            if given:
                raise ConfigError(f"{option} {why}: leave one of the two out")

    def _check_estimator(self) -> None:
        from oddsmap.errors import ConfigError

        full_map = self.estimator == "full-map"
        if full_map and self.settings.votes is not None:
            raise ConfigError("--votes belongs to --estimator filter: a full map counts no votes")
        if full_map and self.method != "rays":
            raise ConfigError(f"--method {self.method} belongs to --estimator filter")
        if not full_map and self.settings.sweeps is not None:
            raise ConfigError("--sweeps belongs to --estimator full-map")

    @cached_property
    def memory_bytes(self) -> int | None:
        """Bytes that the map may take in memory; None: not stated.

        Raises:
            ConfigError: it is no size, or does not go with the other options.
        """
        from oddsmap.errors import ConfigError
        from oddsmap.limits import bytes_of

        if self.memory is None:
            return None
        if self.auto or self.estimator == "full-map":
            why = "--auto looks all over the map" if self.auto else "a full map is kept whole"
            raise ConfigError(f"--memory belongs to --estimator filter alone: {why}")
        return bytes_of(self.memory)

    @property
    def url(self) -> str | None:
        """Where the map goes, if that is no folder; None: it is one."""
        from oddsmap.scale.map_places import url_of

        return url_of(self.output)

    @property
    def target(self) -> str:
        """Where the map goes, as text."""
        return self.url or str(self.output)

    def _check_dask(self) -> None:
        from oddsmap.errors import ConfigError

        if self.dask is None:
            if self.chunk_scans is not None:
                raise ConfigError("--chunk-scans is what a worker takes at a time: add --dask")
            if self.url is not None:
                raise ConfigError(
                    f"{self.url}: maps at URLs are written by workers: add --dask local, or build "
                    "it here and copy it"
                )
            return
        others = {
            "--estimator full-map": self.estimator == "full-map",
            "--auto": self.auto,
            "--hold-out": self.hold_out is not None,
            "--append": self.append,
            "--memory": self.memory is not None,
        }
        for name, given in others.items():
            if given:
                raise ConfigError(f"{name} works on one machine: leave out --dask, or {name}")

    def _check_settings(self) -> None:
        self.layers.check_estimator(self.estimator)
        if not self.append and "resolution" not in self.layers.fields("map"):
            raise typer.BadParameter(
                "a map needs one, in metres, like --resolution 0.05", param_hint="--resolution"
            )
        self.layers.check_values()

    def _check_files(self) -> None:
        from oddsmap.cli.files import (
            HISTORY,
            check_appendable,
            check_files,
            check_logs,
            check_suffix,
        )

        suffix = self.output.suffix.lower()
        made = f"; oddsmap export makes {suffix} of it" if suffix in EXPORTED else ""
        if suffix == HISTORY:
            made = "; oddsmap history REPOSITORY --add MAP.zarr keeps it, and --append adds to that"
        kept = self.append and suffix == HISTORY
        known = ("", HISTORY if kept else ".zarr")
        check_suffix(self.output, known, f"a map is a Zarr folder, by custom NAME.zarr{made}")
        if self.dask is not None:
            from oddsmap.scale.cluster_output import check_output_place

            # Logs are looked for where they are read.
            check_output_place(self.target, force=self.force)
            return
        read = [*self.logs, *self.log_options.files(*self.logs)]
        check_logs(self.logs)
        if self.append:
            check_appendable(self.output)
        output = None if kept else self.output
        check_files(read, output, force=self.force or self.append, is_map=True)
