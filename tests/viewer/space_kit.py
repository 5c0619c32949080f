# SPDX-License-Identifier: Apache-2.0
"""A small map in space, its page, and which voxel a pixel shows, found slowly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap import EvidenceMap
from oddsmap.kernels.units import ONE
from oddsmap.viewer.document import single_page
from oddsmap.viewer.space import space_payload
from tests.viewer.browser_kit import Opened, file_url

RESOLUTION = 0.25


def room_map() -> EvidenceMap:
    """Walls and a floor of many counts, air, an unknown corner, far from the origin of the map."""
    rng = np.random.default_rng(0)
    z, y, x = np.mgrid[0:12, 0:40, 0:30].reshape(3, -1)
    wall = (x < 2) | (y < 2) | (z < 2)
    hits = np.where(wall, rng.poisson(3, x.shape), rng.poisson(0.02, x.shape))
    passes = rng.poisson(np.where(wall, 3, 20)) + 1
    grid = EvidenceMap(RESOLUTION, ndim=3)
    index = np.stack([x - 100, y + 22_000_000, z - 3], axis=1)
    seen = (x < 20) | (y < 30) | (z < 2)
    grid.add_cells(index[seen], hits[seen] * ONE, passes[seen] * ONE)
    return grid


def page_of(grid: EvidenceMap, folder: Path) -> str:
    """The address of the map's page, a file in a folder."""
    path = folder / "room.html"
    path.write_text(single_page("room.zarr", space_payload(grid, "room.zarr")), encoding="utf-8")
    return file_url(path)


def first_on_ray(
    eye: npt.NDArray[np.float64], ray: npt.NDArray[np.float64], voxels: npt.NDArray[np.int64]
) -> int | None:
    """Which of some voxels (n, 3) a ray enters first, in voxels; None: it enters none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        faces = np.stack([(voxels - eye) / ray, (voxels + 1 - eye) / ray])
    enter, leave = faces.min(axis=0).max(axis=1), faces.max(axis=0).min(axis=1)
    enter[(enter > leave) | (enter < 0)] = np.inf
    nearest = int(enter.argmin())
    return nearest if np.isfinite(enter[nearest]) else None


def ray_of(
    found: Opened, x: float, y: float
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """From where and in which direction a pixel is seen, in voxels from the first cell."""
    yaw, pitch, focal, width, height, *eye = found.get(
        "(({ yaw, pitch, focal, width, height }) => "
        "[yaw, pitch, focal, width, height])(oddsmap.camera).concat(oddsmap.camera.eye())"
    )
    ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0])
    up = np.cross(right, ahead)
    return np.array(eye), ahead + ((x - width / 2) * right + (height / 2 - y) * up) / focal
