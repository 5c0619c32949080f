# SPDX-License-Identifier: Apache-2.0
"""Free and unknown space of a 3D map in a browser: slices, and points."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from oddsmap import EvidenceMap
from oddsmap.kernels.units import ONE
from oddsmap.odds import sigmoid
from oddsmap.viewer import air
from tests.viewer.browser_kit import Opened, opened
from tests.viewer.space_kit import RESOLUTION, page_of, ray_of, room_map

if TYPE_CHECKING:
    from playwright.sync_api import Browser

STATES = {
    "free": (255, 255, 255), "undecided": (224, 154, 58), "occupied": (17, 20, 26),
    "unknown": (199, 213, 227),
}  # fmt: skip
FREE_POINT = (0, 114, 178)


@pytest.fixture(scope="module")
def room() -> EvidenceMap:
    return room_map()


@pytest.fixture(scope="module")
def shown(
    browser: Browser, room: EvidenceMap, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Opened]:
    url = page_of(room, tmp_path_factory.mktemp("space"))
    with opened(browser, url, offline=True) as found:
        yield found
        assert found.complaints == []


@pytest.fixture(autouse=True)
def as_the_map_has_it(request: pytest.FixtureRequest) -> None:
    if "shown" in request.fixturenames:
        shown = request.getfixturevalue("shown")
        shown.reset()
        shown.get("oddsmap.camera.fit()")


def set_and_unpack(found: Opened, **settings: Any) -> None:
    found.set(**settings)
    found.get("oddsmap.unpacked")
    found.words()


def picture(found: Opened) -> npt.NDArray[np.uint8]:
    found.words()
    return np.array(Image.open(io.BytesIO(found.page.locator("canvas").screenshot())))[..., :3]


def grid_pixels(found: Opened) -> list[tuple[int, int]]:
    """Pixels all over the middle of the canvas, away from the words over it."""
    width, height = found.get("[oddsmap.camera.width, oddsmap.camera.height]")
    return [
        (x, y)
        for x in range(int(0.15 * width), int(0.85 * width), 29)
        for y in range(int(0.1 * height), int(0.75 * height), 13)
    ]


@pytest.mark.parametrize(
    ("posterior", "look"),
    [
        ("log-odds", "fit(0.3, 1.2)"),
        ("calibrated", "fit(0.3, 1.2)"),
        ("log-odds", "fit(), Object.assign(oddsmap.camera, { target: [9, 9, 7], distance: 1.5 })"),
    ],
)
def test_a_slice_shows_and_says_every_state(
    shown: Opened, room: EvidenceMap, posterior: str, look: str
) -> None:
    height = 0.8
    set_and_unpack(shown, sliced=True, sliceAt=height, posterior=posterior, free=0.3, occupied=0.7)
    shown.get(f"(oddsmap.camera.{look}, oddsmap.store.set({{}}))")
    image = picture(shown)
    index, hits, passes = room.cells()
    cells = {tuple(at): (h / ONE, p / ONE) for at, h, p in zip(index.tolist(), hits, passes)}  # noqa: B905
    first, past = index.min(axis=0), index.max(axis=0) + 1
    level = int(np.floor(height / RESOLUTION))
    view = room.log_odds() if posterior == "log-odds" else room.calibrated()
    pixels = grid_pixels(shown)
    got = shown.get("pixels.map(([x, y]) => oddsmap.pick(x + 0.5, y + 0.5))", pixels=pixels)
    met: dict[str, int] = dict.fromkeys(STATES, 0)
    for (x, y), found in zip(pixels, got, strict=True):
        eye, ray = ray_of(shown, x + 0.5, y + 0.5)
        at = eye + ray * ((level + 0.5 - first[2] - eye[2]) / ray[2]) + first
        cell = np.array([*np.floor(at[:2]), level], np.int64)
        if (cell < first).any() or (cell >= past).any():
            continue
        assert found["index"] == cell.tolist()
        votes = cells.get(tuple(cell.tolist()), (0, 0))
        assert (found["hits"], found["passes"]) == votes
        state = "unknown"
        if any(votes):
            p = float(sigmoid(view.log_odds_at(cell[None])[0]))
            state = "occupied" if p >= 0.7 else "free" if p <= 0.3 else "undecided"
        if np.abs(at[:2] - cell[:2] - 0.5).max() < 0.3:  # away from the lines between cells
            assert image[y, x].tolist() == pytest.approx(STATES[state], abs=2)
            met[state] += 1
    assert all(met.values()) if look == "fit(0.3, 1.2)" else sum(met.values()) > 50, met


def test_a_slice_cuts_what_lies_above(shown: Opened, room: EvidenceMap) -> None:
    index, hits, _ = room.cells()
    set_and_unpack(shown, sliced=True, sliceAt=0.8)
    shown.get(
        "new Promise((done) => { const ask = () => "
        "oddsmap.occupied === null ? setTimeout(ask, 10) : done(); ask(); })"
    )
    below = (index[:, 2] < 3) & (hits > 0)
    least = room.config.posterior.thresholds.occupied
    want = (sigmoid(room.log_odds().log_odds_at(index)) >= least) & below
    assert shown.get("oddsmap.occupied") == want.sum()
    # From below, voxels hide the slice.
    shown.get("(oddsmap.camera.fit(0.3, -1.2), oddsmap.store.set({}))")
    width, height = shown.get("[oddsmap.camera.width, oddsmap.camera.height]")
    middle = shown.get("oddsmap.pick(x, y)", x=width / 2, y=height / 2)
    assert middle["index"][2] < 3
    set_and_unpack(shown, zLow=0.5)
    middle = shown.get("oddsmap.pick(x, y)", x=width / 2, y=height / 2)
    assert middle["index"][2] in (2, 3)


def test_only_another_slice_is_uploaded(shown: Opened) -> None:
    set_and_unpack(shown, sliced=True, sliceAt=0.8)
    before = shown.get("oddsmap.stats.uploaded")
    set_and_unpack(shown, pHit=0.8)
    set_and_unpack(shown, free=0.1)
    assert shown.get("oddsmap.stats.uploaded") == before
    set_and_unpack(shown, sliceAt=1.1)
    assert shown.get("oddsmap.stats.uploaded") > before
    # Many in a row: the last one is shown.
    shown.get("[0.1, 0.4, 0.6, 1.4].forEach((sliceAt) => oddsmap.store.set({ sliceAt }))")
    shown.get("oddsmap.unpacked")
    assert shown.get("oddsmap.slice.height") == int(1.4 / RESOLUTION) + 3


def test_free_space_is_unpacked_whole(shown: Opened, room: EvidenceMap) -> None:
    index, hits, passes = room.cells()
    set_and_unpack(shown, voxels="free")
    places, counts = shown.get("[[...oddsmap.air.places], [...oddsmap.air.counts]]")
    got = np.array(places).reshape(-1, 4)[:, :3] + index.min(axis=0)
    unhit = hits == 0
    order, other = np.lexsort(got.T), np.lexsort(index[unhit].T)
    assert (got[order] == index[unhit][other]).all()
    votes = np.array(counts).reshape(-1, 2)[order]
    assert (votes[:, 0] == 0).all()
    assert (votes[:, 1] == passes[unhit][other] / ONE).all()


def test_points_of_free_and_undecided_voxels(browser: Browser, tmp_path: Path) -> None:
    grid = EvidenceMap(1.0, ndim=3)
    grid.add_cells(
        np.array([[0, 0, 0], [2, 0, 0], [4, 0, 0], [6, 0, 0]]),
        np.array([9, 0, 0, 1]) * ONE, np.array([0, 9, 1, 1]) * ONE,
    )  # fmt: skip

    def colours() -> list[list[int]]:
        image = picture(found)
        places = found.get(
            "[0, 2, 4, 6].map((x) => oddsmap.camera.seen([x + 0.5, 0.5, 0.5]).slice(0, 2))"
        )
        return [image[int(y), int(x)].tolist() for x, y in places]

    with opened(browser, page_of(grid, tmp_path), offline=True) as found:
        found.get("oddsmap.camera.fit(1.5708, 1.57)")
        set_and_unpack(found, opacity=1)
        box, *others = colours()
        nothing = others[0]
        assert others == [nothing] * 3
        set_and_unpack(found, voxels="free")
        assert colours() == [box, list(FREE_POINT), nothing, nothing]
        undecided = list(STATES["undecided"])
        set_and_unpack(found, voxels="known")
        assert colours() == [box, list(FREE_POINT), undecided, undecided]
        set_and_unpack(found, pMiss=0.1)
        assert colours() == [box, list(FREE_POINT), list(FREE_POINT), undecided]
        set_and_unpack(found, pMiss=0.1, opacity=0.5)
        half = (np.array(FREE_POINT) + nothing) / 2
        assert colours()[1] == pytest.approx(half.tolist(), abs=2)
        assert found.complaints == []


def test_too_much_air(browser: Browser, room: EvidenceMap, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(air, "_MOST_VOXELS", 100)
        url = page_of(room, tmp_path)
    with opened(browser, url, offline=True) as found:
        doubt = found.page.locator(".doubt")
        assert not doubt.is_visible()
        for change in ({"sliced": True}, {"sliced": False, "voxels": "free"}):
            set_and_unpack(found, **change)
            assert "voxels without a hit are too many for the page" in doubt.inner_text()
        assert found.get("oddsmap.slice") is None
        assert found.complaints == []
