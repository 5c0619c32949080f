# SPDX-License-Identifier: Apache-2.0
"""The widget in a page that gives it models as anywidget does, several beside each other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import oddsmap
from oddsmap import EvidenceMap, build_map
from oddsmap.kernels.units import ONE
from oddsmap.simulate import Lidar2D, office_drive, office_plan
from oddsmap.viewer.document import page_part
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload
from tests.viewer.test_in_browser import SINGLE, some

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page, Route

HOST = "http://notebook.test/"
# What a notebook is to a widget: elements, and models with events. The page's own style would
# change every button and every paragraph that it reaches.
PAGE = """<!doctype html><html lang="en"><title>A notebook</title><link rel="icon" href="data:,">
<style>button, p, div { color: #fe00fe !important; font-size: 40px }</style>
<body data-jp-theme-light="THEME"><main><h1>Maps</h1></main><script type="module">
import widget from "./widget.js";
class Model {
  constructor(state) { this.state = state; this.listeners = {}; this.saved = 0; }
  get(name) { return this.state[name]; }
  set(name, value) {
    if (this.state[name] === value) return;
    this.state[name] = value;
    for (const listener of this.listeners[`change:${name}`] ?? []) listener();
  }
  on(event, listener) { (this.listeners[event] ??= new Set()).add(listener); }
  off(event, listener) { this.listeners[event]?.delete(listener); }
  save_changes() { this.saved += 1; }
}
globalThis.models = [];
globalThis.shown = [];
globalThis.show = async (number) => {
  const el = document.createElement("div");
  document.querySelector("main").append(el);
  const close = await widget.render({ model: models[number], el });
  shown.push({ el, close, viewer: el.firstChild.oddsmap });
};
globalThis.add = async (state, name) => {
  const bytes = name ? await (await fetch(name)).arrayBuffer() : new ArrayBuffer(0);
  models.push(new Model({ ...state, payload: new DataView(bytes) }));
};
globalThis.ready = true;
</script>"""


def state_of(grid: EvidenceMap, **others: Any) -> dict[str, Any]:
    """As in `oddsmap.viewer.map_widget`."""
    own = grid.config.posterior
    return {
        "posterior": "log-odds", "height": 260, "linked": True, "p_hit": grid.sensor.p_hit,
        "p_miss": grid.sensor.p_miss, "prior": own.prior, "free": own.thresholds.free,
        "occupied": own.thresholds.occupied, **others,
    }  # fmt: skip


@pytest.fixture(scope="module")
def office() -> EvidenceMap:
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    return build_map([lidar.scan(plan, pose, rng) for pose in office_drive(20)], 0.1, votes="beam")


@pytest.fixture
def notebook(
    browser: Browser, office: EvidenceMap, request: pytest.FixtureRequest
) -> Iterator[Page]:
    """A notebook whose kernel has the office as `a.bin` and a 3D map as `b.bin`."""
    space = EvidenceMap(0.2, ndim=3)
    index = np.argwhere(np.ones((9, 8, 3)))
    space.add_cells(index, np.full(len(index), 2 * ONE), np.full(len(index), ONE))
    files = {
        "": ("text/html", PAGE.replace("THEME", getattr(request, "param", "true")).encode()),
        "widget.js": ("text/javascript", page_part("widget.js")),
        "a.bin": ("application/octet-stream", plane_payload(office, "map")),
        "b.bin": ("application/octet-stream", space_payload(space, "map")),
    }

    def answer(route: Route) -> None:
        kind, content = files[route.request.url.removeprefix(HOST)]
        route.fulfill(content_type=kind, body=content)

    page = browser.new_page(viewport={"width": 760, "height": 640})
    complaints: list[str] = []
    page.on("console", lambda said: complaints.append(f"{said.type}: {said.text}"))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.route("**/*", answer)
    page.goto(HOST)
    page.wait_for_function("globalThis.ready")
    yield page
    page.close()
    assert complaints == []


def show(page: Page, *models: dict[str, Any] | int, file: str | None = "a.bin") -> None:
    """Give the page models, by their state, and show each; a number is a model it has already."""
    for model in models:
        number = model
        if isinstance(model, dict):
            page.evaluate("([state, name]) => add(state, name)", [model, file])
            number = page.evaluate("models.length - 1")
        page.evaluate("(number) => show(number)", number)


def settings(page: Page, number: int) -> dict[str, Any]:
    return dict(page.evaluate(f"shown[{number}].viewer.store.value"))


def check(page: Page, number: int, grid: EvidenceMap, **given: Any) -> None:
    """A map on the page has Python's values."""
    cells = some(grid)
    probes = page.evaluate(
        f"(cells) => shown[{number}].viewer.probe(0, cells)", list(map(list, cells))
    )
    want = grid.log_odds(**given).at((np.array(cells) + 0.5) * grid.resolution)
    for probe, value in zip(probes, want, strict=True):
        assert probe["shown"] == pytest.approx(value, abs=SINGLE)


def test_maps_do_not_disturb_each_other(notebook: Page, office: EvidenceMap) -> None:
    show(notebook, state_of(office), state_of(office, linked=False))
    show(notebook, {**state_of(office), "posterior": "calibrated"}, file="b.bin")
    sliders = notebook.get_by_role("spinbutton", name="p_hit, after a hit")
    assert sliders.count() == 2, "the third shows the calibrated posterior"
    sliders.nth(1).fill("0.9")
    check(notebook, 0, office)
    check(notebook, 1, office, p_hit=0.9)
    assert settings(notebook, 2)["pHit"] == 0.7
    assert notebook.evaluate("models.map((model) => model.get('p_hit'))") == [0.7, 0.7, 0.7]
    assert notebook.evaluate("globalThis.oddsmap === undefined")
    # The style of the page does not get in, and none gets out.
    colour = "(element) => getComputedStyle(element).color"
    button = notebook.get_by_role("button", name="Copy command").first
    assert button.evaluate(colour) == "rgb(27, 34, 43)"
    assert notebook.locator("h1").first.evaluate("(e) => getComputedStyle(e).fontSize") == "32px"
    notebook.evaluate("shown[0].close()")
    check(notebook, 1, office, p_hit=0.9)


def test_sliders_are_linked_with_python(notebook: Page, office: EvidenceMap) -> None:
    show(notebook, state_of(office, p_miss=0.3), 0)
    for number in (0, 1):
        check(notebook, number, office, p_miss=0.3)
    notebook.evaluate("models[0].set('p_hit', 0.88)")
    for number in (0, 1):
        check(notebook, number, office, p_miss=0.3, p_hit=0.88)
    notebook.get_by_role("spinbutton", name="prior").first.fill("0.2")
    notebook.get_by_role("combobox", name="Posterior").nth(1).select_option("calibrated")
    notebook.wait_for_function("models[0].saved >= 1")
    state = notebook.evaluate("models[0].state")
    assert (state["prior"], state["posterior"], state["p_hit"]) == (0.2, "calibrated", 0.88)
    assert settings(notebook, 0) == settings(notebook, 1)
    notebook.get_by_role("button", name="As the map has it").first.click()
    state = notebook.evaluate("models[0].state")
    assert (state["prior"], state["posterior"], state["p_hit"]) == (0.5, "log-odds", 0.7)
    assert settings(notebook, 0) == settings(notebook, 1)
    notebook.evaluate("models[0].set('height', 300)")
    assert notebook.evaluate("shown[1].el.offsetHeight") == 300


def test_what_is_taken_away_leaves_nothing(notebook: Page, office: EvidenceMap) -> None:
    """Chromium complains of more than 16 graphics contexts."""
    show(notebook, state_of(office))
    for number in range(18):
        notebook.evaluate("show(0)")
        notebook.evaluate(f"shown[{number}].close()")
    assert notebook.evaluate("shown.slice(0, 18).every(({ el }) => el.childNodes.length === 0)")
    listeners = "Object.values(models[0].listeners).map((all) => all.size)"
    assert set(notebook.evaluate(listeners)) == {1}
    check(notebook, 18, office)


def test_a_payload_that_is_gone(notebook: Page, office: EvidenceMap) -> None:
    show(notebook, state_of(office), file=None)
    assert "Run the cell again" in notebook.get_by_role("alert").inner_text()


def test_what_is_copied_is_python(notebook: Page, office: EvidenceMap) -> None:
    show(notebook, state_of(office))
    cells = some(office)
    for change in (
        {},
        {"pHit": 0.9, "pMiss": 0.3, "prior": 0.1, "clamped": True},
        {"free": 0.1, "occupied": 0.8},
        {"posterior": "calibrated", "fittedPrior": 0.3},
        {"posterior": "reflection", "betaA": 0.5, "betaB": 2},
        {"posterior": "interval-width", "betaB": 2},
    ):
        notebook.get_by_role("button", name="As the map has it").click()
        notebook.evaluate("(change) => shown[0].viewer.store.set(change)", change)
        places = list(map(list, cells))
        probes = notebook.evaluate("(cells) => shown[0].viewer.probe(0, cells)", places)
        command = notebook.locator("code").inner_text()
        if "interval-width" in command:
            command = command.removesuffix('.plot(show="interval-width")')
        view = eval(command, {"grid": office, "oddsmap": oddsmap})  # noqa: S307
        if hasattr(view, "thresholds"):
            assert view.thresholds.free == settings(notebook, 0)["free"]
            want = view.at((np.array(cells) + 0.5) * office.resolution)
            assert [probe["exact"] for probe in probes] == pytest.approx(list(want), rel=1e-9)
        else:
            assert (view.a, view.b) == (change.get("betaA", 1), change["betaB"])


def test_the_page_scrolls_past_a_map(notebook: Page, office: EvidenceMap) -> None:
    show(notebook, state_of(office))
    scale = "shown[0].viewer.camera.scale"
    before = notebook.evaluate(scale)
    box = notebook.locator("canvas").bounding_box()
    assert box is not None
    notebook.mouse.move(box["x"] + 100, box["y"] + 100)
    notebook.mouse.wheel(0, -240)
    notebook.evaluate("new Promise((f) => requestAnimationFrame(() => setTimeout(f)))")
    assert notebook.evaluate(scale) == before
    notebook.mouse.click(box["x"] + 100, box["y"] + 100)
    notebook.mouse.wheel(0, -240)
    notebook.wait_for_function(f"{scale} < {before}")


@pytest.mark.parametrize("notebook", ["false"], indirect=True)
def test_it_is_dark_where_the_notebook_is(notebook: Page, office: EvidenceMap) -> None:
    show(notebook, state_of(office))
    colour = notebook.locator(".oddsmap").evaluate("(root) => getComputedStyle(root).color")
    assert colour == "rgb(230, 235, 240)"


def test_axe_finds_nothing_in_a_notebook(notebook: Page, office: EvidenceMap) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    show(notebook, state_of(office))
    report = axe.Axe().run(notebook)
    assert report.violations_count == 0, report.generate_report()
