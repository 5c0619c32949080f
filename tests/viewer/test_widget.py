# SPDX-License-Identifier: Apache-2.0
"""A map at the end of a cell: what the notebook is given, what Python knows, what is held."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import oddsmap
from oddsmap import ConeSensor, ConfigError, EvidenceMap, InputError, Scan, Thresholds
from oddsmap.kernels.units import ONE
from oddsmap.viewer import notebook
from tests.viewer.payload_kit import parts_of

if TYPE_CHECKING:
    from oddsmap.viewer.map_widget import MapWidget

LIVE = "application/vnd.jupyter.widget-view+json"


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a notebook: IPython with a kernel, and anywidget."""
    pytest.importorskip("anywidget", reason='needs pip install -e ".[widget]"')
    ipython = pytest.importorskip("IPython")
    monkeypatch.setattr(ipython, "get_ipython", lambda: SimpleNamespace(kernel=object()))


def map_of(shape: tuple[int, ...] = (6, 5), **settings: Any) -> EvidenceMap:
    grid = EvidenceMap(0.1, ndim=len(shape), **settings)
    index = np.argwhere(np.ones(shape))
    grid.add_cells(index, np.full(len(index), 2 * ONE), np.full(len(index), ONE))
    return grid


def shown(thing: object) -> dict[str, Any]:
    """What IPython sends of a thing at the end of a cell."""
    from IPython.core.formatters import DisplayFormatter

    formatter: Any = DisplayFormatter()
    return dict(formatter.format(thing)[0])


def widget_in(bundle: dict[str, Any]) -> MapWidget:
    from ipywidgets.widgets.widget import _instances

    found: MapWidget = _instances[bundle[LIVE]["model_id"]]
    return found


@pytest.mark.usefixtures("kernel")
@pytest.mark.parametrize("shape", [(6, 5), (3, 4, 5)])
def test_live_and_a_picture_for_those_who_only_read(shape: tuple[int, ...]) -> None:
    grid = map_of(shape)
    bundle = shown(grid)
    assert set(bundle) == {LIVE, "text/plain", "text/html", "image/png"}
    assert bundle["text/plain"] == repr(grid)
    assert bundle["text/html"] == grid._repr_html_()
    widget = widget_in(bundle)
    facts, _ = parts_of(widget.payload)
    assert facts["cells"] == len(grid.cells()[0])
    assert not widget.linked


CHECK = """
import sys, numpy as np, oddsmap
grid = oddsmap.EvidenceMap(0.1)
grid.add_cells(np.array([[0, 0]]), np.array([65536]), np.array([0]))
{before}
assert grid._repr_mimebundle_() is None
assert not {{"anywidget", "ipywidgets"}} & set(sys.modules)
"""


@pytest.mark.parametrize(
    "before", ["assert 'IPython' not in sys.modules", "import IPython; IPython.get_ipython()"]
)
def test_nothing_is_loaded_elsewhere(before: str) -> None:
    if "import" in before:
        pytest.importorskip("IPython")
    done = subprocess.run(
        [sys.executable, "-c", CHECK.format(before=before)], capture_output=True, text=True,
        check=False, env={**os.environ, "PYTHONPATH": str(Path(oddsmap.__file__).parents[1])},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures("kernel")
def test_without_anywidget_there_is_the_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook, "find_spec", lambda name: None)
    assert set(shown(map_of())) == {"text/plain", "text/html", "image/png"}
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.delitem(sys.modules, "oddsmap.viewer.map_widget", raising=False)
    with pytest.raises(ConfigError, match=r'pip install "oddsmap\[widget\]"'):
        map_of().widget()


@pytest.mark.usefixtures("kernel")
def test_a_picture_says_why_it_is_not_live(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = map_of()
    wide = EvidenceMap(0.1)
    wide.add_cells(np.array([[0, 0], [10**7, 0]]), np.array([ONE, ONE]), np.array([0, 0]))
    for large, why in (
        (EvidenceMap(0.1), "no cell of the map has evidence"),
        (wide, "the page cannot show 1000000 x 12.8 m at 0.1 m"),
    ):
        bundle = shown(large)
        assert LIVE not in bundle
        assert f"A picture, not the live map: {why}" in bundle["text/html"]
        assert large._repr_html_() in bundle["text/html"]
        with pytest.raises(InputError, match=why):
            large.widget()
    monkeypatch.setattr(notebook, "_UNASKED", 100)
    assert "shown live by .widget() alone" in shown(grid)["text/html"]
    assert len(grid.widget().payload) > 0


@pytest.mark.usefixtures("kernel")
def test_a_payload_is_held_once_and_as_long_as_its_map() -> None:
    """IPython's widgets are never let go of: what is large in them must be."""
    from ipywidgets.widgets.widget import _instances

    before = set(_instances)

    def held() -> list[bytes]:
        new = [widget for key, widget in _instances.items() if key not in before]
        return [widget.payload for widget in new if getattr(widget, "payload", b"")]

    grid = map_of()
    first = shown(grid)
    assert shown(grid)[LIVE] == first[LIVE], "the same map is the same widget"
    again = grid.widget()
    assert again.payload is held()[0]
    again.close()
    assert len(held()) == 1
    grid.add(Scan.from_angles((0, 0, 0), [0.0], [2.0]))
    second = shown(grid)
    assert second[LIVE] != first[LIVE]
    assert [parts_of(payload)[0]["cells"] for payload in held()] == [len(grid.cells()[0])]
    old = widget_in(first)
    assert "payload" not in old.get_state(), "pages that show it are not told"
    widget_in(second).close()
    assert shown(grid)[LIVE] != second[LIVE]
    del grid
    assert held() == []


@pytest.mark.usefixtures("kernel")
def test_settings_are_those_of_views() -> None:
    grid = map_of(sensor=oddsmap.BeamSensor(p_hit=0.8, p_miss=0.3))
    widget = grid.widget(height=300)
    assert widget.settings == {
        "p_hit": 0.8, "p_miss": 0.3, "prior": 0.5, "thresholds": Thresholds(),
    }  # fmt: skip
    assert (widget.height, widget.linked) == (300, True)
    assert repr(widget) == f"MapWidget({grid!r})"
    assert set(shown(widget)) == {LIVE, "text/plain", "image/png"}
    widget.p_hit, widget.free, widget.posterior = 0.9, 0.1, "reflection"
    view = grid.log_odds(**widget.settings)
    assert (view.p_hit, view.thresholds) == (0.9, Thresholds(0.1))
    # As a page tells it.
    widget.set_state({"free": 0.7, "occupied": 0.8, "prior": 0.2})
    assert widget.settings["thresholds"] == Thresholds(0.7, 0.8)
    widget.close()


@pytest.mark.usefixtures("kernel")
def test_the_documented_lines() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "viewer.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", page, re.S | re.M)
    names: dict[str, Any] = {"grid": map_of()}
    for block in blocks:
        exec(compile(block, "viewer.md", "exec"), names)
    assert names["view"].p_hit == 0.9


@pytest.mark.usefixtures("kernel")
def test_settings_that_cannot_be() -> None:
    from traitlets import TraitError

    widget = map_of().widget()
    for name, value, said in (
        ("p_hit", 0.4, "p_hit lies between 0.5 and 1, got 0.4"),
        ("p_miss", 0.5, "p_miss lies between 0 and 0.5, got 0.5"),
        ("prior", 1.0, "prior lies between 0 and 1, got 1"),
        ("free", 0.9, "got 0.9 and 0.65"),
        ("posterior", "counts", "log-odds, calibrated, reflection, interval-width, got 'counts'"),
    ):
        with pytest.raises(TraitError, match=said):
            setattr(widget, name, value)
    with pytest.raises(ConfigError, match="at least 240 pixels high, got 100"):
        map_of().widget(height=100)
    cones = map_of(sensor=ConeSensor(cone_deg=20.0, range_max=4.0)).widget()
    with pytest.raises(TraitError, match="log-odds, reflection, interval-width, got 'calibrated'"):
        cones.posterior = "calibrated"
    with pytest.raises(TraitError, match="is one of log-odds, calibrated, got 'reflection'"):
        map_of((2, 2, 2)).widget().posterior = "reflection"
