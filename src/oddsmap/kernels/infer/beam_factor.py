# SPDX-License-Identifier: Apache-2.0
"""Exact messages from a beam to the cells of its cone, in O(cells).

A beam's likelihood f(m) (see `first_echo.py`) is linear in each cell's occupancy, so its message to
cell i of bin k, all other cells averaged over with their cavity probabilities q, needs only sums
over the bins before and behind. With u_i = 1 - d_i q_i, Q_k the product of bin k's u_i, and
R = Q_k / u_i:

    forward   T_0 = 1, A_0 = 0;  A_{k+1} = A_k + T_k (1 - Q_k) L_k,  T_{k+1} = T_k Q_k
    backward  B_{K-1} = L_inf;   B_{k-1} = (1 - Q_k) L_k + Q_k B_k
    message   mu_i(m) = A_k + T_k [L_k + R (1 - d_i m) (B_k - L_k)],
              lambda_i = log mu_i(1) - log mu_i(0).

docs/method/full-map.md derives this. Messages are integers, in units of 2^-24 of a nat: a belief is
the sum of its messages, exactly, in whatever order they were added and taken back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.cell_status import LISTED, REACHED
from oddsmap.kernels.infer.first_echo import Noise, echo_likelihood
from oddsmap.kernels.jit import inlined, kernel

__all__ = [
    "NAT",
    "BeamRows",
    "apply_messages",
    "beam_room",
    "chances",
    "factor",
    "mark_reached",
    "new_messages",
    "passing_messages",
    "sweep_in_turn",
]

NAT = 1 << 24
"""Units of a message in one nat (log odds 1)."""
_MOST = 64.0
# A cell that surely returns the beam and is surely occupied would leave nothing to divide by.
_LEAST_SILENT = 1e-12
# Likelihoods are compared as ratios: below this both are nothing.
_NOTHING = 1e-300

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Messages = npt.NDArray[np.int32]


class BeamRows(NamedTuple):
    """Beams and their cells: beam b has rows offsets[b] to offsets[b + 1], from near to far."""

    readings: FloatArray
    """Ranges [m], shape (beams,); at or above range_max: no return."""
    offsets: IntArray
    """Shape (beams + 1,)."""
    cells: npt.NDArray[np.int32]
    """Number of each row's cell, shape (rows,)."""
    bins: npt.NDArray[np.uint16]
    """Range bin of each row, never falling along a beam."""
    fractions: npt.NDArray[np.float32]
    """Share of the cell in the cone, or of the cone in the cell."""


@inlined
def chances(
    rows: BeamRows, begin: int, end: int, detection: FloatArray, q: FloatArray, d: FloatArray
) -> None:
    """Fill d with d_i of one beam's rows, and put u_i = 1 - d_i q_i in place of q_i."""
    step = 0 if detection.shape[0] == 1 else 1
    for i in range(begin, end):
        chance = detection[rows.cells[i] * step] * rows.fractions[i]
        d[i - begin] = chance
        q[i - begin] = max(1.0 - chance * q[i - begin], _LEAST_SILENT)


@inlined
def factor(
    rows: BeamRows,
    beam: int,
    noise: Noise,
    u: FloatArray,
    groups: FloatArray,
    starts: IntArray,
) -> int:
    """Forward and backward over one beam's bins.

    Args:
        rows: the beams.
        beam: which one.
        noise: what the sensor adds.
        u: 1 - d q of the beam's rows.
        groups: takes Q, L, T, A and B of each bin that has cells, shape (5, bins).
        starts: takes the first row of each of them, counted from the beam's, and the end.

    Returns:
        How many bins have cells.
    """
    begin, end = rows.offsets[beam], rows.offsets[beam + 1]
    reading = rows.readings[beam]
    none = echo_likelihood(-1, reading, noise)
    count = 0
    through, before = 1.0, 0.0
    i = begin
    while i < end:
        k = rows.bins[i]
        starts[count] = i - begin
        silent = 1.0
        while i < end and rows.bins[i] == k:
            silent *= u[i - begin]
            i += 1
        here = echo_likelihood(np.int64(k), reading, noise)
        groups[0, count], groups[1, count] = silent, here
        groups[2, count], groups[3, count] = through, before
        before += through * (1.0 - silent) * here
        through *= silent
        count += 1
    starts[count] = end - begin
    behind = none
    for g in range(count - 1, -1, -1):
        groups[4, g] = behind
        behind = (1.0 - groups[0, g]) * groups[1, g] + groups[0, g] * behind
    return count


@inlined
def _odds(
    begin: int,
    count: int,
    u: FloatArray,
    d: FloatArray,
    groups: FloatArray,
    starts: IntArray,
    out: Messages,
    at: int,
) -> None:
    # lambda of each row of a beam, from out[at] on.
    for g in range(count):
        silent, here = groups[0, g], groups[1, g]
        through, before, behind = groups[2, g], groups[3, g], groups[4, g]
        base = before + through * here
        gain = through * (behind - here)
        for j in range(starts[g], starts[g + 1]):
            part = gain * (silent / u[j])
            # A reading that neither state explains says nothing about the cell.
            ratio = max(base + part * (1.0 - d[j]), _NOTHING) / max(base + part, _NOTHING)
            out[at + j] = _units(math.log(ratio))


@inlined
def _replace(
    belief: IntArray, cell: int, messages: Messages, i: int, message: int, keep: float
) -> int:
    # Take the old message out of the belief before the new one goes in; returns the change.
    old, new = np.int64(messages[i]), np.int64(message)
    if keep > 0.0:
        new = np.int64(np.rint(keep * old + (1.0 - keep) * new))
    belief[cell] += new - old
    messages[i] = np.int32(new)
    return abs(new - old)


@inlined
def _units(nats: float) -> int:
    return np.int32(np.rint(min(max(nats, -_MOST), _MOST) * NAT))


@kernel
def sweep_in_turn(
    rows: BeamRows,
    order: IntArray,
    noise: Noise,
    detection: FloatArray,
    belief: IntArray,
    messages: Messages,
    keep: float,
) -> int:
    """Renew the messages of some beams one after the other, each from what the last one left.

    Args:
        rows: the beams.
        order: which beams, in turn.
        noise: what the sensor adds.
        detection: chance that an occupied cell wholly in the cone returns the beam, for each cell
            or one for all, shape (1,).
        belief: log odds of each cell [1 / NAT], changed in place.
        messages: of each row [1 / NAT], changed in place.
        keep: share of the old message in what takes its place.

    Returns:
        The sum of the messages' changes, in size [1 / NAT].
    """
    q, d, groups, starts = _room_for(rows, order)
    new = np.empty(q.shape[0], np.int32)
    moved = np.int64(0)
    for n in range(order.shape[0]):
        beam = order[n]
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            q[i - begin] = _occupied(belief[rows.cells[i]] - messages[i])
        chances(rows, begin, end, detection, q, d)
        count = factor(rows, beam, noise, q, groups, starts)
        _odds(begin, count, q, d, groups, starts, new, 0)
        for i in range(begin, end):
            moved += _replace(belief, rows.cells[i], messages, i, new[i - begin], keep)
    return moved


@kernel
def new_messages(
    rows: BeamRows,
    order: IntArray,
    noise: Noise,
    detection: FloatArray,
    belief: IntArray,
    messages: Messages,
    new: Messages,
) -> None:
    """The messages of some beams, all from the same beliefs; nothing shared is written.

    Arguments as in `sweep_in_turn`; `new` takes the messages, beam after beam.
    """
    q, d, groups, starts = _room_for(rows, order)
    at = 0
    for n in range(order.shape[0]):
        beam = order[n]
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            q[i - begin] = _occupied(belief[rows.cells[i]] - messages[i])
        chances(rows, begin, end, detection, q, d)
        count = factor(rows, beam, noise, q, groups, starts)
        _odds(begin, count, q, d, groups, starts, new, at)
        at += end - begin


@kernel
def apply_messages(
    rows: BeamRows,
    order: IntArray,
    belief: IntArray,
    messages: Messages,
    new: Messages,
    keep: float,
) -> int:
    """Put the messages of `new_messages` in place: message = keep * old + (1 - keep) * new.

    Returns:
        The sum of the messages' changes, in size [1 / NAT].
    """
    moved = np.int64(0)
    at = 0
    for n in range(order.shape[0]):
        beam = order[n]
        for i in range(rows.offsets[beam], rows.offsets[beam + 1]):
            moved += _replace(belief, rows.cells[i], messages, i, new[at], keep)
            at += 1
    return moved


@kernel
def passing_messages(
    rows: BeamRows, occupied: FloatArray, noise: Noise, detection: FloatArray, out: Messages
) -> None:
    """The messages of all beams, given for each row the cavity probability of its cell.

    Args:
        rows: the beams.
        occupied: q of each row, shape (rows,).
        noise: what the sensor adds.
        detection: see `sweep_in_turn`.
        out: takes the messages [1 / NAT], shape (rows,).
    """
    q, d, groups, starts = beam_room(rows)
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            q[i - begin] = occupied[i]
        chances(rows, begin, end, detection, q, d)
        count = factor(rows, beam, noise, q, groups, starts)
        _odds(begin, count, q, d, groups, starts, out, begin)


@kernel
def mark_reached(
    rows: BeamRows,
    last_bins: IntArray,
    least_fraction: float,
    least_chance: float,
    detection: FloatArray,
    belief: IntArray,
    reached: npt.NDArray[np.uint8],
) -> None:
    """Mark the cells inside cones (LISTED), and those of them that a beam has reached (REACHED).

    Args:
        rows: the beams.
        last_bins: the farthest bin that each beam says something about, shape (beams,).
        least_fraction: a cell with a smaller share in the cone is not marked.
        least_chance: a cell that no beam came to with this probability is not reached.
        detection: see `sweep_in_turn`.
        belief: log odds of each cell [1 / NAT].
        reached: of each cell, raised to LISTED or REACHED.
    """
    q, d, _, _ = beam_room(rows)
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            q[i - begin] = _occupied(belief[rows.cells[i]])
        chances(rows, begin, end, detection, q, d)
        through = 1.0
        i = begin
        while i < end and rows.bins[i] <= last_bins[beam]:
            k = rows.bins[i]
            silent = 1.0
            mark = np.uint8(REACHED if through >= least_chance else LISTED)
            while i < end and rows.bins[i] == k:
                silent *= q[i - begin]
                if rows.fractions[i] >= least_fraction:
                    reached[rows.cells[i]] = max(reached[rows.cells[i]], mark)
                i += 1
            through *= silent


@kernel
def beam_room(rows: BeamRows) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Room for any beam: u and d of its rows, `factor`'s sums and the first rows of its bins."""
    max_rows = 0
    for beam in range(rows.readings.shape[0]):
        max_rows = max(max_rows, rows.offsets[beam + 1] - rows.offsets[beam])
    return _room(max_rows)


@kernel
def _room_for(
    rows: BeamRows, order: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    # Only some beams: looking at all of them for each chunk would be quadratic in the log.
    max_rows = 0
    for n in range(order.shape[0]):
        max_rows = max(max_rows, rows.offsets[order[n] + 1] - rows.offsets[order[n]])
    return _room(max_rows)


@kernel
def _room(max_rows: int) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    return (
        np.empty(max_rows),
        np.empty(max_rows),
        np.empty((5, max_rows + 1)),
        np.empty(max_rows + 2, np.int64),
    )


@inlined
def _occupied(units: int) -> float:
    return 1.0 / (1.0 + math.exp(-units / NAT))
