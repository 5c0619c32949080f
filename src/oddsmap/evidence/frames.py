# SPDX-License-Identifier: Apache-2.0
"""Maps in other frames: quarter turns and shifts that take whole cells to whole cells, exactly."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError, shown
from oddsmap.evidence.tiles import TileStore
from oddsmap.limits import MAX_COORDINATE
from oddsmap.poses.pose import Pose, Pose2, Pose3, quaternion_xyzw
from oddsmap.poses.product import product

__all__ = [
    "WholeCells",
    "axes_of",
    "axes_of_up",
    "named_numbers",
    "rotation_and_position",
    "turned",
    "whole_cells",
]

# How far from a cell's centre another may come to lie [cells] and yet be meant to be there: a
# quarter turn that is written as 1.5708 is off by a hundredth of a cell 2700 cells away.
_MEANT = 0.01

_NAMES = "xyz"

# The first axis stays where it can; where it becomes the vertical, the second does.
_OF_UP = {
    "z": "x y z", "-z": "x -y -z", "y": "x -z y", "-y": "x z -y", "x": "-z y x", "-x": "z y -x"
}  # fmt: skip


class WholeCells(NamedTuple):
    """A transform that takes each cell to one cell: what the new axes are, and a shift."""

    source: list[int]
    """The number of the old axis for each new one."""
    is_reversed: list[bool]
    """Whether it points the other way."""
    shift: IntArray
    """What is added to the new index, shape (d,)."""


def axes_of_up(up: str) -> str:
    """The axes that make one of the old ones the vertical.

    Args:
        up: "z", "-z", "y", "-y", "x" or "-x".

    Raises:
        ConfigError: it is none of these.
    """
    try:
        return _OF_UP[up.strip().lower().removeprefix("+")]
    except (KeyError, AttributeError):
        raise ConfigError(
            f"up is the axis that is to point up: x, y or z, or -x, -y, -z; got {shown(up)}"
        ) from None


def axes_of(axes: str, ndim: int) -> WholeCells:
    """What the new axes are among the old ones.

    Args:
        axes: the old axis that each new one is, in order, such as "z -x -y".
        ndim: 2 or 3.

    Returns:
        The turn about the origin that this is.

    Raises:
        ConfigError: not each axis once, or a mirror image.
    """
    known = _NAMES[:ndim]
    words = axes.replace(",", " ").lower().split() if isinstance(axes, str) else []
    names = [word.removeprefix("-").removeprefix("+") for word in words]
    if sorted(names) != list(known):
        raise ConfigError(
            f"axes name each of {', '.join(known)} once, with - where reversed, as in "
            f'"{"z -x -y" if ndim == 3 else "y -x"}"; got {shown(axes)}'
        )
    source = [known.index(name) for name in names]
    reversed_ = [word.startswith("-") for word in words]
    turn = np.zeros((ndim, ndim))
    turn[range(ndim), source] = np.where(reversed_, -1.0, 1.0)
    if np.linalg.det(turn) < 0.0:
        raise ConfigError(
            f"axes {axes!r} are a mirror image: right would become left; reverse one axis more"
        )
    return WholeCells(source, reversed_, np.zeros(ndim, np.int64))


def rotation_and_position(pose: Pose, ndim: int) -> tuple[FloatArray, FloatArray]:
    """What a pose does to a map of a dimension: rotation, shape (d, d), and position [m], (d,).

    A pose in the plane turns a map of space about z.

    Raises:
        InputError: the pose is not finite, its rotation is scaled or sheared, or it is one of space
            and the map is 2D.
    """
    if not pose.is_finite:
        raise InputError("a map is moved by a finite pose, and this one is not")
    if isinstance(pose, Pose2):
        rotation, position = np.eye(ndim), np.zeros(ndim)
        rotation[:2, :2], position[:2] = pose.rotation, pose.translation
        return rotation, position
    if ndim == 2:
        raise InputError(
            "a 2D map is moved in the plane (x y yaw, or a shift x y), and this pose is in space"
        )
    checked = Pose3.from_matrix(np.column_stack([pose.rotation, pose.translation]))
    # By its quaternion: of a matrix with few digits the transpose is not quite the way back.
    whole = Pose3.from_quaternion_xyzw(checked.translation, quaternion_xyzw(checked.rotation))
    return whole.rotation, whole.translation


def named_numbers(pose: Pose) -> dict[str, float]:
    """A pose as numbers by name, for the provenance: x, y, yaw, or x, y, z and a quaternion."""
    if isinstance(pose, Pose2):
        return {"x": float(pose.x), "y": float(pose.y), "yaw": float(pose.theta)}
    numbers = [*pose.translation.tolist(), *quaternion_xyzw(pose.rotation)]
    return dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), numbers, strict=True))


def whole_cells(
    rotation: FloatArray, shift: FloatArray, lo: IntArray, hi: IntArray
) -> WholeCells | None:
    """The quarter turn and the shift by whole cells that a transform is for the cells of a box.

    Args:
        rotation: shape (d, d).
        shift: [cells], shape (d,).
        lo: first cell of the box, shape (d,).
        hi: past the last.

    Returns:
        None where the centre of some cell comes to lie farther than a hundredth of a cell from
        that of another.

    Raises:
        InputError: a cell would lie farther than 2^46 cells from the origin.
    """
    ends = np.stack([lo + 0.5, hi - 0.5])
    half = np.ptp(ends, axis=0)[None, :] / 2.0
    place = product(ends.mean(axis=0)[None, :], rotation.T)[0] + shift
    if (np.abs(place) + product(half, np.abs(rotation).T)[0]).max() > 2.0 * MAX_COORDINATE:
        raise InputError(
            "the moved map would reach farther than 2^46 cells from its origin: is the pose in "
            "metres?"
        )
    turn = np.rint(rotation)
    if not np.array_equal(turn @ turn.T, np.eye(len(turn))):
        return None
    # A transform is affine, so what it is off by is largest in a corner. As the small difference
    # of the rotations, which loses no digits far from the origin.
    off = rotation - turn
    middle = product(ends.mean(axis=0)[None, :], off.T)[0] + shift
    whole = np.rint(middle)
    reach = product(half, np.abs(off).T)[0]
    if (np.abs(middle - whole) + reach).max() > _MEANT:
        return None
    source = np.abs(turn).argmax(axis=1)
    is_reversed = turn[range(len(turn)), source] < 0.0
    return WholeCells(source.tolist(), is_reversed.tolist(), whole.astype(np.int64))


def turned(to: TileStore, tiles: TileStore, way: WholeCells) -> None:
    """Add to a store the cells of another, turned about the corner that is the origin and moved."""
    for index, hits, passes in tiles.parts():
        # Cell i ends where i + 1 begins: reversed, that is -(i + 1).
        cells = index[:, way.source]
        cells = np.where(way.is_reversed, -1 - cells, cells) + way.shift
        to.add_cells(cells, np.stack([hits, passes], axis=1))
