# SPDX-License-Identifier: Apache-2.0
"""Scans of narrow beams become segments of free and occupied space in the map frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.scans.scan import Scan
from oddsmap.sensors.inverse_model import HitShape

if TYPE_CHECKING:
    from oddsmap.kernels.trace.readings import Limits

__all__ = ["Segments", "cut_scans", "refuse_filters_in_2d"]


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
) -> tuple[Segments, Counter[str]]:
    """Sort the readings of scans: see `BeamSensor.segments`.

    Args:
        scans: measurements of ranges.
        limits: which readings count.
        shape: how a beam votes around its return.
        heights: lowest and highest height in the map frame at which a return marks [m].
        body: corners of a box in the sensor frame in which no return marks [m], shape (2, 3).
    """
    from oddsmap.kernels.trace.clip_beams import BODY, HEIGHT, cut_beams
    from oddsmap.kernels.trace.readings import BELOW, NAN, NO_RETURN

    beams = ranges_of(scans)
    finite = [scan for scan in beams if scan.map_from_sensor.is_finite]
    if len({scan.directions.shape[1] for scan in finite}) > 1:
        raise InputError("2D and 3D scans cannot go into one map")
    d = finite[0].directions.shape[1] if finite else 2
    refuse_filters_in_2d(d, heights, body)
    bundles = [bundle for scan in finite for bundle in _bundles_of(scan)]
    per_scan = np.array([_bundle_count(scan) for scan in finite], np.int64)
    starts = np.concatenate([[0], np.cumsum([len(bundle.ranges) for bundle in bundles])])
    starts = starts.astype(np.int64)
    shared = all(bundle.directions is bundles[0].directions for bundle in bundles)
    none = np.empty((0, d))
    directions = [bundle.directions for bundle in (bundles[:1] if shared else bundles)]
    origins = np.array([bundle.origin for bundle in bundles]).reshape(-1, d)
    counts = np.zeros(5, np.int64)
    ends = np.empty((starts[-1], d))
    half_width = shape.half_width
    tips = np.empty_like(ends) if half_width > 0 else ends
    fades = np.empty_like(ends) if shape.fade > 0 else ends
    hit = np.empty(len(ends), np.bool_)
    offsets = np.empty(len(bundles) + 1, np.int64)
    cut_beams(
        _joined([bundle.ranges for bundle in bundles], np.empty(0)),
        _joined(directions, none),
        shared,
        starts,
        origins,
        np.array([bundle.rotation for bundle in bundles]).reshape(-1, d, d),
        np.array([bundle.shift for bundle in bundles]).reshape(-1, d),
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
    whose = np.repeat(np.arange(len(finite)), per_scan)
    kept_of_scans = np.bincount(whose[kept], minlength=len(finite))
    kept_of_scans = kept_of_scans[kept_of_scans > 0]
    used = int(offsets[-1])
    skipped = Counter(
        {
            "scan.nan_pose": len(scans) - len(finite),
            "scan.empty": len(finite) - len(kept_of_scans),
            "beam.nan": int(counts[NAN]),
            "beam.below_range_min": int(counts[BELOW]),
            "beam.no_return": int(counts[NO_RETURN]),
            "hit.outside_heights": int(counts[HEIGHT]),
            "hit.on_body": int(counts[BODY]),
        }
    )
    ends = ends[:used]
    segments = Segments(
        origins=origins[kept],
        bundles=np.concatenate([[0], np.cumsum(kept_of_scans)]).astype(np.int64),
        offsets=offsets[np.concatenate([[True], kept])],
        ends=ends,
        tips=tips[:used] if half_width > 0 else ends,
        fades=fades[:used] if shape.fade > 0 else ends,
        hit=hit[:used],
    )
    return segments, +skipped


class _Bundle(NamedTuple):
    """Beams of a scan that start in one place."""

    origin: FloatArray
    """In the map frame [m], shape (d,)."""
    rotation: FloatArray
    """map_from_sensor, shape (d, d)."""
    shift: FloatArray
    """The same place in the sensor frame [m], shape (d,)."""
    directions: FloatArray
    ranges: FloatArray


def _bundles_of(scan: Scan) -> Iterator[_Bundle]:
    pose, places = scan.map_from_sensor, scan.beam_origins
    if places is None:
        shift = np.zeros(scan.directions.shape[1])
        yield _Bundle(pose.translation, pose.rotation, shift, scan.directions, scan.ranges)
        return
    origins = pose.transform(places)
    for first, end in pairwise(_runs(places)):
        part = slice(first, end)
        yield _Bundle(
            origins[first], pose.rotation, places[first], scan.directions[part], scan.ranges[part]
        )


def _bundle_count(scan: Scan) -> int:
    return 1 if scan.beam_origins is None else len(_runs(scan.beam_origins)) - 1


def _runs(places: FloatArray) -> list[int]:
    """Where runs of equal places begin, and the end."""
    moved = np.flatnonzero((places[1:] != places[:-1]).any(axis=1)) + 1
    return [0, *moved.tolist(), len(places)] if len(places) else [0]


def refuse_filters_in_2d(d: int, heights: tuple[float, float], body: FloatArray) -> None:
    """Refuse filters by height and by body for 2D scans.

    Raises:
        ConfigError: one is set, and d is 2.
    """
    if d == 2 and (heights != (-math.inf, math.inf) or np.isfinite(body).all()):
        raise ConfigError(
            "sensor.mark_z_min, mark_z_max, body_min and body_max are for 3D scans: these are 2D"
        )


def _joined(arrays: Sequence[FloatArray], nothing: FloatArray) -> FloatArray:
    # A 3D scan is a batch of its own, and long: it is not copied.
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], np.float64)
    return np.concatenate([nothing, *arrays])
