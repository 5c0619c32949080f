# SPDX-License-Identifier: Apache-2.0
"""Folders of depth images: the 7-Scenes layout and the TUM RGB-D layout.

| | 7-Scenes | TUM RGB-D |
|---|---|---|
| images | `frame-XXXXXX.depth.png` | listed in `depth.txt`, else `associations.txt` |
| poses | `frame-XXXXXX.pose.txt` (4 x 4), or `poses=` | `groundtruth.txt` or `poses=`, by stamp, interpolated |
| unit of depth | `depth_scale=`, else 1 mm; 0 and 65535 are invalid | `depth_scale=`, else 1/5000 m; 0 is invalid |
| intrinsics | `camera=`, else `camera-intrinsics.txt` (3 x 3), else | the same |
| by default | fx = fy = 585, cx 320, cy 240 | fx = fy = 525, cx 319.5, cy 239.5 |

Poses are those of the optical frame (x right, y down, z forward) unless `body_from_sensor` says
otherwise. ICL-NUIM needs its own intrinsics, in which y points up: fx 481.2, fy -480, cx 319.5,
cy 239.5.

Source: https://www.microsoft.com/en-us/research/project/rgb-d-dataset-7-scenes/ and
https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats
"""  # noqa: E501 - a table

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.image_file import image_size, read_image
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.readers.compression import open_source
from oddsmap.readers.depth_unit import doubt_unit
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pose_association import match_poses, natural_key
from oddsmap.readers.pose_file import read_pose_matrix
from oddsmap.readers.text_table import parse_numbers, parse_stamp_ns, read_rows
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.lazy_log import DepthLog
from oddsmap.scans.note import Note

__all__ = ["is_seven_scenes", "is_tum_rgbd", "open_seven_scenes", "open_tum_rgbd"]

_IMAGE_END, _POSE_END = ".depth.png", ".pose.txt"
_INTRINSICS_NAME = "camera-intrinsics.txt"
_LISTS = ("depth.txt", "associations.txt")


@dataclass(frozen=True, slots=True)
class _Layout:
    """What the files of a layout do not say."""

    format: str
    units_per_metre: float
    invalid: tuple[int, ...]
    fx_fy_cx_cy: tuple[float, float, float, float]


_SEVEN_SCENES = _Layout("7-Scenes depth images", 1000.0, (65535,), (585.0, 585.0, 320.0, 240.0))
_TUM = _Layout("TUM RGB-D depth images", 5000.0, (), (525.0, 525.0, 319.5, 239.5))


def is_seven_scenes(folder: Path) -> bool:
    """Whether there are images in the 7-Scenes layout."""
    return any(path.name.endswith(_IMAGE_END) for path in folder.iterdir())


def is_tum_rgbd(folder: Path) -> bool:
    """Whether there is a list of images in the TUM layout."""
    return any((folder / name).is_file() for name in _LISTS)


def open_seven_scenes(name: str, options: ReadOptions) -> DepthLog:
    """Open a folder in the 7-Scenes layout.

    Raises:
        InputError: an image without a pose, other counts, or intrinsics that cannot be used.
    """
    folder = Path(name)
    images = sorted(
        (path for path in folder.iterdir() if path.name.endswith(_IMAGE_END)),
        key=lambda path: natural_key(path.name),
    )
    if options.poses is not None:
        names = [image.name for image in images]
        match = match_poses(name, names, options.poses, options.times, options)
        return _open(name, _SEVEN_SCENES, images, match.map_from_sensor, match.stamp_ns, options)
    options.refuse(name, "a 7-Scenes folder", "times", "points_in", "origin", "columns", "deskew")
    files = [image.with_name(image.name.removesuffix(_IMAGE_END) + _POSE_END) for image in images]
    missing = [image for image, file in zip(images, files, strict=True) if not file.is_file()]
    if missing and not options.skip_bad:
        raise InputError(
            f"{name}: {len(images)} depth images and {len(images) - len(missing)} pose files for "
            f"them; {missing[0].name} is the first without: copy the poses (*{_POSE_END}) too, or "
            "leave such images out with --skip-bad (skip_bad=True)"
        )

    def pose(i: int) -> Pose3:
        if not files[i].is_file():
            raise NoPoseError(f"{images[i]}: no pose: {files[i].name} is missing")
        return options.sensor_pose(read_pose_matrix(files[i]))

    return _open(name, _SEVEN_SCENES, images, pose, lambda i: None, options)


def open_tum_rgbd(name: str, options: ReadOptions) -> DepthLog:
    """Open a folder in the TUM RGB-D layout.

    Raises:
        InputError: no poses, a list that cannot be read, or intrinsics that cannot be used.
    """
    folder = Path(name)
    options.refuse(name, "a TUM RGB-D folder", "times", "points_in", "origin", "columns", "deskew")
    images, stamps = _read_list(folder)
    poses = options.poses
    if poses is None:
        poses = folder / "groundtruth.txt"
        if not poses.is_file():
            raise InputError(
                f"{name}: {len(images)} depth images without poses (groundtruth.txt would be "
                "read): name the poses with --poses (poses=)"
            )
    names = [image.name for image in images]
    match = match_poses(name, names, poses, None, options, stamps_ns=stamps)
    return _open(name, _TUM, images, match.map_from_sensor, match.stamp_ns, options)


def _read_list(folder: Path) -> tuple[list[Path], npt.NDArray[np.int64]]:
    """The images of a list and their stamps [ns]."""
    path = next(folder / name for name in _LISTS if (folder / name).is_file())
    rows = read_rows(path)
    if not rows:
        raise InputError(f"{path}: no images are listed: check how the file was written")
    images: list[Path] = []
    stamps: list[int] = []
    for row in rows:
        pairs = list(zip(row.words[::2], row.words[1::2], strict=False))
        if len(row.words) not in (2, 4):
            raise InputError(f"{row.where}: {len(row.words)} words: expected a stamp and a file")
        if len(pairs) == 2:  # depth and colour, in either order
            pairs = [pair for pair in pairs if "depth" in pair[1].lower()]
            if len(pairs) != 1:
                raise InputError(
                    f"{row.where}: which file is the depth image? One of the two must be in a "
                    "folder `depth`"
                )
        stamps.append(parse_stamp_ns(row, pairs[0][0]))
        images.append(folder / pairs[0][1])
    return images, np.array(stamps, np.int64)


def _open(
    name: str,
    layout: _Layout,
    images: list[Path],
    pose: Callable[[int], Pose3],
    stamp_ns: Callable[[int], int | None],
    options: ReadOptions,
) -> DepthLog:
    notes: list[Note] = []
    if options.depth_scale is not None:
        layout = replace(layout, units_per_metre=options.depth_scale)
    camera = options.camera or _find_camera(name, layout, images, notes)
    if options.depth_scale is None:
        notes.extend(doubt_unit(layout.units_per_metre, images))

    def read_depth(i: int) -> DepthScan:
        map_from_sensor = pose(i)
        depth = _read_image(images[i], layout, camera)
        return DepthScan(map_from_sensor, depth, camera, stamp_ns(i))

    return DepthLog(
        path=name,
        format=layout.format,
        scan_count=len(images),
        read_scan=read_depth,
        camera=camera,
        skip_bad=options.skip_bad,
        opening_notes=tuple(notes),
    )


def _find_camera(
    name: str, layout: _Layout, images: list[Path], notes: list[Note]
) -> PinholeCamera:
    """Intrinsics from the folder, for images of the size of the first that can be read."""
    width, height = _first_size(name, images)
    path = Path(name) / _INTRINSICS_NAME
    if path.is_file():
        rows = [parse_numbers(row, row.words) for row in read_rows(path)]
        if [len(row) for row in rows] != [3, 3, 3]:
            raise InputError(f"{path}: intrinsics are a matrix of 3 x 3 numbers")
        (fx, skew, cx), (zero, fy, cy), last = rows
        if skew != 0.0 or zero != 0.0 or last != [0.0, 0.0, 1.0] or fx == 0.0 or fy == 0.0:
            raise InputError(f"{path}: intrinsics other than [fx 0 cx; 0 fy cy; 0 0 1]")
        return PinholeCamera(fx, fy, cx, cy, width, height)
    fx, fy, cx, cy = layout.fx_fy_cx_cy
    if (width, height) != (640, 480):
        raise InputError(
            f"{name}: the depth images are {width} x {height} pixels and there are no intrinsics "
            f"({_INTRINSICS_NAME}); those assumed by default are for 640 x 480: give camera="
        )
    notes.append(
        Note(
            f"no intrinsics ({_INTRINSICS_NAME}): fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g} "
            "are assumed",
            code="camera.assumed",
            severity="warning",
        )
    )
    return PinholeCamera(fx, fy, cx, cy, width, height)


def _first_size(name: str, images: list[Path]) -> tuple[int, int]:
    for path in images:
        try:
            return image_size(path, open_source(path).content)
        except InputError:
            continue  # said when the image itself is read
    raise InputError(
        f"{name}: none of the {len(images)} depth images can be read, the first is "
        f"{images[0].name}: copy them again"
    )


def _read_image(path: Path, layout: _Layout, camera: PinholeCamera) -> npt.NDArray[np.float32]:
    """Depth in metres, shape (h, w); 0 where there is none."""
    image = read_image(path, open_source(path).content)
    width, height = image.size
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            f"{path}: the depth image is {width} x {height} pixels, the intrinsics are for "
            f"{camera.width} x {camera.height}: give the camera of this image"
        )
    if not image.mode.startswith("I"):
        raise InputError(
            f"{path}: a {image.mode} image: depth images are gray with 16 bits per pixel"
        )
    units = np.asarray(image)
    depth = units.astype(np.float32) / np.float32(layout.units_per_metre)
    for value in layout.invalid:
        depth[units == value] = 0.0
    return depth
