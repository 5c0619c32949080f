# SPDX-License-Identifier: Apache-2.0
"""What the page gets of a 3D map: every voxel with hits, in its place, and what it leaves out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap
from oddsmap.errors import InputError
from oddsmap.kernels.units import ONE
from oddsmap.viewer import air
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload
from tests.viewer.payload_kit import air_of, parts_of, voxels_of

UTM = 5_400_000 * 10
Voxel = tuple[int, int, int]


def map_of(voxels: dict[Voxel, tuple[int, int]]) -> EvidenceMap:
    """A map of voxels with hits and passes in units."""
    grid = EvidenceMap(0.1, ndim=3)
    hits, passes = np.array(list(voxels.values()), np.int64).reshape(-1, 2).T
    grid.add_cells(np.array(list(voxels), np.int64).reshape(-1, 3), hits, passes)
    return grid


# Close enough for runs, and far enough for rows and slabs that are empty.
near = st.tuples(*[st.integers(0, 3) | st.integers(-300, 300)] * 3)
whole = st.tuples(st.integers(0, 70_000), st.integers(0, 70_000)).map(
    lambda pair: (pair[0] * ONE, pair[1] * ONE)
)
parts = st.tuples(st.integers(0, 1 << 31), st.integers(0, 1 << 20))


@settings(max_examples=10)
@given(
    st.dictionaries(near, whole, min_size=1, max_size=9)
    | st.dictionaries(near, parts, min_size=1, max_size=9),
    st.sampled_from([0, UTM, -UTM]),
)
def test_the_page_gets_every_voxel(voxels: dict[Voxel, tuple[int, int]], far: int) -> None:
    seen = {(x + far, y - far, z): pair for (x, y, z), pair in voxels.items() if any(pair)}
    want = {at: (h / ONE, p / ONE) for at, (h, p) in seen.items() if h}
    if not want:
        return
    payload = space_payload(map_of(seen), "m.zarr")
    assert voxels_of(payload) == want
    fewest = min((p / ONE for h, p in seen.values() if not h), default=None)
    facts, _ = parts_of(payload)
    assert (facts["unhit"], facts["cells"]) == (fewest, len(seen))
    assert air_of(payload) == {at: p / ONE for at, (h, p) in seen.items() if not h}


def test_runs_of_air_go_on_in_the_next_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many rows, listed some at a time, of three heights."""
    z, y, x = np.mgrid[0:3, 0:180, 0:400].reshape(3, -1)
    rng = np.random.default_rng(0)
    kept = rng.random(len(x)) < 0.7
    index = np.stack([x, y, z], axis=1)[kept]
    passes = rng.integers(1, 300, len(index))
    index[0], passes[0] = (7, 7, 9), 0
    grid = EvidenceMap(0.1, ndim=3)
    grid.add_cells(index, (passes == 0) * ONE, passes * ONE)
    assert len(list(grid.tiles.parts())) > 2
    want = dict(zip(map(tuple, index[1:].tolist()), passes[1:].tolist(), strict=True))
    payload = space_payload(grid, "m.zarr")
    assert air_of(payload) == want
    monkeypatch.setattr(air, "_MOST_SLABS", 4)
    payload = space_payload(grid, "m.zarr")
    assert parts_of(payload)[0]["air"]["heights"] == 3
    assert air_of(payload) == want
    monkeypatch.setattr(air, "_MOST_VOXELS", len(want) - 1)
    facts, sections = parts_of(space_payload(grid, "m.zarr"))
    assert facts["air"] is None
    assert not [name for name in sections if name.startswith("air")], "too much air is left out"


def test_weights_beyond_32_bits_are_rounded_and_told() -> None:
    grid = map_of({(0, 0, 0): (1, 1 << 40), (1, 0, 0): ((1 << 40) + 1, 0)})
    payload = space_payload(grid, "m.zarr")
    facts, _ = parts_of(payload)
    assert facts["rounded"]
    hits = voxels_of(payload)[0, 0, 0][0]
    assert hits == facts["unit"], "what is rounded away stays a hit"


def test_maps_that_are_not_shown() -> None:
    with pytest.raises(InputError, match=r"^m\.zarr: no cell of the map has evidence"):
        space_payload(EvidenceMap(0.1, ndim=3), "m.zarr")
    with pytest.raises(InputError, match=r"^m\.zarr: no voxel of the map has a hit"):
        space_payload(map_of({(0, 0, 0): (0, ONE)}), "m.zarr")
    wide = map_of({(0, 0, 0): (ONE, 0), (65536, 0, 0): (ONE, 0)})
    with pytest.raises(InputError, match=r"^m\.zarr: the page cannot show 6554 x 0\.1 x 0\.1 m"):
        space_payload(wide, "m.zarr")
    just = map_of({(0, 0, 0): (ONE, 0), (65535, 0, 0): (ONE, 0)})
    assert len(voxels_of(space_payload(just, "m.zarr"))) == 2
    with pytest.raises(InputError, match="needs a 3D map"):
        space_payload(EvidenceMap(0.1), "m.zarr")
    with pytest.raises(InputError, match="needs a 2D map"):
        plane_payload(just, "m.zarr")
