# SPDX-License-Identifier: Apache-2.0
"""Transforms over time: both directions, never beyond what was said."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.recordings.transforms import TransformTree

SECOND = 10**9


def turn(yaw: float) -> tuple[float, float, float, float]:
    return (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def tree_of_a_robot() -> TransformTree:
    """map -> odom (moves), odom -> base (moves), base -> laser (fixed, said again and again)."""
    tree = TransformTree("a.bag")
    for k in range(11):
        tree.add("map", "odom", k * SECOND, (0.0, 0.1 * k, 0.0), turn(0.0))
        tree.add("/odom", "/base", k * SECOND, (1.0 * k, 0.0, 0.0), turn(0.1 * k))
        tree.add("base", "laser", k * SECOND, (0.0, 0.0, 0.5), turn(math.pi / 2))
    return tree


def way(tree: TransformTree, target: str, source: str, stamp: int) -> npt.NDArray[np.float64]:
    """The transform between two frames as a matrix, multiplied step by step."""
    pose = np.eye(4)
    for step in tree.path_between(target, source):
        found = tree.transform(step, stamp, SECOND)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = found.rotation, found.translation
        pose = pose @ matrix
    return pose


def test_along_the_tree_and_between_samples() -> None:
    pose = way(tree_of_a_robot(), "map", "laser", 5 * SECOND // 2)
    np.testing.assert_allclose(pose[:3, 3], [2.5, 0.25, 0.5], atol=1e-12)
    yaw = math.atan2(pose[1, 0], pose[0, 0])
    assert yaw == pytest.approx(0.25 + math.pi / 2, abs=1e-12)


def test_against_the_tree() -> None:
    tree = tree_of_a_robot()
    there, back = way(tree, "map", "laser", 3 * SECOND), way(tree, "laser", "map", 3 * SECOND)
    np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-12)


def test_the_map_as_a_child() -> None:
    tree = TransformTree("a.bag")
    for k in range(3):
        tree.add("base", "map", k * SECOND, (-1.0 * k, 0.0, 0.0), turn(0.0))
    np.testing.assert_allclose(way(tree, "map", "base", 2 * SECOND)[:3, 3], [2.0, 0.0, 0.0])


def test_what_is_always_the_same_is_known_at_all_times() -> None:
    tree = tree_of_a_robot()
    assert not tree.moves("base", "laser")
    assert tree.moves("odom", "base")
    np.testing.assert_allclose(way(tree, "base", "laser", -99 * SECOND)[:3, 3], [0.0, 0.0, 0.5])


@pytest.mark.parametrize("stamp", [-1, 10 * SECOND + 1])
def test_nothing_is_known_before_the_first_and_after_the_last_sample(stamp: int) -> None:
    with pytest.raises(NoPoseError, match="not known, only from 0 to 10 s"):
        way(tree_of_a_robot(), "odom", "base", stamp)


def test_a_gap_is_no_pose() -> None:
    tree = TransformTree("a.bag")
    tree.add("odom", "base", 0, (0.0, 0.0, 0.0), turn(0.0))
    tree.add("odom", "base", 60 * SECOND, (9.0, 0.0, 0.0), turn(0.0))
    with pytest.raises(NoPoseError, match="no pose within 1 s"):
        way(tree, "odom", "base", 30 * SECOND)


def test_two_values_for_one_time_the_first_counts_and_all_are_counted() -> None:
    tree = TransformTree("a.bag")
    for value, stamp in ((0.0, 0), (1.0, SECOND), (7.0, SECOND), (1.0, SECOND), (2.0, 2 * SECOND)):
        tree.add("odom", "base", stamp, (value, 0.0, 0.0), turn(0.0))
    tree.add("odom", "base", 0, (5.0, 0.0, 0.0), turn(0.0))  # late
    assert way(tree, "odom", "base", SECOND)[0, 3] == 1.0
    assert way(tree, "odom", "base", 0)[0, 3] == 0.0
    assert tree.conflicts["odom", "base"] == 2


def test_no_way_says_what_there_is() -> None:
    tree = tree_of_a_robot()
    tree.add("camera", "lens", 0, (0.0, 0.0, 0.0), turn(0.0), fixed=True)
    with pytest.raises(
        InputError,
        match=r"a\.bag: no transforms lead from .lens. to .map.: .*'lens' is .* with: camera",
    ):
        tree.path_between("map", "lens")


def test_a_rotation_that_is_none() -> None:
    tree = TransformTree("a.bag")
    tree.add("odom", "base", 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), fixed=True)
    with pytest.raises(InputError, match="transform odom to base: "):
        way(tree, "odom", "base", 0)
