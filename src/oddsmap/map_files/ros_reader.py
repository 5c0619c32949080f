# SPDX-License-Identifier: Apache-2.0
"""Reading a ROS map: the YAML of map_server and the image beside it.

A ROS map has no counts, so it becomes a `ProbabilityMap`. Nav2 has two generations of loaders;
this one follows the newer (limits belong to free and occupied, transparent is unknown) and, like
the older, takes the plain mean of the colours. Grey images read the same in all three.

Source: Nav2, nav2_map_server/src/map_io.cpp (loadMapYaml, loadMapFromFile), both generations.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.decoding import decoding
from oddsmap.errors import ConfigError, InputError, shown
from oddsmap.image_file import read_image
from oddsmap.limits import check_content_size
from oddsmap.odds import Thresholds
from oddsmap.scans.note import Note

__all__ = ["RosGrid", "RosMode", "read_greys", "read_ros"]

RosMode = Literal["trinary", "scale", "raw"]

_REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")

# P5, width, height, largest value, one white space; a comment may stand before each number.
_PGM_HEADER = re.compile(rb"P5" + rb"(?:\s|#[^\n]*\n)+(\d{1,12})" * 3 + rb"\s")

# A map's YAML has some 200 bytes.
_LONGEST_YAML = 1 << 16
# Two levels are needed. PyYAML takes 10 s for three thousand.
_DEEPEST_YAML = 8

# What the savers of map_server and Nav2 write for unknown, whatever the thresholds of the file.
_SAVED_UNKNOWN = 205.0


class RosGrid(NamedTuple):
    """A ROS map, in the order of the arguments of `oddsmap.ProbabilityMap`, and its mode."""

    probability: FloatArray
    observed: BoolArray
    resolution: float
    origin: tuple[float, float]
    yaw: float
    notes: tuple[Note, ...] = ()
    mode: RosMode = "trinary"


def read_ros(path: str | Path) -> RosGrid:
    """Read the grid of a map_server map: see `oddsmap.load_ros`."""
    path = Path(path)
    fields = _read_fields(path)
    resolution = _number(path, "resolution", fields["resolution"])
    if resolution <= 0.0:
        raise InputError(f"{path}: resolution must be positive [m], got {resolution}")
    origin = fields["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise InputError(
            f"{path}: origin must be a list [x, y, yaw] of 3 numbers, got {shown(origin)}"
        )
    x, y, yaw = (_number(path, "origin", value) for value in origin)
    mode = _mode(path, fields.get("mode", "trinary"))
    try:
        thresholds = Thresholds(
            free=_number(path, "free_thresh", fields["free_thresh"]),
            occupied=_number(path, "occupied_thresh", fields["occupied_thresh"]),
        )
    except ConfigError as error:
        raise InputError(f"{path}: {error}") from None
    negate = _negate(path, fields["negate"])
    grey, opaque = _read_image(path, fields["image"])
    probability, observed = read_greys(grey, mode=mode, thresholds=thresholds, negate=negate)
    notes: list[Note] = []
    if mode == "trinary" and not negate:
        saved_unknown = (grey == _SAVED_UNKNOWN) & observed
        if saved_unknown.any():
            observed &= ~saved_unknown
            notes.append(_note_unknown(int(saved_unknown.sum()), thresholds))
    if mode != "raw":
        observed &= opaque
    probability[~observed] = 0.5
    # The first row of an image is its top, the first row of a map its lowest y.
    return RosGrid(
        probability=probability[::-1].copy(),
        observed=observed[::-1].copy(),
        resolution=resolution,
        origin=(x, y),
        yaw=yaw,
        notes=tuple(notes),
        mode=mode,
    )


def read_greys(
    grey: npt.NDArray[np.float64], *, mode: RosMode, thresholds: Thresholds, negate: bool = False
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Say what the greys of a ROS map mean, transparency left aside.

    With d the darkness of a pixel, 0 for white and 1 for black (`negate`: the other way round):

    - trinary: free where d <= thresholds.free, occupied where d >= thresholds.occupied, unknown
      between. p is d itself, for free cells at most and for occupied cells at least the default
      threshold, so that the map's default state is what Nav2 decides by the thresholds of the file;
    - scale: p is d in free and occupied cells (Nav2 makes 0 and 100 of them), and runs from 0 to 1
      as d goes from one threshold to the other between them, as in Nav2;
    - raw: the grey is the probability in percent, above 100 is unknown; `negate` has no effect.

    Args:
        grey: brightness of the pixels, 0 (black) to 255 (white), any shape.
        mode: "trinary", "scale" or "raw".
        thresholds: those in the YAML.
        negate: True where dark pixels are free.

    Returns:
        Probability and observed, both of the shape of `grey`.
    """
    if mode == "raw":
        percent = np.rint(grey)
        return percent / 100.0, percent <= 100.0
    darkness = (grey if negate else 255.0 - grey) / 255.0
    free = darkness <= thresholds.free
    occupied = darkness >= thresholds.occupied
    if mode == "trinary":
        usual = Thresholds()
        probability = np.where(
            free, np.minimum(darkness, usual.free), np.maximum(darkness, usual.occupied)
        )
        return probability, free | occupied
    between = (darkness - thresholds.free) / (thresholds.occupied - thresholds.free)
    probability = np.where(free | occupied, darkness, between)
    return probability, np.ones(grey.shape, dtype=np.bool_)


def _note_unknown(count: int, thresholds: Thresholds) -> Note:
    return Note(
        f"{count} pixels of grey 205 are read as unknown, which they are where map_server's saver "
        f"wrote the map; Nav2's own loader takes them for free, as 50/255 is below free_thresh "
        f"{thresholds.free:g}: set free_thresh to 0.196",
        code="ros.unknown_as_free",
        severity="warning",
    )


def _read_fields(path: Path) -> Mapping[str, object]:
    try:
        content = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError):
        raise InputError(f"{path}: no such file; give the .yaml of the map") from None
    advice = "give the .yaml, not the image of the map"
    if len(content) > _LONGEST_YAML:
        raise InputError(f"{path}: not the YAML of a map ({len(content)} bytes): {advice}")
    with decoding(path, "not YAML", advice):
        fields = _parse_yaml(content.decode("utf-8-sig"))
    if not isinstance(fields, dict):
        raise InputError(f"{path}: not the YAML of a ROS map: no keys; give the .yaml of the map")
    missing = [key for key in _REQUIRED if fields.get(key) is None]
    if missing:
        needed = ", ".join(_REQUIRED)
        raise InputError(f"{path}: no {', '.join(missing)}; a ROS map needs {needed}")
    return fields


def _parse_yaml(text: str) -> object:
    """What plain YAML says: no tags of Python, no aliases, which can stand for billions of values.

    Raises:
        ValueError: an alias, deep nesting, or a key that is there twice.
    """
    import yaml

    depth = 0
    for event in yaml.parse(text, yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise ValueError("aliases (*name) have no place in a map")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST_YAML:
            raise ValueError("nested too deeply")
    root = yaml.compose(text, yaml.SafeLoader)
    if isinstance(root, yaml.MappingNode):
        keys = [key.value for key, _ in root.value if isinstance(key, yaml.ScalarNode)]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if twice:
            raise ValueError(f"{twice[0]} is there twice")
    return yaml.safe_load(text)


def _number(path: Path, key: str, value: object) -> float:
    # A string as well: PyYAML takes 1e-05, without a point, for text.
    if isinstance(value, int | float | str) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):  # an integer beyond all floats
            number = math.nan
        if math.isfinite(number):
            return number
    raise InputError(f"{path}: {key} must be a finite number, got {shown(value)}")


def _mode(path: Path, value: object) -> RosMode:
    for mode in get_args(RosMode):
        if isinstance(value, str) and value.lower() == mode:
            return mode  # type: ignore[no-any-return]
    modes = ", ".join(get_args(RosMode))
    raise InputError(f"{path}: mode must be one of {modes}, got {shown(value)}")


def _negate(path: Path, value: object) -> bool:
    if isinstance(value, int) and value in (0, 1):  # True and False are integers, too
        return value == 1
    raise InputError(f"{path}: negate must be 0, 1, true or false, got {shown(value)}")


def _read_image(path: Path, name: object) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Read the image of the map at `path`: brightness 0 to 255, and where it is opaque."""
    if not isinstance(name, str) or not name:
        raise InputError(f"{path}: image must be the name of a file, got {shown(name)}")
    image = _find_image(path, name)
    with image.open("rb") as file:
        head = file.read(4096)
    match = _PGM_HEADER.match(head)
    # By hand, as Pillow refuses more than 179 million pixels: 670 m at 0.05 m is more.
    if match and match[3] == b"255":
        width, height = int(match[1]), int(match[2])
        held = image.stat().st_size - match.end()
        if width * height == 0:
            raise InputError(f"{image}: announces {width} x {height} pixels: an empty map")
        if held < width * height:
            raise InputError(
                f"{image}: announces {width} x {height} pixels, holds {held}; it is cut off"
            )
        check_content_size(image, 8 * held, f"a map of {width} x {height} cells")
        grey = np.fromfile(image, np.uint8, count=width * height, offset=match.end())
        return grey.reshape(height, width).astype(np.float64), np.ones((height, width), np.bool_)
    return _read_with_pillow(image)


def _find_image(path: Path, name: str) -> Path:
    image = path.parent / name
    if name.startswith("~") and not image.is_file():
        with decoding(path, f"its image {shown(name)} is in no known home", "write the whole path"):
            image = Path(name).expanduser()
    with decoding(path, f"its image {shown(name)} cannot be looked for", "name a file"):
        found = image.is_file()
    if not found:
        raise InputError(f"{path}: its image {image} does not exist; put it beside the .yaml")
    return image


def _read_with_pillow(
    path: Path,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    check_content_size(path, path.stat().st_size, "an image")
    image = read_image(path, path.read_bytes())
    if image.mode == "F":
        raise InputError(
            f"{path}: an image of real numbers, whose scale is not known: "
            "save the map as PGM or PNG, with greys of 8 or 16 bits"
        )
    if image.mode.startswith("I"):  # 16 bits per pixel
        deep = np.asarray(image, dtype=np.float64)
        if deep.min() < 0.0 or deep.max() > 65535.0:
            raise InputError(
                f"{path}: greys of 32 bits, {deep.min():g} to {deep.max():g}, whose scale is not "
                "known: save the map as PGM or PNG, with greys of 8 or 16 bits"
            )
        return deep / 257.0, np.ones(deep.shape, dtype=np.bool_)
    with decoding(path, "its pixels cannot be read as colours", "save the map as PGM or PNG"):
        pixels = np.asarray(image.convert("RGBA"))
    return pixels[..., :3].mean(axis=2), pixels[..., 3] == 255
