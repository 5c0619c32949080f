# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` is told about a picture: title, trajectory, crop, size."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.array_types import FloatArray
    from oddsmap.plot.layout import FrameOptions

__all__ = ["OF_PICTURES", "PICTURES", "frame_options"]

PICTURES = (".png", ".pdf", ".svg")
OF_PICTURES = ("title", "trajectory", "crop", "size", "whole")
"""The options that pictures know."""


def frame_options(options: Mapping[str, Any]) -> FrameOptions:
    """What is stated of a picture, as `oddsmap.plot.layout.FrameOptions` has it.

    Raises:
        ConfigError: one of them would change nothing beside another.
        InputError: the trajectory is neither a log nor a file of poses.
    """
    from oddsmap.errors import ConfigError

    if "whole" in options and "crop" in options:
        raise ConfigError("--crop says what is shown, --whole that all is: leave one of them out")
    stated: Any = {name: options[name] for name in OF_PICTURES if name in options}
    if "trajectory" in stated:
        stated["trajectory"] = _positions(stated["trajectory"])
    found: FrameOptions = stated
    return found


def _positions(path: Path) -> FloatArray:
    """Where the sensor was, shape (n, 2), of a log or of a file of poses [m]."""
    import numpy as np

    from oddsmap.errors import InputError
    from oddsmap.readers import open_log
    from oddsmap.readers.pose_file import read_trajectory

    try:
        poses = open_log(path).poses
    except InputError as no_log:
        if path.is_dir():
            raise
        try:
            return read_trajectory(path).positions[:, :2]
        except InputError:
            raise InputError(f"--trajectory: neither a log nor a file of poses: {no_log}") from None
    return np.array([pose.translation[:2] for pose in poses], np.float64).reshape(-1, 2)
