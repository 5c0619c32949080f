# SPDX-License-Identifier: Apache-2.0
"""Voxels that are pointed at in a browser: the right ones, and what Python says of them."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from scipy.stats import beta

from oddsmap import EvidenceMap
from oddsmap.kernels.units import ONE
from oddsmap.odds import logit, sigmoid
from tests.viewer.browser_kit import Opened, opened
from tests.viewer.space_kit import RESOLUTION, first_on_ray, page_of, ray_of, room_map

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from oddsmap import Calibrated, LogOdds

Voxel = tuple[int, int, int]
VIRIDIS = np.array(
    [(68, 1, 84), (71, 45, 123), (59, 82, 139), (44, 114, 142), (33, 145, 140), (40, 174, 128),
     (94, 201, 98), (173, 220, 48), (253, 231, 37)]
)  # fmt: skip


@pytest.fixture(scope="module")
def room() -> EvidenceMap:
    return room_map()


@pytest.fixture(scope="module")
def shown(
    browser: Browser, room: EvidenceMap, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Opened]:
    url = page_of(room, tmp_path_factory.mktemp("space"))
    with opened(browser, url, offline=True, has_touch=True) as found:
        found.get("oddsmap.onPick((index) => (globalThis.clicked = index))")
        yield found
        assert found.complaints == []


@pytest.fixture(autouse=True)
def as_the_map_has_it(shown: Opened) -> None:
    shown.reset()
    shown.get("oddsmap.camera.fit()")


def picks(found: Opened, pixels: list[tuple[float, float]]) -> list[dict[str, Any] | None]:
    return list(
        found.get("pixels.map((at) => oddsmap.pick(...at))", pixels=list(map(list, pixels)))
    )


@pytest.mark.parametrize(
    ("look", "least"),
    [("fit()", 0.65), ("fit(-2.4, -0.6)", 0.65), ("zoom(6)", 0.9), ("fit(0, 0)", 0.65),
     ("fit(1.5707963267948966, 1.5697)", 0.65), ("move(0, 0, 30)", 0.65)],
)  # fmt: skip
def test_the_first_drawn_voxel_on_the_ray(
    shown: Opened, room: EvidenceMap, look: str, least: float
) -> None:
    shown.set(occupied=least, zHigh=1.5)
    shown.get(f"oddsmap.camera.{look}")
    index, hits, _ = room.cells()
    drawn = (room.log_odds().log_odds_at(index) >= logit(least)) & (hits > 0)
    drawn &= (index[:, 2] + 0.5) * RESOLUTION < 1.5
    index, hits = index[drawn], hits[drawn]
    place = index - room.cells()[0].min(axis=0)
    width, height = shown.get("[oddsmap.camera.width, oddsmap.camera.height]")
    rng = np.random.default_rng(0)
    pixels = [(float(x), float(y)) for x, y in rng.uniform(0.25, 0.75, (60, 2)) * [width, height]]
    met = 0
    for pixel, got in zip(pixels, picks(shown, pixels), strict=True):
        number = first_on_ray(*ray_of(shown, *pixel), place)
        if number is None:
            assert got is None
            continue
        met += 1
        assert got is not None
        assert got["index"] == index[number].tolist()
        assert got["hits"] == hits[number] / ONE
    assert met > 15


NEAR_A_WALL = "{{ target: [1.5, 15.5, 6.5], distance: {}, yaw: {}, pitch: 0.2 }}"


@pytest.mark.parametrize(
    "look",
    ["fit()", "fit(-2.4, -0.6)", "move(0, 0, 56)"]
    + [
        f"fit(), Object.assign(oddsmap.camera, {NEAR_A_WALL.format(distance, yaw)})"
        for distance, yaw in ((2.2, 3.1), (0.8, 2.2), (0.3, 3.1))
    ],
)
def test_what_is_pointed_at_is_what_is_drawn(shown: Opened, room: EvidenceMap, look: str) -> None:
    """From afar, and flying through: near voxels are neither cut off nor lost."""
    shown.get(f"(oddsmap.camera.{look}, oddsmap.store.set({{}}))")
    lowest, highest = (room.cells()[0][:, 2].min(), room.cells()[0][:, 2].max())
    shown.words()
    image = np.array(Image.open(io.BytesIO(shown.page.locator("canvas").screenshot())))[..., :3]
    background = (232, 237, 242)
    pixels = [(x, y) for x in range(9, 590, 29) for y in range(9, 500, 21)]
    wrong = 0
    for (x, y), got in zip(
        pixels, picks(shown, [(x + 0.5, y + 0.5) for x, y in pixels]), strict=True
    ):
        seen = image[y, x].astype(float)
        if got is None:
            wrong += seen.tolist() != list(background)
            continue
        share = (got["index"][2] - lowest) / (highest - lowest)
        colour = np.array([np.interp(8 * share, np.arange(9), VIRIDIS[:, i]) for i in range(3)])
        # Faces have shades, and edges are darker.
        shade = (seen @ colour) / (colour @ colour)
        wrong += not (0.3 < shade < 1.02 and np.abs(seen - shade * colour).max() < 3)
    assert wrong <= 0.01 * len(pixels)


def point_at(found: Opened, voxel: Voxel, first: np.ndarray) -> tuple[float, float]:
    """Look straight down on a voxel, and give where it is on the page."""
    target = [float(at - lo) + 0.5 for at, lo in zip(voxel, first, strict=True)]
    found.get(
        "(oddsmap.camera.fit(0, 1.5), Object.assign(oddsmap.camera, { target, distance: 20 }),"
        " oddsmap.store.set({}))",
        target=target,
    )
    found.words()
    box = found.page.locator("canvas").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def said(found: Opened) -> list[str]:
    found.words()
    return found.page.locator(".readout > :not(:first-child)").all_inner_texts()


def test_what_is_said_is_what_python_says(shown: Opened, room: EvidenceMap) -> None:
    index, hits, passes = room.cells()
    first = index.min(axis=0)
    # A voxel that nothing hides from above, as it is among the highest.
    best = np.flatnonzero((index[:, 2] == index[:, 2].max()) & (hits > 3 * ONE))[5]
    voxel: Voxel = tuple(index[best].tolist())
    h, p = int(hits[best]) // ONE, int(passes[best]) // ONE
    x, y = point_at(shown, voxel, first)
    views: list[tuple[dict[str, Any], LogOdds | Calibrated, tuple[float, float]]] = [
        ({"occupied": 0.1}, room.log_odds(), (1.0, 1.0)),
        ({"occupied": 0.1, "posterior": "calibrated"}, room.calibrated(), (0.0, 0.0)),
    ]
    for change, view, (a, b) in views:
        shown.set(**change)
        shown.page.mouse.move(x + 1, y)
        shown.page.mouse.move(x, y)
        position, words = said(shown)
        middle = [(at + 0.5) * RESOLUTION for at in voxel]
        numbers = re.findall(r"[xyz] (\S+) m", position.replace("\u2212", "-"))
        assert [float(n) for n in numbers] == pytest.approx(middle, abs=0.01)
        lines = words.replace("\u2212", "-").splitlines()
        assert lines[0] == f"voxel {voxel[0]}, {voxel[1]}, {voxel[2]}"
        assert lines[1] == f"{h} hit{'s' * (h != 1)}, {p} pass{'es' * (p != 1)}"
        want = float(sigmoid(view.log_odds_at(np.array([voxel]))[0]))
        assert lines[2].startswith("occupied, p ")
        assert float(lines[2].split()[-1]) == pytest.approx(want, abs=6e-4)
        if change.get("posterior") == "calibrated":
            a, b = room.calibrated().reflectivity.a, room.calibrated().reflectivity.b
        mean, low, high = re.findall(r"reflectivity (\S+), 95 % interval (\S+) to (\S+)", lines[3])[
            0
        ]
        assert float(mean) == pytest.approx((a + h) / (a + b + h + p), abs=6e-3)
        ends = beta(a + h, b + p).interval(0.95)
        assert (float(low), float(high)) == pytest.approx(ends, abs=6e-3)
    edges = shown.page.locator(".edges")
    assert edges.get_attribute("d")
    shown.page.mouse.move(x + 600, y)
    assert "Point at a voxel" in said(shown)[1]
    assert not edges.get_attribute("d")


@pytest.mark.parametrize(
    ("change", "prior"),
    [
        ({"betaA": 2, "betaB": 0.5}, (2.0, 0.5)),
        ({"posterior": "calibrated", "occupied": 0.1}, None),
    ],
)
def test_colours_of_the_share_of_beams_are_python_s(
    shown: Opened, room: EvidenceMap, change: dict[str, Any], prior: tuple[float, float] | None
) -> None:
    index, hits, passes = room.cells()
    best = np.flatnonzero((index[:, 2] == index[:, 2].max()) & (hits > 3 * ONE))[5]
    h, p = int(hits[best]) // ONE, int(passes[best]) // ONE
    fitted = room.calibrated().reflectivity
    a, b = prior or (fitted.a, fitted.b)
    low, high = beta(a + h, b + p).interval(0.95)
    x, y = point_at(shown, tuple(index[best].tolist()), index.min(axis=0))
    pixel = (round(x), round(y))
    assert not shown.number("prior hits [votes]").is_visible()
    for paint, value in (("reflection", (a + h) / (a + b + h + p)), ("interval-width", high - low)):
        shown.set(paint=paint, **change)
        shown.words()
        assert shown.number("prior hits [votes]").is_visible() == (prior is not None)
        image = np.array(Image.open(io.BytesIO(shown.page.screenshot())))
        want = [np.interp(8 * value, np.arange(9), VIRIDIS[:, i]) for i in range(3)]
        assert image[pixel[1], pixel[0], :3] == pytest.approx(want, abs=2), paint


def test_pointing_draws_no_frame(shown: Opened, room: EvidenceMap) -> None:
    index = room.cells()[0]
    x, y = point_at(shown, tuple(index[index[:, 2].argmax()].tolist()), index.min(axis=0))
    draws = shown.get("oddsmap.stats.draws")
    for step in range(5):
        shown.page.mouse.move(x + 10 * step, y)
        said(shown)
    assert shown.get("oddsmap.stats.draws") == draws


def test_click_tap_and_key_pick(shown: Opened, room: EvidenceMap) -> None:
    index, hits, _ = room.cells()
    lower = np.flatnonzero(hits > 5 * ONE)
    voxel: Voxel = tuple(index[lower[index[lower, 2].argmax()]].tolist())
    x, y = point_at(shown, voxel, index.min(axis=0))

    def clicked() -> Any:
        got = shown.page.evaluate("globalThis.clicked")
        shown.page.evaluate("globalThis.clicked = null")
        return got

    clicked()
    shown.page.mouse.click(x, y)
    assert clicked() == list(voxel)
    shown.page.mouse.move(x, y)
    shown.page.mouse.down()
    shown.page.mouse.move(x + 30, y)
    shown.page.mouse.up()
    assert clicked() is None, "a drag is no click"
    x, y = point_at(shown, voxel, index.min(axis=0))
    shown.page.mouse.move(0, 0)
    shown.page.touchscreen.tap(x, y)
    assert clicked() == list(voxel)
    assert said(shown)[1].startswith("voxel "), "what was tapped stays described"
    shown.page.locator("canvas").focus()
    shown.page.keyboard.press("Enter")
    assert clicked() == list(voxel)
    shown.page.mouse.move(x + 600, y)
    shown.page.keyboard.press("1")
    shown.page.keyboard.press("+")
    assert said(shown)[1].startswith(("voxel ", "No voxel"))
