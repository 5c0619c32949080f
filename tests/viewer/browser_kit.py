# SPDX-License-Identifier: Apache-2.0
"""The page of the viewer in headless Chromium."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_OPTIONS = [
    "--headless=new", "--no-sandbox", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    # WebGL 2 without a graphics card.
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
]  # fmt: skip


@contextmanager
def chromium() -> Iterator[Browser]:
    """The browser of this machine; skips the test where there is none."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    named = os.environ.get("ODDSMAP_CHROMIUM")
    path = named or next(filter(None, map(shutil.which, _NAMES)), None)
    if path is None:
        pytest.skip("no Chromium is installed; ODDSMAP_CHROMIUM may name one")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=_OPTIONS)
        yield browser
        browser.close()


@dataclass
class Opened:
    """A page that shows a map, with what it complained of and what it asked the network for."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def get(self, expression: str, **given: Any) -> Any:
        """The value of an expression of `oddsmap`, the viewer of the page, and what is given."""
        names = ", ".join(given)
        return self.page.evaluate(f"({{ {names} }}) => ({expression})", given)

    def set(self, **settings: Any) -> None:
        """Change settings by the names that the page has for them."""
        self.get("oddsmap.store.set(settings)", settings=settings)

    def reset(self) -> None:
        """Everything as the map has it."""
        self.page.get_by_role("button", name="As the map has it").click()

    def probe(self, cells: list[tuple[int, int]], level: int = 0) -> list[dict[str, Any]]:
        """Of each cell what is drawn, `shown`, what is said, `exact`, and its `votes`."""
        return list(
            self.get("oddsmap.probe(level, cells)", level=level, cells=list(map(list, cells)))
        )

    def look_at(self, cell: tuple[int, int]) -> None:
        """Zoom in on a cell of the map as far as it goes."""
        middle = {"x": cell[0] + 0.5, "y": cell[1] + 0.5}
        self.get("(Object.assign(oddsmap.camera, middle), oddsmap.camera.zoom(1e9))", middle=middle)

    def words(self) -> str:
        """What is said of the cell that is pointed at, once it is drawn."""
        self.page.evaluate("new Promise((f) => requestAnimationFrame(() => setTimeout(f)))")
        return str(self.page.locator(".readout").inner_text())

    def number(self, label: str) -> Any:
        """The field of a number."""
        return self.page.get_by_role("spinbutton", name=label)


@contextmanager
def opened(browser: Browser, url: str, **options: Any) -> Iterator[Opened]:
    """A page, once its map is shown."""
    size = options.pop("viewport", {"width": 900, "height": 640})
    context = browser.new_context(viewport=size, **options)
    found = Opened(context.new_page())
    found.page.on("console", lambda said: found.complaints.append(f"{said.type}: {said.text}"))
    found.page.on("pageerror", lambda error: found.complaints.append(str(error)))
    found.page.on("request", lambda request: found.requests.append(request.url))
    found.page.goto(url)
    found.page.wait_for_selector(".map canvas, [role=alert]")
    assert found.page.locator("[role=alert]").all_inner_texts() == []
    yield found
    context.close()


def file_url(path: Path) -> str:
    return path.resolve().as_uri()
