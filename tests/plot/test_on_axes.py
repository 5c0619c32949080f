# SPDX-License-Identifier: Apache-2.0
"""Maps in axes of Matplotlib: what is drawn where, beside what else a figure shows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import oddsmap
from oddsmap.errors import InputError
from oddsmap.plot.comparison import COLOURS
from oddsmap.plot.on_axes import plot_quantity


@pytest.fixture(scope="module")
def grid() -> oddsmap.EvidenceMap:
    angles = np.linspace(-2.0, 2.0, 90)
    scans = [oddsmap.Scan.from_angles((0.1 * i, 0, 0), angles, np.full(90, 2.0)) for i in range(4)]
    return oddsmap.build_map(scans, 0.1, votes="beam", path_lengths=True)


@pytest.fixture
def ax() -> Iterator[Any]:
    figure = Figure()
    FigureCanvasAgg(figure)
    yield figure.add_subplot()
    figure.canvas.draw()  # whatever was added can be drawn


def plots(grid: oddsmap.EvidenceMap) -> dict[str, Any]:
    view = grid.log_odds()
    return {
        "map": grid,
        "log odds": view,
        "calibrated": grid.calibrated(),
        "probability": view.to_probability_map(),
        "reflection": grid.reflection(),
        "decay": grid.decay_rate(),
        "distance": view.distance_field(0.5),
        "costs": view.costmap(0.2),
        "changes": oddsmap.changed(view, view),
    }


def test_everything_of_the_plane_plots(grid: oddsmap.EvidenceMap) -> None:
    for name, thing in plots(grid).items():
        figure = Figure()
        FigureCanvasAgg(figure)
        ax = figure.add_subplot()
        assert thing.plot(ax, title=name, trajectory=[[0, 0], [1, 0]]) is ax
        figure.canvas.draw()
        assert ax.get_title(loc="left") == name
        assert len(figure.axes) == 2, f"{name} has no colour bar"
        assert figure.axes[1].get_ylabel(), f"{name} does not say what its colours are"
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")


def test_cells_are_where_they_belong(grid: oddsmap.EvidenceMap, ax: Any) -> None:
    view = grid.log_odds()
    view.plot(ax, whole=True)
    image, (lo, hi) = ax.images[0], view.bounds() or ((0, 0), (0, 0))
    assert image.get_extent() == pytest.approx(
        [0.0, (hi[0] - lo[0]) * 0.1, 0.0, (hi[1] - lo[1]) * 0.1]
    )
    origin = image.get_transform().transform([0.0, 0.0])
    assert ax.transData.inverted().transform(origin) == pytest.approx(np.array(lo) * 0.1)
    shown, known = image.get_array(), view.observed()
    assert np.array_equal(~shown.mask, known)
    np.testing.assert_allclose(shown[known].data, view.probability()[known], atol=1e-6)


def test_a_legend_of_ones_own_stays_the_only_one(grid: oddsmap.EvidenceMap, ax: Any) -> None:
    grid.plot(ax)
    ax.plot([0, 1], [0, 1], label="mine")
    assert [text.get_text() for text in ax.legend().get_texts()] == ["mine"]


def test_without_colour_bar_and_in_other_colours(grid: oddsmap.EvidenceMap, ax: Any) -> None:
    grid.reflection().plot(ax, show="std", colour_bar=False, cmap="cividis", crop=(0, 0, 1, 1))
    assert len(ax.figure.axes) == 1
    assert ax.images[0].get_cmap().name == "cividis"
    assert ax.get_xlim() == pytest.approx((0.0, 1.0))


def test_the_current_axes_are_the_default(grid: oddsmap.EvidenceMap) -> None:
    import matplotlib as mpl

    before = mpl.get_backend()
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    try:
        mine = plt.figure().add_subplot()
        assert grid.plot() is mine
    finally:
        plt.close("all")
        mpl.use(before)


def test_what_has_no_plane(ax: Any) -> None:
    space = oddsmap.build_map([oddsmap.Scan.from_points(np.eye(4), [[1.0, 0.5, 0.2]])], 0.2)
    for thing in (space, space.log_odds(), space.reflection(), space.log_odds().distance_field(1)):
        with pytest.raises(InputError, match="3D"):
            thing.plot(ax)
    with pytest.raises(InputError, match="nothing to draw"):
        oddsmap.EvidenceMap(0.1).plot(ax)


def test_values_below_zero_are_within_the_colour_bar(ax: Any) -> None:
    value = np.array([[-2.0, 0.0], [1.0, np.nan]])
    cells = oddsmap.ProbabilityMap(value, np.ones((2, 2), np.bool_), 1.0)
    plot_quantity(cells, ax, label="difference")
    assert ax.images[0].get_clim() == (-2.0, 1.0)


# Machado, Oliveira, Fernandes: A physiologically-based model for simulation of color vision
# deficiency (2009), at full severity, on linear light.
VISION = {
    "usual": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
         [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
         [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
         [0.004733, 0.691367, 0.303900]]
    ),
}  # fmt: skip


def lab(colour: str, vision: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """CIE L*a*b* of a colour as somebody sees it."""
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(vision @ linear, 0.0, 1.0)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    t = xyz @ seen / np.array([0.9505, 1.0, 1.089])
    f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", VISION)
def test_colours_of_a_comparison_are_told_apart(vision: str) -> None:
    seen = [lab(colour, VISION[vision]) for colour in COLOURS]
    for i, one in enumerate(seen):
        for j, other in enumerate(seen[:i]):
            distance = float(np.linalg.norm(one - other))
            assert distance > 15.0, f"{COLOURS[i]} and {COLOURS[j]}: {distance:.1f}"
