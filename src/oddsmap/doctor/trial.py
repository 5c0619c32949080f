# SPDX-License-Identifier: Apache-2.0
"""Alternatives on trial: does a log predict itself better if it is read in another way?

A good log loses with every other reading, most often nearly all that it says of itself. So an
alternative is named only where it wins at nearly all places, and by much.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.doctor.prediction import Placed, information
from oddsmap.plausibility.sample import Glance
from oddsmap.poses.pose import Pose, Pose2, Pose3

__all__ = ["Alternative", "Court", "Verdict"]

# Cells of a place, in typical ranges of its scans.
_CELLS = 1 / 40
# Returns further than this are left out, in typical ranges, and so many kept of a scan.
_FURTHEST, _RETURNS = 5.0, 300
# At one place an alternative wins or loses by this factor, and by so many nats.
_CLEARLY, _NATS = 1.15, 0.01
# It is named where it wins at so many places, of those that it wins or loses, and of all.
_FEWEST, _SHARE, _SHARE_OF_ALL = 5, 0.85, 1 / 3
# And what it says of itself then, over all places, in relation and at least [nats per beam].
_MORE, _LEAST = 1.2, 0.1
# Searches look at so many places; what they find is then tried at all.
_FEW = 8
# Motion in typical ranges: see `plausibility.agreement`. Scans that are far apart see different
# places, and no motion at all would look better than theirs.
_OVERLAP, _NEVER, _OTHER_UNIT = 0.4, 20.0, 50.0
# Where an alternative moves scans as far as they were, they may be further apart.
_ALIKE, _STILL_SEEN = 1.3, 3.0
# As they may where they never were so far apart as the log says.
_ABSURD, _MAYBE_SEEN = 200.0, 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Alternative:
    """Another reading of a log.

    Args:
        code: of the note that names it.
        suspicion: what the log would have been then: "quaternions with w first".
        remedy: what to do about it.
        place: where it puts a scan: pose and points.
        scale: metres of one unit of positions, where a unit of ranges is a metre.
    """

    code: str
    suspicion: str
    remedy: str
    place: Callable[[Glance], Placed]
    scale: float = 1.0


class Verdict(NamedTuple):
    """How an alternative compares with the log as it was read."""

    alternative: Alternative
    places: int
    """Places of the log that could be compared."""
    better: int
    """Those at which the alternative is clearly better."""
    worse: int
    """Those at which it is clearly worse."""
    now: float
    """What maps say of held-out beams as the log was read, a mean of places [nats per beam]."""
    then: float
    """The same by the alternative."""

    @property
    def is_sure(self) -> bool:
        """Whether the alternative is to be named."""
        return (
            self.better >= _FEWEST
            and self.better >= _SHARE * (self.better + self.worse)
            and self.better >= _SHARE_OF_ALL * self.places
            and self.then >= max(_MORE * self.now, _LEAST)
        )

    @property
    def is_promising(self) -> bool:
        """Whether a look at a few places is worth one at all of them."""
        return self.better > self.worse and self.then > self.now


@dataclass(slots=True, eq=False)
class Court:
    """The places of a log and how it was read, to compare alternatives with.

    Args:
        groups: scans of each place, of one dimension.
        current: how they are read.
    """

    groups: Sequence[Sequence[Glance]]
    current: Alternative
    _known: dict[tuple[int, bytes], float] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        enough = [[g for g in map(_near, group) if len(g.points) >= 3] for group in self.groups]
        self.groups = [group for group in enough if len(group) >= 3]

    def try_out(self, alternative: Alternative) -> Verdict:
        """Compare an alternative."""
        now, then = [], []
        for number, group in enumerate(self.groups):
            unit = float(np.median([glance.typical_range for glance in group]))
            before, after = _local(group, self.current), _local(group, alternative)
            chosen = _comparable(before, after, unit)
            if chosen.sum() < 3 or not unit > 0.0:
                continue
            key = (number, chosen.tobytes())
            if key not in self._known:
                self._known[key] = information(_some(before, chosen), unit * _CELLS)
            now.append(self._known[key])
            then.append(information(_some(after, chosen), unit * _CELLS))
        a, b = np.array(now), np.array(then)
        better = int((b > _CLEARLY * a + _NATS).sum())
        worse = int((a > _CLEARLY * b + _NATS).sum())
        means = (float(a.mean()), float(b.mean())) if len(a) else (0.0, 0.0)
        return Verdict(alternative, len(a), better, worse, *means)

    def few(self) -> Court:
        """Fewer places, for searches."""
        return Court(self.groups[:: max(1, len(self.groups) // _FEW)], self.current)

    def best_of(self, alternatives: Sequence[Alternative]) -> Verdict | None:
        """The alternative that is named: of those that are sure the best; None where none is."""
        few = self.few()
        promising = [each for each in alternatives if few.try_out(each).is_promising]
        sure = [found for found in map(self.try_out, promising) if found.is_sure]
        return max(sure, key=lambda found: found.then, default=None)


def _near(glance: Glance) -> Glance:
    """Some returns of a scan, without those so far away that they take most of the time."""
    near = (glance.points**2).sum(axis=1) < (_FURTHEST * glance.typical_range) ** 2
    points = glance.points[near]
    return dataclasses.replace(glance, points=points[:: -(-len(points) // _RETURNS) or 1])


def _local(group: Sequence[Glance], alternative: Alternative) -> list[Placed]:
    """Scans of a place in the frame of the first, where an alternative puts them."""
    placed = [alternative.place(glance) for glance in group]
    back = placed[0].pose.inverse()
    return [Placed(_scaled(back @ pose, alternative.scale), points) for pose, points in placed]  # type: ignore[operator]


def _scaled(pose: Pose, scale: float) -> Pose:
    if scale == 1.0:
        return pose
    if isinstance(pose, Pose2):
        return Pose2(pose.x * scale, pose.y * scale, pose.theta)
    return Pose3(pose.translation * scale, pose.rotation)


def _comparable(before: Sequence[Placed], after: Sequence[Placed], unit: float) -> BoolArray:
    """Which scans of a place can be compared, by how far they are from the first."""
    one, other = _motion(before) / unit, _motion(after) / unit
    near, far = np.minimum(one, other), np.maximum(one, other)
    # Less motion always looks better where beams fall in the same pattern, on a floor: it counts
    # where there would be none to see otherwise. More motion never does.
    shrinks = (one > _OTHER_UNIT * other) & (one < _NEVER)
    grows = (other > _OTHER_UNIT * one) & (other > _OVERLAP) & (other < _NEVER)
    alike = (far <= _ALIKE * near) & (far <= _STILL_SEEN)
    absurd = (far > _ABSURD) & (near <= _MAYBE_SEEN)
    chosen: BoolArray
    chosen = alike | absurd | (near <= _OVERLAP) & ~shrinks & ~grows
    return chosen


def _motion(placed: Sequence[Placed]) -> FloatArray:
    return np.array([float(np.linalg.norm(scan.pose.translation)) for scan in placed])


def _some(placed: Sequence[Placed], chosen: BoolArray) -> list[Placed]:
    return [scan for scan, keep in zip(placed, chosen, strict=True) if keep]
