# SPDX-License-Identifier: Apache-2.0
"""Walls of a hall, mapped by a LIDAR on a robot that turns: what docs/images/deskew.png shows."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "deskew.py"


def script() -> Any:
    spec = importlib.util.spec_from_file_location("figures_deskew", FIGURE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_deskewing_makes_walls_as_thin_as_those_of_a_robot_that_stops() -> None:
    figure = script()
    made = figure.maps(ring_count=4, column_count=120, scan_count=14)
    at_once, deskewed, standing = (figure.wall_thickness(grid) for grid in made)
    assert at_once > 2.5 * deskewed
    assert deskewed <= standing + figure.RESOLUTION + 1e-9
    assert len(figure.draw(made).axes) == 2
    assert figure.table(made).count("cm thick") == 3
