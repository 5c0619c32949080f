# SPDX-License-Identifier: Apache-2.0
"""The maps that the calibrated view is compared with, against values worked out by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from benchmarks.kernel_maps import Box, hilbert, kernel, kernel_sums, points
from benchmarks.neighbours import log_loss, scored
from oddsmap import Pose2, Scan


def test_the_kernel_falls_from_one_to_nothing() -> None:
    assert kernel(0.0) == 1.0
    # (2 + cos(pi / 2)) / 3 * 3 / 4 + sin(pi / 2) / (2 pi), and (2 - 1) / 3 / 2
    assert kernel(0.25) == pytest.approx(0.5 + 1.0 / (2.0 * math.pi))
    assert kernel(0.5) == pytest.approx(1.0 / 6.0)
    assert kernel(1.0) == kernel(1.5) == 0.0


def test_points_of_a_beam_are_its_end_and_places_along_it() -> None:
    directions = np.array([[1.0, 0.0], [0.0, 1.0]])
    scan = Scan(Pose2(1.0, 2.0, math.pi / 2), directions, np.array([1.25, 60.0]))
    x, y = points([scan], 0.5, 1e-6, 50.0)
    # The first beam goes along y, from 2 to 3.25: free at each .5 m, and .5 m before its end.
    want = {(1.0, 3.25): 1.0, (1.0, 2.0): 0.0, (1.0, 2.5): 0.0, (1.0, 3.0): 0.0, (1.0, 2.75): 0.0}
    assert {(a, b): c for (a, b), c in zip(x.round(9).tolist(), y, strict=True)} == want
    # Of the points in one voxel the mean is taken: 2.5, 2.75 and 3.0 lie between 2.2 and 3.3.
    x, y = points([scan], 0.5, 1.1, 50.0)
    assert np.allclose(x, [[1.0, 3.25], [1.0, 2.0], [1.0, 2.75]])
    assert y.tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("ndim", [2, 3])
def test_kernel_sums_are_those_over_all_points(ndim: int) -> None:
    rng = np.random.default_rng(ndim)
    x, y = rng.uniform(-0.2, 0.7, (30, ndim)), rng.integers(0, 2, 30).astype(float)
    box = Box(np.full(ndim, -1), np.array([5, 6, 4][:ndim]), 0.1)
    ones, zeros = kernel_sums(x, y, 0.25, box)
    for cell in itertools.product(*(range(-1, n - 1) for n in box.shape)):
        want = [0.0, 0.0]
        for point, what in zip(x, y, strict=True):
            off = math.dist(point, [(c + 0.5) * 0.1 for c in cell]) / 0.25
            want[int(what)] += kernel(off)
        at = box.flat(np.array([cell]))[0]
        assert [zeros[at], ones[at]] == pytest.approx(want)


def test_a_hilbert_map_takes_steps_down_the_gradient() -> None:
    """A point on a lattice point, half a length from four others, p one half: w = rate / 2 * k."""
    x, y = np.array([[0.0, 0.0]]), np.array([1.0])
    cells = np.array([[0.0, 0.0], [9.0, 0.0]])
    found = hilbert(x, y, cells, 2.0, rate=0.4, epochs=1, decay=0.0)
    # The nodes within a length: itself, four a step away, four a diagonal away.
    squares = [1.0] + 4 * [kernel(0.5) ** 2] + 4 * [kernel(math.sqrt(0.5)) ** 2]
    assert found[0] == pytest.approx(0.2 * (sum(squares) + 0.01))
    assert found[1] == pytest.approx(0.2 * 0.01)
    # The second step starts from there, at half the rate.
    p = 1.0 / (1.0 + math.exp(-found[0]))
    again = hilbert(x, y, cells, 2.0, rate=0.4, epochs=2, decay=0.0)
    assert again[0] == pytest.approx(found[0] + 0.2 * (1.0 - p) * (sum(squares) + 0.01))


def test_scores_of_votes() -> None:
    p, hits, passes = np.array([0.26, 0.76]), np.array([1.0, 3.0]), np.array([3.0, 1.0])
    loss = -(math.log(0.26) + 3 * math.log(0.74) + 3 * math.log(0.76) + math.log(0.24)) / 8
    assert log_loss(p, hits, passes) == pytest.approx(loss)
    # Of 16 pairs of a hit and a pass 9 are in order, 6 ties. Rates are .25 and .75, each .01 off.
    assert scored(p, hits, passes) == f"{loss:.4f}, 0.750, 0.0100"
