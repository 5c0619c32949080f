# SPDX-License-Identifier: Apache-2.0
"""From a message as it stands in a file to an object with its fields.

How a message is written and what it is made of, its channel says; no profile of a file is asked.
What comes out has the fields and names of ROS 2, whichever program wrote it.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

from oddsmap.decoding import decoding
from oddsmap.errors import InputError, shown
from oddsmap.recordings import foxglove_messages as foxglove
from oddsmap.recordings.container import Channel
from oddsmap.recordings.livox_bytes import LIVOX_TYPES, livox_message
from oddsmap.recordings.protobuf_messages import protobuf_decoder

__all__ = ["Decode", "decoder_of", "type_of", "why_not_read"]

Decode = Callable[["bytes | memoryview"], Any]
"""A message from its bytes; raises what the library for its encoding raises."""

_ADVICE = "copy the recording again"
# How messages are written, and the descriptions that are read for it ("" is none: by its name).
_READ = {
    "ros1": ("ros1msg", ""),
    "cdr": ("ros2msg", "ros2idl", "omgidl", ""),
    "json": ("jsonschema", ""),
    "protobuf": ("protobuf",),
}


def why_not_read(channel: Channel) -> str:
    """Why messages of a channel cannot be decoded; empty where they can."""
    if channel.encoding not in _READ:
        return f"{shown(channel.encoding)} messages are not read"
    if channel.schema_encoding not in _READ[channel.encoding]:
        return f"{channel.encoding} messages with {shown(channel.schema_encoding)} are not read"
    if channel.encoding in ("json", "protobuf"):
        return ""
    if not channel.schema_encoding and not _store(channel.encoding, "").fielddefs.get(
        _ros_name(channel)
    ):
        return "its definition is not in the file"
    return ""


def type_of(channel: Channel) -> str:
    """The type by the name that both ROS have for it: "sensor_msgs/LaserScan"."""
    if why_not_read(channel):
        return channel.type
    return foxglove.TYPES.get(channel.type.replace("/msg/", "/"), channel.type).replace(
        "/msg/", "/"
    )


def decoder_of(path: str, channel: Channel) -> Decode:
    """What makes objects of the messages of a channel.

    Raises:
        InputError: they cannot be decoded.
    """
    if why := why_not_read(channel):
        raise InputError(f"{path}: {channel.topic}: {why}")
    if channel.encoding in ("ros1", "cdr") and type_of(channel) in LIVOX_TYPES:
        return lambda raw: livox_message(bytes(raw), cdr=channel.encoding == "cdr")
    decode = _DECODERS[channel.encoding](path, channel)
    adapt = foxglove.ADAPTERS.get(channel.type.replace("/msg/", "/"))
    if adapt is None:
        return decode
    return lambda raw: adapt(decode(raw))


def _ros_name(channel: Channel) -> str:
    """A type by the name that rosbags has for it: "sensor_msgs/msg/LaserScan"."""
    package, _, name = channel.type.rpartition("/")
    return f"{package.removesuffix('/msg')}/msg/{name}"


def _store(encoding: str, described: str) -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            'messages of ROS are decoded by rosbags: pip install "oddsmap[ros]"'
        ) from None
    if described:
        return get_typestore(Stores.EMPTY)
    # What a file does not describe itself (old SQLite files do not) is as in the last of each ROS.
    return get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_JAZZY)


def _ros(path: str, channel: Channel) -> Decode:
    try:
        return _ros_decoder(replace(channel, topic=""))
    except InputError as error:
        raise InputError(f"{path}: {channel.topic}: {error}") from None


@lru_cache(maxsize=128)
def _ros_decoder(channel: Channel) -> Decode:
    """Code that rosbags makes for a type; kept, as a recording is opened several times."""
    store, name = _store(channel.encoding, channel.schema_encoding), _ros_name(channel)
    fault = "its definition is damaged"
    if channel.schema_encoding:
        with decoding(channel.type, fault, _ADVICE):
            store.register(_types(name, channel))
            found = _hash(store, name, channel)
        if channel.digest and found != channel.digest:
            raise InputError(
                f"{channel.type}: {fault} (its hash is {found}, not {channel.digest}): {_ADVICE}"
            )
    read = store.deserialize_ros1 if channel.encoding == "ros1" else store.deserialize_cdr
    return lambda raw: read(raw, name)


def _types(name: str, channel: Channel) -> Any:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    text = channel.schema.decode()
    if channel.schema_encoding not in ("ros2idl", "omgidl"):
        return get_types_from_msg(text, name)
    line = "=" * 80 + "\n"
    if not text.startswith(f"{line}IDL: "):
        return get_types_from_idl(text)
    types: Any = {}
    for part in text.split(line)[1:]:
        types.update(get_types_from_idl(part.split("\n", 1)[1]))
    return types


def _hash(store: Any, name: str, channel: Channel) -> str:
    """What the digest of a channel should be."""
    if not channel.digest:
        return ""
    found = (
        store.generate_msgdef(name)[1] if channel.encoding == "ros1" else store.hash_rihs01(name)
    )
    return str(found)


def _json(path: str, channel: Channel) -> Decode:
    return lambda raw: json.loads(bytes(raw), object_hook=foxglove.JsonObject)


_DECODERS: dict[str, Callable[[str, Channel], Decode]] = {
    "ros1": _ros,
    "cdr": _ros,
    "json": _json,
    "protobuf": protobuf_decoder,
}
