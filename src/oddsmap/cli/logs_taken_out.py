# SPDX-License-Identifier: Apache-2.0
"""Logs of `oddsmap subtract`: mapped as the map has them, with what is said of that."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.doubts import doubts_of_settings
from oddsmap.cli.log_options import LogOptions
from oddsmap.cli.opened_logs import watched
from oddsmap.cli.progress import progress_of_scans

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.plausibility.sample import Sample
    from oddsmap.scans.log import Log
    from oddsmap.scans.note import Note
    from oddsmap.sensors.registry import Sensor

__all__ = ["LogsTakenOut"]


class LogsTakenOut:
    """Maps logs again, and says what `oddsmap build` says of them.

    Args:
        source: where the map is from that they are to be taken out of.
        options: how the logs are read.
        threads: how many work.
        voice: says it.

    Attributes:
        facts: of each log, for programs.
    """

    def __init__(self, source: Path, options: LogOptions, threads: int, voice: Voice) -> None:
        self._source, self._options, self._threads, self._voice = source, options, threads, voice
        self.facts: list[dict[str, Any]] = []
        self._notes: list[tuple[Path, Note]] = []

    def map_log(self, grid: EvidenceMap, path: Path) -> EvidenceMap:
        """The evidence of a log as a map has it.

        Raises:
            OddsmapError: it cannot be read, or see `map_again`.
        """
        from oddsmap.errors import OddsmapError
        from oddsmap.integrate.mapped_again import map_again
        from oddsmap.plausibility.doubts import doubts_of_sample

        log = self._options.open(path)
        samples: list[Sample] = []

        def watch(part: Log, sensor: Sensor) -> Log:
            taken, sample = watched(part, sensor)
            samples.append(sample)
            config = dataclasses.replace(grid.config, sensor=sensor)
            notes = (*part.notes, *doubts_of_settings(part, config))
            self._notes.extend((path, note) for note in notes)
            return taken

        with progress_of_scans("mapping", log.scan_count, quiet=self._voice.still) as progress:
            try:
                again = map_again(grid, log, watch=watch, threads=self._threads, progress=progress)
            except OddsmapError as error:
                said = str(error)
                # What the log itself is blamed for begins with its path.
                known = said.startswith((str(path), str(log.path)))
                raise type(error)(said if known else f"{self._source}: {said}") from None
        for sample in samples:
            self._notes.extend((path, doubt) for doubt in doubts_of_sample(sample))
        scans, beams = (
            sum(entry[name] for entry in again.provenance) for name in ("scans", "beams")
        )
        self.facts.append({"log": str(path), "scans": scans, "beams": beams})
        return again

    def say_notes(self) -> None:
        """Say what to know of the logs, once it is clear that they could be taken out."""
        for path, note in self._notes:
            self._voice.note(path, note)
