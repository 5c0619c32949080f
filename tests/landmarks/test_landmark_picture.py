# SPDX-License-Identifier: Apache-2.0
"""The picture of a landmark map: ellipses hold what they say, and nothing lies outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from oddsmap import LandmarkMap
from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.landmarks import Landmark
from oddsmap.landmarks.dots import dots_of
from oddsmap.landmarks.picture import ellipse_axes, plot_landmarks, save_landmarks_png

MARK = (45, 106, 159)
PATH = (228, 87, 46)


def mark(x: float, y: float, sigma_x: float, sigma_y: float) -> Landmark:
    return Landmark(0, np.array([x, y]), np.diag([sigma_x**2, sigma_y**2]), 3)


def coloured(path: Path, colour: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels of a colour, below the legend."""
    with Image.open(path) as image:
        picture = np.asarray(image.convert("RGB")).astype(int)
    rows, columns = np.nonzero(np.abs(picture - np.array(colour)).max(axis=2) < 12)
    return rows[rows > 65], columns[rows > 65]


def test_the_ellipse_holds_its_share() -> None:
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    longer, shorter, angle = ellipse_axes(covariance, 0.95)
    points = np.random.default_rng(0).multivariate_normal([0.0, 0.0], covariance, 100_000)
    c, s = np.cos(angle), np.sin(angle)
    along, across = points @ [c, s], points @ [-s, c]
    share = np.mean((along / longer) ** 2 + (across / shorter) ** 2 <= 1.0)
    assert share == pytest.approx(0.95, abs=0.004)
    assert longer > shorter


def test_an_ellipse_is_drawn_to_scale(tmp_path: Path) -> None:
    """Two landmarks 10 m apart in x; the first is 2.45 m x 1.22 m wide (half, at 95 %)."""
    marks = [mark(0.0, 0.0, 1.0, 0.5), mark(10.0, 0.0, 1.0, 0.5)]
    path = save_landmarks_png(marks, tmp_path / "m.png")
    rows, columns = coloured(path, MARK)
    width, height = np.ptp(columns), np.ptp(rows)
    assert width / height == pytest.approx((10.0 + 2 * 2.448) / (2 * 1.224), rel=0.02)


def test_the_path_is_drawn_within_the_picture(tmp_path: Path) -> None:
    marks = [mark(0.0, 0.0, 0.1, 0.1)]
    bare = save_landmarks_png(marks, tmp_path / "bare.png", title="Trees")
    assert len(coloured(bare, PATH)[0]) == 0
    line = [(-30.0, -5.0), (0.0, 5.0), (np.nan, np.nan), (20.0, -5.0)]
    path = save_landmarks_png(marks, tmp_path / "path.png", trajectory=line)
    rows, columns = coloured(path, PATH)
    assert len(rows) > 200
    with Image.open(path) as image:
        assert columns.max() < image.width - 45
        assert rows.max() < image.height - 105


def test_a_single_sure_landmark(tmp_path: Path) -> None:
    """Nothing but a point: no side of the picture is zero."""
    path = save_landmarks_png([mark(5e5, 5e6, 1e-12, 1e-12)], tmp_path / "one.png")
    assert path.stat().st_size > 1000


def test_refused(tmp_path: Path) -> None:
    marks = [mark(0.0, 0.0, 0.1, 0.1)]
    with pytest.raises(ConfigError, match=r"\.png"):
        save_landmarks_png(marks, tmp_path / "m.jpg")
    with pytest.raises(InputError, match="no landmark"):
        save_landmarks_png([], tmp_path / "m.png")
    with pytest.raises(InputError, match="shape"):
        save_landmarks_png(marks, tmp_path / "m.png", trajectory=[1.0, 2.0])
    save_landmarks_png(marks, tmp_path / "m.png")
    with pytest.raises(OutputError, match="exists already"):
        save_landmarks_png(marks, tmp_path / "m.png")


def test_plot_and_vector_files(tmp_path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    marks, line = [mark(0.0, 0.0, 0.1, 0.2), mark(4.0, 3.0, 0.1, 0.1)], [[0.0, 1.0], [3.0, 1.0]]
    figure = Figure()
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    assert plot_landmarks(marks, ax, trajectory=line, title="Trees") is ax
    figure.canvas.draw()
    assert len(ax.patches) == 2
    assert ax.get_title(loc="left") == "Trees"
    with pytest.raises(InputError, match="no landmark to draw"):
        LandmarkMap().plot(ax)
    svg = save_landmarks_png(marks, tmp_path / "m.svg", title="Trees").read_bytes()
    assert svg == save_landmarks_png(marks, tmp_path / "n.svg", title="Trees").read_bytes()


@given(
    places=st.lists(st.tuples(*[st.floats(-1e6, 1e6)] * 2), min_size=1, max_size=20),
)
def test_a_thumbnail_has_a_dot_for_each(places: list[tuple[float, float]]) -> None:
    thumbnail = dots_of(np.array(places))
    assert thumbnail is not None
    height, width, _ = thumbnail.image.shape
    assert max(height, width) <= 301
    rows, columns = np.nonzero((thumbnail.image == MARK).all(axis=2))
    # No dot is cut off: in each direction the outermost ends as far from the edge.
    assert 25 <= len(rows) <= 25 * len(places)
    assert abs(columns.min() - (width - 1 - columns.max())) <= 1
    assert abs(rows.min() - (height - 1 - rows.max())) <= 1


def test_north_is_up_in_a_thumbnail() -> None:
    thumbnail = dots_of(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 2.0]]))
    assert thumbnail is not None
    rows, columns = np.nonzero((thumbnail.image == MARK).all(axis=2))
    assert columns[rows < rows.mean() - 40].min() > 200
    assert "each dot a landmark; the picture is 3.21 m wide" in thumbnail.caption
    assert dots_of(np.empty((0, 2))) is None
