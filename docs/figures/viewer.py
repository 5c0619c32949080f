# SPDX-License-Identifier: Apache-2.0
"""The simulated office in the page of `oddsmap view`: by day with a cell pointed at, and by night.

python docs/figures/viewer.py        # writes docs/images/viewer.png; needs Chromium and playwright
"""

from __future__ import annotations

import io
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from oddsmap import EvidenceMap, build_map
from oddsmap.simulate import Lidar2D, office_drive, office_plan
from oddsmap.viewer.document import single_page
from oddsmap.viewer.plane import plane_payload

if TYPE_CHECKING:
    from playwright.sync_api import Browser

OUTPUT = Path(__file__).resolve().parent.parent / "images" / "viewer.png"
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


def main() -> None:
    """Write the picture."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    grid = office()
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "office.html"
        path.write_text(single_page("office.zarr", plane_payload(grid, "office.zarr")))
        program = shutil.which("chromium") or shutil.which("google-chrome")
        browser = playwright.chromium.launch(executable_path=program, args=OPTIONS)
        views = (("light", 0, "log-odds"), ("dark", 5, "calibrated"))
        shown = [Image.open(io.BytesIO(picture(browser, path, *view))) for view in views]
        browser.close()
    both = Image.new("RGB", (2 * WIDTH + 10, HEIGHT), "white")
    for i, image in enumerate(shown):
        both.paste(image, (i * (WIDTH + 10), 0))
    both.quantize(256).save(OUTPUT, optimize=True)


if __name__ == "__main__":
    main()
