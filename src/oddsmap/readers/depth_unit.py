# SPDX-License-Identifier: Apache-2.0
"""Whether depth images are in the unit that their layout is known for.

Recorders that save the millimetres of the driver write the layout of TUM around them as well,
where the unit is a fifth of that: everything then lands at a fifth of its distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.image_file import read_image
from oddsmap.readers.compression import open_source
from oddsmap.scans.note import Note

__all__ = ["doubt_unit"]

_TUM_UNITS = 5000.0  # per metre
_MM_UNITS = 1000.0

_SAMPLE = 5  # images that are looked at
# Structured light sees nothing nearer than 0.4 to 0.5 m, so half of an image never is; and rooms
# have something farther away than 1.6 m, which is where 8 m in millimetres would be.
_NEAR_M, _FAR_M = 0.5, 1.6


def doubt_unit(units_per_metre: float, images: Sequence[Path]) -> list[Note]:
    """A warning where images in units of 1/5000 m look like millimetres.

    Args:
        units_per_metre: how they would be read.
        images: all of them; a few are read.
    """
    if units_per_metre != _TUM_UNITS:
        return []
    chosen = sorted({round(i) for i in np.linspace(0, len(images) - 1, _SAMPLE)})
    units = np.concatenate([np.empty(0), *(_units(images[i]) for i in chosen)])
    if not len(units):
        return []
    middle, far = np.quantile(units, [0.5, 0.99]) / units_per_metre
    # The millimetres of a driver times 5 are multiples of 5: those are in the right unit.
    multiplied = bool((units % (_TUM_UNITS / _MM_UNITS) == 0).all())
    if not (far < _FAR_M and (middle < _NEAR_M or not multiplied)):
        return []
    return [
        Note(
            f"half of the depths are below {middle:.3g} m at 5000 units a metre, hardly any above "
            f"{far:.3g} m: nearer than depth cameras see; if the images are in millimetres, say "
            "--depth-scale 1000 (depth_scale=1000)",
            code="depth.unit",
            severity="warning",
        )
    ]


def _units(path: Path) -> FloatArray:
    """The pixels of an image that say something; none where it cannot be read."""
    try:
        image = read_image(path, open_source(path).content)
    except InputError:
        return np.empty(0)  # said when the image itself is read
    units = np.asarray(image, np.float64) if image.mode.startswith("I") else np.empty(0)
    return units[units > 0].ravel()
