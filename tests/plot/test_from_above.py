# SPDX-License-Identifier: Apache-2.0
"""Leaves of an octree as they are seen from above, against a loop over all cells."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from oddsmap import InputError, VoxelMap
from oddsmap.odds import logit
from oddsmap.plot import from_above
from oddsmap.plot.from_above import largest_in_blocks

Leaf = tuple[tuple[int, int, int], int, float]


def map_of(leaves: list[Leaf]) -> VoxelMap:
    """Leaves by their lowest cell, level and p(occupied)."""
    index, level, p = zip(*leaves, strict=True)
    return VoxelMap(np.array(index), logit(np.array(p)), 0.5, np.array(level, np.uint8))


@st.composite
def some_leaves(draw: st.DrawFn) -> VoxelMap:
    """Leaves of several sizes in some of the cubes of 8 cells around the origin."""
    found: list[Leaf] = []
    for corner in np.ndindex(3, 3, 2):
        level = draw(st.sampled_from([None, 0, 1, 3]))
        if level is None:
            continue
        place = (np.array(corner) - 1) * 8
        inner = np.array(draw(st.tuples(*[st.integers(0, (8 >> level) - 1)] * 3))) << level
        x, y, z = (int(n) for n in place + inner)
        found.append(((x, y, z), level, draw(st.floats(0.01, 0.99))))
    return map_of(found or [((0, 0, 0), 0, 0.7)])


@given(some_leaves(), st.integers(1, 9), st.booleans())
def test_blocks_of_columns_against_a_loop(voxels: VoxelMap, block: int, alone: bool) -> None:
    bounds = voxels.bounds()
    assert bounds is not None
    lo, hi = (corner[:2] for corner in bounds)
    want: dict[tuple[int, int], float] = {}
    for (x, y, _), p in zip(*voxels.cells(), strict=True):
        at = ((x - lo[0]) // block, (y - lo[1]) // block)
        want[at] = max(want.get(at, 0.0), p)
    with pytest.MonkeyPatch.context() as patch:
        if alone:  # as leaves are drawn that reach into many blocks
            patch.setattr(from_above, "_MANY", 0)
        found = largest_in_blocks(voxels.index, voxels.side, voxels.probability, lo, hi, block)
    assert found.shape == tuple(-(-(hi - lo) // block)[::-1])
    for row, column in np.ndindex(found.shape):
        value = want.get((column, row), np.nan)
        assert found[row, column] == pytest.approx(value, nan_ok=True)


ROOM = map_of([
    ((0, 0, 0), 2, 0.1),  # 2 m of air on both sides of a wall, below a roof
    ((4, 0, 0), 2, 0.9),
    ((8, 0, 0), 2, 0.1),
    ((0, 0, 4), 0, 0.8),
])  # fmt: skip


def drawn(**options: float) -> list[float]:
    """What a plot of the room has in the row of columns at y = 0 to 0.5 m; unknown is -1."""
    axes = ROOM.plot(Figure().subplots(), colour_bar=False, **options)  # type: ignore[arg-type]
    (image,) = axes.images
    data = image.get_array()
    assert data is not None
    return [round(float(p), 6) for p in np.ma.filled(data, -1.0)[0]]


def test_a_plot_shows_the_most_occupied_leaf_in_a_band() -> None:
    assert drawn() == [0.8, *[0.1] * 3, *[0.9] * 4, *[0.1] * 4]
    assert drawn(z_max=2.0) == [*[0.1] * 4, *[0.9] * 4, *[0.1] * 4]
    # The centre of the roof is at 2.25 m, that of the highest layer below it at 1.75 m.
    assert drawn(z_min=1.75, z_max=2.25)[0] == 0.1
    assert drawn(z_min=1.76) == [0.8]
    for band in ({"z_min": 2.26}, {"z_max": 0.25}, {"z_min": 1.8, "z_max": 2.2}):
        with pytest.raises(InputError, match="no cell of the map is known from"):
            drawn(**band)


def test_axes_are_in_metres() -> None:
    axes = ROOM.plot(Figure().subplots(), crop=(1.0, 0.5, 5.0, 1.5), title="Room")
    assert axes.get_title(loc="left") == "Room"
    assert (*axes.get_xlim(), *axes.get_ylim()) == pytest.approx((1.0, 5.0, 0.5, 1.5), abs=0.6)
    assert tuple(axes.images[0].get_extent()) == (1.0, 5.0, 0.5, 1.5)


def test_a_large_map_takes_no_more_than_its_picture() -> None:
    """A leaf of 16 km, and one of a cell far from it."""
    wide = map_of([((0, 0, 0), 15, 0.2), ((900_000, 0, 0), 0, 0.9)])
    assert wide._repr_png_() is not None
    axes = wide.plot(Figure().subplots(), whole=True)
    data = axes.images[0].get_array()
    assert data is not None
    assert max(data.shape) <= 2000
