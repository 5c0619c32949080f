# SPDX-License-Identifier: Apache-2.0
"""Which part of a map a picture shows, and how large."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from oddsmap.errors import ConfigError, InputError
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.plot.layout import FrameOptions, layout_of
from oddsmap.plot.picture import save_picture
from oddsmap.plot.quantity import save_quantity


def known(cells: list[tuple[int, int]], shape: tuple[int, int] = (400, 400)) -> ProbabilityMap:
    """A square of 100 x 100 known cells, and single ones (row, column)."""
    observed = np.zeros(shape, np.bool_)
    observed[50:150, 50:150] = True
    for cell in cells:
        observed[cell] = True
    return ProbabilityMap(np.where(observed, 0.2, 0.5), observed, 0.1, (-3.0, 7.0))


def test_few_cells_far_away_do_not_set_the_frame() -> None:
    far = [(399, 399), (390, 3), (2, 388)]
    seen, whole = layout_of(known(far), {}), layout_of(known(far), {"whole": True})
    assert (seen.outside, seen.known) == (3, 10_003)
    assert (whole.outside, whole.known) == (0, 10_003)
    assert seen.rows.stop - seen.rows.start < 110 < 390 < whole.rows.stop - whole.rows.start
    assert layout_of(known([]), {}).rows == slice(50, 150)
    # A tenth more is no reason: the frame of most maps is that of all known cells.
    near = layout_of(known([(160, 160)]), {})
    assert near.outside == 0
    assert near.rows == slice(50, 161)


@given(
    st.lists(st.tuples(st.integers(0, 59), st.integers(0, 79)), min_size=1, max_size=60),
    st.booleans(),
)
def test_what_is_left_out_is_counted(cells: list[tuple[int, int]], whole: bool) -> None:
    observed = np.zeros((60, 80), np.bool_)
    observed[tuple(np.array(cells).T)] = True
    grid = ProbabilityMap(np.full((60, 80), 0.5), observed, 0.5)
    layout = layout_of(grid, {"whole": whole})
    inside = np.count_nonzero(observed[layout.rows, layout.columns])
    assert layout.known == np.count_nonzero(observed)
    assert layout.outside == layout.known - inside
    assert layout.outside <= 2e-3 * layout.known or not whole
    assert layout.outside == 0  # of fewer than 1000 cells none is left out


def test_a_crop_is_what_was_asked_for() -> None:
    layout = layout_of(known([]), {"crop": (2.0, 12.0, 4.0, 20.0)})
    assert layout.columns == slice(50, 70)
    assert layout.rows == slice(50, 130)
    assert layout.limits == pytest.approx((2.0, 4.0, 12.0, 20.0))
    beyond = layout_of(known([]), {"crop": (-100.0, -100.0, 100.0, 100.0)})
    assert beyond.limits == pytest.approx((-100.0, 100.0, -100.0, 100.0))
    assert beyond.rows == slice(0, 400)


@pytest.mark.parametrize("size", [100, 233, 400, 1000, 3800])
@pytest.mark.parametrize("side", [7, 100, 399, 2500])
def test_sizes_are_kept_in_whole_pixels(size: int, side: int) -> None:
    grid = ProbabilityMap(np.zeros((side, side)), np.ones((side, side), np.bool_), 0.1)
    layout = layout_of(grid, {"size": size})
    assert 0.4 * size <= max(layout.width, layout.height) <= size + layout.scale


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"size": 99}, ConfigError, "size is 100 to 3800 pixels, got 99"),
        ({"crop": (0, 0, 1)}, ConfigError, "crop is x_min y_min x_max y_max"),
        ({"crop": (1, 0, 1, 2)}, ConfigError, "crop is x_min"),
        ({"crop": (0, 0, np.nan, 2)}, ConfigError, "crop is x_min"),
        ({"crop": (90, 90, 91, 91)}, InputError, "known in the crop 90 90 91 91"),
    ],
)
def test_what_cannot_be_shown(options: FrameOptions, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        layout_of(known([]), options)


def test_turned_maps_have_no_crop() -> None:
    grid = known([])
    turned = ProbabilityMap(grid.probability, grid.observed, 0.1, yaw=0.3)
    with pytest.raises(InputError, match=r"turned by 0\.3 rad"):
        layout_of(turned, {"crop": (0, 0, 9, 9)})


@pytest.mark.parametrize(("suffix", "start"), [(".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_vector_files_are_the_same_each_time(tmp_path: Path, suffix: str, start: bytes) -> None:
    line = np.array([[2.0, 13.0], [9.0, 19.0]])
    for name in ("a", "b"):
        path = save_picture(
            known([]), tmp_path / f"{name}{suffix}", title="Hall & <yard>", trajectory=line
        )
        assert path.read_bytes().startswith(start)
        save_quantity(known([]), tmp_path / f"q{name}{suffix}", label="std", title="Hall")
    for kind in ("", "q"):
        first, second = (tmp_path / f"{kind}{name}{suffix}" for name in ("a", "b"))
        assert first.read_bytes() == second.read_bytes()


def test_the_picture_says_what_it_leaves_out(tmp_path: Path) -> None:
    far, path = [(399, 399)], tmp_path / "m.svg"
    save_picture(known(far), path)
    assert "not shown: 1 of 10,001 known cells" in path.read_text()
    save_picture(known(far), path, whole=True, force=True)
    assert "not shown" not in path.read_text()


def test_text_stays_readable_in_small_pictures(tmp_path: Path) -> None:
    for size in (200, 500):
        path = save_picture(known([]), tmp_path / f"{size}.png", size=size)
        with Image.open(path) as image:
            assert size * 0.5 < min(image.size)
            assert max(image.size) < size + 300
