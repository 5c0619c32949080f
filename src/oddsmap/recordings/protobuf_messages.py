# SPDX-License-Identifier: Apache-2.0
"""Messages of Protocol Buffers, by the descriptors that a file has of them.

Source: https://mcap.dev/spec/registry#protobuf
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from oddsmap.decoding import decoding
from oddsmap.errors import InputError
from oddsmap.recordings.container import Channel

__all__ = ["protobuf_decoder"]


def protobuf_decoder(path: str, channel: Channel) -> Callable[[bytes | memoryview], Any]:
    """What makes objects of such messages.

    Raises:
        InputError: the descriptors are damaged, or protobuf is not installed.
    """
    try:
        from google.protobuf.descriptor_pb2 import FileDescriptorSet
        from google.protobuf.descriptor_pool import DescriptorPool
        from google.protobuf.message_factory import GetMessageClass
    except ImportError:
        raise InputError(
            f"{path}: {channel.topic}: protobuf messages are decoded by protobuf: "
            'pip install "oddsmap[ros]"'
        ) from None
    fault = f"{channel.topic}: a damaged definition of {channel.type}"
    with decoding(path, fault, "copy the recording again"):
        files = FileDescriptorSet.FromString(channel.schema)
        pool, waiting = DescriptorPool(), {each.name: each for each in files.file}
        # A file is known to the pool after those that it imports.
        while waiting:
            ready = [
                each for each in waiting.values() if waiting.keys().isdisjoint(each.dependency)
            ]
            if not ready:
                raise InputError(f"{path}: {fault} (files that import each other)")
            for each in ready:
                pool.Add(each)
                del waiting[each.name]
        kind = GetMessageClass(pool.FindMessageTypeByName(channel.type))
    return lambda raw: kind.FromString(bytes(raw))
