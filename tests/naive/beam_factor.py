# SPDX-License-Identifier: Apache-2.0
"""Beam factors by writing out every map of a few cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import BeamRows
from tests.naive.forward import likelihood

RESOLUTION = 0.1

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Beam:
    """A reading and the cells of its cone: number, bin, fraction of each, from near to far."""

    reading: float
    cells: tuple[tuple[int, int, float], ...]


def rows_of(beams: list[Beam]) -> BeamRows:
    flat = [cell for beam in beams for cell in beam.cells]
    return BeamRows(
        np.array([beam.reading for beam in beams], np.float64),
        np.cumsum([0] + [len(beam.cells) for beam in beams]).astype(np.int64),
        np.array([cell for cell, _, _ in flat], np.int32),
        np.array([k for _, k, _ in flat], np.uint16),
        np.array([fraction for _, _, fraction in flat], np.float32),
    )


def given_map(
    model: ForwardModel, beam: Beam, occupied: tuple[float, ...], detection: FloatArray
) -> float:
    """f(m): p(z | map) where occupied says of each cell of the beam, in its order, what m is."""
    chances = [
        (k, float(detection[cell]) * float(np.float32(fraction)) * m)
        for (cell, k, fraction), m in zip(beam.cells, occupied, strict=True)
    ]
    return likelihood(model, beam.reading, chances, model.bin_width_at(RESOLUTION))


def mu(
    model: ForwardModel, beam: Beam, q: tuple[float, ...], i: int, m_i: int, detection: FloatArray
) -> float:
    """Mean of f over all maps of the other cells, cell i (its place in the beam) being m_i."""
    total = 0.0
    for m in product((0, 1), repeat=len(q)):
        if m[i] == m_i:
            weight = math.prod(q[j] if m[j] else 1.0 - q[j] for j in range(len(q)) if j != i)
            total += weight * given_map(model, beam, m, detection)
    return total


@st.composite
def beams(draw: st.DrawFn, cells: int, most: int = 7) -> Beam:
    """Several cells a bin or one; cells wholly in the cone, or hardly."""
    numbers = draw(st.lists(st.integers(0, cells - 1), min_size=1, max_size=most, unique=True))
    bins = sorted(draw(st.lists(st.integers(0, 30), min_size=len(numbers), max_size=len(numbers))))
    share = st.one_of(st.just(1.0), st.floats(2.0**-10, 1.0, width=32))
    fractions = draw(st.lists(share, min_size=len(numbers), max_size=len(numbers)))
    reading = draw(st.one_of(st.just(math.inf), st.floats(0.05, 1.4)))
    return Beam(reading, tuple(zip(numbers, bins, fractions, strict=True)))


models = st.builds(
    ForwardModel,
    cone_deg=st.just(20.0),
    range_max=st.just(1.5),
    p_random=st.sampled_from([0.001, 0.02, 0.15]),
    p_dropout=st.sampled_from([0.001, 0.02, 0.3]),
    sigma=st.sampled_from([0.01, 0.035, 0.2]),
    bin_width=st.sampled_from([0.05, 0.02]),
)


def detections(cells: int) -> st.SearchStrategy[FloatArray]:
    """Of each cell; 1 now and then."""
    chance = st.one_of(st.just(1.0), st.floats(0.05, 1.0))
    return st.lists(chance, min_size=cells, max_size=cells).map(np.array)
