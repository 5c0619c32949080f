# SPDX-License-Identifier: Apache-2.0
"""Transforms between frames, over time: what `/tf` and `/tf_static` say.

The graph of frames is searched in both directions: a localiser may publish the map as a child.
Between two samples of a transform it is interpolated; before the first and after the last it is
unknown, never extrapolated. A transform that is the same in every sample is one for all time, as
where a robot's description repeats its fixed ones.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.poses.at_times import PoseArray, PoseTrack
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory, format_seconds

__all__ = ["TransformTree"]

Link = tuple[str, str]
"""A parent and a child."""


@dataclass(slots=True, eq=False)
class _Samples:
    """What was said of one transform: stamp, position and quaternion (x, y, z, w)."""

    stamps: list[int] = field(default_factory=list)
    values: list[tuple[float, ...]] = field(default_factory=list)
    fixed: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """A transform parent_from_child over time: fixed, or sampled."""

    fixed: Pose3 | None
    sampled: Trajectory | None
    span_ns: tuple[int, int]
    track: PoseTrack | None = None

    def at(self, stamp_ns: int, tolerance_ns: int) -> Pose3:
        if self.fixed is not None or self.sampled is None:
            return self.fixed or Pose3(np.zeros(3), np.eye(3))
        first, last = self.span_ns
        if not first <= stamp_ns <= last:
            raise NoPoseError(
                f"{self.sampled.path}: at {format_seconds(stamp_ns)} s it is not known, only from "
                f"{format_seconds(first)} to {format_seconds(last)} s"
            )
        return self.sampled.at(stamp_ns, tolerance_ns)

    def at_times(self, times_ns: IntArray, tolerance_ns: int) -> PoseArray:
        if self.track is None:
            return PoseArray.fixed(self.at(0, 0), len(times_ns))
        return self.track.at(times_ns, tolerance_ns)


class TransformTree:
    """Frames and the transforms between them.

    Args:
        path: what messages start with.

    `conflicts` counts samples that differ from another of the same stamp, and `restated` fixed
    transforms that differ from the one stated before.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.conflicts: Counter[Link] = Counter()
        self.restated: Counter[Link] = Counter()
        self._samples: dict[Link, _Samples] = {}
        self._edges: dict[Link, _Edge] = {}

    def add(
        self,
        parent: str,
        child: str,
        stamp_ns: int,
        translation: tuple[float, float, float],
        quaternion_xyzw: tuple[float, float, float, float],
        *,
        fixed: bool = False,
    ) -> None:
        """Take what a message says of parent_from_child.

        Args:
            parent: frame, with or without a leading slash.
            child: frame.
            stamp_ns: when it is so [ns].
            translation: [m].
            quaternion_xyzw: rotation.
            fixed: at all times, as on /tf_static.
        """
        key = (parent.lstrip("/"), child.lstrip("/"))
        samples = self._samples.setdefault(key, _Samples())
        value = (*translation, *quaternion_xyzw)
        if fixed:
            self.restated[key] += samples.fixed not in (None, value)
            samples.fixed = value
        elif samples.stamps and samples.stamps[-1] == stamp_ns:
            # As in tf2, of two for one time the first counts.
            self.conflicts[key] += value != samples.values[-1]
        else:
            samples.stamps.append(stamp_ns)
            samples.values.append(value)
        self._edges.pop(key, None)

    def doubts(self) -> list[str]:
        """What of the transforms contradicts itself, and what counts."""
        for key, samples in self._samples.items():
            # What has the stamp of one long before it shows when they are sorted.
            if len(set(samples.stamps)) < len(samples.stamps):
                with suppress(InputError):  # a rotation that is none: said where it is used
                    self._edge(key)
        said = [
            f"{count} transforms {parent} to {child} differ from another of the same stamp: "
            "the first of each counts"
            for (parent, child), count in self.conflicts.items()
            if count
        ]
        said += [
            f"{parent} to {child} is stated {count + 1} times as fixed, and differently: the last "
            "counts"
            for (parent, child), count in self.restated.items()
            if count
        ]
        return said + [
            f"{parent} to {child} is stated as fixed, and moves elsewhere: the fixed one counts"
            for (parent, child), samples in self._samples.items()
            if samples.fixed is not None and any(v != samples.values[0] for v in samples.values)
        ]

    @property
    def links(self) -> Collection[Link]:
        """All transforms: parent and child."""
        return self._samples.keys()

    def moves(self, parent: str, child: str) -> bool:
        """Whether a transform changes over time."""
        said = self._samples[parent, child]
        return said.fixed is None and any(value != said.values[0] for value in said.values)

    def transform(self, step: Link, stamp_ns: int, tolerance_ns: int) -> Pose3:
        """first_from_second of two frames next to each other, at a time.

        Raises:
            NoPoseError: it is not known at that time.
        """
        if step in self._samples:
            return self._edge(step).at(stamp_ns, tolerance_ns)
        return self._edge((step[1], step[0])).at(stamp_ns, tolerance_ns).inverse()

    def transforms(self, step: Link, times_ns: IntArray, tolerance_ns: int) -> PoseArray:
        """first_from_second of two frames next to each other, at many times."""
        if step in self._samples:
            return self._edge(step).at_times(times_ns, tolerance_ns)
        return self._edge((step[1], step[0])).at_times(times_ns, tolerance_ns).inverse()

    def spacing_ns(self, target: str, source: str) -> float:
        """The time between samples of the transforms on the way, of the rarest [ns]; 0: fixed."""
        spacing = 0.0
        for step in self.path_between(target, source):
            track = self._edge(step if step in self._samples else (step[1], step[0])).track
            spacing = spacing if track is None else max(spacing, track.spacing_ns)
        return spacing

    def path_between(self, target: str, source: str) -> list[Link]:
        """The frames on the shortest way from one to another, in pairs.

        Raises:
            InputError: there is no way between them.
        """
        target, source = target.lstrip("/"), source.lstrip("/")
        came = self._ways_from(target)
        if source not in came:
            reached = _listed(self.reachable(source) - {source}) or "none"
            raise InputError(
                f"{self.path}: no transforms lead from {source!r} to {target!r}: frames that "
                f"{source!r} is connected with: {reached}"
            )
        steps = []
        at = source
        while (before := came[at]) is not None:
            steps.append((before, at))
            at = before
        return steps[::-1]

    def moves_between(self, target: str, source: str) -> bool:
        """Whether the way between two frames changes over time."""
        return any(
            self.moves(*step) if step in self._samples else self.moves(step[1], step[0])
            for step in self.path_between(target, source)
        )

    def reachable(self, frame: str) -> set[str]:
        """Frames that transforms connect with one, and it."""
        return set(self._ways_from(frame.lstrip("/")))

    def _ways_from(self, frame: str) -> dict[str, str | None]:
        """Frames that can be reached, each with the one before it on the shortest way."""
        neighbours: dict[str, list[str]] = {}
        for parent, child in self._samples:
            neighbours.setdefault(parent, []).append(child)
            neighbours.setdefault(child, []).append(parent)
        came: dict[str, str | None] = {frame: None}
        queue = deque([frame])
        while queue:
            here = queue.popleft()
            for other in neighbours.get(here, ()):
                if other not in came:
                    came[other] = here
                    queue.append(other)
        return came

    def _edge(self, key: Link) -> _Edge:
        # Made when it is first asked for, as most of a robot's are not.
        if key not in self._edges:
            self._edges[key] = self._made(key, self._samples[key])
        return self._edges[key]

    def _made(self, key: Link, said: _Samples) -> _Edge:
        if said.fixed is not None or not self.moves(*key):
            return _Edge(self._pose(key, said.fixed or said.values[0]), None, (0, 0))
        stamps = np.array(said.stamps, np.int64)
        order = np.argsort(stamps, kind="stable")
        stamps = stamps[order]
        keep = order[np.append(True, stamps[1:] != stamps[:-1])]
        for row, before in zip(order[1:], order[:-1], strict=True):
            if said.stamps[row] == said.stamps[before]:
                self.conflicts[key] += said.values[row] != said.values[before]
        poses = [self._pose(key, said.values[row]) for row in keep]
        trajectory = Trajectory(
            np.array([pose.translation for pose in poses]),
            np.array([pose.rotation for pose in poses]),
            np.array(said.stamps, np.int64)[keep],
            path=f"{self.path}: the transform {key[0]} to {key[1]}",
        )
        span = int(stamps[0]), int(stamps[-1])
        return _Edge(None, trajectory, span, PoseTrack(trajectory))

    def _pose(self, key: Link, value: tuple[float, ...]) -> Pose3:
        try:
            return Pose3.from_quaternion_xyzw(value[:3], value[3:])
        except InputError as error:
            raise InputError(f"{self.path}: the transform {key[0]} to {key[1]}: {error}") from None


def _listed(frames: Iterable[str]) -> str:
    names = sorted(frames)
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
