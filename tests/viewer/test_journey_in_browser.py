# SPDX-License-Identifier: Apache-2.0
"""A map with its log in a browser: what the page shows of scans and votes is what Python finds."""

from __future__ import annotations

import base64
import io
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import oddsmap
from oddsmap import BeamSensor, EvidenceMap, build_map, open_log
from oddsmap.kernels.units import ONE
from oddsmap.simulate import Lidar2D, Lidar3D, drive3d, office_drive, office_plan, town
from oddsmap.viewer.document import single_page
from oddsmap.viewer.journey import read_journey
from oddsmap.viewer.journey_payload import journey_payload
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.questions import LogQuestions
from oddsmap.viewer.server import PageServer
from oddsmap.viewer.space import space_payload
from oddsmap.witnesses.why import sensor_models
from tests.viewer.browser_kit import Opened, file_url, opened
from tests.viewer.journey_kit import log_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CELL = 0.05


@pytest.fixture(scope="module")
def office() -> tuple[EvidenceMap, Any]:
    """The simulated office: its map and its log."""
    plan, lidar, rng = office_plan(), Lidar2D(p_dropout=0.05), np.random.default_rng(0)
    log = log_of([lidar.scan(plan, pose, rng) for pose in office_drive(40)], range_max=15.0)
    return build_map(log, CELL), log


def journey_of(grid: EvidenceMap, log: Any, *, served: bool, beams: int = 0) -> bytes:
    facts = {"log": "office.log", "served": served, "build": None, "options": ["--skip-bad"],
        "why": ["oddsmap", "why", "office map.zarr", "office.log"]}  # fmt: skip
    return journey_payload(read_journey(log, sensor_models(grid, log), beams=beams), facts)


@contextmanager
def serving(grid: EvidenceMap, log: Any) -> Iterator[str]:
    payload = (plane_payload if grid.ndim == 2 else space_payload)(grid, "office.zarr")
    questions = LogQuestions(grid, log, len(log))
    journey = journey_of(grid, log, served=True)
    with PageServer("office", payload, journey=journey, questions=questions) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield server.url
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture(scope="module")
def served(browser: Browser, office: tuple[EvidenceMap, Any]) -> Iterator[Opened]:
    size = {"width": 640, "height": 600}
    with serving(*office) as url, opened(browser, url, viewport=size) as found:
        yield found
        assert found.complaints == []
        assert all(request.startswith((url, "data:")) for request in found.requests)


def slider(found: Opened) -> Any:
    return found.page.get_by_role("slider", name="Scan of the log")


def said(found: Opened) -> str:
    return str(found.page.locator(".time-bar").inner_text())


def drawn(found: Opened) -> dict[str, Any]:
    """The beams that are drawn."""
    beams = "oddsmap.log.beams"
    return dict(found.get(f"{{ ends: [...{beams}.ends], returned: [...{beams}.returned] }}"))


def picture(found: Opened) -> Any:
    """What is drawn above the map, shape (h, w, 4)."""
    from PIL import Image

    found.page.evaluate("new Promise((f) => requestAnimationFrame(() => setTimeout(f)))")
    code = "document.querySelector('canvas.overlay').toDataURL().split(',')[1]"
    return np.array(Image.open(io.BytesIO(base64.b64decode(found.page.evaluate(code)))))


def arrow_at(found: Opened, x: float, y: float) -> bool:
    """Whether the middle of the mark of the sensor comes to be drawn where a point shows."""
    for _ in range(20):
        at = "((eye) => eye.see(x, y, 0).concat(eye.width / 2, eye.height / 2))(oddsmap.eye())"
        right, up, _, middle, half = found.get(at, x=x, y=y)
        shown = picture(found)[int(half - up), int(middle + right)]
        if shown.tolist() == [11, 92, 173, 255]:
            return True
    return False


def test_the_slider_moves_the_sensor(served: Opened, office: tuple[EvidenceMap, Any]) -> None:
    log = office[1]
    served.page.get_by_label("Trajectory").uncheck()
    served.page.get_by_label("Beams").uncheck()
    slider(served).fill("7")
    first = log[7].map_from_sensor
    assert arrow_at(served, first.x, first.y)
    text = said(served)
    assert "scan 7 of 0 to 39, 7.00 s" in text
    x, y = (f"{value:.3f}".replace("-", "\u2212") for value in first.translation)
    assert f"x {x}, y {y}, yaw " in text
    slider(served).press("ArrowRight")
    second = log[8].map_from_sensor
    assert "scan 8 of" in said(served)
    assert arrow_at(served, second.x, second.y)
    assert slider(served).get_attribute("aria-valuetext").startswith("scan 8 of 0 to 39, 8.00 s")
    lonely = int((picture(served)[..., 3] > 0).sum())
    served.page.get_by_label("Trajectory").check()
    assert int((picture(served)[..., 3] > 0).sum()) > 2 * lonely


def test_the_beams_of_a_scan(served: Opened, office: tuple[EvidenceMap, Any]) -> None:
    grid, log = office
    served.page.get_by_label("Beams").check()
    slider(served).fill("5")
    served.page.wait_for_function("() => oddsmap.log.bar.scan === 5 && oddsmap.log.beams")
    beams = drawn(served)
    scan = log[5]
    ranges = np.where(scan.ranges < 15.0, scan.ranges, 15.0)
    ends = scan.map_from_sensor.transform(scan.directions * ranges[:, None])
    assert np.allclose(np.reshape(beams["ends"], (-1, 3))[:, :2], ends, atol=1e-4)
    seen = int((scan.ranges < 15.0).sum())
    assert f"{scan.size} beams: {seen} with a return, {scan.size - seen} without" in said(served)
    assert isinstance(grid.sensor, BeamSensor)


def test_only_some_beams_are_drawn_and_that_is_said(browser: Browser) -> None:
    angles = np.linspace(-np.pi, np.pi, 1001)
    scan = oddsmap.Scan.from_angles((1.0, 1.0, 0.3), angles, np.where(angles > 3.0, np.nan, 2.0))
    log = log_of([scan, scan])
    with serving(build_map(log, 0.1), log) as url, opened(browser, url) as found:
        found.page.wait_for_function("() => oddsmap.log.beams")
        silent = int((angles > 3.0).sum())
        assert "401 of 1,001 beams, evenly chosen: 401 with a return" in said(found)
        assert f"{silent} of the scan say nothing" in said(found)


def click_on(found: Opened, cell: tuple[int, int]) -> None:
    found.look_at(cell)
    box = found.page.locator(".map canvas").first.bounding_box()
    assert box is not None
    found.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)


def test_a_click_lists_who_voted(served: Opened, office: tuple[EvidenceMap, Any]) -> None:
    grid, log = office
    index, hits, passes = grid.cells()
    for cell in (index[np.argmax(hits)], index[np.argmax(passes)]):
        x, y = (int(i) for i in cell)
        click_on(served, (x, y))
        served.page.wait_for_function(
            "(cell) => oddsmap.log.why.answer?.cell.join() === cell", arg=f"{x},{y}"
        )
        found = oddsmap.why(grid, log, grid.centre_of([cell])[0])
        text = served.page.get_by_role("region", name="Why is this cell so?").inner_text()
        assert f"Cell {x}, {y}".replace("-", "\u2212") in text
        assert f"{len(found.scans)} of 40 scans voted: {found.hits:g} hits, " in text
        assert "which is not what" not in text
        items = served.page.locator(".votes li").all_inner_texts()
        assert len(items) == len(found.scans)
        for item, vote in zip(items, found.scans, strict=True):
            assert item.startswith(f"scan {vote.index}, {vote.index}.0 s, {vote.hits:g} hit")
            hit = vote.beam_hits > 0
            for beam, reading in zip(vote.beams[hit][:2], vote.ranges[hit][:2], strict=True):
                assert f"beam {beam} hit {float(f'{reading:.4g}'):g} m" in item
    last = found.scans[-1].index
    served.page.locator(".votes button").last.click()
    assert f"scan {last} of" in said(served)
    current = served.page.locator(".votes button[aria-current=true]")
    assert current.inner_text().startswith(f"scan {last},")
    served.page.get_by_role("button", name="Clear").click()
    assert served.page.locator(".votes li").count() == 0
    assert served.get("oddsmap.log.why.cell") is None


def asked_and_described(found: Opened) -> tuple[str, str]:
    """The cell that was asked about, and the one below the map."""
    found.page.wait_for_function("() => oddsmap.log.why.cell")
    asked = "cell " + ", ".join(map(str, found.get("oddsmap.log.why.cell")))
    return asked, found.words().replace("\u2212", "-")


def test_what_is_asked_about_is_what_is_pointed_at(served: Opened) -> None:
    """A click comes in whole pixels, a pointer is between them: from afar that is another cell."""
    served.get("oddsmap.camera.fit()")
    box = served.page.locator(".map canvas").first.bounding_box()
    assert box is not None
    for far in range(10):
        served.get("oddsmap.log.why.clear.click()")
        at = (0.3 + 0.04 * far) * box["width"], 0.5 * box["height"]
        served.page.mouse.click(box["x"] + int(at[0]) + 0.9, box["y"] + int(at[1]) + 0.9)
        asked, words = asked_and_described(served)
        assert f"{asked}\n" in words


def test_a_tap_describes_and_asks(browser: Browser, office: tuple[EvidenceMap, Any]) -> None:
    with serving(*office) as url, opened(browser, url, has_touch=True) as found:
        found.page.locator(".map canvas").first.tap()
        asked, words = asked_and_described(found)
        assert f"{asked}\n" in words


def test_dragging_and_a_double_click_ask_once_or_not(served: Opened) -> None:
    asked = len([url for url in served.requests if "why?" in url])
    box = served.page.locator(".map canvas").first.bounding_box()
    assert box is not None
    served.page.mouse.move(box["x"] + 100, box["y"] + 100)
    served.page.mouse.down()
    served.page.mouse.move(box["x"] + 160, box["y"] + 130)
    served.page.mouse.up()
    assert len([url for url in served.requests if "why?" in url]) == asked
    served.page.mouse.dblclick(box["x"] + 100, box["y"] + 100)
    served.page.wait_for_function("() => oddsmap.log.why.answer")
    assert len([url for url in served.requests if "why?" in url]) == asked + 1


def test_without_a_mouse(served: Opened, office: tuple[EvidenceMap, Any]) -> None:
    index, hits, _ = office[0].cells()
    x, y = (int(i) for i in index[np.argmax(hits)])
    served.look_at((x, y))
    served.page.locator(".map canvas").first.focus()
    served.page.keyboard.press("Enter")
    served.page.wait_for_function(
        "(cell) => oddsmap.log.why.answer?.cell.join() === cell", arg=f"{x},{y}"
    )
    served.page.locator(".votes button").first.focus()
    served.page.keyboard.press("Enter")
    first = served.page.locator(".votes button[aria-current=true] .vote").inner_text()
    assert f"{first.split(',')[0]} of" in said(served)
    label = served.page.locator(".map canvas").first.get_attribute("aria-label")
    assert "Enter asks which scans voted on it" in str(label)


def point_of(url: str) -> list[float]:
    """Where a question is about."""
    return [float(word) for word in url.partition("at=")[2].split(",")]


def test_a_later_click_counts(served: Opened) -> None:
    """And what is being worked at is said."""
    page = served.page
    held: list[Any] = []
    page.route("**/why?*", lambda route: held.append(route))
    for cell in ("[1, 2]", "[30, 40]"):
        page.evaluate(f"void oddsmap.log.why.ask({cell})")
        assert "Asking the log about the cell at" in page.locator(".why").inner_text()
    # Requests arrive when they do, and the first one may not, since it is given up.
    side = page.evaluate("oddsmap.facts.resolution")
    later = pytest.approx([30.5 * side, 40.5 * side])
    while not (last := [route for route in held if point_of(route.request.url) == later]):
        page.wait_for_timeout(20)
    last[-1].continue_()
    page.wait_for_function("() => oddsmap.log.why.answer?.cell.join() === '30,40'")
    page.unroute("**/why?*")
    del served.complaints[:]  # Chromium reports the request that was given up


def test_errors_are_a_line(served: Opened, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise oddsmap.InputError("office.log:7: has been changed")

    monkeypatch.setattr("oddsmap.viewer.questions.why", fail)
    served.page.evaluate("void oddsmap.log.why.ask([1, 2])")
    served.page.wait_for_function(
        "() => document.querySelector('.why').innerText.includes('office.log')"
    )
    text = served.page.locator(".answer").inner_text()
    assert text == "The log gives no answer: office.log:7: has been changed"
    assert len(served.complaints) == 1
    assert "400" in served.complaints.pop()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, office: tuple[EvidenceMap, Any]) -> Path:
    """One file with the log."""
    grid, log = office
    path = tmp_path_factory.mktemp("journey") / "office.html"
    journey = journey_of(grid, log, served=False, beams=101)
    page = single_page("office", plane_payload(grid, "office.zarr"), journey)
    path.write_text(page, encoding="utf-8")
    return path


def test_a_file_with_its_log(browser: Browser, file: Path, office: tuple[EvidenceMap, Any]) -> None:
    log = office[1]
    with opened(browser, file_url(file), offline=True) as found:
        slider(found).fill("5")
        beams = drawn(found)
        scan = log[5]
        ranges = np.where(scan.ranges < 15.0, scan.ranges, 15.0)
        every = np.arange(101) * scan.size // 101
        ends = scan.map_from_sensor.transform(scan.directions * ranges[:, None])[every]
        assert np.allclose(np.reshape(beams["ends"], (-1, 3))[:, :2], ends, atol=5e-3)
        assert f"101 of {scan.size} beams, evenly chosen" in said(found)
        slider(found).press("End")
        assert "scan 39 of 0 to 39" in said(found)
        click_on(found, (-3, 12))
        text = found.page.locator(".why").inner_text()
        assert "This page has no log to ask. In a terminal:" in text
        command = "oddsmap why 'office map.zarr' office.log -0.125 0.625 --skip-bad"
        assert found.page.locator(".why code").inner_text() == command
        assert found.complaints == []
        assert all(url.startswith(("file:", "data:")) for url in found.requests)


@pytest.mark.parametrize(("scheme", "width"), [("light", 900), ("dark", 380)])
def test_axe_finds_nothing(
    browser: Browser, office: tuple[EvidenceMap, Any], scheme: str, width: int
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    options = {"color_scheme": scheme, "viewport": {"width": width, "height": 700}}
    grid = office[0]
    index, hits, _ = grid.cells()
    cell = [int(i) for i in index[np.argmax(hits)]]
    with serving(*office) as url, opened(browser, url, **options) as found:
        for answered in (False, True):
            if answered:
                found.page.evaluate("(cell) => void oddsmap.log.why.ask(cell)", cell)
                found.page.wait_for_selector(".votes button")
                found.page.locator(".votes button").first.click()
            report = axe.Axe().run(found.page)
            assert report.violations_count == 0, report.generate_report()
        assert found.complaints == []


@pytest.fixture(scope="module")
def in_space() -> tuple[EvidenceMap, Any]:
    """The simulated town: its map and its log."""
    world, lidar, rng = town(), Lidar3D(), np.random.default_rng(0)
    log = log_of([lidar.scan(world, pose, rng) for pose in drive3d(6, ground=world.ground)])
    return build_map(log, 0.4), log


def test_a_log_in_space(
    browser: Browser, in_space: tuple[EvidenceMap, Any], tmp_path: Path
) -> None:
    grid, log = in_space
    path = tmp_path / "town.html"
    journey = journey_of(grid, log, served=False, beams=101)
    path.write_text(single_page("town", space_payload(grid, "town.zarr"), journey), "utf-8")
    with opened(browser, file_url(path), offline=True) as found:
        slider(found).fill("2")
        assert (picture(found)[..., 3] > 0).sum() > 100
        place = found.get("oddsmap.log.journey.at(2)")
        pose = log[2].map_from_sensor
        assert [place[axis] for axis in "xyz"] == pytest.approx(pose.translation, abs=1e-3)
        beams = drawn(found)
        ends = np.reshape(beams["ends"], (-1, 3))
        # Each is the end of some beam of the scan.
        scan = log[2]
        seen = np.isfinite(scan.ranges)
        points = pose.transform(scan.directions[seen] * scan.ranges[seen, None])
        for end, returned in zip(ends, beams["returned"], strict=True):
            if returned:
                assert np.linalg.norm(points - end, axis=1).min() < 0.02
        assert found.complaints == []


def test_why_a_voxel_is_so(browser: Browser, in_space: tuple[EvidenceMap, Any]) -> None:
    grid, log = in_space
    with serving(grid, log) as url, opened(browser, url) as found:
        # The column of a voxel with hits comes to the middle, seen from above.
        index, hits, _ = grid.cells()
        top = index[np.argmax(index[:, 2] + 1000 * (hits > 3 * ONE))]
        target = [float(x) + 0.5 for x in top - found.get("oddsmap.facts.lo")]
        found.get("(oddsmap.camera.fit(0, 1.5), Object.assign(oddsmap.camera, view))",
            view={"target": target, "distance": 40})  # fmt: skip
        found.page.locator(".map canvas").first.focus()
        found.page.keyboard.press("Enter")
        found.page.wait_for_selector(".votes button")
        cell = found.get("oddsmap.log.why.answer.cell")
        assert cell[:2] == top[:2].tolist()
        want = oddsmap.why(grid, log, grid.centre_of([cell])[0])
        scans = found.get("oddsmap.log.why.answer.scans.map(({ index }) => index)")
        assert scans == [vote.index for vote in want.scans] != []
        assert f"{len(scans)} of 6 scans voted" in found.page.locator(".answer").inner_text()
        assert found.complaints == []


@pytest.mark.realdata
def test_the_intel_log(browser: Browser, data_folder: Path) -> None:
    log = open_log(data_folder / "laser2d" / "intel-corrected.log.gz")
    grid = build_map(log, 0.05)
    index, hits, _ = grid.cells()
    cell = [int(i) for i in index[np.argmax(hits)]]
    with serving(grid, log) as url, opened(browser, url) as found:
        found.page.evaluate("(cell) => void oddsmap.log.why.ask(cell)", cell)
        found.page.wait_for_selector(".votes button")
        scans = found.get("oddsmap.log.why.answer.scans.map(({ index }) => index)")
        want = oddsmap.why(grid, log, grid.centre_of([cell])[0])
        assert scans == [vote.index for vote in want.scans]
        assert found.complaints == []
