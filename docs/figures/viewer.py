# SPDX-License-Identifier: Apache-2.0
"""Simulated maps in the page of `oddsmap view`: the office, with its log, and the town in space.

python docs/figures/viewer.py        # needs Chromium and playwright

Writes docs/images/viewer.png, by day with a cell pointed at, and by night, viewer-log.png,
viewer-space.png, with a voxel pointed at and with a slice, and viewer-full-map.png, a map of sonars
beside the full map of the same log, with landmarks.
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

from oddsmap import EvidenceMap, LandmarkMap, build_full_map, build_map
from oddsmap.landmarks.observations import Observations
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.sensors.cone import ConeSensor
from oddsmap.simulate import Lidar2D, Lidar3D, Sonar2D, drive3d, office_drive, office_plan, town
from oddsmap.viewer.document import single_page
from oddsmap.viewer.given import given_of
from oddsmap.viewer.journey import read_journey
from oddsmap.viewer.journey_payload import journey_payload
from oddsmap.viewer.landmarks import landmark_facts
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


def sonars() -> bytes:
    """The page of a drive with sonars through the office: counts, the full map, and landmarks."""
    truth = office_plan().rasterise(0.1, (0, 0), (200, 140))
    sonar, rng = Sonar2D(p_random=0.02, p_dropout=0.02), np.random.default_rng(0)
    sensor = ConeSensor(cone_deg=sonar.cone_deg, range_max=sonar.range_max)
    scans = [sonar.scan(truth, 0.1, pose, rng) for pose in office_drive(400)]
    grid = build_map(scans, 0.1, sensor=sensor)
    full = build_full_map(scans, 0.1, sensor=sensor)
    # Columns, round tables, and ends of walls beside doors.
    points = [(9.13, 1.0), (15.3, 2.9), (11.33, 10.2), (16.5, 9.7), (3.7, 6.0), (4.8, 6.0)]
    marks = np.array([*points, (7.3, 6.0), (14.3, 6.0), (16.3, 6.0), (13.5, 11.1)])
    seen = LandmarkMap()
    for pose in office_drive(40):
        there = (marks - pose.translation) @ pose.rotation
        near = np.flatnonzero(np.hypot(*there.T) < 6.0)
        noise = np.broadcast_to(np.eye(2) * 0.3**2, (len(near), 2, 2))
        values = there[near] + 0.3 * rng.standard_normal((len(near), 2))
        seen.add(Observations(pose, "position", values, noise, near))
    grid.provenance.clear()
    grid.record("sonar.npz", scans=400)
    beside, on_top = given_of(full, "full.zarr"), landmark_facts(seen.landmarks)
    return plane_payload(grid, "sonar.zarr", [beside], landmarks=on_top)


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


def picture_in_space(
    browser: Browser, page_file: Path, scheme: str, program: str, at: tuple[int, int]
) -> bytes:
    """The page of voxels, after a program has run on its viewer, and a pixel is pointed at."""
    context = browser.new_context(
        viewport={"width": WIDTH, "height": HEIGHT},
        color_scheme="dark" if scheme == "dark" else "light",
    )
    page = context.new_page()
    page.goto(page_file.as_uri())
    page.wait_for_selector(".map canvas")
    page.evaluate(program)
    page.mouse.move(*at)
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
            ("light", "(oddsmap.camera.zoom(1.25), oddsmap.store.set({}))", (336, 231)),
            (
                "dark",
                "(oddsmap.camera.zoom(4), oddsmap.camera.turn(0, -60),"
                " oddsmap.store.set({ sliced: true, sliceAt: 1 }))",
                (195, 335),
            ),
        )
        shown = [picture_in_space(browser, path, *program) for program in programs]
        write(shown, "viewer-space.png")
        path = Path(folder) / "sonar.html"
        path.write_text(single_page("sonar.zarr", sonars()))
        programs = (
            ("light", "oddsmap.store.set({ landmarks: false })", (300, 200)),
            ("light", "oddsmap.store.set({ posterior: 'given0' })", (300, 200)),
        )
        shown = [picture_in_space(browser, path, *program) for program in programs]
        write(shown, "viewer-full-map.png")
        browser.close()


if __name__ == "__main__":
    main()
