# SPDX-License-Identifier: Apache-2.0
"""A map of point landmarks: scans with known poses in, one Gaussian a landmark out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError, OddsmapError, as_line, shown
from oddsmap.landmarks.association import (
    chi_square_quantile,
    mutual_nearest,
    squared_mahalanobis,
)
from oddsmap.landmarks.dots import dots_of
from oddsmap.landmarks.landmark import Landmark, Track
from oddsmap.landmarks.observations import Observations
from oddsmap.landmarks.store import read_json, save_csv, save_json
from oddsmap.plot.thumbnail import Pictured, Thumbnail
from oddsmap.poses.pose import Pose2
from oddsmap.short_repr import counted, described, extent_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["LandmarkMap"]


# Beyond, no tenth of a millimetre is left of a coordinate [m].
_FARTHEST = 1e12
# Ratio of the variances along and across a ray beyond which no matrix of both can be inverted.
_FLATTEST = 1e12

# How often a landmark must have been seen to be reported, with and without ids.
_MIN_COUNT = {True: 1, False: 3}
_OPTIONS = ("gate", "new_gate", "min_count", "depth_ratio_max", "ndim")


class LandmarkMap(Pictured):
    """Point landmarks, each a Gaussian: the maximum of the likelihood of all its observations.

    The poses are known, so that the landmarks are independent of each other: there is no joint
    covariance. With ids, the order of the scans matters only through rounding (a landmark whose
    positions alone were observed) and where the iteration stops (1e-9 standard deviations).
    Without, it also matters through the decisions of association, which are never taken back.

    Args:
        gate: probability in (0, 1) that an observation lies within the gate of its landmark.
        new_gate: the same of the wider gate, outside of which an observation starts a landmark;
            what lies between the two is counted and left out, or each landmark would spawn a
            double from the tails of its own noise.
        min_count: a landmark observed less often is tentative and not reported. None: 1 with ids,
            3 without.
        depth_ratio_max: a landmark known by bearings alone is reported once its largest standard
            deviation is at most this part of its distance to the nearest sensor.
        ndim: 2, or 3 for 3D positions.

    Raises:
        ConfigError: an argument outside its range.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield f"{self.ndim}D"
        means = np.array([mark.mean for mark in self.landmarks])
        yield counted(len(means), "landmark")
        if len(means):
            yield extent_of(means.min(axis=0), means.max(axis=0))
        yield f"{self.tentative:,} tentative, {self.unlocated:,} not located"
        yield f"gates {self.gate:g}, {self.new_gate:g}"
        if lost := self.skipped.total():
            yield f"{lost:,} skipped"

    def __init__(
        self,
        *,
        gate: float = 0.99,
        new_gate: float = 0.999999,
        min_count: int | None = None,
        depth_ratio_max: float = 0.2,
        ndim: int = 2,
    ) -> None:
        if not 0.0 < gate <= new_gate < 1.0:
            raise ConfigError(f"gates need 0 < gate <= new_gate < 1, got {gate} and {new_gate}")
        if min_count is not None and min_count < 1:
            raise ConfigError(f"min_count must be at least 1, got {min_count}")
        if not 0.0 < depth_ratio_max < 1.0:
            raise ConfigError(f"depth_ratio_max must lie in (0, 1), got {depth_ratio_max}")
        if ndim not in (2, 3):
            raise ConfigError(f"a landmark map has 2 or 3 dimensions, got {ndim}")
        self.gate = gate
        self.new_gate = new_gate
        self.min_count = min_count
        self.depth_ratio_max = depth_ratio_max
        self.ndim = ndim
        self.skipped: Counter[str] = Counter()
        self.tracks: dict[int, Track] = {}
        self.known_ids: bool | None = None  # decided by the first scan

    def add(self, observations: Observations) -> IntArray:
        """Add the observations of one scan.

        With ids, each goes to the landmark of its id. Without, pairs of an observation and a
        landmark that are each other's nearest by Mahalanobis distance, within `gate`, belong
        together: first among the landmarks seen `min_count` times, then among the tentative ones.
        What remains outside `new_gate` of all landmarks that found no partner starts a new
        landmark, unless it is a bearing alone.

        Args:
            observations: of one scan: without ids, a landmark gets one of them at most.

        Returns:
            The id of the landmark that each observation went to, or -1, shape (n,). What went to
            none is counted in `skipped`: "observation.nan", "observation.range_not_positive",
            "observation.out_of_scale" (too far or too near to calculate with),
            "observation.ambiguous" (between the two gates), "observation.unmatched_bearing".

        Raises:
            InputError: a pose of another dimension, or a scan with ids after one without, or the
                other way round.
        """
        self._check(observations)
        ids = np.full(len(observations), -1, dtype=np.int64)
        usable = self._usable(observations)
        kept = observations.rows(usable)
        ids[usable] = self._associate(kept) if kept.ids is None else kept.ids
        for name in np.unique(ids[ids >= 0]).tolist():
            of_it = observations.rows(usable & (ids == name))
            if name not in self.tracks:
                self.tracks[name] = Track(_anchor(of_it))
            self.tracks[name].add(of_it)
        return ids

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """The landmarks to report, by id: located, and observed at least `min_count` times."""
        return tuple(mark for mark in self._located() if mark.count >= self._needed_count())

    @property
    def tentative(self) -> int:
        """How many landmarks are located but were observed less than `min_count` times."""
        return sum(mark.count < self._needed_count() for mark in self._located())

    @property
    def unlocated(self) -> int:
        """How many landmarks have bearings that do not (yet) say where they are."""
        return len(self.tracks) - len(self._located())

    def nees(self, truth: Mapping[int, npt.ArrayLike]) -> FloatArray:
        """Normalised estimation error squared: (m - x)^T P^-1 (m - x), chi-square if consistent.

        Args:
            truth: true positions [m], shape (d,), by id.

        Returns:
            One value for each reported landmark that `truth` names, by id, shape (n,). Over many
            landmarks the mean of a consistent map is d.

        Source: Bar-Shalom, Li, Kirubarajan 2001, ch. 5.4.2.
        """
        values = []
        for mark in self.landmarks:
            if mark.id in truth:
                error = mark.mean - np.asarray(truth[mark.id], dtype=np.float64)
                values.append(error @ np.linalg.solve(mark.covariance, error))
        return np.array(values, dtype=np.float64)

    def _thumbnail(self) -> Thumbnail | None:
        return dots_of(np.array([mark.mean[:2] for mark in self.landmarks]))

    def plot(
        self,
        ax: Axes | None = None,
        *,
        trajectory: npt.ArrayLike | None = None,
        title: str | None = None,
    ) -> Axes:
        """Draw landmarks and their 95 % ellipses: see `oddsmap.landmarks.picture.plot_landmarks`.

        Args:
            ax: axes of Matplotlib; None: the current ones of pyplot.
            trajectory: positions of the sensor [m], shape (n, 2).
            title: a line above the axes.
        """
        from oddsmap.landmarks.picture import plot_landmarks

        return plot_landmarks(self.landmarks, ax, trajectory=trajectory, title=title)

    def save(self, path: str | Path, *, force: bool = False) -> Path:
        """Write the map: `.json` holds all and can be loaded, `.csv` is a table of the landmarks.

        Raises:
            ConfigError: another suffix.
            OutputError: the file exists already or cannot be written.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        if suffix == ".json":
            save_json(self.to_dict(), path, force=force)
        elif suffix == ".csv":
            save_csv(self.landmarks, self.ndim, path, force=force)
        else:
            raise ConfigError(
                f"{path}: landmarks are written to .json (all) or .csv (a table), "
                f'not "{path.suffix}"'
            )
        return path

    @classmethod
    def load(cls, path: str | Path) -> LandmarkMap:
        """Read a `.json` that `save` wrote: the same map, to the last bit; it can be added to.

        Raises:
            InputError: not such a file.
        """
        content = read_json(path)
        try:
            return cls.from_dict(content)
        except OddsmapError as error:
            raise InputError(f"{path}: {error}") from None
        except (ValueError, KeyError, TypeError, OverflowError, AttributeError) as error:
            reason = as_line(f"{type(error).__name__}: {error}", 100)
            raise InputError(f"{path}: a damaged landmark map ({reason}): write it again") from None

    def to_dict(self) -> dict[str, Any]:
        """All of the map as plain values for JSON; numbers give the same float64 back."""
        reported = {mark.id: mark for mark in self.landmarks}
        rows = []
        for name, track in sorted(self.tracks.items()):
            mark = reported.get(name)
            rows.append(
                {
                    "id": name,
                    "count": track.count,
                    "mean": None if mark is None else mark.mean.tolist(),
                    "covariance": None if mark is None else mark.covariance.tolist(),
                    "track": track.to_dict(),
                }
            )
        return {
            "options": {option: getattr(self, option) for option in _OPTIONS},
            "known_ids": self.known_ids,
            "skipped": dict(self.skipped),
            "landmarks": rows,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> LandmarkMap:
        """The inverse of `to_dict`.

        Raises:
            ConfigError: an option outside its range.
            KeyError, TypeError, ValueError: something is missing, is not a number, or is there
                twice.
        """
        landmarks = cls(**{option: content["options"][option] for option in _OPTIONS})
        if content["known_ids"] not in (True, False, None):
            raise ValueError(f"known_ids is true, false or null, got {shown(content['known_ids'])}")
        landmarks.known_ids = content["known_ids"]
        landmarks.skipped = Counter({str(k): _whole(v) for k, v in content["skipped"].items()})
        for row in content["landmarks"]:
            name = _whole(row["id"])
            if name in landmarks.tracks:
                raise ValueError(f"landmark {name} is there twice")
            track = Track.from_dict(row["track"], _whole(row["count"]), landmarks.ndim)
            landmarks.tracks[name] = track
        return landmarks

    def _needed_count(self) -> int:
        return _MIN_COUNT[bool(self.known_ids)] if self.min_count is None else self.min_count

    def _located(self) -> list[Landmark]:
        found = []
        for name, track in sorted(self.tracks.items()):
            estimate = track.estimate(self.depth_ratio_max)
            if estimate is not None:
                found.append(Landmark(name, *estimate, track.count))
        return found

    def _check(self, observations: Observations) -> None:
        d = 2 if isinstance(observations.map_from_sensor, Pose2) else 3
        if d != self.ndim:
            raise InputError(f"a landmark map of {self.ndim}D got a scan with a {d}D pose")
        known = observations.ids is not None
        if self.known_ids is None:
            self.known_ids = known
        if known != self.known_ids:
            raise InputError(
                "a landmark map takes scans with ids or scans without, not both: its own numbers "
                "would run into the given ones"
            )

    def _usable(self, observations: Observations) -> npt.NDArray[np.bool_]:
        usable = np.isfinite(observations.values).all(axis=1)
        self._skip("observation.nan", int((~usable).sum()))
        if observations.kind == "range-bearing":
            positive = observations.values[:, 0] > 0.0
            self._skip("observation.range_not_positive", int((usable & ~positive).sum()))
            usable &= positive
        in_scale = _in_scale(observations)
        self._skip("observation.out_of_scale", int((usable & ~in_scale).sum()))
        return np.asarray(usable & in_scale)

    def _associate(self, observations: Observations) -> IntArray:
        degrees = observations.values.shape[1]
        near = chi_square_quantile(self.gate, degrees)
        far = chi_square_quantile(self.new_gate, degrees)
        located = self._located()
        distance = np.empty((len(observations), 0))
        if located:
            means = np.array([mark.mean for mark in located])
            covariances = np.array([mark.covariance for mark in located])
            distance = squared_mahalanobis(observations, means, covariances)
        names = np.array([mark.id for mark in located], dtype=np.int64)
        seen_enough = np.array(
            [mark.count >= self._needed_count() for mark in located], dtype=np.bool_
        )
        ids = np.full(len(observations), -1, dtype=np.int64)
        alone = np.ones(len(located), dtype=np.bool_)
        # Tentative landmarks get what is left: a false reading beside a landmark would otherwise
        # take half of its observations from then on.
        for group in (seen_enough, ~seen_enough):
            rows, columns = np.flatnonzero(ids < 0), np.flatnonzero(group)
            pairs = mutual_nearest(distance[np.ix_(rows, columns)], near)
            ids[rows[pairs >= 0]] = names[columns[pairs[pairs >= 0]]]
            alone[columns[pairs[pairs >= 0]]] = False
        unmatched = ids < 0
        if observations.kind == "bearing":
            self._skip("observation.unmatched_bearing", int(unmatched.sum()))
            return ids
        between = unmatched & (distance[:, alone] <= far).any(axis=1)
        self._skip("observation.ambiguous", int(between.sum()))
        new = unmatched & ~between
        ids[new] = max(self.tracks, default=-1) + 1 + np.arange(int(new.sum()))
        return ids

    def _skip(self, reason: str, count: int) -> None:
        if count:
            self.skipped[reason] += count


def _whole(number: object) -> int:
    """A count or an id as it stands in JSON.

    Raises:
        ValueError: something else; a count of 2.5 would be another landmark.
    """
    if type(number) is not int or not 0 <= number < 2**63:
        raise ValueError(f"{shown(number)} is no count and no id")
    return number


def _in_scale(observations: Observations) -> npt.NDArray[np.bool_]:
    """Whether each observation can be calculated with: one of 1e9 m would stop the whole run."""
    values = observations.values
    place = np.abs(observations.map_from_sensor.translation).max()
    near = np.full(len(values), bool(place <= _FARTHEST))
    if observations.kind == "bearing":
        return near
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        if observations.kind == "position":
            return np.asarray(near & (np.abs(values) <= _FARTHEST).all(axis=1))
        across = observations.covariance[:, 1, 1] * np.square(values[:, 0])
        ratio = observations.covariance[:, 0, 0] / across
        return near & (ratio < _FLATTEST) & (ratio > 1.0 / _FLATTEST) & (values[:, 0] <= _FARTHEST)


def _anchor(observations: Observations) -> FloatArray:
    if observations.kind == "bearing":
        return observations.map_from_sensor.translation
    return np.asarray(observations.in_map()[0][0])
