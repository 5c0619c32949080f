# SPDX-License-Identifier: Apache-2.0
"""What a scan from some pose is expected to tell: Shannon information along its beams."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from numbers import Real
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.kernels.query.gains import MAX_REACH, Met, Told, add_up_gains, gain_of_scan
from oddsmap.limits import memory_limit
from oddsmap.poses.given_pose import PoseLike, pose_of
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.query.given_numbers import check_numbers, check_threads
from oddsmap.query.places import CellGrid, check_places, points_in
from oddsmap.query.row_blocks import fill_rows

__all__ = ["Measure", "PosesLike", "Votes", "expected_gains"]

Measure = Literal["information", "entropy"]
Votes = Literal["scan", "beam"]
PosesLike: TypeAlias = npt.ArrayLike | Sequence[PoseLike]
"""Poses of the sensor: in 2D an array (n, 3) of x, y, yaw [m, m, rad], in 3D matrices (n, 4, 4), or
a list of whatever is a pose (`oddsmap.poses.given_pose.PoseLike`)."""

# A direction may be off by what single precision makes of one.
_UNIT = 1e-6
# Beams handed to a thread at a time.
_BATCH = 1 << 14


def expected_gains(
    grid: CellGrid,
    parts: Iterable[tuple[IntArray, FloatArray]],
    poses: PosesLike,
    directions: npt.ArrayLike,
    max_range: float,
    *,
    p_hit: float,
    p_miss: float,
    unknown: float,
    clear_range: float | None,
    votes: Votes,
    measure: Measure,
    threads: int,
    frame: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """What a scan from each pose is expected to tell [nats], shape (n,).

    Arguments and errors as in `Queries.information_gain`.

    Args:
        grid: the map.
        parts: its known cells, some at a time: index, shape (n, d), and probability, shape (n,).
        poses: see `Queries.information_gain`, as all that follow but the last.
        directions: likewise.
        max_range: likewise.
        p_hit: likewise.
        p_miss: likewise.
        unknown: likewise.
        clear_range: likewise.
        votes: likewise.
        measure: likewise.
        threads: likewise.
        frame: where the map's cells count from, if not from the map frame: rotation, shape (d, d),
            and translation [m], shape (d,).
    """
    d = grid.ndim
    check_numbers(
        max_range=max_range, clear_range=clear_range, p_hit=p_hit, p_miss=p_miss, unknown=unknown
    )
    clear = max_range if clear_range is None else clear_range
    _check(max_range / grid.resolution, clear / grid.resolution, p_hit, p_miss, unknown)
    _check_words(votes, measure, threads)
    ways = points_in(directions, d, "directions")
    length = np.linalg.norm(ways, axis=1)
    wrong = ~(np.abs(length - 1.0) <= _UNIT)
    if wrong.any():
        raise InputError(
            f"{np.count_nonzero(wrong)} of {len(ways)} directions are not of length 1, the first "
            f"has length {length[np.argmax(wrong)]:g}: divide by it"
        )
    rotations, places = _taken_apart(poses, d)
    if frame is not None:
        turn, corner = frame
        rotations, places = turn.T @ rotations, (places - corner) @ turn
    check_places(places / grid.resolution)
    blocks, probability = fill_rows(d, parts, unknown)
    rows = _told(probability, p_hit, p_miss, measure)
    scan = votes == "scan"
    reach, clear = max_range / grid.resolution, clear / grid.resolution
    gains = np.empty(len(places))
    side = max(1, _BATCH // max(1, len(ways)))

    def work(first: int) -> None:
        some = slice(first, first + side)
        turned = np.einsum("pij,bj->pbi", rotations[some], ways)
        starts = places[some] / grid.resolution
        met, key = _room_of_beam(reach, d), np.zeros(d, np.int64)
        if scan:
            told = _room_of_scan(reach, d, len(ways))
            for i in range(len(starts)):
                gains[first + i] = gain_of_scan(
                    blocks, rows, starts[i], turned[i], reach, clear, met, key, told
                )
            return
        each = np.empty(turned.shape[:2])
        for i in range(len(starts)):
            start = np.ascontiguousarray(np.broadcast_to(starts[i], turned[i].shape))
            add_up_gains(
                blocks, rows, start, turned[i], reach, clear, met, key, each[i]
            )  # fmt: skip
        gains[some] = each.sum(axis=1)

    batches = range(0, len(places), side)
    if threads == 1:
        for first in batches:
            work(first)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, batches))
    return gains


def _room_of_beam(reach: float, ndim: int) -> Met:
    most = ndim * (math.ceil(reach) + 2)
    return Met(
        np.zeros(most, np.uint32), np.zeros(most, np.int64), np.zeros(1, np.int64), np.zeros(1)
    )


def _room_of_scan(reach: float, ndim: int, beams: int) -> Told:
    """Room for as many cells as beams can meet, or as there are that near.

    Raises:
        MapTooLargeError: it does not fit in memory.
    """
    near = (2 * math.ceil(reach) + 3) ** ndim
    most = min(near, beams * ndim * (math.ceil(reach) + 2))
    slots = 1 << (2 * most).bit_length()
    if 24 * slots + 8 * most > memory_limit():
        raise MapTooLargeError(
            f"a scan of {beams} beams that reach {reach:.0f} cells may meet {most:.1e} of them: "
            'use fewer beams, a shorter max_range, or votes="beam"'
        )
    return Told(
        np.full(slots, -1, np.int64), np.zeros(slots), np.zeros(slots), np.zeros(most, np.int64)
    )


def _told(probability: FloatArray, p_hit: float, p_miss: float, measure: str) -> FloatArray:
    """For each probability: itself, what a hit tells of such a cell, what a pass does [nats]."""
    o = np.clip(probability, 0.0, 1.0)
    return np.stack([o, *(_of_vote(o, p / (1.0 - p), measure) for p in (p_hit, p_miss))], axis=1)


def _of_vote(o: FloatArray, factor: float, measure: str) -> FloatArray:
    # The vote multiplies the odds o / (1 - o) by the factor.
    total = 1.0 - o + factor * o
    after = factor * o / total
    if measure == "entropy":
        return _entropy(o) - _entropy(after)
    return after * math.log(factor) - np.log(total)


def _entropy(p: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return -np.nan_to_num(p * np.log(p)) - np.nan_to_num((1.0 - p) * np.log1p(-p))


def _taken_apart(poses: PosesLike, ndim: int) -> tuple[FloatArray, FloatArray]:
    """Rotations, shape (n, d, d), and translations [m], shape (n, d)."""
    kind, form = (Pose2, "(n, 3) of x, y, yaw") if ndim == 2 else (Pose3, "(n, 4, 4) of matrices")
    if isinstance(poses, Pose2 | Pose3) or _is_one(poses, ndim):
        raise InputError(
            f"poses are a list of them, or an array of shape {form}: one alone is [pose]"
        )
    if not np.iterable(poses):
        raise InputError(f"poses are a list of them, or an array of shape {form}, got {poses!r}")
    found = [pose_of(pose) for pose in poses]
    for number, pose in enumerate(found):
        if not isinstance(pose, kind):
            raise InputError(f"pose {number} is none of a {ndim}D map: {form}, or {kind.__name__}")
    rotations = np.array([pose.rotation for pose in found]).reshape(-1, ndim, ndim)
    places = np.array([pose.translation for pose in found]).reshape(-1, ndim)
    if not np.isfinite(rotations).all():
        raise InputError("a pose is not finite: leave it out")
    return rotations, places


def _is_one(poses: object, ndim: int) -> bool:
    """Whether numbers are those of one pose."""
    if isinstance(poses, np.ndarray | list | tuple) and len(poses):
        first = poses[0]
        row = ndim == 3 and len(poses) == 4 and np.shape(first) == (4,)  # of a matrix
        return isinstance(first, Real) or row
    return False


def _check(reach: float, clear: float, p_hit: float, p_miss: float, unknown: float) -> None:
    if not 0.0 < reach < MAX_REACH:
        raise ConfigError(
            f"max_range is a length above 0 of at most {MAX_REACH} cells, got {reach:g} cells"
        )
    if not 0.0 <= clear <= reach:
        raise ConfigError(f"clear_range is a length up to max_range, got {clear:g} cells")
    if not 0.0 < p_miss < 0.5 < p_hit < 1.0:
        raise ConfigError(
            "a hit must speak for and a pass against a cell: 0 < p_miss < 0.5 < p_hit < 1, got "
            f"p_miss {p_miss} and p_hit {p_hit}"
        )
    if not 0.0 < unknown < 1.0:
        raise ConfigError(f"unknown is a probability between 0 and 1, got {unknown}")


def _check_words(votes: str, measure: str, threads: int) -> None:
    if votes not in get_args(Votes):
        raise ConfigError(f'votes is "scan" or "beam", got {votes!r}')
    if measure not in get_args(Measure):
        raise ConfigError(f'measure is "information" or "entropy", got {measure!r}')
    check_threads(threads)
