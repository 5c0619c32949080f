# SPDX-License-Identifier: Apache-2.0
"""A map at the end of a cell: live where the extra `widget` is installed, else its thumbnail.

ipywidgets holds every widget for as long as the kernel runs. What would be held with it, the
payload, is let go of with the map, or when the map is shown again with other evidence: pages that
show it have their own.
"""

from __future__ import annotations

import html
import sys
import weakref
from collections.abc import Callable
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.short_repr import in_bytes

if TYPE_CHECKING:
    from oddsmap.viewer.map_widget import MapWidget

__all__ = ["Bundle", "bundle_of", "widget_of"]

Bundle = dict[str, Any] | tuple[dict[str, Any], dict[str, Any]] | None
"""As IPython takes it: data by their kind, and what is to be known of them."""

# Of evidence: more would take seconds, and tens of megabytes of the notebook that is saved.
_UNASKED = 1 << 25

_shown: weakref.WeakKeyDictionary[Evidence, MapWidget] = weakref.WeakKeyDictionary()


def bundle_of(evidence: Evidence, drawn: Callable[[], str]) -> Bundle:
    """What a notebook shows of a map beside its picture; None: nothing.

    Nothing is loaded but in a kernel, which is what pages talk to.

    Args:
        evidence: the map.
        drawn: makes the HTML of its picture.
    """
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    if getattr(shell, "kernel", None) is None or find_spec("anywidget") is None:
        return None
    try:
        if evidence.nbytes > _UNASKED:
            size = in_bytes(evidence.nbytes)
            raise InputError(f"with {size} of evidence it is shown live by .widget() alone")
        widget = _live(evidence)
    except InputError as error:
        why = html.escape(f"A picture, not the live map: {str(error).removeprefix('map: ')}")
        return {"text/html": f"{drawn()}<div><small>{why}</small></div>"}
    data, metadata = widget._repr_mimebundle_()
    kind = "application/vnd.jupyter.widget-view+json"
    return {kind: data[kind]}, metadata


def _live(evidence: Evidence) -> MapWidget:
    """The widget of a map: the one that was shown last, where the map is still the same."""
    from oddsmap.viewer.map_widget import MapWidget, payload_of_map

    last, payload = _shown.get(evidence), payload_of_map(evidence)
    if last is not None:
        if last.payload == payload and last.comm is not None:  # as after `Widget.close_all()`
            return last
        last.forget()
    widget = MapWidget(evidence, payload, linked=False)
    _shown[evidence] = widget
    weakref.finalize(evidence, widget.forget).atexit = False
    return widget


def widget_of(evidence: Evidence, height: int | None, picture: bytes | None) -> MapWidget:
    """A widget whose settings are linked with Python's: see `EvidenceMap.widget`.

    Args:
        evidence: the map.
        height: of the widget [pixels of the page]; None: as usual.
        picture: see `MapWidget`.
    """
    try:
        from oddsmap.viewer.map_widget import HEIGHT, LOWEST, MapWidget, payload_of_map
    except ImportError:
        raise ConfigError('a live map needs anywidget: pip install "oddsmap[widget]"') from None
    height = HEIGHT if height is None else height
    if height < LOWEST:
        raise ConfigError(f"a widget is at least {LOWEST} pixels high, got {height}")
    last, payload = _shown.get(evidence), payload_of_map(evidence)
    if last is not None and last.payload == payload:
        payload = last.payload  # held once
    return MapWidget(evidence, payload, height=height, picture=picture)
