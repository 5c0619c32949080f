# SPDX-License-Identifier: Apache-2.0
"""Small pictures for notebooks: a map at the end of a cell shows itself.

Nothing of Matplotlib is loaded, and no more of a map is decoded at a time than a part of it.
"""

from __future__ import annotations

import base64
import html
import struct
import zlib
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.plot.picture import FREE, OCCUPIED

__all__ = [
    "MOST_CELLS", "MOST_PIXELS", "Pictured", "Thumbnail", "of_hits", "of_probability",
    "of_quantity", "png_bytes",
    "shrunk",
]  # fmt: skip

MOST_PIXELS = 400
"""Of a thumbnail, along each side."""

MOST_CELLS = 1 << 23
"""Boxes of more cells are not worked out for a thumbnail."""

_LEAST_PIXELS = 200  # smaller ones get several pixels a cell
_UNKNOWN = (199, 213, 227)
# Viridis at seventeen places, of S. van der Walt and N. Smith (CC0); lines between them are off by
# up to 6 of 255.
_VIRIDIS = np.array(
    [(68, 1, 84), (72, 24, 106), (71, 45, 123), (66, 64, 134), (59, 82, 139), (51, 99, 141),
     (44, 114, 142), (38, 130, 142), (33, 145, 140), (31, 160, 136), (40, 174, 128),
     (63, 188, 115), (94, 201, 98), (132, 212, 75), (173, 220, 48), (216, 226, 25),
     (253, 231, 37)], np.float64,
)  # fmt: skip

Image = npt.NDArray[np.uint8]


class Thumbnail(NamedTuple):
    """A small picture, and what its colours are."""

    image: Image
    """RGB, shape (height, width, 3), the first row on top."""
    caption: str


class Pictured:
    """What notebooks show of a thing that has a thumbnail. Made to be derived from."""

    __slots__ = ()

    def _thumbnail(self) -> Thumbnail | None:
        """A small picture; None: there is nothing to be seen."""
        return None

    def _repr_png_(self) -> bytes | None:
        try:
            thumbnail = self._thumbnail()
        except Exception:  # what is shown must never stand in the way of what is done
            return None
        return None if thumbnail is None else png_bytes(thumbnail.image)

    def _repr_html_(self) -> str:
        text = html.escape(repr(self).removeprefix("<").removesuffix(">"))
        try:
            thumbnail = self._thumbnail()
        except Exception:
            thumbnail = None
        if thumbnail is None:
            return f"<div>{text}</div>"
        height, width, _ = thumbnail.image.shape
        data = base64.b64encode(png_bytes(thumbnail.image)).decode("ascii")
        caption = html.escape(thumbnail.caption)
        return (
            f'<figure style="margin:0"><img src="data:image/png;base64,{data}" width="{width}" '
            f'height="{height}" style="image-rendering:pixelated" alt="{caption}">'
            f"<figcaption>{text}<br><small>{caption}</small></figcaption></figure>"
        )


def png_bytes(image: Image) -> bytes:
    """An RGB image as the bytes of a PNG.

    Args:
        image: shape (height, width, 3), the first row on top.

    Source: Portable Network Graphics specification, third edition (W3C 2025), sections 5 and 11.
    """
    height, width, _ = image.shape
    # Each row begins with the number of its filter: 0, none.
    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = image.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def shrunk(
    parts: Iterable[tuple[IntArray, FloatArray]], lo: IntArray, hi: IntArray
) -> npt.NDArray[np.float64]:
    """Values of 2D cells in at most `MOST_PIXELS` blocks along each side.

    A block has the largest value of its cells from 0.5 on, else the mean of those known, as in the
    pictures; NaN where none is known.

    Args:
        parts: known cells, some at a time: index, shape (n, 2), x first, and value, shape (n,).
        lo: the first cell, shape (2,).
        hi: past the last, shape (2,).
    """
    nx, ny = (int(n) for n in hi - lo)
    block = -(-max(nx, ny, 1) // MOST_PIXELS)
    width, height = -(-nx // block), -(-ny // block)
    largest, total, count = np.full(width * height, -np.inf), *np.zeros((2, width * height))
    for index, value in parts:
        x, y = (index - lo).T // block
        place = y * width + x
        np.maximum.at(largest, place, value)
        total += np.bincount(place, value, minlength=width * height)
        count += np.bincount(place, minlength=width * height)
    with np.errstate(invalid="ignore"):
        mean = total / count
    return np.where(largest >= 0.5, largest, mean).reshape(height, width)


def of_probability(value: npt.NDArray[np.float64], of: str = "") -> Thumbnail:
    """White for free, black for occupied.

    Args:
        value: as `shrunk` gives it, row = y ascending.
        of: what a pixel is of, where that is not the most occupied cell of its block.
    """
    free, occupied = np.array(FREE), np.array(OCCUPIED)
    shade = np.nan_to_num(value)[..., None]
    return _finished(
        free + (occupied - free) * shade,
        np.isnan(value),
        "white free, grey undecided, black occupied, blue unknown" + (f"; {of}" if of else ""),
    )


def of_hits(hits: npt.NDArray[np.float64], known: npt.NDArray[np.bool_]) -> Thumbnail:
    """A 3D map from above: the darker, the more hits, on a scale of logarithms."""
    share = np.log1p(hits) / max(float(np.log1p(hits).max(initial=0.0)), 1e-12)
    free, occupied = np.array(FREE), np.array(OCCUPIED)
    return _finished(
        free + (occupied - free) * share[..., None],
        ~known,
        "seen from above: the darker, the more hits; blue unknown",
    )


def of_quantity(
    value: npt.NDArray[np.float64], label: str, limits: tuple[float, float] | None = None
) -> Thumbnail:
    """Dark blue over green to yellow; NaN where nothing is known; row = y ascending.

    Args:
        value: large arrays are drawn at every k-th row and column.
        label: what it is, with its unit.
        limits: values at the ends; None: 0 and the largest.
    """
    step = -(-max(value.shape) // MOST_PIXELS)
    value = value[::step, ::step]
    seen = value[np.isfinite(value)]
    low, high = limits or (min(0.0, float(seen.min(initial=0.0))), float(seen.max(initial=0.0)))
    shown = np.where(np.isfinite(value), value, low)
    share = np.clip((shown - low) / (high - low if high > low else 1.0), 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(_VIRIDIS))
    colours = np.stack([np.interp(share, places, channel) for channel in _VIRIDIS.T], axis=-1)
    caption = f"{label}: dark {low:.4g}, yellow {high:.4g}; blue-grey unknown"
    return _finished(colours, ~np.isfinite(value), caption)


def _finished(
    colours: npt.NDArray[np.float64], unknown: npt.NDArray[np.bool_], caption: str
) -> Thumbnail:
    image = np.rint(colours).astype(np.uint8)
    image[unknown] = _UNKNOWN
    scale = max(1, _LEAST_PIXELS // max(image.shape[:2]))
    image = image[::-1].repeat(scale, axis=0).repeat(scale, axis=1)
    return Thumbnail(np.ascontiguousarray(image), caption)
