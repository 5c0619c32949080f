# SPDX-License-Identifier: Apache-2.0
"""Wide beams (sonar, time of flight, radar): from readings to the cells of a cone.

A wide beam says how far the nearest thing in its cone is, not in which direction. So the inverse
model has three regions by range, for all cells in the cone: free before the return, occupied on
the arc around it, nothing is said behind it.

Sources: Moravec, Elfes: High resolution maps from wide angle sonar (ICRA 1985); Elfes: Using
occupancy grids for mobile robot perception and navigation (1989); Thrun, Burgard, Fox:
Probabilistic Robotics (2005), section 9.2 and table 9.2.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.limits import MAX_COORDINATE, TOO_LONG
from oddsmap.scans.measurement import ranges_of
from oddsmap.sensors.beam import NO_RANGE_MAX, BeamSensor, check_rates
from oddsmap.sensors.cell_votes import CellVotes
from oddsmap.sensors.filters import check_filters
from oddsmap.sensors.usable_beams import Verdicts, judge_readings, refuse_beam_origins
from oddsmap.short_repr import short_repr

if TYPE_CHECKING:
    from oddsmap.forward.model import ForwardModel
    from oddsmap.kernels.trace.readings import Limits
    from oddsmap.kernels.vote.cone_votes import Cones, Room
    from oddsmap.scans.measurement import Measurement

__all__ = ["ConeSensor"]


# Entries listed at a time: 6 MB. A scan is listed whole, and may have up to _MAX_ENTRIES of them (3
# GB).
_ENTRIES = 1 << 17
_MAX_ENTRIES = 1 << 26
_MAX_REACH = float(1 << 22)


@dataclass(frozen=True, slots=True, kw_only=True)
class ConeSensor:
    """A sensor of wide beams: a sector in 2D, a circular cone in 3D.

    A cell belongs to a cone where its centre lies within half the opening angle of the axis, and
    with r the centre's range, z the reading and w the larger of `hit_width` and a cell's side:
    free where r < z - w/2, occupied where |r - z| <= w/2, nothing said behind. Cells that the axis
    itself passes belong to the cone wherever their centre lies, so that narrow cones have no gaps;
    the cell of the axis' end point is always occupied. Where nothing was seen the cone clears
    r < clear range - half a cell, but never the cell of the axis' end point.

    Args:
        cone_deg: full opening angle [deg], up to 180.
        range_min: a reading below it carries no information [m].
        range_max: a finite reading at or above it is a no-return [m]; None where unknown.
        clear_range: how far a no-return clears [m]. None: a reading of +Inf clears up to
            range_max, and a finite no-return, which may as well be a fault, clears nothing.
        hit_width: radial depth of the occupied arc [m]; 0: one cell.
        share_hit: True: the cells of the arc share one hit by their weight; False: each gets a
            whole one, which is the textbook's model.
        angular_falloff: f in the weight 1 - f (angle / half the opening angle)^2 of a cell's
            vote, 0 to 1; what the axis alone brings in is at angle 0.
        range_falloff: f in the weight 1 - f (r / range_max), 0 to 1; needs range_max. A shared
            hit stays a whole one.
        pass_falloff: f in the weight 1 - f (r / z)^2 of a pass, 0 to 1: passes fade near the
            return.
        p_hit: p(x | z) at prior 1/2 on the arc.
        p_miss: p(x | z) at prior 1/2 before it.
        mark_z_min: a return below this height in the map frame clears but does not mark [m], by
            the end point of the axis; 3D scans only.
        mark_z_max: likewise above this height [m].
        body_min: lowest corner of the robot's body in the sensor frame [m], x and y in 2D, x, y
            and z in 3D; a return whose axis ends inside the body's box does not mark.
        body_max: its highest corner [m].
        detection: probability that an occupied cell echoes. This and what follows belongs to the
            forward model: it changes `forward_model`, never the filter.
        p_random: rate of random readings.
        p_dropout: rate of echoes lost.
        sigma: range noise, standard deviation [m].

    Raises:
        ConfigError: a value is outside its range.
    """

    kind: ClassVar[str] = "cone"
    names: ClassVar[tuple[str, ...]] = ("sonar", "tof")
    evidence_from: ClassVar[Literal["rays", "cells"]] = "cells"
    default_votes: ClassVar[str] = "beam"

    cone_deg: float
    range_min: float = 0.0
    range_max: float | None = None
    clear_range: float | None = None
    hit_width: float = 0.0
    share_hit: bool = True
    angular_falloff: float = 0.0
    range_falloff: float = 0.0
    pass_falloff: float = 0.0
    p_hit: float = 0.7
    p_miss: float = 0.4
    mark_z_min: float | None = None
    mark_z_max: float | None = None
    body_min: tuple[float, ...] | None = None
    body_max: tuple[float, ...] | None = None
    detection: float = 0.98
    p_random: float = 0.02
    p_dropout: float = 0.02
    sigma: float = 0.035

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not 0.0 < self.cone_deg <= 180.0:
            raise ConfigError(
                "sensor.cone_deg is a full opening angle above 0 and up to 180 degrees, "
                f"got {self.cone_deg}"
            )
        self._axis_beam()
        for name in ("angular_falloff", "range_falloff", "pass_falloff"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ConfigError(f"sensor.{name} lies between 0 and 1, got {value}")
        if self.range_falloff > 0.0 and self.range_max is None:
            raise ConfigError(
                f"sensor.range_falloff is a share of range_max: got {self.range_falloff} without "
                "sensor.range_max"
            )
        check_rates(self.detection, self.p_random, self.p_dropout)
        if not 0.0 < self.sigma < math.inf:
            raise ConfigError(f"sensor.sigma is a length above 0 m, got {self.sigma}")

    def _axis_beam(self) -> BeamSensor:
        # What a cone has in common with a narrow beam, its checks included.
        return BeamSensor(
            range_min=self.range_min,
            range_max=self.range_max,
            clear_range=self.clear_range,
            hit_width=self.hit_width,
            p_hit=self.p_hit,
            p_miss=self.p_miss,
            mark_z_min=self.mark_z_min,
            mark_z_max=self.mark_z_max,
            body_min=self.body_min,
            body_max=self.body_max,
        )

    @property
    def forward_limits(self) -> Limits:
        """Which readings the forward model predicts: see `usable_beams`."""
        range_min, range_max, _, _ = self._axis_beam().limits
        return range_min, range_max, math.inf, math.inf

    def forward_model(self) -> ForwardModel:
        """p(z | map, pose) of the same cone, for simulation and full-map estimation.

        Raises:
            ConfigError: range_max is not set, or p_random is 0.
        """
        from oddsmap.forward.model import ForwardModel

        if self.range_max is None:
            raise ConfigError(NO_RANGE_MAX)
        return ForwardModel(
            cone_deg=self.cone_deg,
            range_max=self.range_max,
            range_min=self.range_min,
            detection=self.detection,
            p_random=self.p_random,
            p_dropout=self.p_dropout,
            sigma=self.sigma,
        )

    def votes(
        self, scans: Sequence[Measurement], resolution: float
    ) -> tuple[Iterator[CellVotes], Counter[str]]:
        """Sort readings into hits, no-returns and what must be skipped, and list their cells.

        Args:
            scans: measurements of one dimension, 2D or 3D; depth images are taken as beams.
            resolution: side of a cell [m].

        Returns:
            The votes of the scans with at least one usable beam, some scans at a time, in arrays
            that are used again for the next ones; and how many scans and beams were skipped, by
            reason.

        Raises:
            InputError: 2D and 3D scans are mixed.
            ConfigError: a filter for 3D scans is set, and the scans are 2D.
            MapTooLargeError: a cone is millions of cells long.
        """
        cones, skipped = self._cones(scans, resolution)
        return self._listed(cones, resolution), skipped

    def _listed(self, cones: Cones, resolution: float) -> Iterator[CellVotes]:
        from oddsmap.kernels.vote.cone_votes import ConeModel, list_cones

        half_angle = math.radians(self.cone_deg) / 2
        model = ConeModel(
            cosine=0.0 if self.cone_deg == 180.0 else math.cos(half_angle),
            sine=math.sin(half_angle),
            half_angle=half_angle,
            half_width=max(self.hit_width / resolution, 1.0) / 2,
            angular_falloff=float(self.angular_falloff),
            range_falloff=self.range_falloff * (resolution / (self.range_max or math.inf)),
            pass_falloff=float(self.pass_falloff),
            share=self.share_hit,
        )
        offsets = np.zeros(len(cones.origins) + 1, np.int64)
        room = _room(_ENTRIES, cones.origins.shape[1])
        first = 0
        while first < len(cones.origins):
            done = list_cones(cones, model, first, offsets, room)
            if done > 0:
                end = offsets[done]
                beams = int(cones.offsets[first + done] - cones.offsets[first])
                yield CellVotes(
                    offsets[: done + 1],
                    room.index[:end],
                    room.hits[:end],
                    room.passes[:end],
                    beams,
                )
                first += done
            elif len(room.hits) < _MAX_ENTRIES:
                room = _room(2 * len(room.hits), cones.origins.shape[1])
            else:
                raise MapTooLargeError(
                    f"the cones of one scan hold over {_MAX_ENTRIES:.1e} cells of "
                    f"{resolution:g} m: {TOO_LONG}"
                )

    def _cones(self, scans: Sequence[Measurement], resolution: float) -> tuple[Cones, Counter[str]]:
        from oddsmap.kernels.vote.cone_votes import Cones

        beam = self._axis_beam()
        finite = [scan for scan in ranges_of(scans) if scan.map_from_sensor.is_finite]
        if len({scan.directions.shape[1] for scan in finite}) > 1:
            raise InputError("2D and 3D scans cannot go into one map")
        d = finite[0].directions.shape[1] if finite else 2
        refuse_beam_origins(finite)
        check_filters(d, beam.heights, beam.body)
        limit = MAX_COORDINATE * resolution
        near = [s for s in finite if np.abs(s.map_from_sensor.translation).max() < limit]
        sizes = np.array([scan.size for scan in near], np.int64)
        origins = np.array([s.map_from_sensor.translation for s in near]).reshape(-1, d)
        rotations = np.array([s.map_from_sensor.rotation for s in near]).reshape(-1, d, d)
        directions = np.concatenate([np.empty((0, d)), *(scan.directions for scan in near)])
        ranges = np.concatenate([np.empty(0), *(scan.ranges for scan in near)])

        # Column by column, not as a product of matrices: each beam by itself, whatever the batch.
        turned = np.repeat(rotations, sizes, axis=0)
        axes = np.zeros_like(directions)
        for column in range(d):
            axes += turned[:, :, column] * directions[:, column : column + 1]
        starts = np.repeat(origins, sizes, axis=0)
        verdicts, hit, skipped = _sorted(beam, ranges, directions, axes, starts)
        seen, used, reach = verdicts.seen, verdicts.used, verdicts.reach
        skipped["scan.nan_pose"] = len(scans) - len(finite)
        skipped["scan.pose_too_far"] = len(finite) - len(near)
        counts = np.bincount(np.repeat(np.arange(len(near)), sizes)[used], minlength=len(near))
        kept = counts > 0
        skipped["scan.empty"] = len(near) - int(np.count_nonzero(kept))
        longest = float(reach[used].max(initial=0.0))
        if longest + self.hit_width > _MAX_REACH * resolution:
            raise MapTooLargeError(
                f"a cone of {longest:.4g} m is over {_MAX_REACH:.1e} cells of {resolution:g} m "
                f"long: {TOO_LONG}"
            )
        ends = starts[used] + axes[used] * reach[used, None]
        cones = Cones(
            origins=origins[kept] / resolution,
            offsets=np.concatenate([[0], np.cumsum(counts[kept])]).astype(np.int64),
            axes=axes[used],
            reach=reach[used] / resolution,
            ends=ends / resolution,
            seen=seen[used],
            hit=hit[used],
        )
        return cones, +skipped


def _sorted(
    beam: BeamSensor,
    ranges: FloatArray,
    directions: FloatArray,
    axes: FloatArray,
    starts: FloatArray,
) -> tuple[Verdicts, BoolArray, Counter[str]]:
    """What readings are, which of them mark, and what was skipped."""
    readings = np.where(np.isfinite(axes).all(axis=1), ranges, np.nan)
    verdicts = judge_readings(readings, beam.limits)
    hit, counts = verdicts.seen.copy(), verdicts.skipped
    d = directions.shape[1]
    low, high = beam.heights
    body = beam.body[:, :d]
    with np.errstate(invalid="ignore"):
        points = directions * verdicts.reach[:, None]
        z = starts[:, 2] + axes[:, 2] * verdicts.reach if d == 3 else np.zeros(len(starts))
        on_body = hit & ((body[0] <= points) & (points <= body[1])).all(axis=1)
        outside = hit & ~on_body & ((z < low) | (z > high))
    hit &= ~(on_body | outside)
    counts["hit.on_body"] = int(np.count_nonzero(on_body))
    counts["hit.outside_heights"] = int(np.count_nonzero(outside))
    return verdicts, hit, counts


def _room(entries: int, d: int) -> Room:
    from oddsmap.kernels.vote.cone_votes import Room

    # np.empty takes address space; memory only where entries are listed.
    return Room(
        index=np.empty((entries, d), np.int64),
        hits=np.empty(entries, np.int64),
        passes=np.empty(entries, np.int64),
        arc=np.empty(entries, np.int64),
        shares=np.empty(entries, np.float64),
    )
