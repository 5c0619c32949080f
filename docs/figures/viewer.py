# SPDX-License-Identifier: Apache-2.0
"""Simulated maps in the page of `oddsmap view`: the office, and the town in space.

python docs/figures/viewer.py        # needs Chromium and playwright

Writes docs/images/viewer.png, by day with a cell pointed at, and by night, and viewer-space.png,
with a voxel pointed at, and with a slice.
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from oddsmap import EvidenceMap, build_map
from oddsmap.simulate import Lidar2D, Lidar3D, drive3d, office_drive, office_plan, town
from oddsmap.viewer.document import single_page
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload

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


def office() -> EvidenceMap:
    """A drive through the office."""
    plan, lidar, rng = office_plan(), Lidar2D(p_dropout=0.01), np.random.default_rng(0)
    grid = build_map((lidar.scan(plan, pose, rng) for pose in office_drive(200)), 0.05)
    grid.provenance.clear()
    grid.record("office.log.gz", scans=200)
    return grid


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

    grid, space = office(), street()
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "office.html"
        path.write_text(single_page("office.zarr", plane_payload(grid, "office.zarr")))
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=program, args=OPTIONS)
        views = (("light", 0, "log-odds"), ("dark", 5, "calibrated"))
        write([picture(browser, path, *view) for view in views], "viewer.png")
        path = Path(folder) / "town.html"
        path.write_text(single_page("town.zarr", space_payload(space, "town.zarr")))
        programs = (
            ("light", "(oddsmap.camera.zoom(1.25), oddsmap.store.set({}))", (193, 364)),
            (
                "dark",
                "(oddsmap.camera.zoom(4), oddsmap.camera.turn(0, -60),"
                " oddsmap.store.set({ sliced: true, sliceAt: 1 }))",
                (195, 335),
            ),
        )
        shown = [picture_in_space(browser, path, *program) for program in programs]
        write(shown, "viewer-space.png")
        browser.close()


if __name__ == "__main__":
    main()
