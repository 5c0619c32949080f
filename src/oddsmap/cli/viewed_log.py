# SPDX-License-Identifier: Apache-2.0
"""The log of `oddsmap view`: opened, mapped where no map is given, and packed for the page."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from oddsmap.cli.log_options import LogOptions
from oddsmap.cli.progress import progress_of_logs, progress_of_scans, working

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.log import Log

__all__ = ["ViewedLog", "is_map", "open_viewed"]

# Sides of cells [m] where nobody says one: of scans in the plane, and of wide beams and in space.
_FINE, _COARSE = 0.05, 0.1
# Those that ROS maps are made of; what they lack is said as of a map.
_IMAGES = (".pgm", ".png", ".bmp")


@dataclass(frozen=True, slots=True)
class ViewedLog:
    """A log that is shown with its map.

    Args:
        path: as the caller wrote it.
        options: how it is read.
        log: the log.
    """

    path: Path
    options: LogOptions
    log: Log

    @property
    def name(self) -> str:
        """What the log is called."""
        return self.path.name or self.path.resolve().name

    @property
    def map_name(self) -> str:
        """What a map of it would be called."""
        stem = re.sub(r"\.(gz|bz2|xz|zst)$", "", self.name)
        return f"{Path(stem).stem or stem}.zarr"

    def mapped(self, resolution: float | None, voice: Voice) -> tuple[EvidenceMap, str]:
        """The map that `oddsmap build` makes by its defaults, and that command; says what it took.

        Args:
            resolution: side of a cell [m]; None: as the scans are.
            voice: says it.
        """
        from oddsmap.cli.options import thread_count
        from oddsmap.evidence_map import build_map
        from oddsmap.integrate.add import ndim_of
        from oddsmap.plausibility.doubts import check_log

        side = resolution
        if side is None:
            flat = ndim_of(next(iter(self.log), None)) == 2 and "cone_deg" not in self.log.sensor
            side = _FINE if flat else _COARSE
        with progress_of_logs(self.log.scan_count, quiet=voice.still) as advance:
            grid = build_map(self.log, side, threads=thread_count(None), progress=advance())
        for note in (*self.log.notes, *check_log(self.log)):
            voice.note(self.path, note)

        def command(log: str) -> str:
            made = ["oddsmap", "build", log, *self.options.words, "--resolution", f"{side:g}"]
            return shlex.join([*made, "-o", self.map_name])

        how = "" if resolution is not None else "; --resolution sets another side"
        voice.say(
            f"mapped   {self.name} at {side:g} m{how}. It is not saved: {command(str(self.path))}"
        )
        # A page may be sent: of the files in its commands it has the names.
        return grid, command(self.name)

    def doubt_of_map(self, grid: EvidenceMap, name: str, voice: Voice) -> None:
        """Refuse a map of another dimension, and say where one was made of other logs alone.

        Raises:
            InputError: one of the two is 2D, the other 3D.
        """
        from oddsmap.errors import InputError
        from oddsmap.integrate.add import ndim_of

        ndim = ndim_of(next(iter(self.log), None))
        if ndim != grid.ndim:
            raise InputError(
                f"{self.path}: its scans are {ndim}D, {name} is a {grid.ndim}D map: give the log "
                "that it was made of"
            )
        known = {entry.get("source") for entry in grid.provenance} - {None}
        if known and self.name not in known:
            names = ", ".join(sorted(map(str, known)))
            voice.note(
                self.path, f"{name} says that it was made of {names}, not of this log", err=True
            )

    def payload(
        self, grid: EvidenceMap, name: str, voice: Voice, *, build: str | None, served: bool
    ) -> tuple[bytes, int]:
        """What the page is given of the log, and how many scans that has.

        Args:
            grid: the map.
            name: of its file.
            voice: whether to show progress.
            build: the command that makes the map, where it is in no file.
            served: False: with some beams of each scan, for a page that can ask nobody.
        """
        from oddsmap.viewer.journey import kept_beams, read_journey
        from oddsmap.viewer.journey_payload import journey_payload
        from oddsmap.witnesses.why import sensor_models

        count = self.log.scan_count
        if count is None:
            count = sum(1 for _ in self.log)
        with progress_of_scans("reading the log", count, quiet=voice.still) as progress:
            journey = read_journey(
                self.log, sensor_models(grid, self.log),
                beams=0 if served else kept_beams(count), progress=progress,
            )  # fmt: skip
        facts = {
            "log": self.name,
            "served": served,
            "build": build,
            "why": ["oddsmap", "why", name, self.name],
            "options": list(self.options.words),
        }
        return journey_payload(journey, facts), journey.scan_count


def is_map(path: Path) -> bool:
    """Whether a path is a map, of whatever kind, and not to be read as a log."""
    from oddsmap.cli.export_sources import is_ros_map
    from oddsmap.cli.view_sources import LANDMARKS
    from oddsmap.map_files.octomap_reader import is_octomap

    if path.is_dir():
        return path.suffix.lower() == ".zarr" or (path / "zarr.json").is_file()
    return path.suffix.lower() in (*_IMAGES, *LANDMARKS) or is_ros_map(path) or is_octomap(path)


def open_viewed(path: Path, options: LogOptions, voice: Voice) -> ViewedLog:
    """Open a log.

    Raises:
        OddsmapError: see `oddsmap.open_log`.
    """
    with working(f"opening {path.name}", quiet=voice.still):
        return ViewedLog(path, options, options.open(path))
