# SPDX-License-Identifier: Apache-2.0
"""`oddsmap view MAP --foxglove`: a map in Foxglove, over a WebSocket on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from oddsmap.cli.progress import working

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice

__all__ = ["serve_to_foxglove"]

_PORT = 8765  # what Foxglove proposes


def serve_to_foxglove(source: Path, port: int | None, voice: Voice) -> None:
    """Serve a map of any kind until Ctrl-C.

    Raises:
        OddsmapError: it is no map, or too large for one message, or it cannot be served.
    """
    from oddsmap.cli.export_plane import plane_of
    from oddsmap.cli.export_ros import space_asked_for
    from oddsmap.cli.export_sources import open_source, thresholds_of
    from oddsmap.cli.interrupts import Interrupt
    from oddsmap.map_files.grid_messages import grid_messages
    from oddsmap.map_files.voxel_messages import voxel_messages
    from oddsmap.viewer.foxglove_server import FoxgloveServer

    name = source.name or source.resolve().name
    with working(f"reading {name}", quiet=voice.still):
        view = open_source(source, None, {}, voice)
        space = space_asked_for(view, {})
        if space is None:
            make = grid_messages(plane_of(view, {})[0])
        else:
            make = voxel_messages(space, thresholds=thresholds_of(view, {}))
        server = FoxgloveServer(make, name=f"oddsmap: {name}", port=port or _PORT)
    with server:
        # Whatever else is quiet: without the address there is nothing to open.
        typer.echo(server.url)
        voice.say("         Foxglove: Open connection, Foxglove WebSocket, this address")
        voice.say(
            "         Until Ctrl-C, any program and web page on this machine can read the map"
        )
        try:
            server.serve_forever()
        except (Interrupt, KeyboardInterrupt):
            voice.say("ended")
