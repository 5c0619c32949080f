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
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError
from oddsmap.odds import logit
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.filters import AngleWindow, body_box, check_body
from oddsmap.sensors.inverse_model import HitShape, beam_weights
from oddsmap.sensors.segments import Segments, cut_scans
from oddsmap.short_repr import short_repr

if TYPE_CHECKING:
    from oddsmap.forward.model import ForwardModel
    from oddsmap.kernels.trace.readings import Limits

__all__ = ["NO_RANGE_MAX", "BeamSensor", "check_rates"]


NO_RANGE_MAX = (
    "sensor.range_max is needed by the forward model, got none: set it (--set sensor.range_max="
    "METRES) to the range at and beyond which the sensor reports nothing"
)
# Range noise of a common lidar [m], for the forward model of a sensor that does not state it.
_LIDAR_SIGMA = 0.02


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
        sigma: standard deviation of the range [m]; 0: none. Above 0 the cells within `spread`
            times sigma of the return share one hit, each in proportion to the mass that the
            normal distribution around the return, cut off there and at the sensor, has in it. It
            takes the place of hit_width, and share_hit has no effect.
        spread: how many standard deviations count.
        fade: the way before the occupied region, or before the return, over which passes fade
            [m]: their weight falls in a straight line from 1 to 0, and a cell gets the mean along
            the beam inside it. No-returns do not fade.
        p_hit: p(x | z) at prior 1/2 around the return.
        p_miss: p(x | z) at prior 1/2 before it.
        mark_z_min: a return below this height in the map frame clears but does not mark [m];
            3D scans only.
        mark_z_max: likewise above this height [m].
        body_min: lowest corner of the robot's body in the sensor frame [m], x and y in 2D, x, y
            and z in 3D; a return inside the body's box does not mark.
        body_max: its highest corner [m].
        angle_min: beams of a lower azimuth in the sensor frame say nothing [rad]: where the robot
            itself is in the way; None: -pi. 2D scans only.
        angle_max: likewise those of a higher one [rad]; None: pi. The window between the two may
            lie across the back: from 2 to 4.
        detection: probability that an occupied cell returns the beam. This and what follows belongs
            to the forward model: it changes `forward_model`, never the filter.
        p_random: rate of random readings.
        p_dropout: rate of returns lost.

    Raises:
        ConfigError: a value is outside its range.
    """

    kind: ClassVar[str] = "beam"
    names: ClassVar[tuple[str, ...]] = ("lidar2d", "lidar3d", "depth")
    evidence_from: ClassVar[Literal["rays", "cells"]] = "rays"
    default_votes: ClassVar[str] = "scan"

    range_min: float = 0.0
    range_max: float | None = None
    clear_range: float | None = None
    hit_width: float = 0.0
    share_hit: bool = False
    sigma: float = 0.0
    spread: float = 3.0
    fade: float = 0.0
    p_hit: float = 0.7
    p_miss: float = 0.4
    mark_z_min: float | None = None
    mark_z_max: float | None = None
    body_min: tuple[float, ...] | None = None
    body_max: tuple[float, ...] | None = None
    angle_min: float | None = None
    angle_max: float | None = None
    detection: float = 0.98
    p_random: float = 0.02
    p_dropout: float = 0.02

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in ("range_min", "hit_width", "sigma", "fade"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"sensor.{name} is a length of 0 m or more, got {value}")
        for name in ("range_max", "clear_range"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ConfigError(f"sensor.{name} is a length above 0 m, got {value}")
        if self.range_max is not None and self.range_min >= self.range_max:
            raise ConfigError(
                f"sensor.range_min < range_max is needed, got {self.range_min} and {self.range_max}"
            )
        if not 0.0 < self.spread < math.inf:
            raise ConfigError(f"sensor.spread is a number above 0, got {self.spread}")
        if self.sigma > 0.0 and self.hit_width > 0.0:
            raise ConfigError(
                "sensor.sigma and hit_width both say where a hit goes: set one to 0, "
                f"got {self.sigma} and {self.hit_width}"
            )
        if not 0.5 < self.p_hit < 1.0:
            raise ConfigError(f"sensor.p_hit lies between 0.5 and 1, got {self.p_hit}")
        if not 0.0 < self.p_miss < 0.5:
            raise ConfigError(f"sensor.p_miss lies between 0 and 0.5, got {self.p_miss}")
        check_rates(self.detection, self.p_random, self.p_dropout)
        self._check_filters()

    def _check_filters(self) -> None:
        low, high = self.heights
        for name in ("mark_z_min", "mark_z_max"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise ConfigError(f"sensor.{name} is a height [m], got {value}")
        if not low < high:
            raise ConfigError(f"sensor.mark_z_min < mark_z_max is needed, got {low} and {high}")
        check_body(self.body_min, self.body_max)
        window = self.angle_window
        if window is not None and not window[0] < window[1] <= window[0] + 2 * math.pi:
            raise ConfigError(
                "sensor.angle_min < angle_max are angles in radians, up to 2 pi apart (by default "
                f"-pi and pi), got {self.angle_min} and {self.angle_max}"
            )

    def forward_model(self) -> ForwardModel:
        """p(z | map, pose) of the same beam, a ray, for simulation and full-map estimation.

        Its range noise is `sigma`, or 2 cm where that is 0.

        Raises:
            ConfigError: range_max is not set, or p_random is 0.
        """
        from oddsmap.forward.model import ForwardModel

        if self.range_max is None:
            raise ConfigError(NO_RANGE_MAX)
        return ForwardModel(
            cone_deg=0.0,
            range_max=self.range_max,
            range_min=self.range_min,
            detection=self.detection,
            p_random=self.p_random,
            p_dropout=self.p_dropout,
            sigma=self.sigma or _LIDAR_SIGMA,
        )

    @property
    def half_width(self) -> float:
        """How far the occupied region reaches before and behind the return [m]."""
        return float(self.spread * self.sigma if self.sigma > 0.0 else self.hit_width / 2)

    @property
    def hit_shape(self) -> HitShape:
        """How a beam votes around its return."""
        return HitShape(
            share=self.share_hit or self.sigma > 0.0,
            half_width=self.half_width,
            sigma=float(self.sigma),
            fade=float(self.fade),
        )

    @property
    def whole_votes(self) -> bool:
        """True where each beam gives its cells whole votes, with a hit for one cell alone."""
        return self.half_width == 0.0 and self.fade == 0.0

    @property
    def heights(self) -> tuple[float, float]:
        """Lowest and highest height in the map frame at which a return marks [m]."""
        return (
            -math.inf if self.mark_z_min is None else float(self.mark_z_min),
            math.inf if self.mark_z_max is None else float(self.mark_z_max),
        )

    @property
    def body(self) -> FloatArray:
        """Corners of the body's box in the sensor frame [m], shape (2, 3); in 2D of any height."""
        return body_box(self.body_min, self.body_max)

    @property
    def angle_window(self) -> AngleWindow:
        """Lowest and highest azimuth of a beam that counts [rad]; None: all count."""
        if self.angle_min is None and self.angle_max is None:
            return None
        return (
            -math.pi if self.angle_min is None else float(self.angle_min),
            math.pi if self.angle_max is None else float(self.angle_max),
        )

    @property
    def limits(self) -> Limits:
        """range_min, range_max, how far +Inf clears, how far a finite no-return clears [m].

        An unknown range_max is infinite; what clears nothing is NaN.
        """
        unseen = self.range_max if self.clear_range is None else self.clear_range
        # Floats also where a setting is a whole number: kernels are compiled for each type.
        return (
            float(self.range_min),
            math.inf if self.range_max is None else float(self.range_max),
            math.nan if unseen is None else float(unseen),
            math.nan if self.clear_range is None else float(self.clear_range),
        )

    @property
    def forward_limits(self) -> Limits:
        """Which readings the forward model predicts: see `usable_beams`."""
        range_min, range_max, _, clear_over = self.limits
        return range_min, range_max, math.inf, math.nan if math.isnan(clear_over) else math.inf

    def inverse_model(
        self,
        distance: npt.ArrayLike,
        reading: float,
        prior: npt.ArrayLike = 0.5,
        *,
        cell: float | None = None,
    ) -> FloatArray:
        """p(x | z): probability that there is something at a distance along the beam.

        Args:
            distance: distances from the sensor along the beam [m], any shape.
            reading: the range z [m].
            prior: p(x), a number or one for each distance.
            cell: side of cells centred at the distances [m]: what a cell there gets of a shared
                hit, and of a fading pass. None: points, where a hit with a width is whole.

        Returns:
            The probability at each distance, the prior itself behind the return.

        Raises:
            ConfigError: sigma > 0 and no cell: a share of a hit needs its size.

        Source: Probabilistic Robotics, table 9.2, with the prior's log odds kept apart.
        """
        at = np.asarray(distance, dtype=np.float64)
        base = np.broadcast_to(np.asarray(prior, dtype=np.float64), at.shape)
        if cell is None and self.sigma > 0.0:
            raise ConfigError("a hit spread by sigma is shared by cells: give the side of a cell")
        hits, passes = beam_weights(self.hit_shape, at, reading, cell or 0.0)
        factor = hits * logit(self.p_hit) + passes * logit(self.p_miss)
        odds = np.exp(logit(base) + factor)
        return np.where((hits > 0.0) | (passes > 0.0), odds / (1.0 + odds), base)

    def segments(
        self, scans: Sequence[Measurement], farthest: float = math.inf
    ) -> tuple[Segments, Counter[str]]:
        """Sort readings into hits, no-returns and what must be skipped.

        Args:
            scans: measurements of one dimension, 2D or 3D; depth images are taken as beams.
            farthest: a scan with a beam that starts this far from the map's origin is skipped [m].

        Returns:
            The segments of the scans with at least one usable beam, and how many scans and beams
            were skipped, by reason.

        Raises:
            InputError: 2D and 3D scans are mixed.
            ConfigError: a filter is set that is not for scans of their dimension.
        """
        return cut_scans(
            scans,
            limits=self.limits,
            shape=self.hit_shape,
            heights=self.heights,
            body=self.body,
            window=self.angle_window,
            farthest=farthest,
        )


def check_rates(detection: float, p_random: float, p_dropout: float) -> None:
    """Check what the forward model of a beam is made of.

    Raises:
        ConfigError: a rate is outside its range, or nothing is left for true readings.
    """
    if not 0.0 < detection <= 1.0:
        raise ConfigError(f"sensor.detection lies above 0 and up to 1, got {detection}")
    for name, value in (("p_random", p_random), ("p_dropout", p_dropout)):
        if not 0.0 <= value < 1.0:
            raise ConfigError(f"sensor.{name} is a rate from 0 to below 1, got {value}")
    if p_random + p_dropout >= 1.0:
        raise ConfigError(
            "sensor.p_random and p_dropout leave room for true readings below 1 together, "
            f"got {p_random} + {p_dropout}"
        )
