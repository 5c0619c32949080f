# SPDX-License-Identifier: Apache-2.0
"""A map for Foxglove: what a WebSocket client is told, and what it gets."""

from __future__ import annotations

import base64
import json
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.grid_messages import grid_messages
from oddsmap.map_files.voxel_messages import voxel_messages
from oddsmap.posterior.plane import BeliefPlane
from oddsmap.viewer.foxglove_server import FoxgloveServer
from tests.cli.conftest import Run, run

__all__ = ["run"]

CELL = np.dtype(
    [(name, "<f4") for name in ("probability", "hits", "passes")]
    + [(name, "u1") for name in ("red", "green", "blue", "alpha")]
)


@contextmanager
def served(make: Callable[..., Any]) -> Iterator[FoxgloveServer]:
    """A server that answers in a thread."""
    pytest.importorskip("foxglove")
    pytest.importorskip("websockets")
    done = threading.Event()
    with FoxgloveServer(make, name="a map") as server:

        def answer() -> None:
            while not done.is_set():
                server.serve_next(timeout_s=0.05)

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            yield server
        finally:
            done.set()
            thread.join()


def received(url: str) -> tuple[dict[str, Any], Any]:
    """The channel that is advertised, and its message, as its own schema decodes it."""
    pytest.importorskip("google.protobuf")
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    with connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as client:
        assert json.loads(client.recv(timeout=10))["name"] == "a map"
        (channel,) = json.loads(client.recv(timeout=10))["channels"]
        wanted = {"id": 7, "channelId": channel["id"]}
        client.send(json.dumps({"op": "subscribe", "subscriptions": [wanted]}))
        data = client.recv(timeout=10)
    assert isinstance(data, bytes)
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    # One byte says what it is, four the subscription, eight the time.
    return channel, kind.FromString(data[13:])


def cells_of(message: Any) -> Any:
    names = [field.name for field in message.fields]
    assert names == list(CELL.names or ())
    assert [field.offset for field in message.fields] == [CELL.fields[n][1] for n in names]  # type: ignore[index]
    return np.frombuffer(message.data, CELL)


def test_a_plane_in_foxglove() -> None:
    grid = oddsmap.EvidenceMap(0.5)
    grid.add([oddsmap.Scan.from_angles((0.25, 1.25, 0.0), [0.0], [2.0])] * 2)
    view = grid.log_odds()
    with served(grid_messages(BeliefPlane(view))) as server:
        assert server.url.startswith("ws://127.0.0.1:")
        channel, message = received(server.url)
        again = received(server.url)[1]  # and who comes later gets it, too
    assert (channel["topic"], channel["schemaName"]) == ("/map_cells", "foxglove.Grid")
    assert again.data == message.data
    assert (message.frame_id, message.column_count) == ("map", 5)
    assert (message.pose.position.x, message.pose.position.y) == (0.0, 1.0)
    assert (message.cell_size.x, message.row_stride, message.cell_stride) == (0.5, 80, 16)
    cells = cells_of(message)
    assert cells["hits"].tolist() == [0, 0, 0, 0, 2]
    assert cells["passes"].tolist() == [2, 2, 2, 2, 0]
    assert cells["probability"] == pytest.approx(view.probability()[0], abs=1e-6)


def test_space_in_foxglove() -> None:
    grid = oddsmap.EvidenceMap(0.5, ndim=3)
    grid.add([oddsmap.Scan.from_points(oddsmap.Pose3(np.full(3, 0.25), np.eye(3)), [[1.5, 0, 0]])])
    view = grid.log_odds()
    with served(voxel_messages(view, thresholds=view.thresholds)) as server:
        channel, message = received(server.url)
    assert (channel["topic"], channel["schemaName"]) == ("/map_voxels", "foxglove.VoxelGrid")
    assert (message.row_count, message.column_count, message.cell_size.z) == (1, 4, 0.5)
    cells = cells_of(message)
    assert cells["hits"].tolist() == [0, 0, 0, 1]
    assert cells["alpha"].tolist() == [0, 0, 0, 255]


def test_a_port_that_is_taken() -> None:
    grid = oddsmap.EvidenceMap(0.5)
    grid.add(oddsmap.Scan.from_angles((0.0, 0.0, 0.0), [0.0], [2.0]))
    make = grid_messages(BeliefPlane(grid.log_odds()))
    with served(make) as server:
        port = int(server.url.rpartition(":")[2])
        with pytest.raises(InputError, match=f"port {port} on 127.0.0.1: cannot be listened on"):
            FoxgloveServer(make, name="another", port=port)


def test_the_command(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any map that export reads; Ctrl-C is how it ends."""
    pytest.importorskip("foxglove")
    grid = oddsmap.EvidenceMap(0.5)
    grid.add(oddsmap.Scan.from_angles((0.0, 0.0, 0.0), [0.0], [2.0]))
    grid.save(tmp_path / "hall.zarr")
    grid.log_odds().save_ros(tmp_path / "hall.yaml")
    asked = []

    def ended(server: FoxgloveServer) -> None:
        asked.append(server.url)
        raise KeyboardInterrupt

    monkeypatch.setattr(FoxgloveServer, "serve_forever", ended)
    with FoxgloveServer(
        grid_messages(BeliefPlane(grid.log_odds())), name="finds a free port"
    ) as server:
        free = int(server.url.rpartition(":")[2])
    for name in ("hall.zarr", "hall.yaml"):
        done = run("view", tmp_path / name, "--foxglove", "--port", free)
        assert done.status == 0
        assert done.out.splitlines()[0] == asked[-1] == f"ws://127.0.0.1:{free}"
    assert (
        "leave --no-browser out" in run("view", tmp_path / name, "--foxglove", "--no-browser").line
    )
    assert "leave one of them out" in run("view", name, "--foxglove", "-o", "m.html").line


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ConfigError, match=r'pip install "oddsmap\[foxglove\]"'):
        FoxgloveServer(lambda messages: iter([]), name="a map")
