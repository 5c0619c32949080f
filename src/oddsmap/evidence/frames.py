# SPDX-License-Identifier: Apache-2.0
"""Maps in other frames: quarter turns about the origin, which move whole cells and so are exact."""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import ConfigError, shown
from oddsmap.evidence.tiles import TileStore

__all__ = ["axes_of", "axes_of_up", "turned"]

_NAMES = "xyz"

# The first axis stays where it can; where it becomes the vertical, the second does.
_OF_UP = {
    "z": "x y z", "-z": "x -y -z", "y": "x -z y", "-y": "x z -y", "x": "-z y x", "-x": "z y -x"
}  # fmt: skip


def axes_of_up(up: str) -> str:
    """The axes that make one of the old ones the vertical.

    Args:
        up: "z", "-z", "y", "-y", "x" or "-x".

    Raises:
        ConfigError: it is none of these.
    """
    try:
        return _OF_UP[up.strip().lower().removeprefix("+")]
    except (KeyError, AttributeError):
        raise ConfigError(
            f"up is the axis that is to point up: x, y or z, or -x, -y, -z; got {shown(up)}"
        ) from None


def axes_of(axes: str, ndim: int) -> tuple[list[int], list[bool]]:
    """What the new axes are among the old ones.

    Args:
        axes: the old axis that each new one is, in order, such as "z -x -y".
        ndim: 2 or 3.

    Returns:
        The number of the old axis for each new one, and whether it is reversed.

    Raises:
        ConfigError: not each axis once, or a mirror image.
    """
    known = _NAMES[:ndim]
    words = axes.replace(",", " ").lower().split() if isinstance(axes, str) else []
    names = [word.removeprefix("-").removeprefix("+") for word in words]
    if sorted(names) != list(known):
        raise ConfigError(
            f"axes name each of {', '.join(known)} once, with - where reversed, as in "
            f'"{"z -x -y" if ndim == 3 else "y -x"}"; got {shown(axes)}'
        )
    source = [known.index(name) for name in names]
    reversed_ = [word.startswith("-") for word in words]
    turn = np.zeros((ndim, ndim))
    turn[range(ndim), source] = np.where(reversed_, -1.0, 1.0)
    if np.linalg.det(turn) < 0.0:
        raise ConfigError(
            f"axes {axes!r} are a mirror image: right would become left; reverse one axis more"
        )
    return source, reversed_


def turned(to: TileStore, tiles: TileStore, source: list[int], reversed_: list[bool]) -> None:
    """Add to a store the cells of another, turned about the corner that is the origin."""
    for index, hits, passes in tiles.parts():
        to.add_cells(_turned_cells(index, source, reversed_), np.stack([hits, passes], axis=1))


def _turned_cells(index: IntArray, source: list[int], reversed_: list[bool]) -> IntArray:
    # Cell i ends where i + 1 begins: reversed, that is -(i + 1).
    cells = index[:, source]
    return np.where(reversed_, -1 - cells, cells)
