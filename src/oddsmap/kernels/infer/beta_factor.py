# SPDX-License-Identifier: Apache-2.0
"""Reflection maps from beams of any width: how often does each cell return a beam that reaches it?

In place of an occupancy each cell has a reflectivity rho, drawn anew for each beam: glass, leaves.
A beam's likelihood is linear in the rho of each of its cells, all others averaged over,

    f(rho) = mu0 (1 - rho) + mu1 rho,

with the mu of `beam_factor.py` and q_i the mean reflectivity. Three ways to use it:

- Assumed density: with rho ~ Beta(a, b) the posterior after one beam is the mixture
  w Beta(a + 1, b) + (1 - w) Beta(a, b + 1), w = mu1 a / (mu1 a + mu0 b), put back to the Beta of
  the same mean and variance. So an arc's hit is shared among its cells by how likely each is to
  have caused it. With n = a + b and

      v = (1 - w) a (b + 1) + w b (a + 1),  r = v / (v + (n + 2) w (1 - w))

  it is Beta(r (a + w), r (b + 1 - w)): sums of positive terms, so no digits are lost. Where the
  beam says nothing w = a / n and the Beta stays as it is.
- Expectation propagation: the same again and again, each time with what the beam said before taken
  out of its cells' Betas first. It rests where no beam has more to say, whatever their order.
- Expected counts (the E step of EM): of each beam the probabilities that a cell was reached and
  returned it, or was reached and let it pass.

docs/method/full-map.md derives both.
Source: Minka, Expectation propagation for approximate Bayesian inference (2001), sections 3.1
(assumed density) and 3.2; Luft, Schaefer,
Schubert, Burgard, Closed-form full map posteriors (2018), for Beta maps.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.infer.beam_factor import BeamRows, beam_room, chances, factor
from oddsmap.kernels.infer.first_echo import Noise
from oddsmap.kernels.jit import inlined, kernel

__all__ = ["VOTE", "beta_update", "expected_counts", "filter_beams", "revisit_beams"]

VOTE = 1 << 32
"""Units of an expected count in one: counts add up exactly, in any order of the beams."""

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Added = npt.NDArray[np.float32]

# Likelihoods are compared as ratios: below this both are nothing.
_NOTHING = 1e-300
# Weights that a Beta distribution keeps without one of its beams; otherwise that beam has to wait.
_LEAST = 1e-3


@inlined
def _moment_matched(a: float, b: float, mu0: float, mu1: float) -> tuple[float, float]:
    hit, miss = mu1 * a, mu0 * b
    if not hit + miss > _NOTHING:
        return a, b
    w, other = hit / (hit + miss), miss / (hit + miss)
    spread = other * a * (b + 1.0) + w * b * (a + 1.0)
    kept = spread / (spread + (a + b + 2.0) * w * other)
    return kept * (a + w), kept * (b + other)


@kernel
def beta_update(a: float, b: float, mu0: float, mu1: float) -> tuple[float, float]:
    """Beta(a, b) after a reading of likelihood mu0 (1 - rho) + mu1 rho, moment-matched.

    Args:
        a: above 0.
        b: above 0.
        mu0: likelihood where rho = 0, 0 or more.
        mu1: likelihood where rho = 1.
    """
    return _moment_matched(a, b, mu0, mu1)


@kernel
def filter_beams(
    rows: BeamRows,
    order: IntArray,
    noise: Noise,
    detection: FloatArray,
    a: FloatArray,
    b: FloatArray,
) -> None:
    """Go through beams once, in turn; the cells of one beam are updated together.

    Args:
        rows: the beams.
        order: which of them, in turn (that of the log); each once, or it counts twice.
        noise: what the sensor adds.
        detection: chance that a cell of reflectivity 1 wholly in the cone returns the beam, for
            each cell or one for all, shape (1,).
        a: first parameter of each cell's Beta distribution, changed in place, shape (cells,).
        b: second parameter, likewise.
    """
    u, d, groups, starts = beam_room(rows)
    for n in range(order.shape[0]):
        beam = order[n]
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            cell = rows.cells[i]
            u[i - begin] = a[cell] / (a[cell] + b[cell])
        chances(rows, begin, end, detection, u, d)
        count = factor(rows, beam, noise, u, groups, starts)
        for g in range(count):
            silent, here = groups[0, g], groups[1, g]
            through, before, behind = groups[2, g], groups[3, g], groups[4, g]
            base = before + through * here
            gain = through * (behind - here)
            for j in range(starts[g], starts[g + 1]):
                part = gain * (silent / u[j])
                cell = rows.cells[begin + j]
                # Rounding may leave a likelihood of nothing just below 0.
                mu0 = max(base + part, 0.0)
                mu1 = max(base + part * (1.0 - d[j]), 0.0)
                a[cell], b[cell] = _moment_matched(a[cell], b[cell], mu0, mu1)


@kernel
def revisit_beams(
    rows: BeamRows,
    order: IntArray,
    noise: Noise,
    detection: FloatArray,
    a: FloatArray,
    b: FloatArray,
    added: Added,
    keep: float,
) -> int:
    """Go through beams once more: one sweep of expectation propagation.

    The first sweep, with nothing added yet, is that of `filter_beams`.

    Args:
        rows: and the next five as in `filter_beams`.
        order: see there.
        noise: see there.
        detection: see there.
        a: see there.
        b: see there.
        added: what each row has added to a and to b of its cell, changed in place, shape (rows, 2).
        keep: share of its old message that a row keeps: 0 the first time, about 1/2 later on,
            or sweeps may go round in circles.

    Returns:
        How many rows had to be left as they were, since without them, or with their new message, a
        cell's distribution would be none.
    """
    u, d, groups, starts = beam_room(rows)
    left_out = 0
    for n in range(order.shape[0]):
        beam = order[n]
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        for i in range(begin, end):
            cell = rows.cells[i]
            remainder_a, remainder_b = a[cell] - added[i, 0], b[cell] - added[i, 1]
            if min(remainder_a, remainder_b) < _LEAST:
                remainder_a, remainder_b = a[cell], b[cell]
            u[i - begin] = remainder_a / (remainder_a + remainder_b)
        chances(rows, begin, end, detection, u, d)
        count = factor(rows, beam, noise, u, groups, starts)
        for g in range(count):
            silent, here = groups[0, g], groups[1, g]
            through, before, behind = groups[2, g], groups[3, g], groups[4, g]
            base = before + through * here
            gain = through * (behind - here)
            for j in range(starts[g], starts[g + 1]):
                i = begin + j
                cell = rows.cells[i]
                remainder_a, remainder_b = a[cell] - added[i, 0], b[cell] - added[i, 1]
                if min(remainder_a, remainder_b) < _LEAST:
                    left_out += 1
                    continue
                part = gain * (silent / u[j])
                mu0 = max(base + part, 0.0)
                mu1 = max(base + part * (1.0 - d[j]), 0.0)
                new_a, new_b = _moment_matched(remainder_a, remainder_b, mu0, mu1)
                # As it is stored, so that the same is taken out again.
                say_a = np.float32(keep * added[i, 0] + (1.0 - keep) * (new_a - remainder_a))
                say_b = np.float32(keep * added[i, 1] + (1.0 - keep) * (new_b - remainder_b))
                if min(remainder_a + say_a, remainder_b + say_b) < _LEAST:
                    left_out += 1
                    continue
                a[cell], b[cell] = remainder_a + say_a, remainder_b + say_b
                added[i, 0], added[i, 1] = say_a, say_b
    return left_out


@kernel
def expected_counts(
    rows: BeamRows,
    noise: Noise,
    detection: FloatArray,
    reflectivity: FloatArray,
    informative: bool,
    hits: IntArray,
    passes: IntArray,
) -> float:
    """Add to each cell how many beams it is expected to have returned and to have let pass.

    With R the chance that no other cell of the bin returns the beam and remainder = (1 - R) L_k + R
    B_k, of a cell with reflectivity o

        hit = T_k o [d L_k + (1 - d) remainder] / Z,  miss = T_k (1 - o) remainder / Z

    or, of trials that tell something about o alone, hit = T_k d o L_k / Z and
    miss = T_k d (1 - o) remainder / Z. Both have the same fixed points o = hit / (hit + miss); kept
    as counts of a Beta distribution only the second are not over-confident where d < 1.

    Args:
        rows: the beams.
        noise: what the sensor adds.
        detection: see `filter_beams`.
        reflectivity: of each cell, shape (cells,).
        informative: True: only trials that tell something.
        hits: added to [1 / VOTE], shape (cells,).
        passes: likewise.

    Returns:
        log p(z | reflectivity) of all beams together.
    """
    u, d, groups, starts = beam_room(rows)
    total = 0.0
    for beam in range(rows.readings.shape[0]):
        begin, end = rows.offsets[beam], rows.offsets[beam + 1]
        if begin == end:
            continue
        for i in range(begin, end):
            u[i - begin] = reflectivity[rows.cells[i]]
        chances(rows, begin, end, detection, u, d)
        count = factor(rows, beam, noise, u, groups, starts)
        # A, T, Q, L and B of the nearest bin make up the whole: A_0 = 0, T_0 = 1.
        z = max((1.0 - groups[0, 0]) * groups[1, 0] + groups[0, 0] * groups[4, 0], _NOTHING)
        total += np.log(z)
        for g in range(count):
            silent, here = groups[0, g], groups[1, g]
            through, behind = groups[2, g] / z, groups[4, g]
            for j in range(starts[g], starts[g + 1]):
                cell = rows.cells[begin + j]
                o = reflectivity[cell]
                alone = silent / u[j]
                remainder = (1.0 - alone) * here + alone * behind
                if informative:
                    hit = through * d[j] * o * here
                    miss = through * d[j] * (1.0 - o) * remainder
                else:
                    hit = through * o * (d[j] * here + (1.0 - d[j]) * remainder)
                    miss = through * (1.0 - o) * remainder
                hits[cell] += np.int64(np.rint(hit * VOTE))
                passes[cell] += np.int64(np.rint(miss * VOTE))
    return total
