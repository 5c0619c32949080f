# SPDX-License-Identifier: Apache-2.0
"""Tables of landmark observations: one row per observation, CSV with a header line, or NPZ.

| column | |
|---|---|
| `x`, `y`, `theta` | pose of the sensor in the map frame [m, m, rad] |
| `range`, `bearing` | distance [m] and direction in the sensor frame, counter-clockwise [rad] |
| `bearing` without `range` | the direction alone |
| `dx`, `dy` | position in the sensor frame [m] |
| `id` | optional: integer from 0 that names the landmark; empty, NaN or negative: not known |
| `stamp` | optional: time [s], to tell scans from one place apart |

Consecutive rows of equal pose and stamp are one scan. Other columns are ignored.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.landmarks.observations import Kind, Observations
from oddsmap.landmarks.table_npz import NO_ID, check_id, is_npz, read_npz_columns
from oddsmap.poses.pose import Pose2
from oddsmap.readers.compression import Source, open_source
from oddsmap.short_repr import short_repr

__all__ = ["ObservationTable", "read_observations"]


_POSE = ("x", "y", "theta")
_VALUES: dict[Kind, tuple[str, ...]] = {
    "range-bearing": ("range", "bearing"),
    "bearing": ("bearing",),
    "position": ("dx", "dy"),
}
_LONGEST_ID = 40  # digits; leading zeros among them
_KNOWN = {*_POSE, "range", "bearing", "dx", "dy", "id", "stamp"}
_NEEDS = "x, y, theta and either range, bearing or bearing or dx, dy"


@dataclass(frozen=True, slots=True, eq=False)
class ObservationTable:
    """The observations of a file, in file order.

    Args:
        path: the file.
        kind: what was observed.
        poses: of the sensor, x, y [m], theta [rad], shape (n, 3), finite.
        values: the columns of the kind, shape (n, k); some may be NaN.
        ids: names of the landmarks, shape (n,), or None: the file has no column `id`.
        starts: the first row of each scan.
        skipped: rows left out, by reason: "observation.nan_pose" (or stamp) and
            "observation.no_id".
    """

    path: str
    kind: Kind
    poses: FloatArray
    values: FloatArray
    ids: IntArray | None
    starts: IntArray
    skipped: Counter[str]

    __repr__ = short_repr

    def scans(
        self,
        *,
        sigma_range: float | None = None,
        sigma_bearing: float | None = None,
        sigma_xy: float | None = None,
    ) -> Iterator[Observations]:
        """The scans, with the noise of the sensor.

        Args:
            sigma_range: standard deviation of the ranges [m].
            sigma_bearing: standard deviation of the bearings [rad].
            sigma_xy: standard deviation of each coordinate of a position [m].

        Raises:
            ConfigError: one that the kind of the table needs is missing or not positive.
        """
        stated = {"sigma_range": sigma_range, "sigma_bearing": sigma_bearing, "sigma_xy": sigma_xy}
        needs = {
            "range-bearing": ("sigma_range", "sigma_bearing"),
            "bearing": ("sigma_bearing",),
            "position": ("sigma_xy", "sigma_xy"),
        }[self.kind]
        sigmas = []
        for name in needs:
            sigma = stated[name]
            if sigma is None or not 0.0 < sigma < math.inf:
                raise ConfigError(f"{self.kind} observations need a positive {name}, got {sigma}")
            sigmas.append(sigma)
        noise = np.diag(np.square(sigmas))
        for start, end in zip(self.starts, [*self.starts[1:], len(self.poses)], strict=True):
            values = self.values[start:end]
            yield Observations(
                Pose2(*map(float, self.poses[start])),
                self.kind,
                values,
                np.broadcast_to(noise, (len(values), *noise.shape)),
                None if self.ids is None else self.ids[start:end],
            )


def read_observations(path: str | os.PathLike[str]) -> ObservationTable:
    """Read a table of landmark observations; the columns that exist say of which kind they are.

    Args:
        path: a CSV or NPZ file, which may be compressed by gzip or bzip2.

    Raises:
        InputError: no such file, missing columns, a word that is not a number, a bearing that
            cannot be in radians, or no usable row.
    """
    source = open_source(path)
    if is_npz(source.head):
        columns, ids, places = read_npz_columns(source, _KNOWN)
    else:
        columns, ids, places = _read_csv(source)
    return _table(source.path, columns, ids, places)


def _read_csv(source: Source) -> tuple[dict[str, FloatArray], IntArray | None, list[str]]:
    """The columns, the ids (-1: none) and where each row stands."""
    text = source.content.decode("utf-8-sig", "replace")
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    names: list[str] | None = None
    words: list[list[str]] = []
    places: list[str] = []
    try:
        for row in reader:
            if not any(word.strip() for word in row) or row[0].lstrip().startswith("#"):
                continue
            where = f"{source.path}:{reader.line_num}"
            if names is None:
                names = [word.strip() for word in row]
                _check_names(where, names)
                continue
            if len(row) != len(names):
                raise InputError(
                    f"{where}: {len(row)} values where the header announces {len(names)}: "
                    "check how the file was written"
                )
            words.append(row)
            places.append(where)
    except csv.Error as error:
        raise InputError(f"{source.path}:{reader.line_num}: not a CSV line ({error})") from None
    columns: dict[str, FloatArray] = {}
    ids: IntArray | None = None
    for column, name in enumerate(names or []):
        cells = [row[column].strip() for row in words]
        if name == "id":
            ids = np.array([_id(w, word) for w, word in zip(places, cells, strict=True)], np.int64)
        elif name in _KNOWN:
            numbers = [_number(w, name, word) for w, word in zip(places, cells, strict=True)]
            columns[name] = np.array(numbers, dtype=np.float64)
    return columns, ids, places


def _check_names(where: str, names: list[str]) -> None:
    twice = [name for name in _KNOWN if names.count(name) > 1]
    if twice:
        raise InputError(f"{where}: column `{min(twice)}` is there twice: name each column once")
    _kind(where, names)


def _kind(where: str, names: list[str]) -> Kind:
    """What the columns are of.

    Raises:
        InputError: columns are missing, or of two kinds.
    """
    found = ", ".join(names[:12]) or "none"
    missing = [name for name in _POSE if name not in names]
    if missing:
        raise InputError(f"{where}: no column `{missing[0]}`, found {found}: needs {_NEEDS}")
    polar, position = {"range", "bearing"} & {*names}, {"dx", "dy"} & {*names}
    if polar and position:
        raise InputError(f"{where}: columns of two kinds, found {found}: needs {_NEEDS}")
    if position == {"dx", "dy"}:
        return "position"
    if "bearing" in polar:
        return "range-bearing" if "range" in polar else "bearing"
    raise InputError(f"{where}: no landmarks in the columns {found}: needs {_NEEDS}")


def _table(
    path: str,
    columns: dict[str, FloatArray],
    ids: IntArray | None,
    places: list[str],
) -> ObservationTable:
    kind = _kind(path, [*columns])
    values = np.stack([columns[name] for name in _VALUES[kind]], axis=1)
    if "bearing" in columns:
        with np.errstate(invalid="ignore"):
            large = np.flatnonzero(np.abs(columns["bearing"]) > 2.0 * np.pi)
        if len(large):
            row = int(large[0])
            raise InputError(
                f"{places[row]}: a bearing of {columns['bearing'][row]:g}: bearings and theta are "
                "in radians, write them so"
            )
    # A scan is told by where and when it was taken.
    place = np.stack([columns[name] for name in (*_POSE, "stamp") if name in columns], axis=1)
    skipped: Counter[str] = Counter()
    usable = np.asarray(np.isfinite(place).all(axis=1))
    if not usable.all():
        skipped["observation.nan_pose"] = int((~usable).sum())
    if ids is not None:
        unnamed = usable & (ids < 0)
        if unnamed.any():
            skipped["observation.no_id"] = int(unnamed.sum())
        usable &= ~unnamed
    if not usable.any():
        raise InputError(
            f"{path}: no usable observation in {len(usable)} rows: check what wrote the file"
        )
    place = place[usable]
    moved = (place[1:] != place[:-1]).any(axis=1)
    return ObservationTable(
        path=path,
        kind=kind,
        poses=place[:, :3],
        values=values[usable],
        ids=None if ids is None else ids[usable],
        starts=np.concatenate([[0], np.flatnonzero(moved) + 1]).astype(np.int64),
        skipped=skipped,
    )


def _number(where: str, name: str, word: str) -> float:
    if not word:
        return math.nan
    try:
        if "_" in word:  # 1_0 is 10 to Python and to nobody else
            raise ValueError
        return float(word)
    except ValueError:
        raise InputError(f"{where}: {word[:40]!r} in column `{name}` is not a number") from None


def _id(where: str, word: str) -> int:
    number = _number(where, "id", word)
    if math.isnan(number):
        return NO_ID
    # Not by way of the float, which holds 53 bits; but pandas writes 3.0 where a column has gaps.
    whole = word.lstrip("+-").isdecimal() and len(word) <= _LONGEST_ID
    return check_id(where, int(word) if whole else number)
