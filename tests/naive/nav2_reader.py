# SPDX-License-Identifier: Apache-2.0
"""Nav2's map loader, from its rules alone: one pixel at a time, no oddsmap in it.

`rules="older"` is the loader of Humble and Jazzy (limits belong to nobody, alpha of a trinary image
is averaged in), `rules="newer"` the one that replaced it (limits belong to free and occupied,
transparent is unknown). A file that is to last must read the same in both.

Source: Nav2, nav2_map_server/src/map_io.cpp, before and after its loop over pixels was vectorised.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

Pixel = tuple[int, int, int, int]


def read_map(path: Path, rules: str = "newer") -> dict[str, Any]:
    """Read a map as a `nav_msgs/OccupancyGrid`: data row-major, x fastest, -1 or 0..100."""
    fields = yaml.safe_load(path.read_text(encoding="utf-8"))
    mode = fields.get("mode", "trinary")
    negate = bool(fields["negate"])
    free, occupied = float(fields["free_thresh"]), float(fields["occupied_thresh"])
    x, y, yaw = (float(value) for value in fields["origin"])
    rows, has_alpha = _pixels(path.parent / fields["image"])
    height, width = len(rows), len(rows[0])
    data = [-2] * (width * height)
    for row in range(height):
        for column in range(width):
            cell = _cell(rows[row][column], has_alpha, mode, negate, free, occupied, rules)
            data[width * (height - row - 1) + column] = cell
    return {
        "data": data,
        "width": width,
        "height": height,
        "resolution": float(fields["resolution"]),
        "origin": (x, y, yaw),
    }


def _cell(
    pixel: Pixel,
    has_alpha: bool,
    mode: str,
    negate: bool,
    free: float,
    occupied: float,
    rules: str,
) -> int:
    red, green, blue, alpha = pixel
    shades = [red, green, blue]
    if rules == "older" and mode == "trinary" and has_alpha:
        shades.append(alpha)
    shade = sum(shades) / len(shades) / 255.0
    occ = shade if negate else 1.0 - shade
    if mode == "raw":
        value = round(shade * 255.0)
        return value if value <= 100 else -1
    if mode not in {"trinary", "scale"}:
        raise ValueError(f"mode {mode}")
    if alpha != 255 and (mode == "scale" or rules == "newer"):
        return -1
    if rules == "newer":
        occ = float(np.float32(occ))
        is_free, is_occupied = occ <= free, occ >= occupied
    else:
        is_free, is_occupied = occ < free, occ > occupied
    if is_occupied:
        return 100
    if is_free:
        return 0
    if mode == "trinary":
        return -1
    return round((occ - free) / (occupied - free) * 100.0)


def _pixels(path: Path) -> tuple[list[list[Pixel]], bool]:
    if path.suffix == ".pgm":
        return _pgm(path.read_bytes()), False
    with Image.open(path) as image:
        has_alpha = "A" in image.getbands()
        colour = image.convert("RGBA")
        width, height = colour.size
        rows: list[list[Pixel]] = []
        for y in range(height):
            row: list[Pixel] = []
            for x in range(width):
                red, green, blue, alpha = colour.getpixel((x, y))  # type: ignore[misc]
                row.append((red, green, blue, alpha))
            rows.append(row)
        return rows, has_alpha


def _pgm(content: bytes) -> list[list[Pixel]]:
    lines = content.split(b"\n", 3)  # as written: "P5", "width height", "255", pixels
    if lines[0] != b"P5" or lines[2] != b"255":
        raise ValueError("not a binary PGM of 8 bits")
    width, height = (int(word) for word in lines[1].split())
    if len(lines[3]) != width * height:
        raise ValueError("the pixels of the PGM do not fill it")
    rows: list[list[Pixel]] = []
    for y in range(height):
        greys = lines[3][y * width : (y + 1) * width]
        rows.append([(grey, grey, grey, 255) for grey in greys])
    return rows
