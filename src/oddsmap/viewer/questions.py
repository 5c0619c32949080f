# SPDX-License-Identifier: Apache-2.0
"""What a page may ask of its log while it is served: the beams of a scan, and who voted on a cell.

    scan?number=88          the beams of a scan
    why?at=3.04,-1.2        the scans and beams that voted on the cell at a point [m]

The log is read by one question at a time. A later "why" ends an earlier one.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from threading import Lock
from typing import Any

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import Sensor
from oddsmap.viewer.drawn_beams import beams_of, reach_of
from oddsmap.witnesses.why import Explanation, ScanVote, sensor_models, why

__all__ = ["LISTED_BEAMS", "LISTED_SCANS", "SHOWN_BEAMS", "LogQuestions", "SupersededError"]

SHOWN_BEAMS = 401
"""Of a scan, at most."""
LISTED_SCANS, LISTED_BEAMS = 300, 24
"""Of an answer, and of each scan in it; the others are counted."""

_NUMBER = re.compile(r"number=(0|[1-9][0-9]{0,8})")
_POINT = re.compile(
    r"at=(-?[0-9]{1,20}(?:\.[0-9]{1,20})?(?:,-?[0-9]{1,20}(?:\.[0-9]{1,20})?){1,2})"
)


class SupersededError(Exception):
    """A later question has ended this one."""


class LogQuestions:
    """Answers of a log, as JSON; they may be asked in several threads.

    Args:
        grid: the map.
        log: what it was made of.
        scan_count: how many scans the log gives.
    """

    def __init__(self, grid: Evidence, log: Log, scan_count: int) -> None:
        self._grid, self._log, self._count = grid, log, scan_count
        self._models = sensor_models(grid, log)
        self._scans = _ScansByNumber(log)
        self._reading, self._counting, self._asked = Lock(), Lock(), 0

    def scan(self, query: str) -> bytes:
        """The beams of a scan: `number=88`.

        Raises:
            InputError: the query is of another form, there is no such scan, or it cannot be read.
        """
        form = _NUMBER.fullmatch(query)
        if form is None or int(form[1]) >= self._count:
            raise InputError(f"a scan is asked for by number=N, from 0 to {self._count - 1}")
        with self._reading:
            scan = self._scans.get(int(form[1]))
        beams = beams_of(scan, self._model(scan.sensor_id), SHOWN_BEAMS)
        return _json(
            {
                "starts": _rounded(beams.starts),
                "ends": _rounded(beams.ends),
                "returned": beams.returned.astype(int).tolist(),
                "readings": beams.readings,
                "silent": beams.silent,
            }
        )

    def why(self, query: str) -> bytes:
        """Who voted on the cell at a point [m]: `at=3.04,-1.2`; ends what was asked before.

        Raises:
            InputError: the query is of another form, or see `oddsmap.witnesses.why.why`.
            SupersededError: something else was asked meanwhile.
        """
        form = _POINT.fullmatch(query)
        point = [] if form is None else [float(word) for word in form[1].split(",")]
        if len(point) != self._grid.ndim:
            raise InputError(
                f"a cell is asked about by at={','.join('xyz'[: self._grid.ndim])}, in metres"
            )
        with self._counting:
            self._asked += 1
            mine = self._asked

        def go_on(_: int) -> None:
            if self._asked != mine:
                raise SupersededError

        with self._reading:
            go_on(0)
            found = why(self._grid, self._log, point, progress=go_on)
        return _json(self._facts(found))

    def _model(self, sensor_id: str) -> Sensor | None:
        return self._models.get(sensor_id) or self._models.get("")

    def _facts(self, found: Explanation) -> dict[str, Any]:
        return {
            "cell": found.cell.tolist(),
            "centre": found.centre.tolist(),
            "looked_at": found.looked_at,
            "voted": len(found.scans),
            "hits": found.hits,
            "passes": found.passes,
            "map_hits": found.map_hits,
            "map_passes": found.map_passes,
            "complete": found.complete,
            "notes": [str(note) for note in found.notes],
            "scans": [self._vote(vote, found.centre) for vote in found.scans[:LISTED_SCANS]],
        }

    def _vote(self, vote: ScanVote, centre: FloatArray) -> dict[str, Any]:
        # Those that hit come first, as `oddsmap why` lists them.
        order = np.argsort(vote.beam_hits <= 0.0, kind="stable")[:LISTED_BEAMS]
        starts, directions, ranges = vote.starts[order], vote.directions[order], vote.ranges[order]
        length = reach_of(ranges, self._model(vote.sensor_id)).length
        # What says nothing by itself, or nobody knows how far, is drawn to the cell that it is of.
        to_cell = np.sqrt(np.square(centre - starts).sum(axis=1))
        length = np.maximum(np.where(np.isfinite(length), length, 0.0), np.fmin(to_cell, ranges))
        return {
            "index": vote.index,
            "hits": vote.hits,
            "passes": vote.passes,
            "beam_count": len(vote.beams),
            "beams": vote.beams[order].tolist(),
            "ranges": [r if math.isfinite(r) else None for r in ranges.tolist()],
            "beam_hits": vote.beam_hits[order].tolist(),
            "beam_passes": vote.beam_passes[order].tolist(),
            "starts": _rounded(starts),
            "ends": _rounded(starts + directions * length[:, None]),
        }


class _ScansByNumber:
    """The scans of a log by number, in its order, without those that it leaves out.

    Where a scan cannot be read alone, those before it are: from the one that was read last, or from
    the first one.
    """

    def __init__(self, log: Log) -> None:
        self._log = log
        self._alone = isinstance(log, LazyLog) and not log.skip_bad
        self._ahead: Iterator[Any] = iter(())
        self._next = 0
        self._last: Measurement | None = None

    def get(self, number: int) -> Measurement:
        """The scan of a number."""
        if self._alone:
            alone: Measurement = self._log[number]
            return alone
        if self._last is not None and number == self._next - 1:
            return self._last
        if self._last is None or number < self._next:
            self._ahead, self._next, self._last = iter(self._log), 0, None
        scan: Measurement
        for scan in self._ahead:
            self._next += 1
            if self._next > number:
                self._last = scan
                return scan
        raise InputError(f"{self._log.path}: has no scan {number} any more: has it been changed?")


def _rounded(points: FloatArray) -> list[float]:
    """Coordinates to a tenth of a millimetre, one point after the other."""
    return [round(x, 4) for x in points.ravel().tolist()]


def _json(facts: Mapping[str, Any]) -> bytes:
    return json.dumps(facts, separators=(",", ":"), allow_nan=False).encode()
