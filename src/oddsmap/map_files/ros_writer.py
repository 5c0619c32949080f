# SPDX-License-Identifier: Apache-2.0
"""Writing a ROS map: the YAML of map_server and an image beside it.

The greys are chosen for what Nav2's loader makes of them, which its own saver is not: there,
unknown (205) turns free under free_thresh 0.25, and `scale` gives back other probabilities than
were saved. Here unknown stays unknown, and a probability comes back, whatever the thresholds.

Source: Nav2, nav2_map_server/src/map_io.cpp (tryWriteMapToFile, loadMapFromFile).
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import get_args

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_outputs, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.fields import Grid
from oddsmap.map_files.ros_reader import RosMode, read_greys
from oddsmap.odds import State, Thresholds

__all__ = ["image_beside", "save_ros"]

_FREE, _UNKNOWN, _OCCUPIED = 254, 205, 0  # the greys of Nav2's saver
_RAW_UNKNOWN = 255

# Nav2 compares in single precision, and older ones with < instead of <=: keep off the thresholds.
_MARGIN = 1e-6


def save_ros(
    grid: Grid,
    path: str | Path,
    *,
    mode: RosMode = "trinary",
    thresholds: Thresholds | None = None,
    force: bool = False,
) -> tuple[Path, Path]:
    """Write a map for ROS's map_server: YAML, and an image of the same name beside it.

    - trinary (PGM): 254 free, 205 unknown or undecided, 0 occupied. Where 205 would not read as
      unknown under `thresholds`, a grey between them takes its place.
    - scale (PNG): Nav2 reads free cells as 0, occupied ones as 100 (only that is lethal to its
      planners), and undecided ones as 100 p within 100 / (255 (occupied - free)), by default 0.9;
      `load_ros` gets p back in all of them. Unknown cells are transparent.
    - raw (PGM): 100 p rounded to an integer, 255 where unknown.

    Args:
        grid: the map, at least one cell.
        path: the `.yaml`; the image is `path` with the suffix `.pgm` or `.png`.
        mode: what the image holds: "trinary", "scale" or "raw".
        thresholds: what is free and what is occupied, written to the YAML; by default 0.196, 0.65.
        force: True where existing files may be replaced.

    Returns:
        The paths of the YAML and of the image.

    Raises:
        InputError: the map has no cells, or an observed cell no probability in [0, 1].
        ConfigError: an unknown mode, or thresholds with no grey of 8 bits between them.
        OutputError: a file exists already or cannot be written.
    """
    path = Path(path)
    limits = thresholds or Thresholds()
    if mode not in get_args(RosMode):
        raise ConfigError(f"mode must be one of {', '.join(get_args(RosMode))}, got {mode!r}")
    if path.suffix not in {".yaml", ".yml"}:
        raise ConfigError(f"{path}: a ROS map is named by its .yaml; give such a name")
    image = image_beside(path, mode)
    check_output(path, force=force)
    check_output(image, force=force)
    _check_grid(grid, path)
    grey = _greys(grid, mode, limits)[::-1]  # the top row of the image is the highest y
    # Both are complete before either takes its place, the image first: a YAML never lacks it.
    with atomic_outputs(image, path, force=force) as (part, yaml_part):
        yaml_part.write_text(_yaml(grid, image.name, mode, limits), encoding="utf-8")
        if mode == "scale":
            _write_png(part, grey, grid.observed[::-1])
        else:
            _write_pgm(part, grey)
    return path, image


def image_beside(path: Path, mode: RosMode) -> Path:
    """The image of a ROS map, by the path of its YAML."""
    return path.with_suffix(".png" if mode == "scale" else ".pgm")


def _check_grid(grid: Grid, path: Path) -> None:
    ny, nx = grid.probability.shape
    if ny == 0 or nx == 0:
        raise InputError(f"{path}: the map has {ny} x {nx} cells, nothing to write")
    seen = grid.probability[grid.observed]
    wrong = np.count_nonzero(~((seen >= 0.0) & (seen <= 1.0)))
    if wrong:
        raise InputError(f"{path}: {wrong} observed cells have no probability in [0, 1]")
    if not all(math.isfinite(value) for value in (*grid.origin, grid.yaw)):
        raise InputError(f"{path}: the origin {grid.origin}, yaw {grid.yaw} is not finite")


def _greys(grid: Grid, mode: RosMode, limits: Thresholds) -> npt.NDArray[np.uint8]:
    """Choose the grey of each cell, shape (ny, nx), row = y ascending."""
    if mode == "raw":
        percent = np.rint(100.0 * np.where(grid.observed, grid.probability, 0.0))
        return np.where(grid.observed, percent, _RAW_UNKNOWN).astype(np.uint8)
    state = limits.state(grid.probability, grid.observed)
    if mode == "scale":
        return _scale_greys(grid.probability, state, limits)
    read = _state_of_greys(limits)
    unknown = _UNKNOWN
    if read[unknown] != State.UNDECIDED and np.any((state < 0) | (state == State.UNDECIDED)):
        between = np.flatnonzero(read == State.UNDECIDED)
        _check_between(between.size, limits)
        unknown = int(between[between.size // 2])
    grey = np.full(state.shape, unknown, dtype=np.uint8)
    grey[state == State.FREE] = _FREE if read[_FREE] == State.FREE else 255
    grey[state == State.OCCUPIED] = _OCCUPIED
    return grey


def _scale_greys(
    probability: npt.NDArray[np.float64], state: npt.NDArray[np.int8], limits: Thresholds
) -> npt.NDArray[np.uint8]:
    """Choose, among the greys that keep the state of a cell, the one that reads nearest to p."""
    grey = np.full(state.shape, 127, dtype=np.uint8)  # what a transparent pixel would show
    meaning, _ = read_greys(np.arange(256.0), mode="scale", thresholds=limits)
    read = _state_of_greys(limits)
    for wanted in (State.FREE, State.UNDECIDED, State.OCCUPIED):
        cells = state == wanted
        if not cells.any():
            continue
        usable = read == wanted
        if wanted == State.UNDECIDED:
            # Near a threshold the nearest grey may read as a p beyond it: the next one does not.
            _check_between(int(np.count_nonzero(usable)), limits)
            inside = usable & (meaning > limits.free) & (meaning < limits.occupied)
            # Thresholds less than 0.07 apart may leave no such grey; then the nearest has to do.
            usable = inside if inside.any() else usable
        choice = np.flatnonzero(usable)[::-1]  # from bright to dark: p ascending
        middle = (meaning[choice][1:] + meaning[choice][:-1]) / 2.0
        grey[cells] = choice[np.searchsorted(middle, probability[cells])]
    return grey


def _state_of_greys(limits: Thresholds) -> npt.NDArray[np.int8]:
    """Say what every version of Nav2 makes of the 256 greys; -1 where they may differ."""
    darkness = (255.0 - np.arange(256.0)) / 255.0
    state = np.full(256, State.UNKNOWN, dtype=np.int8)
    state[(darkness < limits.free - _MARGIN) | (darkness == 0.0)] = State.FREE
    state[(darkness > limits.occupied + _MARGIN) | (darkness == 1.0)] = State.OCCUPIED
    between = (darkness > limits.free + _MARGIN) & (darkness < limits.occupied - _MARGIN)
    state[between] = State.UNDECIDED
    return state


def _check_between(count: int, limits: Thresholds) -> None:
    if count == 0:
        raise ConfigError(
            f"thresholds {limits.free} and {limits.occupied} leave no 8-bit grey for the cells "
            "between them; move them apart or use mode raw"
        )


def _yaml(grid: Grid, image_name: str, mode: RosMode, limits: Thresholds) -> str:
    x, y = grid.origin
    plain = re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.-]*", image_name)
    name = image_name if plain else json.dumps(image_name, ensure_ascii=False)
    return (
        f"image: {name}\n"
        f"mode: {mode}\n"
        f"resolution: {_exact(grid.resolution)}\n"
        f"origin: [{_exact(x)}, {_exact(y)}, {_exact(grid.yaw)}]\n"
        "negate: 0\n"
        f"occupied_thresh: {_exact(limits.occupied)}\n"
        f"free_thresh: {_exact(limits.free)}\n"
    )


def _exact(value: float) -> str:
    """Write a number so that the same one is read: Nav2's own saver keeps 3 digits."""
    text = repr(float(value))
    # YAML 1.1 takes 1e-05 for text; it needs a point.
    return text if "." in text else text.replace("e", ".0e")


def _write_pgm(path: Path, grey: npt.NDArray[np.uint8]) -> None:
    height, width = grey.shape
    with path.open("wb") as file:
        file.write(f"P5\n{width} {height}\n255\n".encode("ascii"))
        file.write(grey.tobytes())


def _write_png(path: Path, grey: npt.NDArray[np.uint8], opaque: npt.NDArray[np.bool_]) -> None:
    from PIL import Image

    # RGBA, not grey with alpha: Nav2's image library has trouble with the alpha of the latter.
    alpha = np.where(opaque, 255, 0).astype(np.uint8)
    Image.fromarray(np.stack([grey, grey, grey, alpha], axis=-1)).save(path, format="PNG")
