# SPDX-License-Identifier: Apache-2.0
"""The formats of `oddsmap export`, and which options each of them knows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from oddsmap.cli.options import flag
from oddsmap.cli.picture_options import OF_PICTURES

__all__ = ["BAGS", "HEIGHTS", "check_format_options", "kind_of"]

BAGS = (".mcap", ".bag", "ros2-bag", "foxglove")
"""Messages of ROS: a file of ROS 2, a file of ROS 1, a folder of ROS 2; an MCAP for Foxglove."""

HEIGHTS = ("z_min", "z_max", "ground", "rule", "slab")
"""The options that make a plane of space."""

_SAME = {".pdf": ".png", ".svg": ".png", ".yml": ".yaml", ".tiff": ".tif"}
_OF_PLANE = (".yaml", ".png", ".tif", ".rrd", *BAGS)

# Where an option changes something, and what is said elsewhere.
_WHERE: dict[str, tuple[tuple[str, ...], str]] = {
    "mode": ((".yaml", *BAGS), "--mode says how a ROS map is written"),
    "clamp": (
        (".yaml", ".png", ".npz", ".tif", ".ot", ".ply", ".las", ".laz", ".rrd", *BAGS),
        "--clamp bounds probabilities that are written",
    ),
    **dict.fromkeys(
        ("free", "occupied"),
        (
            (".yaml", ".bt", ".ply", ".las", ".laz", ".rrd", *BAGS),
            "--free and --occupied decide which cells are free or occupied in a ROS map, its "
            "messages, a .bt and points",
        ),
    ),
    **dict.fromkeys(HEIGHTS, (_OF_PLANE, "--z-min, --z-max, --ground make a 2D map")),
    "frame": (BAGS, "--frame names the frame of a map in .mcap, .bag and --format ros2-bag"),
    "stamp": (BAGS, "--stamp is the time of a map in .mcap, .bag and --format ros2-bag"),
    "shift": ((".bt", ".ot", ".rrd", *BAGS), "--shift moves an OctoMap or an .rrd"),
    **dict.fromkeys(
        OF_PICTURES,
        ((".png",), "--title, --trajectory, --crop, --size and --whole shape a picture"),
    ),
    "crs": ((".tif", ".las", ".laz"), "--crs says where a .tif, .las or .laz is on the Earth"),
}


def kind_of(output: Path, options: Mapping[str, Any]) -> str:
    """What is written: a suffix, .png for all pictures, or the --format where no suffix says it."""
    stated: str | None = options.get("format")
    suffix = output.suffix.lower()
    return stated or _SAME.get(suffix, suffix)


def check_format_options(output: Path, kind: str, options: Mapping[str, Any]) -> None:
    """Refuse an option that would change nothing in this output.

    Raises:
        ConfigError: one would not.
    """
    from oddsmap.errors import ConfigError

    for name, (kinds, meaning) in _WHERE.items():
        if name in options and kind not in kinds:
            raise ConfigError(f"{meaning}, not {output.name}")
    if "shift" in options and kind != ".rrd" and options.keys() & set(HEIGHTS):
        raise ConfigError(f"--shift moves an OctoMap, and {flag('z_min')}, ... make a 2D map")
