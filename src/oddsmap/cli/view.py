# SPDX-License-Identifier: Apache-2.0
"""`oddsmap view`: a map in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from oddsmap.cli.options import Quiet, Verbose, force_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap

__all__ = ["HELP", "view"]

HELP = """Look at a map in the browser, and tune the sensor model on it.

\b
  oddsmap view intel.zarr                 serves it to this machine, opens it
  oddsmap view intel.zarr -o intel.html   one file that needs no network
  oddsmap view intel.zarr --foxglove      in Foxglove (oddsmap[foxglove])

A 3D map is shown as its occupied voxels, to turn and to fly through.
The map has hits and passes, so the page works out every posterior itself: its
sliders act at once. A copied command writes what is on the screen. Only this
machine can reach the page, and only with its address; Ctrl-C ends it.
"""

_BAND = ", in a band of heights (--z-min, --z-max)"


def view(
    source: Annotated[Path, typer.Argument(metavar="MAP", help="A saved map (.zarr), 2D or 3D.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT.html",
            help="Write one file that works from the disk; by default the map is served.",
        ),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page, or just say where it is.")
    ] = True,
    port: Annotated[
        int | None,
        typer.Option(
            "--port", metavar="N", min=1, max=65535, help="Where to serve; by default any free one."
        ),
    ] = None,
    foxglove: Annotated[
        bool,
        typer.Option(
            "--foxglove",
            help="Serve a map of any kind to Foxglove, as a Grid or a VoxelGrid; at port 8765, if "
            "--port names no other.",
        ),
    ] = False,
    force: Annotated[bool, force_option("an existing file")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Look at a map in the browser: see `HELP`."""
    from oddsmap.cli.files import check_files, check_suffix
    from oddsmap.cli.view_foxglove import serve_to_foxglove
    from oddsmap.errors import ConfigError
    from oddsmap.viewer.plane import plane_payload
    from oddsmap.viewer.space import space_payload

    voice = Voice(quiet=quiet, verbose=verbose)
    if output is not None:
        if port is not None or not browser:
            raise ConfigError("--port and --no-browser say how a map is served, -o writes a file")
        check_suffix(output, (".html", ".htm"), "a page has a name that ends in .html")
        if foxglove:
            raise ConfigError("--foxglove serves a map, -o writes a file: leave one of them out")
    check_files([source], output, force=force)
    if foxglove:
        if not browser:
            raise ConfigError("--foxglove opens no page: leave --no-browser out")
        serve_to_foxglove(source, port, voice)
        return
    name = source.name or source.resolve().name  # "." has none of its own
    with working(f"reading {name}", quiet=voice.still):
        grid = _opened(source)
        payload = (plane_payload if grid.ndim == 2 else space_payload)(grid, name)
    if output is None:
        _serve(name, payload, port, browser, voice)
    else:
        _write(name, payload, output, force)
        voice.say(f"wrote    {output}")


def _opened(source: Path) -> EvidenceMap:
    """The map, if it is of a kind that the page shows.

    Raises:
        InputError: it is of another kind.
    """
    from oddsmap.cli.export_sources import check_no_image, is_ros_map
    from oddsmap.errors import InputError
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap

    kind = None
    if is_full_map(source):
        kind = "a full map"
    elif is_ros_map(source):
        kind = "a ROS map"
    elif source.is_file() and is_octomap(source):
        kind = "an OctoMap"
    if kind is not None:
        raise InputError(
            f"{source}: {kind} has no counts, and so far the page shows maps with hits and passes: "
            f"oddsmap export {source} OUT.png draws it{_BAND if kind == 'an OctoMap' else ''}"
        )
    check_no_image(source)
    return load_map(source)


def _write(title: str, payload: bytes, output: Path, force: bool) -> None:
    from oddsmap.atomic_write import atomic_output
    from oddsmap.viewer.document import single_page

    page = single_page(title, payload)
    with atomic_output(output, force=force) as part:
        part.write_text(page, encoding="utf-8", newline="\n")


def _serve(title: str, payload: bytes, port: int | None, browser: bool, voice: Voice) -> None:
    """Serve the page until Ctrl-C, which is how it is meant to end."""
    import webbrowser

    from oddsmap.cli.interrupts import Interrupt
    from oddsmap.viewer.server import PageServer

    with PageServer(title, payload, port=port or 0) as server:
        # Whatever else is quiet: without the address there is no page.
        typer.echo(server.url)
        voice.say("         Ctrl-C ends it")
        try:
            if browser and not webbrowser.open(server.url):
                voice.say("         no browser was found: open this address in one")
            server.serve_forever()
        except (Interrupt, KeyboardInterrupt):
            voice.say("ended")
