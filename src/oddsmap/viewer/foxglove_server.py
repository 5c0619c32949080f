# SPDX-License-Identifier: Apache-2.0
"""A map for Foxglove, live: its Grid or VoxelGrid over a WebSocket on this machine.

The messages are those of `oddsmap export --format foxglove`, as Foxglove's own package encodes
them. A map is sent to whoever subscribes, also to those who come late.

Source: https://docs.foxglove.dev/docs/sdk/introduction
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from typing import Any

from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.ros_messages import MapMessages, TopicMessage

__all__ = ["FoxgloveServer"]

_HOST = "127.0.0.1"
# What messages of ROS are called here; their fields are in the same order.
_NAMES = {
    "geometry_msgs/Point": ("Vector3", "x y z"),
    "geometry_msgs/Vector3": ("Vector3", "x y z"),
    "geometry_msgs/Quaternion": ("Quaternion", "x y z w"),
    "geometry_msgs/Pose": ("Pose", "position orientation"),
    "foxglove_msgs/Vector2": ("Vector2", "x y"),
    "foxglove_msgs/PackedElementField": ("PackedElementField", "name offset type"),
    "foxglove_msgs/Grid": (
        "Grid",
        "timestamp frame_id pose column_count cell_size row_stride cell_stride fields data",
    ),
    "foxglove_msgs/VoxelGrid": (
        "VoxelGrid",
        "timestamp frame_id pose row_count column_count cell_size slice_stride row_stride "
        "cell_stride fields data",
    ),
}
_TYPES = {1: "Uint8", 7: "Float32"}


class FoxgloveServer:
    """Serves a map on the loopback; `serve_forever` runs it, `close` ends it.

    Args:
        make: makes the message of the map.
        name: of the server.
        port: 0: any that is free.

    Attributes:
        url: where to connect to.

    Raises:
        ConfigError: the package is not installed.
        InputError: the port cannot be had.
    """

    def __init__(
        self, make: Callable[[MapMessages], Iterator[TopicMessage]], *, name: str, port: int = 0
    ) -> None:
        try:
            import foxglove
            from foxglove import channels
        except ImportError:
            raise ConfigError(
                'maps are served with foxglove-sdk: pip install "oddsmap[foxglove]"'
            ) from None
        (found,) = make(_FoxgloveMessages())
        self._message, self._subscribed = found.message, queue.SimpleQueue[str]()
        # The server and its channel do not hold it: where it ends, nothing is advertised.
        self._context = context = foxglove.Context()
        listener: Any = _Listener(self._subscribed)
        channel = getattr(channels, f"{type(found.message).__name__}Channel")
        self._channel = channel(found.topic, context=context)
        try:
            self._server = foxglove.start_server(
                name=name,
                host=_HOST,
                port=port,
                context=context,
                server_listener=listener,
            )
        except Exception as error:  # it has no class of its own
            raise InputError(
                f"port {port} on {_HOST}: cannot be listened on ({error}); give another one"
            ) from None
        self.url = f"ws://{_HOST}:{self._server.port}"

    def __enter__(self) -> FoxgloveServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def serve_forever(self) -> None:
        """Send the map to whoever subscribes, until something is raised here, as by Ctrl-C."""
        while True:
            self.serve_next(timeout_s=1.0)  # on Windows nothing interrupts a wait without an end

    def serve_next(self, *, timeout_s: float) -> bool:
        """Send the map once, if somebody subscribes meanwhile; whether it was sent."""
        try:
            self._subscribed.get(timeout=timeout_s)
        except queue.Empty:
            return False
        self._channel.log(self._message)
        return True

    def close(self) -> None:
        """End the server."""
        self._server.stop()


class _Listener:
    """Tells the server's loop of new subscribers; the package calls it in a thread of its own."""

    def __init__(self, subscribed: queue.SimpleQueue[str]) -> None:
        self._subscribed = subscribed

    def on_subscribe(self, client: Any, channel: Any) -> None:
        self._subscribed.put(channel.topic)

    def __getattr__(self, name: str) -> Callable[..., None]:
        """All other events, of which there is nothing to do."""
        return lambda *_: None


class _FoxgloveMessages:
    """Makes messages as the package has them."""

    frame = "map"

    def make(self, kind: str, *values: Any) -> Any:
        from foxglove import messages

        name, fields = _NAMES[kind]
        named = dict(zip(fields.split(), values, strict=True))
        if name == "PackedElementField":
            named["type"] = getattr(messages.PackedElementFieldNumericType, _TYPES[named["type"]])
        if "data" in named:
            named["data"] = named["data"].tobytes()
        return getattr(messages, name)(**named)

    def stamp(self) -> Any:
        from foxglove.messages import Timestamp

        return Timestamp(0, 0)
