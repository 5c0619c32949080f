# SPDX-License-Identifier: Apache-2.0
"""Messages of depth cameras: images of depth along the optical axis, and their intrinsics.

Sources: https://www.ros.org/reps/rep-0118.html (depth images);
https://docs.ros.org/en/noetic/api/sensor_msgs/html/msg/CameraInfo.html
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.recordings.beams import Beams
from oddsmap.recordings.recording import stamp_of
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.note import Note

__all__ = ["DEPTH_ENCODINGS", "camera_of", "depth_beams", "intrinsics_topic"]

DEPTH_ENCODINGS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
"""What an image of depth may be encoded as, and the type of its pixels."""

_MM_PER_M = 1000.0
_SATURATED = 65535
# Distortion that moves the corners of an image by less than this is none [pixels].
_UNSEEN = 0.1


def depth_beams(data: Any, units_per_metre: float | None = None) -> Beams:
    """The depths of a `sensor_msgs/Image`; its camera is stated by another message.

    Args:
        data: the message.
        units_per_metre: of whole numbers; by default they are millimetres.

    Raises:
        InputError: its size does not fit its bytes, or it is no image of depth.
    """
    kind = DEPTH_ENCODINGS.get(data.encoding)
    if kind is None:
        raise InputError(f"an image of encoding {data.encoding!r} has no depth")
    if units_per_metre is not None and kind == "f4":
        raise InputError("depths of 32FC1 are metres: leave `depth_scale` out for this log")
    width, height, step = int(data.width), int(data.height), int(data.step)
    content = np.asarray(data.data, np.uint8)
    size = np.dtype(kind).itemsize
    if width < 1 or height < 1 or width * size > step or step * height > len(content):
        raise InputError(
            f"an image of {width} x {height} pixels in rows of {step} bytes, and "
            f"{len(content)} bytes"
        )
    rows = content[: step * height].reshape(height, step)[:, : width * size]
    pixels = np.ascontiguousarray(rows).view((">" if data.is_bigendian else "<") + kind)
    notes = []
    if data.encoding == "mono16":
        text = "images are of encoding mono16, which need not be depth: taken as such"
        notes.append(Note(text, code="depth.encoding", severity="warning"))
    return Beams(
        frame=data.header.frame_id.lstrip("/"),
        stamp_ns=stamp_of(data.header),
        depth=_metres(pixels, units_per_metre or _MM_PER_M),
        notes=tuple(notes),
    )


def _metres(pixels: npt.NDArray[Any], units_per_metre: float) -> npt.NDArray[np.float32]:
    if pixels.dtype.kind == "f":
        return pixels.astype(np.float32)
    depth = pixels.astype(np.float32) / np.float32(units_per_metre)
    depth[pixels == _SATURATED] = np.nan
    return depth


def intrinsics_topic(image: str) -> str:
    """Where the intrinsics of an image are by convention: beside it."""
    return image.rstrip("/").rpartition("/")[0] + "/camera_info"


def camera_of(data: Any, image: str) -> tuple[PinholeCamera, list[Note]]:
    """The camera of a `sensor_msgs/CameraInfo`, and doubts about it.

    A rectified image (its topic says "rect") is described by P, any other by K and the distortion,
    which is left out.

    Args:
        data: the message.
        image: topic of the images.

    Raises:
        InputError: the camera is not calibrated, or is none.
    """
    k = _numbers(data, "k", 9)
    p = _numbers(data, "p", 12)
    rectified = "rect" in image.rsplit("/", 1)[-1] and p[0] != 0.0
    fx, fy, cx, cy = (p[0], p[5], p[2], p[6]) if rectified else (k[0], k[4], k[2], k[5])
    if fx == 0.0 or fy == 0.0:
        raise InputError(
            "the camera is not calibrated (a focal length of 0): state it with --camera 'FX FY CX "
            "CY WIDTH HEIGHT' (camera=)"
        )
    roi, binned = data.roi, (max(int(data.binning_x), 1), max(int(data.binning_y), 1))
    width, height = int(roi.width) or int(data.width), int(roi.height) or int(data.height)
    try:
        camera = PinholeCamera(
            fx=float(fx) / binned[0],
            fy=float(fy) / binned[1],
            cx=(float(cx) - int(roi.x_offset)) / binned[0],
            cy=(float(cy) - int(roi.y_offset)) / binned[1],
            width=width // binned[0],
            height=height // binned[1],
        )
    except ConfigError as error:
        raise InputError(str(error)) from None
    notes = [] if rectified else _doubts_of_distortion(data, camera)
    return camera, notes


def _doubts_of_distortion(data: Any, camera: PinholeCamera) -> list[Note]:
    """A warning where the lens moves pixels: how far, and what to do."""
    d = np.asarray(getattr(data, "d", None) if hasattr(data, "d") else data.D, np.float64)
    if not d.any():
        return []
    moved = (
        _moved(d, camera) if data.distortion_model in ("plumb_bob", "rational_polynomial") else None
    )
    if moved is not None and moved < _UNSEEN:
        return []
    far = "" if moved is None else f" by up to {moved:.1f} pixels"
    text = f"the lens moves pixels{far} ({data.distortion_model}), which is left out: record the "
    text += "rectified images, or run image_proc's rectify before"
    return [Note(text, code="camera.distortion", severity="warning")]


@np.errstate(all="ignore")  # of numbers that are no camera's
def _moved(d: FloatArray, camera: PinholeCamera) -> float:
    """How far distortion moves the corners of an image [pixels]; of the model of OpenCV."""
    k1, k2, p1, p2, k3, k4, k5, k6 = np.append(d, np.zeros(8))[:8]
    u = np.array([0.0, camera.width, 0.0, camera.width])
    v = np.array([0.0, 0.0, camera.height, camera.height])
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    dx = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - x
    dy = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - y
    return float(np.hypot(dx * camera.fx, dy * camera.fy).max())


def _numbers(data: Any, name: str, count: int) -> FloatArray:
    """A matrix of a message, which ROS 1 writes in capitals."""
    values = np.asarray(getattr(data, name if hasattr(data, name) else name.upper()), np.float64)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise InputError(f"{name.upper()} of the camera is no matrix of {count} numbers")
    return values
