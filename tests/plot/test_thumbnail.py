# SPDX-License-Identifier: Apache-2.0
"""What notebooks show at the end of a cell."""

from __future__ import annotations

import base64
import io
import re
import subprocess
import sys
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

import oddsmap
from oddsmap.evidence.overview import overview_of
from oddsmap.plot import thumbnail
from oddsmap.plot.thumbnail import Pictured, of_quantity, png_bytes, shrunk
from oddsmap.posterior import count_view

UNKNOWN = (199, 213, 227)


def decoded(data: bytes | None) -> npt.NDArray[np.uint8]:
    assert data is not None
    with Image.open(io.BytesIO(data)) as image:
        image.load()
        return np.asarray(image)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_a_png_is_what_pillow_reads(height: int, width: int, seed: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)
    assert np.array_equal(decoded(png_bytes(image)), image)


@settings(max_examples=30)
@given(st.integers(1, 900), st.integers(1, 30), st.integers(0, 2**32 - 1))
def test_blocks_against_a_loop(nx: int, ny: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    known, p = rng.random((ny, nx)) < 0.3, rng.random((ny, nx))
    y, x = np.nonzero(known)
    parts = [(np.stack([x, y], axis=1) - 7, p[y, x])]
    found = shrunk(parts, np.array([-7, -7]), np.array([nx - 7, ny - 7]))
    block = -(-max(nx, ny) // 400)
    assert found.shape == (-(-ny // block), -(-nx // block))
    for row, column in np.ndindex(found.shape):
        part = (slice(row * block, (row + 1) * block), slice(column * block, (column + 1) * block))
        seen = p[part][known[part]]
        if not len(seen):
            assert np.isnan(found[row, column])
        else:
            expected = seen.max() if seen.max() >= 0.5 else seen.mean()
            assert found[row, column] == pytest.approx(expected)


@pytest.mark.parametrize("ndim", [2, 3])
@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), most=st.sampled_from([2, 3, 50, 400]))
def test_an_overview_is_the_sum_of_all_cells(ndim: int, seed: int, most: int) -> None:
    rng = np.random.default_rng(seed)
    grid = oddsmap.EvidenceMap(0.1, ndim=ndim)
    index = rng.integers(-90, 90, (40, ndim))
    # Few units, whole votes, and more than a byte of them.
    weights = rng.choice([0, 1, 65536, 70_000, 65536 * 300], (2, 40))
    grid.add_cells(index, *weights)
    seen = overview_of(grid.tiles, most)
    assert seen is not None
    assert max(seen.hits.shape) <= most
    sums = np.zeros((2, *seen.hits.shape))
    for cell, hits, passes in zip(*grid.cells(), strict=True):
        x, y = (cell[:2] - seen.first) // seen.block
        sums[:, y, x] += hits / 65536, passes / 65536
    np.testing.assert_array_equal(np.stack([seen.hits, seen.passes]), sums)


@pytest.fixture(scope="module")
def grid() -> oddsmap.EvidenceMap:
    angles = np.linspace(-2.0, 2.0, 90)
    scans = [oddsmap.Scan.from_angles((0.1 * i, 0, 0), angles, np.full(90, 2.0)) for i in range(4)]
    return oddsmap.build_map(scans, 0.1, votes="beam", path_lengths=True)


def things(grid: oddsmap.EvidenceMap) -> dict[str, Any]:
    view = grid.log_odds()
    space = oddsmap.build_map([oddsmap.Scan.from_points(np.eye(4), np.eye(3) + 1.0)], 0.2)
    return {
        "map": grid, "log odds": view, "calibrated": grid.calibrated(), "3D": space.log_odds(),
        "probability": view.to_probability_map(), "reflection": grid.reflection(),
        "3D reflection": space.reflection(), "decay": grid.decay_rate(),
        "distance": view.distance_field(0.5), "costs": view.costmap(0.2),
        "changes": oddsmap.changed(view, view), "voxels": space.log_odds().to_voxels(),
    }  # fmt: skip


@pytest.mark.filterwarnings("ignore:reflectivity from a map")
def test_all_that_can_be_seen_shows_itself(grid: oddsmap.EvidenceMap) -> None:
    for name, thing in things(grid).items():
        image = decoded(thing._repr_png_())
        assert 100 < max(image.shape[:2]) <= thumbnail.MOST_PIXELS, name
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1, name
        page = thing._repr_html_()
        inline = re.search(r'src="data:image/png;base64,([^"]+)"', page)
        assert inline is not None, name
        assert np.array_equal(decoded(base64.b64decode(inline[1])), image)
        assert f"{type(thing).__name__}" in page


def test_free_is_white_and_north_is_up(grid: oddsmap.EvidenceMap) -> None:
    view = grid.log_odds()
    (lo, hi), image = view.bounds() or ((0, 0), (1, 1)), decoded(view._repr_png_())
    scale = image.shape[0] // (hi[1] - lo[1])
    cells = image[scale // 2 :: scale, scale // 2 :: scale][::-1]
    p, known = view.probability(), view.observed()
    assert np.array_equal((cells == UNKNOWN).all(axis=2), ~known)
    np.testing.assert_allclose(cells[known][:, 0], 255 - 238 * p[known], atol=0.51)


def test_large_maps_are_sums(grid: oddsmap.EvidenceMap, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(count_view, "_SHRUNK_CELLS", 0)
    monkeypatch.setattr(grid.tiles, "parts", None)
    assert "sums of 1² cells" in grid._repr_html_()
    assert decoded(grid._repr_png_()).size


@pytest.mark.filterwarnings("ignore:reflectivity from a map")
def test_nothing_to_be_seen() -> None:
    empty = oddsmap.EvidenceMap(0.1)
    for thing in (empty, empty.log_odds(), empty.reflection()):
        assert thing._repr_png_() is None
        assert "empty" in thing._repr_html_()


def test_what_is_shown_is_escaped_and_raises_nothing() -> None:
    class Odd(Pictured):
        def __repr__(self) -> str:
            return '<Odd <script>alert("x")</script>>'

        def _thumbnail(self) -> thumbnail.Thumbnail | None:
            raise ZeroDivisionError

    assert Odd()._repr_png_() is None
    assert Odd()._repr_html_() == (
        "<div>Odd &lt;script&gt;alert(&quot;x&quot;)&lt;/script&gt;</div>"
    )


def test_colours_are_viridis() -> None:
    from matplotlib import colormaps

    value = np.linspace(0.0, 1.0, 300)[None]
    image = of_quantity(value, "x", (0.0, 1.0)).image[0]
    expected = colormaps["viridis"](value[0], bytes=True)[:, :3]
    assert np.abs(image.astype(int) - expected.astype(int)).max() <= 8


def test_matplotlib_is_not_loaded() -> None:
    code = (
        "import sys, numpy as np, oddsmap\n"
        "grid = oddsmap.EvidenceMap(0.1)\n"
        "grid.add_cells(np.array([[0, 0]]), np.array([65536]), np.array([0]))\n"
        "assert grid._repr_html_().startswith('<figure') and grid.reflection()._repr_png_()\n"
        "assert 'matplotlib' not in sys.modules and 'PIL' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)
