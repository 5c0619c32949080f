# SPDX-License-Identifier: Apache-2.0
"""The scripts behind the pictures of the documents still run, and the pictures stay small."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
IMAGES = sorted((DOCS / "images").glob("*.png"))


def script(name: str) -> Any:
    spec = importlib.util.spec_from_file_location(
        f"figures_{name}", DOCS / "figures" / f"{name}.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "name", ["sensor_beam", "sensor_cone", "sensor_overhead", "sensor_forward"]
)
def test_pictures_of_sensor_models(name: str) -> None:
    figure = script("sensor_models").FIGURES[name]()
    drawn = [panel for panel in figure.axes if panel.has_data()]
    assert len(drawn) == len(figure.axes) >= 2
    assert (DOCS / "images" / f"{name}.png").exists()


def test_a_picture_shows_what_a_reading_says() -> None:
    """The first panel is the model's own p(x | z), cell by cell."""
    module = script("sensor_models")
    from oddsmap import BeamSensor

    p = module.one_reading(module.beam_of(3.0), BeamSensor(), [0, 0], [42, 1], 0.2)[0]
    want = BeamSensor().inverse_model(0.1 * np.arange(42), 3.0, 0.2, cell=0.1)
    np.testing.assert_allclose(p[:31], want[:31])
    assert np.isnan(p[31:]).all()


def test_the_picture_of_localising() -> None:
    figure = script("localising").draw()
    assert len([panel for panel in figure.axes if panel.has_data()]) >= 3


@pytest.mark.parametrize("image", IMAGES, ids=lambda image: image.name)
def test_pictures_are_small_and_shown(image: Path) -> None:
    assert image.stat().st_size <= 200_000
    pages = [DOCS.parent / "README.md", *DOCS.glob("**/*.md")]
    assert any(f"images/{image.name}" in page.read_text(encoding="utf-8") for page in pages)
