# SPDX-License-Identifier: Apache-2.0
"""Narrow beams (LIDAR): from readings to segments of free and occupied space.

The inverse sensor model p(x | z) along a beam has three regions: before the return, around it and
behind it. It is kept as Bayes factors, p(x | z) at prior 1/2, so that it responds to any prior:
where a reading says nothing the factor is 1 and the posterior is the prior itself.

Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), section 9.2 and table 9.2.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError, InputError
from oddsmap.scan import Scan
from oddsmap.sensors.depth_camera import DepthScan

__all__ = ["BeamSensor", "Segments", "logit"]

FloatArray = npt.NDArray[np.float64]


def logit(p: npt.ArrayLike) -> FloatArray:
    """Log odds of a probability: log p / (1 - p)."""
    chance = np.asarray(p, dtype=np.float64)
    return np.asarray(np.log(chance) - np.log1p(-chance))


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """What the beams of some scans say, as segments in the map frame [m].

    Args:
        origins: sensor positions, shape (scans, d).
        offsets: first segment of each scan, and the end, shape (scans + 1,).
        ends: where the free part of each segment ends, shape (m, d).
        tips: where its occupied part ends, shape (m, d).
        hit: False where nothing was seen and the segment only clears, shape (m,).
    """

    origins: FloatArray
    offsets: npt.NDArray[np.int64]
    ends: FloatArray
    tips: FloatArray
    hit: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class BeamSensor:
    """A sensor of narrow beams.

    Args:
        range_min: a reading below it carries no information [m].
        range_max: a finite reading at or above it is a no-return [m]; None where unknown.
        clear_range: how far a no-return clears [m]. None: a reading of +Inf clears up to
            range_max, and a finite no-return, which may as well be a fault, clears nothing.
        hit_width: length of the occupied region, centred at the return [m]; 0: one cell.
        share_hit: True: the cells of that region share one hit by the beam's length in them;
            False: each gets a whole one.
        p_hit: p(x | z) at prior 1/2 around the return.
        p_miss: p(x | z) at prior 1/2 before it.
        mark_z_min: a return below this height in the map frame clears but does not mark [m];
            scans of space only.
        mark_z_max: likewise above this height [m].
        body_min: least corner of the robot's body in the sensor frame [m], three numbers; a
            return inside the body's box does not mark. Scans of space only.
        body_max: its most corner [m].

    Raises:
        ConfigError: a value is outside its range.
    """

    range_min: float = 0.0
    range_max: float | None = None
    clear_range: float | None = None
    hit_width: float = 0.0
    share_hit: bool = False
    p_hit: float = 0.7
    p_miss: float = 0.4
    mark_z_min: float | None = None
    mark_z_max: float | None = None
    body_min: tuple[float, float, float] | None = None
    body_max: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("range_min", "hit_width"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"sensor.{name} is a length of 0 m or more, got {value}")
        for name in ("range_max", "clear_range"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ConfigError(f"sensor.{name} is a length above 0 m, got {value}")
        if not 0.5 < self.p_hit < 1.0:
            raise ConfigError(f"sensor.p_hit lies between 0.5 and 1, got {self.p_hit}")
        if not 0.0 < self.p_miss < 0.5:
            raise ConfigError(f"sensor.p_miss lies between 0 and 0.5, got {self.p_miss}")
        self._check_filters()

    def _check_filters(self) -> None:
        low, high = self.heights
        for name in ("mark_z_min", "mark_z_max"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ConfigError(f"sensor.{name} is a height [m], got {value}")
        if not low < high:
            raise ConfigError(f"sensor.mark_z_min < mark_z_max is needed, got {low} and {high}")
        if (self.body_min is None) != (self.body_max is None):
            raise ConfigError("sensor.body_min and body_max make a box: set both or none")
        if self.body_min is not None and self.body_max is not None:
            corners = np.array([self.body_min, self.body_max], np.float64)
            if (
                corners.shape != (2, 3)
                or not (np.isfinite(corners) & (corners[0] < corners[1])).all()
            ):
                raise ConfigError(
                    "sensor.body_min and body_max are three lengths each, min below max, "
                    f"got {self.body_min} and {self.body_max}"
                )

    @property
    def heights(self) -> tuple[float, float]:
        """Least and most height in the map frame at which a return marks [m]."""
        return (
            -math.inf if self.mark_z_min is None else self.mark_z_min,
            math.inf if self.mark_z_max is None else self.mark_z_max,
        )

    @property
    def body(self) -> FloatArray:
        """Corners of the body's box in the sensor frame [m], shape (2, 3)."""
        if self.body_min is None or self.body_max is None:
            return np.array([[math.inf] * 3, [-math.inf] * 3])  # no point lies in this box
        return np.array([self.body_min, self.body_max], np.float64)

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """range_min, range_max, how far +Inf clears, how far a finite no-return clears [m].

        An unknown range_max is infinite; what clears nothing is NaN.
        """
        unseen = self.range_max if self.clear_range is None else self.clear_range
        return (
            self.range_min,
            math.inf if self.range_max is None else self.range_max,
            math.nan if unseen is None else unseen,
            math.nan if self.clear_range is None else self.clear_range,
        )

    def inverse_model(
        self, distance: npt.ArrayLike, reading: float, prior: npt.ArrayLike = 0.5
    ) -> FloatArray:
        """p(x | z): probability that there is something at a distance along the beam.

        Args:
            distance: distances from the sensor along the beam [m], any shape.
            reading: the range z [m].
            prior: p(x), a number or one for each distance.

        Returns:
            The probability at each distance, the prior itself behind the return.

        Source: Probabilistic Robotics, table 9.2, with the prior's log odds kept apart.
        """
        at = np.asarray(distance, dtype=np.float64)
        base = np.broadcast_to(np.asarray(prior, dtype=np.float64), at.shape)
        near, far = reading - self.hit_width / 2, reading + self.hit_width / 2
        factor = np.where(at < near, logit(self.p_miss), logit(self.p_hit))
        odds = np.exp(logit(base) + factor)
        return np.where(at > far, base, odds / (1.0 + odds))

    def segments(self, scans: Sequence[Scan | DepthScan]) -> tuple[Segments, Counter[str]]:
        """Sort readings into hits, no-returns and what must be skipped.

        Args:
            scans: measurements of one dimension, 2D or 3D; depth images are taken as beams.

        Returns:
            The segments of the scans with at least one usable beam, and how many scans and beams
            were skipped, by reason.

        Raises:
            InputError: scans of the plane and of space are mixed.
            ConfigError: a filter for scans of space meets scans of the plane.
        """
        from oddsmap.kernels.beams import BELOW, BODY, HEIGHT, LOST, NAN, cut_beams

        beams = [scan.to_scan() if isinstance(scan, DepthScan) else scan for scan in scans]
        finite = [scan for scan in beams if scan.map_from_sensor.is_finite]
        if len({scan.directions.shape[1] for scan in finite}) > 1:
            raise InputError("scans of the plane and of space cannot go into one map")
        d = finite[0].directions.shape[1] if finite else 2
        if d == 2 and (self.heights != (-math.inf, math.inf) or self.body_min is not None):
            raise ConfigError(
                "sensor.mark_z_min, mark_z_max, body_min and body_max are for scans of space: "
                "these are of the plane"
            )
        starts = np.concatenate([[0], np.cumsum([len(scan.ranges) for scan in finite])])
        starts = starts.astype(np.int64)
        shared = all(scan.directions is finite[0].directions for scan in finite)
        none = np.empty((0, d))
        directions = [scan.directions for scan in (finite[:1] if shared else finite)]
        origins = np.array([scan.map_from_sensor.translation for scan in finite]).reshape(-1, d)
        counts = np.zeros(5, np.int64)
        ends = np.empty((starts[-1], d))
        tips = np.empty_like(ends) if self.hit_width > 0 else ends
        hit = np.empty(len(ends), np.bool_)
        offsets = np.empty(len(finite) + 1, np.int64)
        cut_beams(
            _joined([scan.ranges for scan in finite], np.empty(0)),
            _joined(directions, none),
            shared,
            starts,
            origins,
            np.array([scan.map_from_sensor.rotation for scan in finite]).reshape(-1, d, d),
            self.limits,
            self.hit_width / 2,
            self.heights,
            self.body,
            ends,
            tips,
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
            tips=tips[:used] if self.hit_width > 0 else ends,
            hit=hit[:used],
        )
        return segments, +skipped


def _joined(arrays: Sequence[FloatArray], nothing: FloatArray) -> FloatArray:
    # A scan of space is a batch of its own, and long: it is not copied.
    if len(arrays) == 1:
        return np.ascontiguousarray(arrays[0], np.float64)
    return np.concatenate([nothing, *arrays])
