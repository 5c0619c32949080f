# SPDX-License-Identifier: Apache-2.0
"""Scans of narrow beams become segments of free and occupied space in the map frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.scans.scan import Scan
from oddsmap.sensors.filters import AngleWindow, beams_within, check_filters
from oddsmap.sensors.inverse_model import HitShape

if TYPE_CHECKING:
    from oddsmap.kernels.trace.readings import Limits

__all__ = ["Segments", "cut_scans"]


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """What the beams of some scans say, as segments in the map frame [m].

    A bundle is what is seen from one place: a scan is one, or several where it has `beam_origins`.

    Args:
        origins: where each bundle starts, shape (bundles, d).
        bundles: first bundle of each scan, and the end, shape (scans + 1,).
        offsets: first segment of each bundle, and the end, shape (bundles + 1,).
        ends: where the free part of each segment ends, shape (m, d).
        tips: where its occupied part ends, shape (m, d).
        fades: where passes begin to fade, shape (m, d); `ends` where they do not.
        hit: False where nothing was seen and the segment only clears, shape (m,).
    """

    origins: FloatArray
    bundles: IntArray
    offsets: IntArray
    ends: FloatArray
    tips: FloatArray
    fades: FloatArray
    hit: npt.NDArray[np.bool_]


def cut_scans(
    scans: Sequence[Measurement],
    *,
    limits: Limits,
    shape: HitShape,
    heights: tuple[float, float],
    body: FloatArray,
    window: AngleWindow,
    farthest: float,
) -> tuple[Segments, Counter[str]]:
    """Sort the readings of scans: see `BeamSensor.segments`.

    Args:
        scans: measurements of ranges.
        limits: which readings count.
        shape: how a beam votes around its return.
        heights: lowest and highest height in the map frame at which a return marks [m].
        body: corners of a box in the sensor frame in which no return marks [m], shape (2, 3); in 2D
            of any height.
        window: azimuths in the sensor frame outside which beams say nothing [rad].
        farthest: a scan with a beam that starts this far from the map's origin is skipped [m].
    """
    from oddsmap.kernels.trace.clip_beams import BODY, HEIGHT, REASONS, cut_beams
    from oddsmap.kernels.trace.readings import BELOW, NAN, NO_RETURN, ZERO

    beams = ranges_of(scans)
    finite = [scan for scan in beams if scan.map_from_sensor.is_finite]
    if len({scan.directions.shape[1] for scan in finite}) > 1:
        raise InputError("2D and 3D scans cannot go into one map")
    d = finite[0].directions.shape[1] if finite else 2
    check_filters(d, heights, body, window)
    finite, lost = beams_within(finite, window)
    finite, bundles, too_far = _near_bundles_of(finite, d, farthest)
    starts = np.concatenate([[0], np.cumsum(bundles.sizes)]).astype(np.int64)
    measured = [scan.measured_points is not None for scan in finite]
    shared = len(bundles.sizes) == len(finite) and all(
        scan.directions is finite[0].directions and not points
        for scan, points in zip(finite, measured, strict=True)
    )
    vectors = [
        scan.directions if scan.measured_points is None else scan.measured_points
        for scan in (finite[:1] if shared else finite)
    ]
    joined = _joined(vectors, np.empty((0, d)))
    told = joined
    if any(scan.own_vectors is not None for scan in finite):
        own = [scan.own_vectors for scan in finite]
        told = _joined(
            [v if o is None else o for v, o in zip(vectors, own, strict=True)], np.empty((0, d))
        )
    counts = np.zeros(REASONS, np.int64)
    ends = np.empty((starts[-1], d))
    half_width = shape.half_width
    tips = np.empty_like(ends) if half_width > 0 else ends
    fades = np.empty_like(ends) if shape.fade > 0 else ends
    hit = np.empty(len(ends), np.bool_)
    offsets = np.empty(len(starts), np.int64)
    cut_beams(
        _joined([scan.ranges for scan in finite], np.empty(0)),
        joined,
        told,
        shared,
        np.repeat(np.array(measured, np.bool_), bundles.per_scan),
        starts,
        bundles.origins,
        bundles.rotations,
        bundles.shifts,
        limits,
        half_width,
        float(shape.fade),
        heights,
        body,
        ends,
        tips,
        fades,
        hit,
        offsets,
        counts,
    )
    kept = np.diff(offsets) > 0
    whose = np.repeat(np.arange(len(finite)), bundles.per_scan)
    kept_of_scans = np.bincount(whose[kept], minlength=len(finite))
    kept_of_scans = kept_of_scans[kept_of_scans > 0]
    used = int(offsets[-1])
    skipped = Counter(
        {
            "scan.nan_pose": len(scans) - len(finite) - too_far,
            "scan.pose_too_far": too_far,
            "scan.empty": len(finite) - len(kept_of_scans),
            "beam.outside_angles": sum(lost.get(id(scan), 0) for scan in finite),
            "beam.nan": int(counts[NAN]),
            "beam.below_range_min": int(counts[BELOW]),
            "beam.no_return": int(counts[NO_RETURN]),
            "beam.zero_range": int(counts[ZERO]),
            "hit.outside_heights": int(counts[HEIGHT]),
            "hit.on_body": int(counts[BODY]),
        }
    )
    ends = ends[:used]
    segments = Segments(
        origins=bundles.origins[kept],
        bundles=np.concatenate([[0], np.cumsum(kept_of_scans)]).astype(np.int64),
        offsets=offsets[np.concatenate([[True], kept])],
        ends=ends,
        tips=tips[:used] if half_width > 0 else ends,
        fades=fades[:used] if shape.fade > 0 else ends,
        hit=hit[:used],
    )
    return segments, +skipped


class _Bundles(NamedTuple):
    """Runs of beams that start in one place, of all scans."""

    origins: FloatArray
    """Where they start in the map frame [m], shape (bundles, d)."""
    rotations: FloatArray
    """map_from_sensor, shape (bundles, d, d)."""
    shifts: FloatArray
    """Where they start in the frame that the robot's body is told in [m], shape (bundles, d)."""
    sizes: IntArray
    """Beams of each, shape (bundles,)."""
    per_scan: IntArray
    """Bundles of each scan, shape (scans,)."""


def _near_bundles_of(
    scans: list[Scan], d: int, farthest: float
) -> tuple[list[Scan], _Bundles, int]:
    """Scans that are not too far away, with their bundles, and how many are."""
    bundles = _bundles_of(scans, d)
    far = np.abs(bundles.origins).max(axis=1, initial=0.0) >= farthest
    if not far.any():
        return scans, bundles, 0
    whose = np.repeat(np.arange(len(scans)), bundles.per_scan)
    gone = set(whose[far].tolist())
    near = [scan for number, scan in enumerate(scans) if number not in gone]
    return near, _bundles_of(near, d), len(gone)


def _bundles_of(scans: Sequence[Scan], d: int) -> _Bundles:
    rotations = np.array([scan.map_from_sensor.rotation for scan in scans]).reshape(-1, d, d)
    if all(scan.beam_origins is None for scan in scans):
        origins = np.array([scan.map_from_sensor.translation for scan in scans]).reshape(-1, d)
        sizes = np.array([scan.size for scan in scans], np.int64)
        per_scan = np.ones(len(scans), np.int64)
        return _Bundles(origins, rotations, np.zeros_like(origins), sizes, per_scan)
    places, shifts, ends = [], [], []
    for scan in scans:
        own = np.zeros((1, d)) if scan.beam_origins is None else scan.beam_origins
        moved = np.zeros(len(own), np.bool_)
        moved[:1] = True
        for axis in range(d):  # not .any(axis=1), which takes ten times as long
            moved[1:] |= own[1:, axis] != own[:-1, axis]
        first = np.flatnonzero(moved)
        places.append(own[first])
        # Beams that are told from where the sensor was are not shifted: see `Scan.own_vectors`.
        shifts.append(own[first] if scan.own_vectors is None else np.zeros((len(first), d)))
        ends.append(np.diff(np.append(first, scan.size)))
    per_scan = np.array([len(own) for own in places], np.int64)
    return _Bundles(
        np.concatenate(
            [s.map_from_sensor.transform(own) for s, own in zip(scans, places, strict=True)]
        ),
        np.repeat(rotations, per_scan, axis=0),
        np.concatenate(shifts),
        np.concatenate(ends).astype(np.int64),
        per_scan,
    )


def _joined(arrays: Sequence[FloatArray], nothing: FloatArray) -> FloatArray:
    # A 3D scan is a batch of its own, and long: it is not copied.
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], np.float64)
    return np.concatenate([nothing, *arrays])
