# SPDX-License-Identifier: Apache-2.0
"""What the page gets of a 2D map is the map: every count, in its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import BeamSensor, EvidenceMap, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.kernels.units import ONE
from oddsmap.viewer.layout import TILE
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.text import text_of
from tests.viewer.payload_kit import cells_of, parts_of

UTM = 5_400_000 * 20


def map_of(cells: dict[tuple[int, int], tuple[int, int]], **options: object) -> EvidenceMap:
    """A map of cells with hits and passes in units."""
    grid = EvidenceMap(0.05, **options)  # type: ignore[arg-type]
    hits, passes = np.array(list(cells.values()), np.int64).reshape(-1, 2).T
    grid.add_cells(np.array(list(cells), np.int64).reshape(-1, 2), hits, passes)
    return grid


def want(grid: EvidenceMap) -> dict[tuple[int, int], tuple[float, float]]:
    index, hits, passes = grid.cells()
    return {
        (int(x), int(y)): (int(h) / ONE, int(p) / ONE)
        for (x, y), h, p in zip(index, hits, passes, strict=True)
    }


near = st.integers(-200, 200)
whole = st.tuples(st.integers(0, 70_000), st.integers(0, 70_000)).map(
    lambda pair: (pair[0] * ONE, pair[1] * ONE)
)
parts = st.tuples(st.integers(0, 1 << 31), st.integers(0, 1 << 20))


@settings(max_examples=10)
@given(
    st.dictionaries(st.tuples(near, near), whole, min_size=1, max_size=5)
    | st.dictionaries(st.tuples(near, near), parts, min_size=1, max_size=5),
    st.sampled_from([0, UTM, -UTM]),
    st.sampled_from([None, 8, 48, 200]),
)
def test_the_page_gets_every_count_in_its_place(
    cells: dict[tuple[int, int], tuple[int, int]], far: int, tile_side: int | None
) -> None:
    seen = {(x + far, y + far): pair for (x, y), pair in cells.items() if any(pair)}
    if not seen:
        return
    grid = map_of(seen, tile_side=tile_side)
    assert cells_of(plane_payload(grid, "m.zarr")) == want(grid)


def test_facts_are_the_maps(tmp_path: Path) -> None:
    sensor = BeamSensor(p_hit=0.8, p_miss=0.3)
    grid = map_of({(-1, 4): (2 * ONE, 0), (700, 5): (0, 300 * ONE)}, sensor=sensor, votes="beam")
    grid.record("logs/hall.log", scans=7)
    facts, _ = parts_of(plane_payload(grid, str(tmp_path / "hall.zarr")))
    assert facts["name"] == "hall.zarr"
    assert facts["sources"] == [{"source": "hall.log", "scans": 7}]
    assert (facts["p_hit"], facts["p_miss"], facts["prior"]) == (0.8, 0.3, 0.5)
    assert (facts["free"], facts["occupied"]) == (0.196, 0.65)
    assert (facts["resolution"], facts["votes"], facts["sensor"]) == (0.05, "beam", "beam")
    assert (facts["lo"], facts["hi"], facts["cells"]) == ([-1, 4], [701, 6], 2)
    assert (facts["tiles"], facts["bytes"], facts["unit"]) == (2, 2, 1.0)
    assert facts["first_cell"] == [-TILE, 0]


def test_weights_beyond_32_bits_are_rounded_and_said_so() -> None:
    grid = map_of({(0, 0): ((1 << 40) + 1, 3), (1, 0): (5 * ONE, 0)})
    payload = plane_payload(grid, "m.zarr")
    facts, _ = parts_of(payload)
    assert facts["rounded"]
    cells = cells_of(payload)
    assert cells[0, 0] == (2.0**24, facts["unit"]), "rounded, and yet seen"
    assert cells[1, 0] == (5.0, 0.0)
    assert not parts_of(plane_payload(map_of({(0, 0): (3, ONE)}), "m"))[0]["rounded"]


def test_a_cleared_tile_is_left_out() -> None:
    grid = map_of({(0, 0): (ONE, 0), (900, 900): (ONE, ONE)})
    grid.subtract(map_of({(900, 900): (ONE, ONE)}))
    assert parts_of(plane_payload(grid, "m"))[0]["tiles"] == 1


def test_what_cannot_be_shown() -> None:
    with pytest.raises(InputError, match=r"^m: no cell of the map has evidence, nothing to show$"):
        plane_payload(EvidenceMap(0.05), "m")
    with pytest.raises(InputError, match="needs a 2D map"):
        plane_payload(EvidenceMap(0.05, ndim=3), "m")
    wide = map_of({(0, 0): (ONE, 0), (1 << 40, 0): (ONE, 0)})
    with pytest.raises(InputError, match=r"cannot show .* m at 0.05 m; show a part \(oddsmap crop"):
        plane_payload(wide, "m")


@pytest.mark.realdata
def test_a_payload_is_no_larger_than_the_saved_map(data_folder: Path, tmp_path: Path) -> None:
    """As it stands in a file to send, within 1.3 of it."""
    log = open_log(data_folder / "laser2d" / "intel-corrected.log.gz")
    grid = build_map(log, 0.05)
    grid.save(tmp_path / "m.zarr")
    saved = sum(f.stat().st_size for f in (tmp_path / "m.zarr").rglob("*") if f.is_file())
    assert len(text_of(plane_payload(grid, "m.zarr"))) <= 1.3 * saved
