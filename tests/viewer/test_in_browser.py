# SPDX-License-Identifier: Apache-2.0
"""The page in a browser: it shows what Python works out, is used without a mouse, loads nothing."""

from __future__ import annotations

import io
import shlex
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from oddsmap import EvidenceMap, Thresholds, build_map, open_log
from oddsmap.cli import main
from oddsmap.kernels.units import ONE
from oddsmap.posterior.beta import beta_interval
from oddsmap.simulate import Lidar2D, office_drive, office_plan
from oddsmap.viewer.document import single_page
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.server import PageServer
from tests.viewer.browser_kit import Opened, file_url, opened

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# The graphics card works in single precision.
SINGLE = 1e-5


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> tuple[EvidenceMap, Path]:
    """The simulated office: the map, and the folder with office.zarr and office.html."""
    plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    scans = [lidar.scan(plan, pose, rng) for pose in office_drive(40)]
    grid = build_map(scans, 0.05, votes="beam")
    folder = tmp_path_factory.mktemp("viewer")
    grid.save(folder / "office.zarr")
    write(grid, folder / "office.html", "office.zarr")
    return grid, folder


@pytest.fixture(scope="module")
def shown(browser: Browser, office: tuple[EvidenceMap, Path]) -> Iterator[Opened]:
    """The file on the disk, with the network off."""
    with opened(browser, file_url(office[1] / "office.html"), offline=True) as found:
        yield found
        assert found.complaints == []
        assert all(url.startswith(("file:", "data:")) for url in found.requests)


@pytest.fixture(autouse=True)
def as_the_map_has_it(request: pytest.FixtureRequest) -> None:
    if "shown" in request.fixturenames:
        shown = request.getfixturevalue("shown")
        shown.reset()
        shown.get("(oddsmap.camera.fit(), oddsmap.store.set({}))")


def write(grid: EvidenceMap, path: Path, name: str) -> None:
    path.write_text(single_page(name, plane_payload(grid, name)), encoding="utf-8")


def some(grid: EvidenceMap, count: int = 12) -> list[tuple[int, int]]:
    """Cells of all kinds: those with the most hits, the most passes, and others."""
    index, hits, passes = grid.cells()
    rng = np.random.default_rng(3)
    chosen = [*np.argsort(hits)[-3:], *np.argsort(passes)[-2:], *rng.choice(len(index), count - 5)]
    return [(int(x), int(y)) for x, y in index[chosen]]


def check(found: Opened, cells: list[tuple[int, int]], want: Any, *, atol: float = SINGLE) -> None:
    """The picture has Python's values, and what is said of a cell has them to the last digits."""
    for cell, probe, value in zip(cells, found.probe(cells), want, strict=True):
        assert probe["shown"] == pytest.approx(value, abs=atol), cell
        assert probe["exact"] == pytest.approx(value, rel=1e-9, abs=1e-12), cell


def test_a_slider_moves_the_map_to_pythons_values(
    shown: Opened, office: tuple[EvidenceMap, Path]
) -> None:
    grid, _ = office
    cells = some(grid)
    check(shown, cells, grid.log_odds().at((np.array(cells) + 0.5) * 0.05))
    before = shown.get("oddsmap.stats.uploaded")
    shown.number("p_hit, after a hit").fill("0.93")
    shown.number("p_miss, after a pass").fill("0.45")
    shown.number("prior").fill("0.2")
    view = grid.log_odds(p_hit=0.93, p_miss=0.45, prior=0.2)
    check(shown, cells, view.at((np.array(cells) + 0.5) * 0.05))
    slider = shown.page.get_by_role("slider", name="p_hit, after a hit")
    slider.focus()
    slider.press("ArrowRight")
    moved = shown.get("oddsmap.store.value.pHit")
    assert moved > 0.93
    view = grid.log_odds(p_hit=moved, p_miss=0.45, prior=0.2)
    check(shown, cells, view.at((np.array(cells) + 0.5) * 0.05))
    assert shown.get("oddsmap.stats.uploaded") == before, "a slider uploads nothing"


def test_a_frame_is_one_draw_call(shown: Opened) -> None:
    shown.words()
    before = shown.get("oddsmap.stats.draws")
    shown.set(pHit=0.8)
    shown.words()
    assert shown.get("oddsmap.stats.draws") == before + 1


def test_other_posteriors(shown: Opened, office: tuple[EvidenceMap, Path]) -> None:
    grid, _ = office
    cells = some(grid)
    places = (np.array(cells) + 0.5) * 0.05
    shown.set(clamped=True, clampLow=0.2, clampHigh=0.9)
    check(shown, cells, grid.log_odds(clamp=(0.2, 0.9)).at(places))
    shown.set(clamped=False, posterior="calibrated")
    check(shown, cells, grid.calibrated().at(places))
    shown.set(fittedPrior=0.4)
    check(shown, cells, grid.calibrated(prior=0.4).at(places))
    reflection = grid.reflection(a=0.5, b=3.0)
    alpha, beta, _ = reflection.parameters_at(np.array(cells))
    shown.set(posterior="reflection", betaA=0.5, betaB=3.0)
    check(shown, cells, alpha / (alpha + beta))
    low, high = beta_interval(alpha, beta, 0.95)
    shown.set(posterior="interval-width")
    check(shown, cells, high - low, atol=2e-3)


def test_levels_are_sums_of_evidence(shown: Opened, office: tuple[EvidenceMap, Path]) -> None:
    grid, _ = office
    factors = shown.get("oddsmap.pyramid.levels.map((level) => level.factor)")
    assert factors[:2] == [1, 2]
    for level, factor in enumerate(factors):
        coarse = grid.resample(0.05 * factor)
        cells = some(coarse)
        index = np.array(cells)
        hits, passes = coarse.tiles.at(index)
        want = coarse.log_odds().log_odds_at(index)
        for probe, h, p, log_odds in zip(
            shown.probe(cells, level), hits, passes, want, strict=True
        ):
            assert probe["votes"] == [h / ONE, p / ONE]
            assert probe["shown"] == pytest.approx(1 / (1 + np.exp(-log_odds)), abs=SINGLE)


def far_map(*, whole: bool) -> EvidenceMap:
    """Cells of a map of UTM coordinates, on both sides of a tile's border."""
    grid = EvidenceMap(0.05)
    index = np.array(
        [[10_000_127, 108_000_000], [10_000_128, 108_000_001], [10_000_700, 108_000_900]]
    )
    unit = ONE if whole else 777
    grid.add_cells(index, np.array([70_000, 3, 0]) * unit, np.array([20, 5, 2]) * unit)
    return grid


@pytest.mark.parametrize("whole", [True, False])
def test_far_from_the_origin_and_with_large_or_fractional_weights(
    browser: Browser, tmp_path: Path, whole: bool
) -> None:
    grid = far_map(whole=whole)
    write(grid, tmp_path / "m.html", "utm.zarr")
    index, _, _ = grid.cells()
    cells = [(int(x), int(y)) for x, y in index]
    with opened(browser, file_url(tmp_path / "m.html"), offline=True) as found:
        want = 1 / (1 + np.exp(-grid.log_odds().log_odds_at(index)))
        check(found, cells, want)
        assert found.probe([(10_000_129, 108_000_001)])[0]["shown"] is None
        # In the middle of the screen, zoomed in as far as it goes, is the very cell.
        found.look_at((10_000_128, 108_000_001))
        found.page.locator("canvas").focus()
        found.page.keyboard.press("+")
        assert "cell 10000128, 108000001" in found.words()
        assert found.complaints == []


def test_pointing_at_a_cell(shown: Opened, office: tuple[EvidenceMap, Path]) -> None:
    grid, _ = office
    cell = some(grid)[2]
    shown.look_at(cell)
    box = shown.page.locator("canvas").bounding_box()
    assert box is not None
    shown.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    text = shown.words()
    hits, passes = (int(n[0] // ONE) for n in grid.tiles.at(np.array([cell])))
    assert f"{hits} hits" in text
    assert f"{passes} pass" in text
    assert "occupied, p " in text
    assert "95 % interval" in text
    x, y = ((c + 0.5) * 0.05 for c in cell)
    assert f"x {x:.3f} m, y {y:.3f} m".replace("-", "\u2212") in text
    shown.page.mouse.move(box["x"] + box["width"] + 40, box["y"] + 5)
    assert "Point at a cell" in shown.words()


def position(found: Opened) -> list[float]:
    """The coordinates that are said."""
    words = found.words().splitlines()[0].replace("\u2212", "-").split()
    return [float(words[1]), float(words[4])]


def test_the_mouse_moves_the_map(shown: Opened) -> None:
    box = shown.page.locator("canvas").bounding_box()
    assert box is not None
    at = box["x"] + box["width"] / 3, box["y"] + box["height"] / 3
    shown.page.mouse.move(*at)
    where = position(shown)
    scale = shown.get("oddsmap.camera.scale")
    shown.page.mouse.wheel(0, -240)
    assert position(shown) == pytest.approx(where, abs=0.02), "what is pointed at stays"
    assert shown.get("oddsmap.camera.scale") < scale
    shown.page.mouse.down()
    shown.page.mouse.move(at[0] + 70, at[1] - 30)
    shown.page.mouse.up()
    assert position(shown) == pytest.approx(where, abs=0.02), "the map went along"


def test_two_fingers_zoom(browser: Browser, office: tuple[EvidenceMap, Path]) -> None:
    url = file_url(office[1] / "office.html")
    size = {"width": 390, "height": 700}
    with opened(browser, url, offline=True, has_touch=True, viewport=size) as found:
        before = found.get("oddsmap.camera.scale")
        send = found.page.context.new_cdp_session(found.page).send
        for kind, apart in (("touchStart", 20), ("touchMove", 40), ("touchMove", 60)):
            points = [{"x": 190 + side * apart, "y": 150} for side in (-1, 1)]
            send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        assert found.get("oddsmap.camera.scale") == pytest.approx(before / 3, rel=0.05)
        assert found.complaints == []


def test_keys_alone(shown: Opened) -> None:
    page = shown.page
    page.locator("body").press("Tab")
    for _ in range(40):
        if page.evaluate("document.activeElement.tagName") == "CANVAS":
            break
        page.keyboard.press("Tab")
    assert "Point at" not in shown.words(), "the cell in the middle is described"
    begin = shown.get("[oddsmap.camera.x, oddsmap.camera.y, oddsmap.camera.scale]")
    for key in ("ArrowRight", "ArrowUp", "+", "Shift+ArrowLeft"):
        page.keyboard.press(key)
    x, y, scale = shown.get("[oddsmap.camera.x, oddsmap.camera.y, oddsmap.camera.scale]")
    assert (x > begin[0], y > begin[1]) == (True, True)
    assert scale == pytest.approx(begin[2] / 1.5)
    assert page.locator("output.words").get_attribute("aria-live") == "polite"
    page.keyboard.press("0")
    assert shown.get("oddsmap.camera.isFitted()")
    page.keyboard.press("Tab")
    focused = {page.evaluate("document.activeElement.outerHTML")}
    for _ in range(40):
        page.keyboard.press("Tab")
        focused.add(page.evaluate("document.activeElement.outerHTML"))
    reached = " ".join(focused)
    for name in ("Copy command", "As the map has it", 'type="range"', "<select", "checkbox"):
        assert name in reached


def test_copied_commands_run(
    shown: Opened, office: tuple[EvidenceMap, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What the page says for what it shows is what `oddsmap export` takes."""
    _, folder = office
    (tmp_path / "office.zarr").symlink_to(folder / "office.zarr")
    monkeypatch.chdir(tmp_path)
    commands = []
    for settings in (
        {},
        {"pHit": 0.9, "pMiss": 0.3, "prior": 0.1, "clamped": True},
        {"colours": "states", "free": 0.1, "occupied": 0.8, "pHit": 0.8},
        {"posterior": "calibrated", "fittedPrior": 0.3},
        {"posterior": "reflection", "betaA": 0.5},
        {"posterior": "interval-width", "betaB": 2},
    ):
        shown.reset()
        shown.set(**settings)
        commands.append(shown.page.locator("code").inner_text())
    assert commands[0] == "oddsmap export office.zarr office.png"
    assert len(set(commands)) == 6
    for command in commands:
        words = shlex.split(command)
        words[3] = f"{len(list(tmp_path.iterdir()))}{Path(words[3]).suffix}"
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code, command
    assert "--p-hit 0.8 --free 0.1 --occupied 0.8" in commands[2]


def test_thresholds_decide_colours(shown: Opened, office: tuple[EvidenceMap, Path]) -> None:
    from PIL import Image

    def share(colour: tuple[int, int, int]) -> int:
        shown.words()
        picture = np.array(Image.open(io.BytesIO(shown.page.locator("canvas").screenshot())))
        return int((picture[..., :3] == colour).all(axis=-1).sum())

    grid, _ = office
    shown.set(colours="states")
    black, orange = (17, 20, 26), (224, 154, 58)
    usual, undecided = share(black), share(orange)
    assert usual > 0
    shown.set(occupied=0.9999)
    assert share(black) < usual
    assert share(orange) > undecided
    states = grid.log_odds(thresholds=Thresholds(0.196, 0.65)).state()
    assert (states == 100).any()


def test_why_nothing_is_shown(
    browser: Browser, office: tuple[EvidenceMap, Path], tmp_path: Path
) -> None:
    grid, _ = office
    payload = plane_payload(grid, "office.zarr")
    for name, content, script, said in (
        ("no_webgl", payload, "HTMLCanvasElement.prototype.getContext = () => null", "no WebGL 2"),
        ("cut", payload[:-9000], "", "the data of the map are incomplete"),
        ("cut_in_the_header", payload[:900], "", ""),
    ):
        path = tmp_path / f"{name}.html"
        path.write_text(single_page("m", content), encoding="utf-8")
        context = browser.new_context(offline=True)
        page = context.new_page()
        page.add_init_script(script)
        page.goto(file_url(path))
        text = page.get_by_role("alert").inner_text(timeout=5000)
        assert text.startswith("The map cannot be shown: ")
        assert said in text
        context.close()


@pytest.mark.parametrize("size", [(900, 640), (380, 700)])
def test_nothing_covers_the_map(
    browser: Browser, office: tuple[EvidenceMap, Path], size: tuple[int, int]
) -> None:
    """What is said stands below it, also what is longest: of a cell with hits and passes."""
    url = file_url(office[1] / "office.html")
    viewport = {"width": size[0], "height": size[1]}
    with opened(browser, url, offline=True, viewport=viewport) as found:
        found.page.locator("canvas").focus()
        found.look_at(some(office[0])[2])
        found.page.keyboard.press("+")
        assert "95 % interval" in found.words()
        canvas, readout = (
            found.page.locator(f".{name}").bounding_box() for name in ("map > canvas", "readout")
        )
        assert canvas is not None
        assert readout is not None
        assert canvas["height"] > 200
        assert canvas["y"] + canvas["height"] <= readout["y"] + 1
        colours = found.page.get_by_role("button", name="Colours: auto")
        colours.click()
        assert found.page.get_by_role("button", name="Colours: light").is_visible()


@pytest.mark.parametrize(("scheme", "width"), [("light", 900), ("dark", 380)])
def test_axe_finds_nothing(
    browser: Browser, office: tuple[EvidenceMap, Path], scheme: str, width: int
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    url = file_url(office[1] / "office.html")
    options = {"color_scheme": scheme, "viewport": {"width": width, "height": 700}}
    with opened(browser, url, offline=True, **options) as found:
        for settings in ({"colours": "states", "clamped": True}, {"posterior": "reflection"}):
            found.set(**settings)
            report = axe.Axe().run(found.page)
            assert report.violations_count == 0, report.generate_report()


@pytest.mark.realdata
def test_a_served_map_of_a_real_log(browser: Browser, data_folder: Path) -> None:
    grid = build_map(open_log(data_folder / "laser2d" / "intel-corrected.log.gz"), 0.05)
    with PageServer("intel.zarr", plane_payload(grid, "intel.zarr")) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            with opened(browser, server.url) as found:
                assert "910 scans" in found.page.locator("header").inner_text()
                cells = some(grid)
                found.number("p_hit, after a hit").fill("0.9")
                view = grid.log_odds(p_hit=0.9)
                check(found, cells, view.at((np.array(cells) + 0.5) * 0.05))
                assert found.complaints == []
                asked = {url.removeprefix(server.url) for url in found.requests}
                assert asked - {"data:,"} == {"", "viewer.css", "viewer.js", "map.bin"}
        finally:
            server.shutdown()
            thread.join()
