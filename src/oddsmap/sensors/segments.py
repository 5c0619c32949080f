# SPDX-License-Identifier: Apache-2.0
"""Scans of narrow beams become segments of free and occupied space in the map frame."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.sensors.inverse_model import HitShape

if TYPE_CHECKING:
    from oddsmap.kernels.trace.readings import Limits

__all__ = ["Segments", "cut_scans", "refuse_filters_in_2d"]


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """What the beams of some scans say, as segments in the map frame [m].

    Args:
        origins: sensor positions, shape (scans, d).
        offsets: first segment of each scan, and the end, shape (scans + 1,).
        ends: where the free part of each segment ends, shape (m, d).
        tips: where its occupied part ends, shape (m, d).
        fades: where passes begin to fade, shape (m, d); `ends` where they do not.
        hit: False where nothing was seen and the segment only clears, shape (m,).
    """

    origins: FloatArray
    offsets: npt.NDArray[np.int64]
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
        heights: least and most height in the map frame at which a return marks [m].
        body: corners of a box in the sensor frame in which none does [m], shape (2, 3).
    """
    from oddsmap.kernels.trace.clip_beams import BODY, HEIGHT, cut_beams
    from oddsmap.kernels.trace.readings import BELOW, LOST, NAN

    beams = ranges_of(scans)
    finite = [scan for scan in beams if scan.map_from_sensor.is_finite]
    if len({scan.directions.shape[1] for scan in finite}) > 1:
        raise InputError("scans of the plane and of space cannot go into one map")
    d = finite[0].directions.shape[1] if finite else 2
    refuse_filters_in_2d(d, heights, body)
    starts = np.concatenate([[0], np.cumsum([len(scan.ranges) for scan in finite])])
    starts = starts.astype(np.int64)
    shared = all(scan.directions is finite[0].directions for scan in finite)
    none = np.empty((0, d))
    directions = [scan.directions for scan in (finite[:1] if shared else finite)]
    origins = np.array([scan.map_from_sensor.translation for scan in finite]).reshape(-1, d)
    counts = np.zeros(5, np.int64)
    ends = np.empty((starts[-1], d))
    half_width = shape.half_width
    tips = np.empty_like(ends) if half_width > 0 else ends
    fades = np.empty_like(ends) if shape.fade > 0 else ends
    hit = np.empty(len(ends), np.bool_)
    offsets = np.empty(len(finite) + 1, np.int64)
    cut_beams(
        _joined([scan.ranges for scan in finite], np.empty(0)),
        _joined(directions, none),
        shared,
        starts,
        origins,
        np.array([scan.map_from_sensor.rotation for scan in finite]).reshape(-1, d, d),
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
    used = int(offsets[-1])
    skipped = Counter(
        {
            "scan.nan_pose": len(scans) - len(finite),
            "scan.empty": len(finite) - int(np.count_nonzero(kept)),
            "beam.nan": int(counts[NAN]),
            "beam.below_range_min": int(counts[BELOW]),
            "beam.no_return": int(counts[LOST]),
            "hit.outside_heights": int(counts[HEIGHT]),
            "hit.on_body": int(counts[BODY]),
        }
    )
    ends = ends[:used]
    segments = Segments(
        origins=origins[kept],
        offsets=offsets[np.concatenate([[True], kept])],
        ends=ends,
        tips=tips[:used] if half_width > 0 else ends,
        fades=fades[:used] if shape.fade > 0 else ends,
        hit=hit[:used],
    )
    return segments, +skipped


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
    # A scan of space is a batch of its own, and long: it is not copied.
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], np.float64)
    return np.concatenate([nothing, *arrays])
