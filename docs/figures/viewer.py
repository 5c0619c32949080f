# SPDX-License-Identifier: Apache-2.0
"""Simulated maps in the page of `oddsmap view`: the office, with its log, and the town in space.

python docs/figures/viewer.py        # needs Chromium and playwright

Writes docs/images/viewer.png, by day with a cell pointed at, and by night, viewer-log.png and
viewer-space.png.
"""

from __future__ import annotations

import io
import shutil
import threading
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from oddsmap import EvidenceMap, build_map
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.simulate import Lidar2D, Lidar3D, drive3d, office_drive, office_plan, town
from oddsmap.viewer.document import single_page
from oddsmap.viewer.journey import read_journey
from oddsmap.viewer.journey_payload import journey_payload
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.questions import LogQuestions
from oddsmap.viewer.server import PageServer
from oddsmap.viewer.space import space_payload
from oddsmap.witnesses.why import sensor_models

if TYPE_CHECKING:
    from playwright.sync_api import Browser

IMAGES = Path(__file__).resolve().parent.parent / "images"
WIDTH, HEIGHT = 1000, 640
OPTIONS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


def office() -> tuple[EvidenceMap, LoadedLog]:
    """A drive through the office."""
    plan, lidar, rng = office_plan(), Lidar2D(p_dropout=0.01), np.random.default_rng(0)
    scans = [lidar.scan(plan, pose, rng) for pose in office_drive(200)]
    for i, scan in enumerate(scans):
        object.__setattr__(scan, "stamp_ns", i * 10**9)
    log = LoadedLog("office.log.gz", "simulated", {}, Counter(), (), tuple(scans))
    return build_map(log, 0.05), log


def street() -> EvidenceMap:
    """A drive through the town."""
    world, lidar, rng = town(), Lidar3D(), np.random.default_rng(0)
    poses = drive3d(40, ground=world.ground)
    grid = build_map((lidar.scan(world, pose, rng) for pose in poses), 0.2)
    grid.provenance.clear()
    grid.record("town", scans=40)
    return grid


def picture(browser: Browser, page_file: Path, scheme: str, notches: int, posterior: str) -> bytes:
    """The page, zoomed in by notches of the wheel on a wall."""
    context = browser.new_context(
        viewport={"width": WIDTH, "height": HEIGHT},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page = context.new_page()
    page.goto(page_file.as_uri())
    page.get_by_label("Posterior").select_option(posterior)
    page.mouse.move(262, 203)
    for _ in range(notches):
        page.mouse.wheel(0, -120)
    page.wait_for_timeout(1000)
    content = bytes(page.screenshot())
    context.close()
    return content


def picture_of_log(browser: Browser, url: str, scheme: str, cell: list[int]) -> bytes:
    """The page with a log: all of the way, or near a cell of which it was asked why it is so."""
    context = browser.new_context(
        viewport={"width": WIDTH, "height": HEIGHT},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page = context.new_page()
    page.goto(url)
    page.wait_for_selector(".time-bar")
    if scheme == "dark":
        page.evaluate("([x, y]) => (Object.assign(oddsmap.camera, { x, y }), 0)", cell)
        page.evaluate(
            "([x, y]) => void (oddsmap.camera.zoom(3), oddsmap.log.why.ask([x, y]))", cell
        )
        page.wait_for_selector(".votes button")
        page.locator(".votes button").nth(12).click()
    else:
        page.evaluate("oddsmap.log.bar.scan = 120")
    page.wait_for_timeout(1500)
    content = bytes(page.screenshot())
    context.close()
    return content


def pictures_of_log(browser: Browser, grid: EvidenceMap, log: LoadedLog) -> list[bytes]:
    """Both pages with a log, from a server."""
    facts = {"log": "office.log.gz", "served": True, "build": None, "options": [], "why": []}
    journey = journey_payload(read_journey(log, sensor_models(grid, log)), facts)
    index, hits, _ = grid.cells()
    cell = [int(i) for i in index[np.argmax(hits)]]
    payload, questions = plane_payload(grid, "office.zarr"), LogQuestions(grid, log, len(log))
    with PageServer("office.zarr", payload, journey=journey, questions=questions) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        shown = [picture_of_log(browser, server.url, scheme, cell) for scheme in ("light", "dark")]
        server.shutdown()
        thread.join()
    return shown


def picture_in_space(browser: Browser, page_file: Path, scheme: str, program: str) -> bytes:
    """The page of voxels, after a program has run on its viewer."""
    context = browser.new_context(
        viewport={"width": WIDTH, "height": HEIGHT},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page = context.new_page()
    page.goto(page_file.as_uri())
    page.wait_for_selector(".map canvas")
    page.evaluate(program)
    page.wait_for_timeout(1500)
    content = bytes(page.screenshot())
    context.close()
    return content


def write(pictures: list[bytes], name: str) -> None:
    """Pictures side by side."""
    from PIL import Image

    both = Image.new("RGB", (2 * WIDTH + 10, HEIGHT), "white")
    for i, content in enumerate(pictures):
        both.paste(Image.open(io.BytesIO(content)), (i * (WIDTH + 10), 0))
    both.quantize(256).save(IMAGES / name, optimize=True)


def main() -> None:
    """Write the pictures."""
    from playwright.sync_api import sync_playwright

    (grid, log), space = office(), street()
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "office.html"
        path.write_text(single_page("office.zarr", plane_payload(grid, "office.zarr")))
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=program, args=OPTIONS)
        views = (("light", 0, "log-odds"), ("dark", 5, "calibrated"))
        write([picture(browser, path, *view) for view in views], "viewer.png")
        write(pictures_of_log(browser, grid, log), "viewer-log.png")
        path = Path(folder) / "town.html"
        path.write_text(single_page("town.zarr", space_payload(space, "town.zarr")))
        programs = (
            ("light", "(oddsmap.camera.zoom(1.25), oddsmap.store.set({}))"),
            (
                "dark",
                "(oddsmap.camera.zoom(4), oddsmap.camera.turn(0, -60),"
                " oddsmap.store.set({ paint: 'hits', zHigh: 8 }))",
            ),
        )
        shown = [picture_in_space(browser, path, *program) for program in programs]
        write(shown, "viewer-space.png")
        browser.close()


if __name__ == "__main__":
    main()
