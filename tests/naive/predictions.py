# SPDX-License-Identifier: Apache-2.0
"""Causes of readings and hazards along beams in plain Python, from every outcome of the cells."""

from __future__ import annotations

import math
from collections.abc import Sequence

from oddsmap.forward.model import ForwardModel
from tests.naive.forward import first_echo


def normal_cdf(x: float) -> float:
    return 0.5 * (1 + math.erf(x / math.sqrt(2)))


def causes(
    model: ForwardModel, z: float, cells: Sequence[tuple[int, float]], width: float
) -> tuple[float, float, float, float]:
    """Likelihood, P(random | z), P(dropout | z), sum of P(true echo of k | z) (z - r_k)^2.

    Args:
        model: the sensor.
        z: the reading.
        cells: bin and chance of an echo of each.
        width: of a bin [m].
    """
    true = 1 - model.p_random - model.p_dropout
    random = dropout = heard = squares = 0.0
    for k, p in first_echo(cells).items():
        r = math.inf if k is None else (k + 0.5) * width
        if z >= model.range_max:
            dropout += p * model.p_dropout
            heard += p * true * (1 - normal_cdf((model.range_max - r) / model.sigma))
            continue
        random += p * model.p_random * width / (model.range_max - model.range_min)
        if k is not None:
            density = math.exp(-(((z - r) / model.sigma) ** 2) / 2)
            share = p * true * density * width / (model.sigma * math.sqrt(2 * math.pi))
            heard += share
            squares += share * (z - r) ** 2
    total = random + dropout + heard
    return total, random / total, dropout / total, squares / total


def chance_between(
    model: ForwardModel, echo: Sequence[float], width: float, low: float, high: float
) -> float:
    """P(low <= z < high), below range_min included; echo: P(first echo from bin k)."""
    true = 1 - model.p_random - model.p_dropout
    total = sum(
        true * p * (normal_cdf((high - r) / model.sigma) - normal_cdf((low - r) / model.sigma))
        for p, r in ((p, (k + 0.5) * width) for k, p in enumerate(echo))
    )
    inside = max(0.0, min(high, model.range_max) - max(low, model.range_min))
    return total + model.p_random * inside / (model.range_max - model.range_min)


def hazards(
    model: ForwardModel, z: float, echo: Sequence[float], width: float, step: float
) -> list[tuple[float, bool]]:
    """Of each step up to the reading: the chance that it ends there, and whether it does."""
    found = []
    low = model.range_min
    number = 0
    while low < model.range_max - 1e-9:
        number += 1
        high = min(model.range_min + number * step, model.range_max)
        left = 1 - chance_between(model, echo, width, -math.inf, low)
        ends = low <= z < high
        found.append((chance_between(model, echo, width, low, high) / left, ends))
        if ends:
            break
        low = high
    return found
