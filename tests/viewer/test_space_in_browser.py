# SPDX-License-Identifier: Apache-2.0
"""A 3D map in a browser: what is drawn, and how many voxels Python takes for occupied."""

from __future__ import annotations

import io
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import EvidenceMap
from oddsmap.cli import main
from oddsmap.kernels.units import ONE
from oddsmap.odds import logit
from tests.viewer.browser_kit import Opened, opened
from tests.viewer.space_kit import RESOLUTION, page_of, room_map

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def room() -> EvidenceMap:
    return room_map()


@pytest.fixture(scope="module")
def shown(
    browser: Browser, room: EvidenceMap, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Opened]:
    """The file on the disk, with the network off."""
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


def counted(found: Opened) -> int:
    """The number that is said once all is counted."""
    # The policy of the page allows no string as a program, which waiting for a condition would be.
    found.get(
        "new Promise((done) => { const ask = () => "
        "oddsmap.occupied === null ? setTimeout(ask, 10) : done(); ask(); })"
    )
    said = found.words()
    number = int(found.get("oddsmap.occupied"))
    assert said.startswith(f"{number:,} occupied voxels, of ")
    return number


def wanted(grid: EvidenceMap, view: Any, least: float) -> npt.NDArray[np.bool_]:
    """Which of the map's cells have hits and are occupied."""
    index, hits, _ = grid.cells()
    occupied: npt.NDArray[np.bool_] = (view.log_odds_at(index) >= logit(least)) & (hits > 0)
    return occupied


def picture(found: Opened) -> npt.NDArray[np.uint8]:
    from PIL import Image

    found.words()
    content = found.page.locator("canvas").screenshot()
    return np.array(Image.open(io.BytesIO(content)))[..., :3]


def test_sliders_draw_as_many_voxels_as_python_has(shown: Opened, room: EvidenceMap) -> None:
    least = room.config.posterior.thresholds.occupied
    usual = counted(shown)
    assert usual == wanted(room, room.log_odds(), least).sum()
    drawn = (picture(shown) != picture(shown)[0, 0]).any(axis=-1).sum()
    assert drawn > 2000
    stats = shown.get("oddsmap.stats")
    assert stats["vertices"] == (room.cells()[1] > 0).sum()
    shown.number("occupied from").fill("0.9")
    assert counted(shown) == wanted(room, room.log_odds(), 0.9).sum() < usual
    assert (picture(shown) != picture(shown)[0, 0]).any(axis=-1).sum() < drawn
    shown.set(pHit=0.9, pMiss=0.2, prior=0.3)
    view = room.log_odds(p_hit=0.9, p_miss=0.2, prior=0.3)
    assert counted(shown) == wanted(room, view, 0.9).sum()
    before = shown.get("oddsmap.stats.draws")
    slider = shown.page.get_by_role("slider", name="p_hit, after a hit")
    slider.focus()
    slider.press("ArrowRight")
    counted(shown)
    after = shown.get("oddsmap.stats")
    assert after["draws"] == before + 1, "a frame is one draw call"
    assert after["uploaded"] == stats["uploaded"], "a slider uploads nothing"


def test_calibrated(shown: Opened, room: EvidenceMap) -> None:
    shown.set(posterior="calibrated", occupied=0.8)
    assert counted(shown) == wanted(room, room.calibrated(), 0.8).sum()
    shown.set(fittedPrior=0.05)
    assert counted(shown) == wanted(room, room.calibrated(prior=0.05), 0.8).sum()


def test_a_clip_box_cuts_at_the_middle_of_voxels(shown: Opened, room: EvidenceMap) -> None:
    shown.page.get_by_text("Clip box").click()
    index, _, _ = room.cells()
    occupied = wanted(room, room.log_odds(), room.config.posterior.thresholds.occupied)
    ends = {"x": (-24.3, -18.1), "y": (5_500_000.1, 5_500_004.9), "z": (-0.4, 0.9)}
    inside = occupied.copy()
    for axis, (name, (low, high)) in enumerate(ends.items()):
        middle = (index[:, axis] + 0.5) * RESOLUTION
        inside &= (middle >= low) & (middle < high)
        shown.number(f"{name} from [m]").fill(str(low))
        shown.number(f"{name} to [m]").fill(str(high))
    assert counted(shown) == inside.sum() > 0
    assert inside.sum() < occupied.sum()


def test_what_is_not_drawn_is_told(shown: Opened, room: EvidenceMap) -> None:
    """Voxels without a hit, of which one with one pass is occupied from a high prior on."""
    doubt = shown.page.locator(".doubt")
    assert not doubt.is_visible()
    assert (room.cells()[1] == 0).any()
    shown.set(prior=0.9, pMiss=0.4)
    assert "voxels without a hit are occupied, too" in doubt.inner_text()


@pytest.mark.parametrize("above", [True, False])
def test_the_nearer_voxel_hides_the_farther(browser: Browser, tmp_path: Path, above: bool) -> None:
    grid = EvidenceMap(1.0, ndim=3)
    grid.add_cells(np.array([[0, 0, 0], [0, 0, 4]]), np.array([9, 9]) * ONE, np.zeros(2, np.int64))
    with opened(browser, page_of(grid, tmp_path), offline=True) as found:
        found.get("(oddsmap.camera.fit(0, p), oddsmap.store.set({}))", p=1.57 if above else -1.57)
        found.get("(oddsmap.camera.zoom(0.5), oddsmap.store.set({}))")
        image = picture(found)
        seen = image[image.shape[0] // 2, image.shape[1] // 2].astype(float)
        # The ends of the ramp of heights; a face that is seen from below is darker.
        want = np.array([253, 231, 37]) if above else np.array([68, 1, 84]) * 0.55
        assert np.abs(seen - want).max() <= 3
        # The box fills just the pixels that it covers: a square, as seen along an axis.
        there = (image[:-130] != image[0, 0]).any(axis=-1)  # without words and axes
        rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
        assert there[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()
        focal, distance = found.get("[oddsmap.camera.focal, oddsmap.camera.distance]")
        assert len(rows) == pytest.approx(focal / (distance - 2.5), abs=2)
        assert len(columns) == pytest.approx(len(rows), abs=2)
        assert found.complaints == []


def test_mouse_and_keys_turn_and_move(shown: Opened) -> None:
    def state() -> list[float]:
        return list(
            shown.get("[...oddsmap.camera.eye(), oddsmap.camera.yaw, oddsmap.camera.pitch]")
        )

    page = shown.page
    page.locator("canvas").focus()
    seen = [state()]
    for key in ("ArrowLeft", "ArrowUp", "w", "a", "e", "+", "1"):
        page.keyboard.press(key)
        seen.append(state())
        assert seen[-1] != seen[-2], key
    page.keyboard.press("0")
    assert state() == pytest.approx(seen[0])
    box = page.locator("canvas").bounding_box()
    assert box is not None
    target = shown.get("oddsmap.camera.target")
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 260, box["y"] + 220)
    assert shown.get("oddsmap.camera.target") == target, "orbit keeps the middle"
    assert state()[3:] != seen[0][3:]
    page.mouse.up()
    shown.set(drag="fly")
    eye = state()[:3]
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.up()
    assert state()[:3] == pytest.approx(eye), "to fly keeps the eye"
    assert shown.get("oddsmap.camera.target") != target
    page.mouse.wheel(0, -240)
    assert state()[:3] != pytest.approx(eye)


def test_fingers_turn_move_and_zoom(browser: Browser, room: EvidenceMap, tmp_path: Path) -> None:
    with opened(browser, page_of(room, tmp_path), offline=True, has_touch=True) as found:
        touch = found.page.context.new_cdp_session(found.page)

        def send(kind: str, *places: tuple[int, int]) -> None:
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            touch.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})
            found.words()

        def state() -> dict[str, Any]:
            camera = "(({ yaw, pitch, distance, target }) => ({ yaw, pitch, distance, target }))"
            return dict(found.get(f"{camera}(oddsmap.camera)"))

        fitted = state()
        send("Start", (200, 200))
        send("Move", (260, 230))
        send("End")
        turned = state()
        assert turned["yaw"] < fitted["yaw"]
        assert turned["pitch"] > fitted["pitch"]
        assert (turned["target"], turned["distance"]) == (fitted["target"], fitted["distance"])
        send("Start", (200, 200), (300, 200))
        send("Move", (150, 200), (350, 200))
        apart = state()
        assert apart["distance"] == pytest.approx(turned["distance"] / 2, rel=0.01)
        send("Move", (150, 260), (350, 260))
        send("End")
        moved = state()
        assert moved["target"] != pytest.approx(apart["target"])
        assert moved["distance"] == pytest.approx(apart["distance"], rel=0.05)
        assert (moved["yaw"], moved["pitch"]) == (turned["yaw"], turned["pitch"])
        assert found.complaints == []


def test_the_bar_is_as_long_as_it_says_and_axes_point_their_way(shown: Opened) -> None:
    shown.get("(oddsmap.camera.zoom(3), oddsmap.camera.turn(40, 30), oddsmap.store.set({}))")
    shown.words()
    bar = shown.page.locator(".scale-bar")
    ((length, unit),) = re.findall(r"^(\S+) (\S+) \(middle\)$", bar.inner_text())
    voxels = float(length) * {"km": 1000, "m": 1, "cm": 0.01, "mm": 0.001}[unit] / RESOLUTION
    seen = (
        "(along, far) => oddsmap.camera.seen("
        "oddsmap.camera.target.map((x, i) => x + along[i] * far)).slice(0, 2)"
    )
    middle, end = shown.get(
        f"[0, n].map((far) => ({seen})(oddsmap.camera.axes()[0], far))", n=voxels
    )
    width = shown.get("document.querySelector('.scale-bar').style.width")
    assert np.hypot(*np.subtract(end, middle)) == pytest.approx(float(width[:-2]), rel=1e-3)
    for axis, name in enumerate("xyz"):
        line = shown.page.locator(f".axes .{name}")
        drawn = [float(line.get_attribute(end) or "nan") for end in ("x2", "y2")]
        along = [float(i == axis) for i in range(3)]
        tip = shown.get(f"({seen})(along, 1e-3)", along=along)
        way = np.arctan2(tip[1] - middle[1], tip[0] - middle[0])
        assert np.arctan2(drawn[1], drawn[0]) == pytest.approx(way, abs=0.05)


def test_legend_and_command_are_in_sight(
    browser: Browser, room: EvidenceMap, tmp_path: Path
) -> None:
    size = {"width": 1280, "height": 800}
    with opened(browser, page_of(room, tmp_path), offline=True, viewport=size) as found:
        for part in (found.page.locator(".legend"), found.page.get_by_text("Copy command")):
            box = part.bounding_box()
            assert box is not None
            assert box["y"] + box["height"] <= 800
        assert not found.number("x from [m]").is_visible()
        found.page.get_by_text("Clip box").click()
        assert found.number("x from [m]").is_visible()


def test_a_copied_command_runs(
    shown: Opened, room: EvidenceMap, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    room.save(tmp_path / "room.zarr")
    monkeypatch.chdir(tmp_path)
    shown.set(pHit=0.9, occupied=0.8)
    command = shown.page.locator("code").inner_text()
    assert command == "oddsmap export room.zarr room.ply --p-hit 0.9 --occupied 0.8"
    monkeypatch.setattr(sys, "argv", shlex.split(command))
    with pytest.raises(SystemExit) as end:
        main()
    assert not end.value.code
    assert f"element vertex {counted(shown)}\n".encode() in (tmp_path / "room.ply").read_bytes()


@pytest.mark.parametrize(("scheme", "width"), [("light", 900), ("dark", 380)])
def test_axe_finds_nothing(
    browser: Browser, room: EvidenceMap, tmp_path: Path, scheme: str, width: int
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    options = {"color_scheme": scheme, "viewport": {"width": width, "height": 700}}
    with opened(browser, page_of(room, tmp_path), offline=True, **options) as found:
        found.set(prior=0.9, clamped=True, sliced=True, voxels="known")
        found.page.get_by_text("Clip box").click()
        counted(found)
        report = axe.Axe().run(found.page)
        assert report.violations_count == 0, report.generate_report()
