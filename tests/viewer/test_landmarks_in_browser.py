# SPDX-License-Identifier: Apache-2.0
"""Landmarks in a browser: drawn where they are, named when they are pointed at."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import ProbabilityMap
from oddsmap.landmarks.landmark import Landmark
from oddsmap.landmarks.picture import ellipse_axes
from oddsmap.viewer.document import single_page
from oddsmap.viewer.given import given_of
from oddsmap.viewer.given_sheets import given_payload
from oddsmap.viewer.landmarks import landmark_facts, landmarks_payload
from tests.viewer.browser_kit import Opened, file_url, opened
from tests.viewer.payload_kit import parts_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

BLUE = (31, 95, 153)
MARKS = (
    Landmark(7, np.array([2.5, 1.0]), np.array([[0.04, 0.02], [0.02, 0.03]]), 12),
    Landmark(2**62, np.array([-1.0, 3.0]), np.eye(2) * 1e-6, 1),
    Landmark(3, np.array([4.0, -2.0, 9.0]), np.eye(3) * 0.09, 5),
)


def show(browser: Browser, folder: Path, payload: bytes, **options: Any) -> Any:
    path = folder / "m.html"
    path.write_text(single_page("m", payload), encoding="utf-8")
    return opened(browser, file_url(path), offline=True, **options)


def turned() -> bytes:
    """A ROS map with cells of .1 m, turned by half a radian, and landmarks on top."""
    p = np.zeros((70, 60))
    view = ProbabilityMap(p, np.ones(p.shape, np.bool_), 0.1, (1.0, -3.0), 0.5)
    return given_payload([given_of(view, "m.yaml")], landmarks=landmark_facts(MARKS))


def point_at(found: Opened, mark: Landmark, frame: tuple[float, float, float], side: float) -> str:
    """Point at a landmark; what is said then."""
    x, y, yaw = frame
    dx, dy = mark.mean[:2] - (x, y)
    c, s = np.cos(yaw), np.sin(yaw)
    cell = ((c * dx + s * dy) / side, (c * dy - s * dx) / side)
    right, down = found.get(
        "[(at[0] - oddsmap.camera.x) / oddsmap.camera.scale + oddsmap.camera.width / 2,"
        " (oddsmap.camera.y - at[1]) / oddsmap.camera.scale + oddsmap.camera.height / 2]",
        at=list(map(float, cell)),
    )
    box = found.page.locator("canvas").first.bounding_box()
    assert box is not None
    found.page.mouse.move(box["x"] + right, box["y"] + down)
    return found.words()


def blue(found: Opened) -> npt.NDArray[np.bool_]:
    """Where the screen has the colour of landmarks."""
    from PIL import Image

    found.words()
    shot = np.array(Image.open(io.BytesIO(found.page.locator(".map").screenshot())))[..., :3]
    return np.asarray((np.abs(shot.astype(int) - BLUE) <= 2).all(axis=-1))


@pytest.mark.parametrize("below", [True, False])
def test_landmarks_are_drawn_and_named(browser: Browser, tmp_path: Path, below: bool) -> None:
    payload = turned() if below else landmarks_payload(MARKS, "trees.csv")
    side = parts_of(payload)[0]["resolution"]
    frame = (1.0, -3.0, 0.5) if below else (0.0, 0.0, 0.0)
    with show(browser, tmp_path, payload) as found:
        for mark in MARKS:
            said = point_at(found, mark, frame, side)
            many = "1 observation" if mark.count == 1 else f"{mark.count} observations"
            assert f"landmark {mark.id}, {many}\n" in said
            longer, shorter, _ = ellipse_axes(mark.covariance[:2, :2], 0.95)
            axes = said.rpartition("semi-axes ")[2].removesuffix(" m").split(" and ")
            assert [float(x) for x in axes] == pytest.approx([longer, shorter], rel=5e-3)
            assert ("cell " in said) == below
        assert "z 9.0" in said
        found.page.mouse.move(880, 600)
        found.get("oddsmap.camera.zoom(4)")
        found.get("oddsmap.store.set({})")
        assert blue(found).sum() > 20
        if not below:
            assert found.page.locator("select, code").count() == 0
            assert "3 landmarks" in found.page.locator("header").inner_text()
        else:
            found.page.get_by_label("Landmarks").uncheck()
            assert blue(found).sum() == 0
            assert "landmark" not in point_at(found, MARKS[0], frame, side)
        assert found.complaints == []


def test_an_ellipse_has_its_size(browser: Browser, tmp_path: Path) -> None:
    one = Landmark(1, np.array([5.0, 5.0]), np.diag([0.01, 0.0025]), 3)
    with show(browser, tmp_path, landmarks_payload([one], "trees.csv")) as found:
        there = blue(found)[:, :300]  # without its name, to the right of the middle
        columns = np.flatnonzero(there.any(axis=0))
        side, scale = found.get("[oddsmap.facts.resolution, oddsmap.camera.scale]")
        longer, _, _ = ellipse_axes(one.covariance, 0.95)
        assert columns[0] == pytest.approx(300 - longer / side / scale, abs=2)


def test_facts_are_pythons() -> None:
    facts, _ = parts_of(landmarks_payload(MARKS, "a/trees.csv"))
    assert facts["name"] == "trees.csv"
    assert [mark["id"] for mark in facts["landmarks"]] == ["7", str(2**62), "3"]
    assert facts["landmarks"][2]["mean"] == [4.0, -2.0, 9.0]
    lo, hi, side = (facts[name] for name in ("lo", "hi", "resolution"))
    for mark in MARKS:
        for axis in (0, 1):
            reach = 2.45 * np.sqrt(mark.covariance[axis, axis])
            assert lo[axis] * side <= mark.mean[axis] - reach
            assert mark.mean[axis] + reach <= hi[axis] * side


@pytest.mark.parametrize(("scheme", "below"), [("light", True), ("dark", False)])
def test_axe_finds_nothing(browser: Browser, tmp_path: Path, scheme: str, below: bool) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    payload = turned() if below else landmarks_payload(MARKS, "trees.csv")
    with show(browser, tmp_path, payload, color_scheme=scheme) as found:
        report = axe.Axe().run(found.page)
        assert report.violations_count == 0, report.generate_report()
