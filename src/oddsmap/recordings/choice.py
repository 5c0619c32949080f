# SPDX-License-Identifier: Apache-2.0
"""Which topics of a recording are mapped, in which frame: the one choice there is, or the caller's.

Nothing is guessed: where there are several, a message names them and the option that says which.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oddsmap.errors import InputError
from oddsmap.recordings.depth_messages import DEPTH_ENCODINGS
from oddsmap.recordings.poses import POSE_TYPES
from oddsmap.recordings.recording import Recording, Topic, shape_of
from oddsmap.recordings.scan_messages import IMAGE, SCAN_TYPES
from oddsmap.recordings.transforms import TransformTree

__all__ = ["body_frame", "choose_frame", "choose_scans", "map_frames", "pose_topics", "scan_topics"]

# Frames that a map is in by the conventions of ROS (REP 105), the best first.
_MAP_NAMES = ("map", "world", "odom")
# What the body that carries the sensors is called by them, the best first.
_BODY_NAMES = ("base_link", "base_footprint", "base")


def scan_topics(recording: Recording) -> list[Topic]:
    """Topics of scans; of images those of depth, which their first message tells.

    Raises:
        InputError: the recording is damaged there.
    """
    found = [
        each for each in recording.topics.values() if each.type in SCAN_TYPES and not each.problem
    ]
    return [topic for topic in found if topic.type != IMAGE or _is_of_depth(recording, topic)]


def _is_of_depth(recording: Recording, topic: Topic) -> bool:
    if topic.count == 0:
        return False
    first = next(iter(recording.messages([topic.name])), None)
    if first is None:
        return False
    with shape_of(topic.type):
        return first.data.encoding in DEPTH_ENCODINGS


def pose_topics(recording: Recording) -> list[Topic]:
    """Topics of poses."""
    return [
        each for each in recording.topics.values() if each.type in POSE_TYPES and not each.problem
    ]


def choose_scans(recording: Recording, stated: Sequence[str]) -> list[Topic]:
    """The topics to map.

    Raises:
        InputError: there is none, there are several, or there is none of a stated name.
    """
    found = {topic.name: topic for topic in scan_topics(recording)}
    for name in stated:
        if name in recording.topics and (why := recording.topics[name].problem):
            raise InputError(f"{recording.path}: {name} cannot be read: {why}")
        if name not in found:
            topic = recording.topics.get(name)
            images = topic is not None and topic.type == IMAGE
            kinds = f"images without depth (with it they are {', '.join(DEPTH_ENCODINGS)})"
            raise InputError(
                f"{recording.path}: {name} is {f'of {kinds}' if images else 'no topic of scans'}: "
                f"it has {_words(found) or 'none'}"
            )
    if stated:
        return [found[name] for name in dict.fromkeys(stated)]
    if not found:
        # Livox's two drivers have the same name for theirs; images count where they are of depth.
        kinds = ", ".join(dict.fromkeys(kind.rsplit("/", 1)[-1] for kind in SCAN_TYPES))
        kinds = kinds.replace("Image", "Image of depth")
        raise InputError(
            f"{recording.path}: no topic of scans ({kinds}): it has "
            f"{_words(recording.topics) or 'no messages'}"
        )
    if len(found) > 1:
        raise InputError(
            f"{recording.path}: several topics of scans, {_words(found)}: say which with --scans "
            "TOPIC (scans=), once for each"
        )
    return list(found.values())


def body_frame(tree: TransformTree, sensor: str) -> str | None:
    """The frame of the body that carries a sensor, one that it is fixed to before others."""
    names = {frame.rsplit("/", 1)[-1]: frame for frame in tree.reachable(sensor) - {sensor}}
    bodies = [names[name] for name in _BODY_NAMES if name in names]
    return min(bodies, key=lambda frame: tree.moves_between(frame, sensor), default=None)


def map_frames(tree: TransformTree, sensor: str) -> list[str]:
    """Frames that a map could be in: those by a usual name, else where the transforms begin.

    Only such from which the way to the sensor changes over time.
    """
    reachable = tree.reachable(sensor) - {sensor}
    moving = sorted(frame for frame in reachable if tree.moves_between(frame, sensor))
    named = [frame for frame in moving if frame.rsplit("/", 1)[-1].startswith(_MAP_NAMES)]
    children = {child for _, child in tree.links}
    return named or [frame for frame in moving if frame not in children]


def choose_frame(tree: TransformTree, sensor: str, stated: str | None) -> str | None:
    """The frame of the map; None where no transforms lead to the sensor from one that moves.

    Raises:
        InputError: there are several, or none of the stated name.
    """
    if stated is not None:
        tree.path_between(stated, sensor)  # or a message that says what is there
        return stated.lstrip("/")
    found = map_frames(tree, sensor)
    for name in _MAP_NAMES:
        if name in found and not _rivals(tree, name, found, sensor):
            return name
    if len(found) > 1:
        raise InputError(
            f"{tree.path}: the map could be in {' or '.join(found)}: say which with --frame NAME "
            "(frame=)"
        )
    return found[0] if found else None


def _rivals(tree: TransformTree, name: str, found: list[str], sensor: str) -> list[str]:
    """Other frames as good as this one: not odom on the way from map, nor parts of a map."""
    on_the_way = {frame for step in tree.path_between(name, sensor) for frame in step}
    others = [frame for frame in found if frame not in on_the_way and frame != name]
    return [frame for frame in others if name != "map" or frame in _MAP_NAMES]


def _words(topics: Mapping[str, Topic]) -> str:
    """Topics for a message."""
    parts = [
        f"{topic.name} ({topic.type.rsplit('/', 1)[-1]}"
        + (")" if topic.count is None else f", {topic.count})")
        for topic in topics.values()
    ]
    return ", ".join(parts[:6]) + (f" and {len(parts) - 6} more" if len(parts) > 6 else "")
