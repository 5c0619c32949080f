# SPDX-License-Identifier: Apache-2.0
"""Recordings: bags of ROS 1, SQLite files of ROS 2, and MCAP files. Nothing of ROS is needed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from oddsmap.errors import InputError, as_line
from oddsmap.recordings.bag_file import BagFile
from oddsmap.recordings.container import FIRST_PLACE, Channel
from oddsmap.recordings.decoders import Decode, decoder_of, type_of, why_not_read
from oddsmap.recordings.recording import START, Damage, Message, Place, Topic
from oddsmap.recordings.recording_files import (
    Folder,
    is_recording_file,
    open_container,
    open_folder,
)

__all__ = ["RosRecording", "is_ros_recording", "open_ros_recording"]

# A message that grows more than a thousandfold, and beyond this [bytes], fills memory.
_LARGEST_MESSAGE = 64 * 1024 * 1024


def is_ros_recording(head: bytes) -> bool:
    """Whether a file that starts like this may be a recording."""
    return is_recording_file(head)


@dataclass(frozen=True, slots=True, eq=False)
class RosRecording:
    """Files of messages, one after the other; satisfies `Recording`."""

    path: str
    format: str
    topics: Mapping[str, Topic]
    span_ns: tuple[int, int] | None
    _folder: Folder
    _skip_bad: bool = False
    _decoders: dict[Channel, Decode] = field(default_factory=dict)
    _bad: dict[tuple[str, int], str] = field(default_factory=dict)

    @property
    def damage(self) -> Sequence[Damage]:
        """What is missing, as far as the files have been read."""
        found: list[Damage] = []
        for file in self._folder.files:
            where = f"{Path(file.path).name}: " if len(self._folder.files) > 1 else ""
            found += [replace(each, text=f"{where}{each.text}") for each in file.damage]
        if self._bad:
            text = f"messages that cannot be decoded, the first: {next(iter(self._bad.values()))}"
            found.append(Damage(text, len(self._bad)))
        return self._with_what_is_listed(found)

    @property
    def has_places(self) -> bool:
        """Whether all of its files have them."""
        return all(file.has_places for file in self._folder.files)

    def messages(self, topics: Iterable[str], start: Place = START) -> Iterator[Message]:
        """The messages of some topics, in the order in which they were written."""
        wanted = {name for name in topics if name in self.topics and not self.topics[name].problem}
        for number, file in enumerate(self._folder.files):
            if number < start[0]:
                continue
            chosen = {key: each for key, each in file.channels.items() if each.topic in wanted}
            decoders = {key: self._decoder(channel) for key, channel in chosen.items()}
            begin = start[1] if number == start[0] else FIRST_PLACE
            for key, log_ns, raw, place in file.raw(chosen, begin):
                topic = chosen[key].topic
                # Whatever a damaged message makes of it, but not what is done with the message.
                try:
                    data = decoders[key](_plain(raw) if self._folder.per_message else raw)
                except Exception as error:
                    reason = as_line(f"{topic}: {str(error) or type(error).__name__}", 160)
                    if not self._skip_bad:
                        raise InputError(
                            f"{self.path}: a message cannot be decoded ({reason}): copy the "
                            "recording again, or skip such messages with --skip-bad "
                            "(skip_bad=True)"
                        ) from None
                    self._bad[topic, log_ns] = reason
                    continue
                yield Message(topic, log_ns, data, (number, place))

    def _decoder(self, channel: Channel) -> Decode:
        if channel not in self._decoders:
            self._decoders[channel] = decoder_of(self.path, channel)
        return self._decoders[channel]

    def _with_what_is_listed(self, found: list[Damage]) -> list[Damage]:
        """Damage, with how much is lost by it where metadata.yaml says what there should be."""
        if self._folder.messages is None:
            return found
        there = sum(sum(file.counts.values()) for file in self._folder.files)
        lost = self._folder.messages - there
        if lost <= 0:
            return found
        seconds = None
        if self._folder.end_ns is not None and self.span_ns is not None:
            seconds = max(0.0, (self._folder.end_ns - self.span_ns[1]) / 1e9)
        unknown = [each for each in found if each.messages is None]
        text = unknown[0].text if unknown else "metadata.yaml lists more messages than there are"
        known = [each for each in found if each.messages is not None]
        return [*known, *unknown[1:], Damage(text, lost, seconds)]


def open_ros_recording(path: str, *, skip_bad: bool = False) -> RosRecording:
    """Open a recording: a bag, a `.db3`, an `.mcap`, or a folder of them.

    Args:
        path: the file or folder.
        skip_bad: read what there is of a damaged recording, in place of raising.

    Raises:
        InputError: it cannot be read.
    """
    if Path(path).is_dir():
        folder = open_folder(path, skip_bad=skip_bad)
        first = folder.files[0].format
        name = first if first == BagFile.format else "ROS 2 recording"
    else:
        folder = Folder([open_container(path, skip_bad=skip_bad)])
        name = folder.files[0].format
    topics: dict[str, Topic] = {}
    for file in folder.files:
        for key, channel in file.channels.items():
            found = _topic(channel, file.counts.get(key, 0))
            topics[found.name] = _merged(topics.get(found.name, found), found)
    spans = [file.span_ns for file in folder.files if file.span_ns is not None]
    span = (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None
    return RosRecording(path, name, dict(sorted(topics.items())), span, folder, skip_bad)


def _topic(channel: Channel, count: int) -> Topic:
    return Topic(channel.topic, type_of(channel), count, why_not_read(channel))


def _merged(one: Topic, other: Topic) -> Topic:
    """Two channels of one topic, or one."""
    if one is other:
        return one
    problem = one.problem or other.problem
    if one.type != other.type:
        problem = f"it has messages of two types, {one.type} and {other.type}"
    return replace(one, count=(one.count or 0) + (other.count or 0), problem=problem)


def _plain(data: bytes | memoryview) -> bytes:
    """A message that was compressed on its own."""
    import zstandard

    most = max(_LARGEST_MESSAGE, 1000 * len(data))
    with zstandard.ZstdDecompressor().stream_reader(bytes(data)) as reader:
        content: bytes = reader.read(most)
    return content
