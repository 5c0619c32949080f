# SPDX-License-Identifier: Apache-2.0
"""Maps without counts in a browser: full maps, ROS maps and OctoMaps, alone and beside others."""

from __future__ import annotations

import io
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import EvidenceMap, FullMap, ProbabilityMap, VoxelMap, load_octomap, load_ros
from oddsmap.cli import main
from oddsmap.kernels.units import ONE
from oddsmap.viewer.document import single_page
from oddsmap.viewer.given import given_of
from oddsmap.viewer.given_sheets import given_payload
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload
from tests.saved_maps_kit import full_map
from tests.viewer.browser_kit import Opened, file_url, opened
from tests.viewer.test_given_payload import space_full_map

if TYPE_CHECKING:
    from playwright.sync_api import Browser

CLOSE = 1e-5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of each kind, saved, and its page beside it."""
    made = tmp_path_factory.mktemp("kinds")
    full = full_map(1)
    full.save(made / "full.zarr")
    write(made / "full.html", given_payload([given_of(full, "full.zarr")]))
    full.save_ros(made / "old.yaml", mode="scale")
    old = load_ros(made / "old.yaml")
    write(made / "old.html", given_payload([given_of(old, "old.yaml")]))
    voxels().save_octomap(made / "yard.ot")
    write(made / "yard.html", given_payload([given_of(load_octomap(made / "yard.ot"), "yard.ot")]))
    write(made / "turned.html", given_payload([given_of(ros(), "turned.yaml")]))
    flat, deep = counts(2), counts(3)
    write(made / "both.html", plane_payload(flat, "m.zarr", [given_of(full, "full.zarr")]))
    space = given_of(space_full_map(), "s.zarr", above=0.196)
    write(made / "space.html", space_payload(deep, "d.zarr", [space]))
    write(made / "deep.html", space_payload(deep, "d.zarr"))
    return made


def write(path: Path, payload: bytes) -> None:
    path.write_text(single_page(path.stem, payload), encoding="utf-8")


def ros() -> ProbabilityMap:
    """A map that is turned, with cells that are unknown."""
    rng = np.random.default_rng(0)
    p = rng.choice([0.0, 0.1, 0.7, 1.0], (30, 40))
    return ProbabilityMap(p, rng.random(p.shape) < 0.8, 0.1, (2.0, -1.0), 0.5)


def voxels() -> VoxelMap:
    """Leaves of one and of eight voxels, of many log odds."""
    rng = np.random.default_rng(0)
    index = np.unique(rng.integers(-20, 20, (600, 3)) * 2, axis=0)
    level = rng.integers(0, 2, len(index))
    return VoxelMap(
        index, rng.normal(0, 2, len(index)).astype(np.float32), 0.2, level.astype(np.uint8)
    )


def counts(ndim: int) -> EvidenceMap:
    rng = np.random.default_rng(1)
    grid = EvidenceMap(0.1, ndim=ndim)
    index = np.unique(rng.integers(0, 60, (500, ndim)), axis=0) + (3000 if ndim == 2 else 0)
    grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * ONE))
    return grid


def show(browser: Browser, folder: Path, name: str, **options: Any) -> Any:
    return opened(browser, file_url(folder / f"{name}.html"), offline=True, **options)


def check(found: Opened, view: FullMap | ProbabilityMap, first: tuple[int, int] = (0, 0)) -> None:
    """Cells on the screen, and in words, are Python's."""
    if isinstance(view, ProbabilityMap):
        y, x = np.nonzero(view.observed)
        index, p = np.stack([x, y], axis=1) + first, view.probability[y, x]
    else:
        index, p = view.cells()
    some = np.random.default_rng(0).choice(len(index), 20)
    cells = [(int(x), int(y)) for x, y in index[some]]
    for probe, want in zip(found.probe(cells), p[some], strict=True):
        assert probe["shown"] == pytest.approx(want, abs=CLOSE)
        assert probe["exact"] == pytest.approx(want, abs=CLOSE)


def counted(found: Opened) -> int:
    found.get(
        "new Promise((done) => { const ask = () => "
        "oddsmap.occupied === null ? setTimeout(ask, 10) : done(); ask(); })"
    )
    return int(found.get("oddsmap.occupied"))


def picture(found: Opened) -> npt.NDArray[np.uint8]:
    from PIL import Image

    found.words()
    content = found.page.locator("canvas").screenshot()
    return np.array(Image.open(io.BytesIO(content)))[..., :3]


def differing(a: npt.NDArray[np.uint8], b: npt.NDArray[np.uint8]) -> float:
    """The share of pixels."""
    return float((a != b).any(axis=-1).mean())


def test_a_full_map(browser: Browser, folder: Path) -> None:
    view = full_map(1)
    with show(browser, folder, "full") as found:
        check(found, view)
        index, p = view.cells()
        cell = tuple(index[0].tolist())
        found.look_at(cell)
        found.page.locator("canvas").first.focus()
        found.page.keyboard.press("+")
        said = found.words()
        state = "occupied" if p[0] >= 0.65 else "free" if p[0] <= 0.196 else "undecided"
        assert f"cell {cell[0]}, {cell[1]}\n{state}, p " in said.replace("\u2212", "-")
        assert said.endswith("in full.zarr, a full map")
        assert found.probe([(99_999, 0)])[0]["shown"] is None
        visible = found.page.locator(".panel").inner_text()
        assert "Probabilities without counts" in visible
        for absent in ("p_hit", "prior", "Clamp", "From afar"):
            assert absent not in visible
        assert found.complaints == []


def test_levels_keep_walls_and_average_what_is_free(browser: Browser, folder: Path) -> None:
    view = load_ros(folder / "old.yaml")
    first = [round(x / view.resolution) for x in view.origin]
    with show(browser, folder, "old") as found:
        check(found, view, (first[0], first[1]))
        y, x = np.nonzero(view.observed)
        index, p = np.stack([x, y], axis=1) + first, view.probability[y, x]
        block, at = np.unique(index // 2, axis=0, return_inverse=True)
        most = np.zeros(len(block))
        np.maximum.at(most, at, p)
        mean = np.bincount(at, p) / np.bincount(at)
        want = np.where(most >= 0.5, most, mean)
        some = np.random.default_rng(1).choice(len(block), 20)
        probes = found.probe([(int(i), int(j)) for i, j in block[some]], 1)
        values = np.unique(p)
        for probe, goal in zip(probes, want[some], strict=True):
            # A mean is the nearest of the probabilities that the map has.
            assert probe["exact"] == values[np.abs(values - goal).argmin()]
        assert found.complaints == []


def test_a_map_that_is_turned(browser: Browser, folder: Path) -> None:
    with show(browser, folder, "turned") as found:
        check(found, ros())
        header = found.page.locator("header").inner_text()
        assert "along its own axes, which are turned by 28.6\u00b0" in header
        cell = (7, 21)
        found.look_at(cell)
        found.page.locator("canvas").first.focus()
        found.page.keyboard.press("+")
        x, y = ros().centre_of([cell])[0]
        assert found.words().startswith(f"x {x:.2f} m, y {y:.2f} m")
        assert found.complaints == []


def test_an_octomap(browser: Browser, folder: Path) -> None:
    _, p = load_octomap(folder / "yard.ot").cells()
    with show(browser, folder, "yard") as found:
        usual = counted(found)
        assert usual == (p >= 0.65).sum()
        found.number("occupied from").fill("0.9")
        assert counted(found) == (p >= 0.9).sum() < usual
        found.number("occupied from").fill("0.2")
        assert counted(found) == (p >= 0.2).sum() > usual
        assert f"{(p > 0.196).sum():,} above p = 0.196" in found.words()
        assert not found.page.get_by_text("p_hit").is_visible()
        assert found.complaints == []


def test_a_full_map_beside_counts(browser: Browser, folder: Path) -> None:
    view = full_map(1)
    with show(browser, folder, "both") as found:
        grid = counts(2)
        index, _, _ = grid.cells()
        for probe, want in zip(
            found.probe([(int(x), int(y)) for x, y in index[:9]]),
            grid.log_odds().at((index[:9] + 0.5) * 0.1),
            strict=True,
        ):
            assert probe["shown"] == pytest.approx(want, abs=CLOSE)
        found.page.get_by_label("Posterior").select_option("given0")
        check(found, view)
        assert found.page.locator("code").inner_text() == "oddsmap export full.zarr full.png"
        text = found.page.locator("header").inner_text()
        assert f"beside full.zarr, a full map of {len(view.cells()[0]):,} cells" in text
        found.page.get_by_label("Posterior").select_option("reflection")
        assert found.complaints == []


def test_a_full_map_in_space_beside_counts(browser: Browser, folder: Path) -> None:
    _, p = space_full_map().cells()
    with show(browser, folder, "deep") as found:
        found.set(paint="probability")
        alone = picture(found)
        lo, target, far = found.get(
            "[oddsmap.facts.lo, oddsmap.camera.target, oddsmap.camera.distance]"
        )
    with show(browser, folder, "space") as found:
        index, hits, _ = counts(3).cells()
        view = counts(3).log_odds()
        want = ((view.at((index + 0.5) * 0.1) >= 0.65) & (hits > 0)).sum()
        assert counted(found) == want
        # The box is that of both; seen from the same place:
        moved = np.array(target) + lo - found.get("oddsmap.facts.lo")
        place = {"target": moved.tolist(), "distance": far}
        found.get("Object.assign(oddsmap.camera, place)", place=place)
        found.set(paint="probability")
        assert differing(picture(found), alone) < 0.01, "each map has its own voxels"
        found.set(paint="hits")
        found.page.get_by_label("Posterior").select_option("given0")
        assert found.get("oddsmap.store.value.paint") == "probability"
        assert counted(found) == (p >= 0.65).sum()
        assert differing(picture(found), alone) > 0.02
        found.page.get_by_label("Posterior").select_option("log-odds")
        assert counted(found) == want
        assert differing(picture(found), alone) < 0.01
        assert found.complaints == []


def test_copied_commands_run(
    browser: Browser, folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for path in (*folder.glob("*.zarr"), *folder.glob("old.*"), *folder.glob("*.ot")):
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    states = {"colours": "states", "occupied": 0.8}
    commands = []
    for name, settings in (("both", [{}, states]), ("old", [states]), ("yard", [states])):
        with show(browser, folder, name) as found:
            for one in settings:
                found.set(posterior="given0", **one)
                commands.append(found.page.locator("code").inner_text())
    assert commands == [
        "oddsmap export full.zarr full.png",
        "oddsmap export full.zarr full.yaml --occupied 0.8",
        "oddsmap export old.yaml old-states.yaml --occupied 0.8",
        "oddsmap export yard.ot yard.ply --occupied 0.8",
    ]
    for command in commands:
        monkeypatch.setattr(sys, "argv", shlex.split(command))
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code, command
        assert (tmp_path / shlex.split(command)[3]).exists()


@pytest.mark.parametrize(("name", "scheme"), [("both", "dark"), ("yard", "light")])
def test_axe_finds_nothing(browser: Browser, folder: Path, name: str, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    with show(browser, folder, name, color_scheme=scheme) as found:
        found.set(posterior="given0", colours="states")
        report = axe.Axe().run(found.page)
        assert report.violations_count == 0, report.generate_report()
