# SPDX-License-Identifier: Apache-2.0
"""Why a cell has the evidence that it has: each scan that voted on it, and its beams.

Nothing is worked out anew here. Each scan is mapped once more, by itself and by the map's own
settings, and so is each of its beams that may matter: what the cell gains is what it said.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.add import ndim_of
from oddsmap.integrate.forgetting import numbered
from oddsmap.integrate.threads import WorkerPool
from oddsmap.integrate.toy_map import compile_kernels
from oddsmap.kernels.units import ONE
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.given_scans import scans_alone, scans_given
from oddsmap.scans.log import Log, parts_of
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan
from oddsmap.scans.scan_part import part_of
from oddsmap.scans.split_log import is_held
from oddsmap.sensors.registry import KINDS, Sensor, sensor_of_log
from oddsmap.short_repr import short_repr
from oddsmap.witnesses.reach import beams_near, rays_of

__all__ = ["Explanation", "ScanVote", "sensor_models", "why"]

# Cells that votes leave beside the one in question are forgotten from time to time.
_TILES = 4096


@dataclass(frozen=True, slots=True, eq=False)
class ScanVote:
    """What one scan said of a cell.

    Attributes:
        index: which scan of the log, counted from 0 as the log gives them.
        stamp_ns: its time [ns]; None: it has none.
        sensor_id: which of the log's sensors made it.
        hits: what it added to the cell's hits [votes].
        passes: likewise, to its passes.
        beams: numbers of the beams that speak of the cell, shape (k,): of a depth image pixels, row
            by row; empty where cells are named otherwise (grids of labels, and depth images by
            "projective").
        ranges: their readings [m], shape (k,).
        beam_hits: what each says of the cell alone [votes], shape (k,). With votes "scan" the scan
            says it once: its hits, if any, and otherwise its passes.
        beam_passes: likewise.
        starts: where each beam starts in the map frame [m], shape (k, d).
        directions: unit vectors along each in the map frame, shape (k, d).
    """

    index: int
    stamp_ns: int | None
    sensor_id: str
    hits: float
    passes: float
    beams: IntArray
    ranges: FloatArray
    beam_hits: FloatArray
    beam_passes: FloatArray
    starts: FloatArray
    directions: FloatArray

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """Where the evidence of a cell comes from.

    Attributes:
        cell: the cell, shape (d,).
        centre: its centre [m], shape (d,).
        scans: what each scan said that said something, in the order of the log.
        looked_at: how many scans of the log the map has, as far as its provenance says.
        hits: the sum of the scans' hits [votes].
        passes: likewise.
        map_hits: what the map has [votes].
        map_passes: likewise.
        notes: where these are not the same, what may be the reason.
    """

    cell: IntArray
    centre: FloatArray
    scans: tuple[ScanVote, ...]
    looked_at: int
    hits: float
    passes: float
    map_hits: float
    map_passes: float
    notes: tuple[Note, ...]

    __repr__ = short_repr

    @property
    def complete(self) -> bool:
        """Whether the scans add up to what the map has, exactly."""
        return self.hits == self.map_hits and self.passes == self.map_passes


def why(
    grid: Evidence,
    log: Log | Measurement | Iterable[Measurement],
    point: npt.ArrayLike,
    *,
    progress: Callable[[int], None] | None = None,
) -> Explanation:
    """Say which scans and which of their beams voted on the cell that holds a point.

    Votes are found by mapping: by the sensor model, the kind of votes, the half-life and the method
    that the map's provenance names for this log, without the scans that were held out. So the
    answer is exact, and where the sums differ from what the map has, the map holds something else.

    Args:
        grid: the map.
        log: what it was made of: a log that `open_log` returned, or the scans.
        point: in the map frame [m], shape (d,), x first.
        progress: called with the number of scans looked at so far.

    Raises:
        InputError: the map has no counts, the point has no cell, what is given holds no scans, one
            has another dimension than the map, or does not go with its half-life.
    """
    if not isinstance(grid, Evidence):
        raise InputError(
            "why is asked of a map that counts hits and passes, an EvidenceMap, and then of its "
            f"log: got {type(grid).__name__}"
        )
    place = np.asarray(point)
    cell = grid.cell_of(place[None] if place.ndim == 1 else place)
    if len(cell) != 1:
        raise InputError(f"why is asked of one point, shape ({grid.ndim},), got {place.shape}")
    centre = grid.centre_of(cell)[0]
    taken: Any = scans_given(log)
    if grid.config.map.half_life_scans is not None and not hasattr(taken, "sensors"):
        taken = list(scans_alone(taken))
        if all(scan.number is None for scan in taken):
            taken = list(numbered(taken))  # as build_map counts them
    entries = _entries_of(grid, taken)
    trials = _trials(grid, taken, entries)
    found: list[ScanVote] = []
    looked_at = 0
    for index, scan in _mapped(scans_alone(taken), entries):
        if ndim_of(scan) != grid.ndim:
            raise InputError(
                f"scan {index} is {ndim_of(scan)}D, the map {grid.ndim}D: give the log that it was "
                "made of"
            )
        trial = trials.get(scan.sensor_id) or trials[""]
        vote = trial.vote(index, scan, cell, centre)
        if vote is not None:
            found.append(vote)
        looked_at += 1
        if progress is not None:
            progress(looked_at)
    hits, passes = sum(vote.hits for vote in found), sum(vote.passes for vote in found)
    own_hits, own_passes = (int(units[0]) / ONE for units in grid.tiles.at(cell))
    notes: tuple[Note, ...] = ()
    if (hits, passes) != (own_hits, own_passes):
        text = (
            f"the scans add up to {hits:g} hits and {passes:g} passes, the map has {own_hits:g} "
            f"and {own_passes:g} there: {'; '.join(_reasons(grid, taken, entries))}"
        )
        notes = (Note(text, code="why.incomplete", severity="warning"),)
    return Explanation(
        cell[0], centre, tuple(found), looked_at, hits, passes, own_hits, own_passes, notes
    )


class _Trial:
    """A map like another, in which single scans and beams are tried."""

    def __init__(self, grid: Evidence, sensor: Sensor, method: str) -> None:
        own = grid.config.map
        self._map = Evidence(
            grid.resolution, votes=grid.votes, half_life=own.half_life, t_ref_ns=own.t_ref_ns,
            half_life_scans=own.half_life_scans, ref_scan=own.ref_scan, sensor=sensor,
            ndim=grid.ndim,
        )  # fmt: skip
        compile_kernels(self._map, sensor, method)
        self._pool = WorkerPool(self._map, sensor, 1, method)
        self._sensor, self._method = sensor, method

    def vote(
        self, index: int, scan: Measurement, cell: IntArray, centre: FloatArray
    ) -> ScanVote | None:
        """What a scan says of a cell; None: nothing."""
        if not scan.map_from_sensor.is_finite:
            return None
        if not isinstance(scan, Scan | DepthScan) or self._method == "projective":
            said = self._said(scan, cell)
            beams, ranges, each = np.empty(0, np.int64), np.empty(0), np.empty((0, 2))
            starts = directions = np.empty((0, len(centre)))
        else:
            whole = scan.to_scan() if isinstance(scan, DepthScan) else scan
            beams = beams_near(whole, centre, self._map.resolution, self._sensor)
            if len(beams) == 0:
                return None
            said = self._said(part_of(whole, beams), cell)
            if not said.any():
                return None
            each = np.zeros((len(beams), 2))
            self._ask(whole, beams, cell, said, each)
            speaks = each.any(axis=1)
            beams, each = beams[speaks], each[speaks]
            ranges = whole.ranges[beams]
            starts, directions = rays_of(whole, beams)
        if not said.any():
            return None
        return ScanVote(
            index, scan.stamp_ns, scan.sensor_id, float(said[0]), float(said[1]), beams, ranges,
            each[:, 0], each[:, 1], starts, directions,
        )  # fmt: skip

    def _ask(
        self, scan: Scan, beams: IntArray, cell: IntArray, said: FloatArray, each: FloatArray
    ) -> None:
        """What each of some beams says alone, into `each`; `said` is what they say together.

        Beams that say nothing together say nothing alone, so halves that are silent are left: of
        depth images most beams near a cell do not meet it.
        """
        if not said.any():
            return
        if len(beams) == 1:
            each[0] = said
            return
        half = len(beams) // 2
        for part in (slice(None, half), slice(half, None)):
            theirs = self._said(part_of(scan, beams[part]), cell)
            self._ask(scan, beams[part], cell, theirs, each[part])

    def _said(self, scan: Measurement, cell: IntArray) -> FloatArray:
        """What a cell gets of a scan [votes]: hits, passes."""
        tiles = self._map.tiles
        if tiles.count > _TILES:
            tiles.clear()
        before = np.concatenate(tiles.at(cell))
        for _ in self._pool.run([scan]):
            pass
        return np.asarray((np.concatenate(tiles.at(cell)) - before) / ONE)


def _entries_of(grid: Evidence, log: Any) -> list[dict[str, Any]]:
    """What the map's provenance says of this log, of scans without a log likewise."""
    path = getattr(log, "path", None)
    name = None if path is None else Path(path).name
    return [
        entry
        for entry in grid.provenance
        if entry.get("source") == name and ("scans" in entry or name is not None)
    ]


def sensor_models(grid: Evidence, log: Log) -> dict[str, Sensor]:
    """By which sensor model a map took the scans of a log.

    Args:
        grid: the map.
        log: what it was made of.

    Returns:
        For each sensor of the log its model; "" for scans of a sensor that is not named.
    """
    models: dict[str, Sensor] = {}
    for sensor, _, names in _models(grid, log, _entries_of(grid, log)):
        models.setdefault("", sensor)
        models |= dict.fromkeys(names, sensor)
    return models


def _trials(grid: Evidence, log: Any, entries: list[dict[str, Any]]) -> dict[str, _Trial]:
    """For each sensor of a log the map to try its scans in; "" for those that are not named."""
    trials: dict[str, _Trial] = {}
    for sensor, method, names in _models(grid, log, entries):
        trial = _Trial(grid, sensor, method)
        trials.setdefault("", trial)
        trials |= dict.fromkeys(names, trial)
    return trials


def _models(
    grid: Evidence, log: Any, entries: list[dict[str, Any]]
) -> Iterator[tuple[Sensor, str, tuple[str, ...]]]:
    """For each part of a log its sensor model, the method, and the sensors that it is of."""
    parts = parts_of(log)
    for number, part in enumerate(parts):
        entry = entries[number] if len(entries) == len(parts) else {}
        if "sensor" in entry:
            settings = dict(entry["sensor"])
            sensor = KINDS[settings.pop("kind")](**settings)
        else:
            sensor = grid.sensor if number == 0 else sensor_of_log(part)
        yield sensor, entry.get("method", "rays"), tuple(getattr(part, "sensors", ()))


def _mapped(
    scans: Iterable[Measurement], entries: list[dict[str, Any]]
) -> Iterator[tuple[int, Measurement]]:
    """The scans that were mapped, with their numbers in the log."""
    kept = {(entry.get("hold_out_every"), entry.get("hold_out_run", 1)) for entry in entries}
    every, run = kept.pop() if len(kept) == 1 else (None, 1)
    numbers: Counter[str] = Counter()
    for index, scan in enumerate(scans):
        numbers[scan.sensor_id] += 1
        if every is None or not is_held(numbers[scan.sensor_id], every, run):
            yield index, scan


def _reasons(grid: Evidence, log: Any, entries: list[dict[str, Any]]) -> list[str]:
    """Why scans of a log may not add up to a map."""
    found = []
    path = getattr(log, "path", None)
    others = {entry.get("source") for entry in grid.provenance} - {
        None if path is None else Path(path).name
    }
    names = sorted(str(other) for other in others if other is not None)
    if names and entries:
        found.append(f"it was also made of {', '.join(names)}")
    elif names:
        found.append(f"it says that it was made of {', '.join(names)}, not of this log")
    if None in others and any(
        entry.get("source") is None and "scans" in entry for entry in grid.provenance
    ):
        found.append("it was also made of scans without a log")
    if len(entries) > len(parts_of(log)):
        found.append("scans of this log were added more than once")
    if not names and not entries:
        found.append("it does not say what it was made of")
    for key, what in (
        ("resampled_from", "it was resampled to larger cells"),
        ("rescaled_from_t_ref_ns", "its half-life was counted from a later time, with rounding"),
        ("subtracted", "other evidence was subtracted from it"),
    ):
        if any(key in entry for entry in grid.provenance):
            found.append(what)
    if not found:
        found.append(
            "the log was read in another way then (poses, a part of its scans), or has changed"
        )
    return found
