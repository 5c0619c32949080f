# SPDX-License-Identifier: Apache-2.0
"""Toy beams that go through the kernels of full maps: see `oddsmap.warm_up`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import CellField
from oddsmap.forward.model import ForwardModel

if TYPE_CHECKING:
    from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = ["toy_beams"]


def toy_beams() -> Iterator[tuple[CellField, BeamRows, ForwardModel]]:
    """One beam in 2D and one in 3D, with the cells that it meets."""
    from oddsmap.forward.beam_rows import list_rows
    from oddsmap.sensors.cone import ConeSensor

    model = ConeSensor(cone_deg=30.0, range_max=3.0).forward_model()
    for d in (2, 3):
        field = CellField(d, 0)
        beams = Beams(np.zeros((1, d)), np.eye(d)[:1], np.array([2.0]))
        yield field, list_rows(field, beams, model, 1.0), model
