# SPDX-License-Identifier: Apache-2.0
"""The viewer in a cell of a notebook, as a widget of anywidget, which is an extra."""

from __future__ import annotations

import base64
from typing import Any

import anywidget
import traitlets

from oddsmap.errors import ConfigError
from oddsmap.evidence.evidence import Evidence
from oddsmap.odds import Thresholds
from oddsmap.viewer.document import page_part
from oddsmap.viewer.plane import plane_payload
from oddsmap.viewer.space import space_payload

__all__ = ["HEIGHT", "LOWEST", "MapWidget", "payload_of_map"]

HEIGHT = 480
"""Of a widget [pixels of the page]."""

LOWEST = 240
"""Less has no room for the map and what is said of it [pixels]."""

_BETWEEN = {"p_hit": (0.5, 1.0), "p_miss": (0.0, 0.5), "prior": (0.0, 1.0)}


def payload_of_map(evidence: Evidence) -> bytes:
    """What the page is given of a map.

    Raises:
        InputError: it is empty, or too large for the page.
    """
    return (plane_payload if evidence.ndim == 2 else space_payload)(evidence, "map")


class MapWidget(anywidget.AnyWidget):
    """A map in the page of a notebook, as it was when this was made.

    Who moves a slider changes the attribute of that name, and the reverse.

    Args:
        evidence: the map.
        payload: see `payload_of_map`. It is held until `close`.
        height: of the widget [pixels of the page].
        linked: False: whoever looks at it has settings of their own.
        picture: a PNG for those who only read the notebook; None: they see a line.

    Attributes:
        posterior: what is shown: "log-odds", "calibrated" (not under wide beams), and of 2D maps
            "reflection" or "interval-width".
        p_hit: p(x | z) of a hit at prior 1/2, as in `EvidenceMap.log_odds`.
        p_miss: of a pass, likewise.
        prior: p(x), of the log odds.
        free: probability up to which a cell is free.
        occupied: probability from which a cell is occupied.

    Raises:
        traitlets.TraitError: an attribute is given a value that it cannot have.
    """

    _esm = page_part("widget.js").decode()

    payload = traitlets.Bytes(b"").tag(sync=True)
    linked = traitlets.Bool(True).tag(sync=True)
    height = traitlets.Int(HEIGHT, min=LOWEST).tag(sync=True)
    posterior = traitlets.Unicode("log-odds").tag(sync=True)
    p_hit = traitlets.Float().tag(sync=True)
    p_miss = traitlets.Float().tag(sync=True)
    prior = traitlets.Float().tag(sync=True)
    free = traitlets.Float().tag(sync=True)
    occupied = traitlets.Float().tag(sync=True)

    def __init__(
        self,
        evidence: Evidence,
        payload: bytes,
        *,
        height: int = HEIGHT,
        linked: bool = True,
        picture: bytes | None = None,
    ) -> None:
        sensor, own = evidence.sensor, evidence.config.posterior
        self._posteriors = (
            "log-odds",
            *(() if sensor.kind == "cone" else ("calibrated",)),
            *(("reflection", "interval-width") if evidence.ndim == 2 else ()),
        )
        self._words, self._picture = f"MapWidget({evidence!r})", picture
        super().__init__(
            payload=payload, height=height, linked=linked, p_hit=sensor.p_hit,
            p_miss=sensor.p_miss, prior=own.prior, free=own.thresholds.free,
            occupied=own.thresholds.occupied,
        )  # fmt: skip

    def __repr__(self) -> str:
        return self._words

    @property
    def settings(self) -> dict[str, Any]:
        """What is set, for `grid.log_odds(**widget.settings)`."""
        numbers = {name: getattr(self, name) for name in _BETWEEN}
        return {**numbers, "thresholds": Thresholds(self.free, self.occupied)}

    def forget(self) -> None:
        """Let go of the payload; pages that show it go on, and after a reload cannot."""
        # What is not synchronised is not taken from pages that have it, either.
        self.set_trait("keys", [name for name in self.keys if name != "payload"])
        self.payload = b""

    @traitlets.validate("p_hit", "p_miss", "prior")
    def _between(self, proposal: Any) -> float:
        low, high = _BETWEEN[proposal.trait.name]
        if not low < proposal.value < high:
            raise traitlets.TraitError(
                f"{proposal.trait.name} lies between {low:g} and {high:g}, got {proposal.value:g}"
            )
        return float(proposal.value)

    @traitlets.validate("free", "occupied")
    def _apart(self, proposal: Any) -> float:
        pair = {"free": self.free, "occupied": self.occupied}
        try:
            Thresholds(**{**pair, proposal.trait.name: proposal.value})
        except ConfigError as error:
            raise traitlets.TraitError(str(error)) from None
        return float(proposal.value)

    @traitlets.validate("posterior")
    def _known(self, proposal: Any) -> str:
        if proposal.value not in self._posteriors:
            raise traitlets.TraitError(
                f"posterior of this map is one of {', '.join(self._posteriors)}, "
                f"got {proposal.value!r}"
            )
        return str(proposal.value)

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        data, metadata = super()._repr_mimebundle_(**kwargs) or ({}, {})
        if self._picture is not None:
            data["image/png"] = base64.b64encode(self._picture).decode("ascii")
        return data, metadata
