# SPDX-License-Identifier: Apache-2.0
"""`oddsmap view`: a map in the browser, with its log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.options import Quiet, Verbose, force_option
from oddsmap.cli.progress import working
from oddsmap.cli.viewed_log import ViewedLog, is_map, open_viewed
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.viewer.server import PageServer

__all__ = ["HELP", "view"]

HELP = """Look at a map in the browser, and tune the sensor model on it.

\b
  oddsmap view intel.zarr                 serves it to this machine, opens it
  oddsmap view intel.zarr intel.log.gz    with its log: where the sensor was,
                                          and which beams voted on a cell
  oddsmap view intel.log.gz               maps the log first
  oddsmap view intel.zarr -o intel.html   one file that needs no network

A 3D map is shown as its occupied voxels, to turn and to fly through.
The map has hits and passes, so the page works out every posterior itself: its
sliders act at once. A copied command writes what is on the screen. Only this
machine can reach the page, and only with its address; Ctrl-C ends it.
Read the log as oddsmap build did, with the same options.
"""

_BAND = ", in a band of heights (--z-min, --z-max)"


@takes_log_options
def view(
    *,
    source: Annotated[
        Path, typer.Argument(metavar="MAP", help="A saved map (.zarr), 2D or 3D; or a log.")
    ],
    log: Annotated[
        Path | None, typer.Argument(metavar="LOG", help="The log that it was made of.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT.html",
            help="Write one file that works from the disk; by default the map is served.",
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(
            "--resolution",
            metavar="METRES",
            help="Side of a cell, where a log is given alone; by default 0.05, in 3D and of wide "
            "beams 0.1.",
        ),
    ] = None,
    log_options: LogOptions,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page, or just say where it is.")
    ] = True,
    port: Annotated[
        int | None,
        typer.Option(
            "--port", metavar="N", min=1, max=65535, help="Where to serve; by default any free one."
        ),
    ] = None,
    force: Annotated[bool, force_option("an existing file")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Look at a map in the browser: see `HELP`."""
    from oddsmap.cli.files import check_files, check_logs, check_suffix
    from oddsmap.errors import ConfigError
    from oddsmap.viewer.plane import plane_payload
    from oddsmap.viewer.questions import LogQuestions
    from oddsmap.viewer.server import PageServer
    from oddsmap.viewer.space import space_payload

    voice = Voice(quiet=quiet, verbose=verbose)
    if output is not None:
        if port is not None or not browser:
            raise ConfigError("--port and --no-browser say how a map is served, -o writes a file")
        check_suffix(output, (".html", ".htm"), "a page has a name that ends in .html")
    if log is not None:
        check_logs([log])
    check_files([source, log, *log_options.files(log or source)], output, force=force)
    alone = log is None and not is_map(source)
    if resolution is not None and not alone:
        raise ConfigError("--resolution is for a log given alone: a map has its own")
    if log is None and not alone and log_options.words:
        raise ConfigError(
            f"{log_options.words[0]} says how a log is read: oddsmap view {source} LOG"
        )
    name = source.name or source.resolve().name  # "." has none of its own
    shown: ViewedLog | None = None
    build: str | None = None
    if alone:
        shown = open_viewed(source, log_options, voice)
        grid, build = shown.mapped(resolution, voice)
        name = shown.map_name
    else:
        with working(f"reading {name}", quiet=voice.still):
            grid = _opened(source)
        if log is not None:
            shown = open_viewed(log, log_options, voice)
            shown.doubt_of_map(grid, name, voice)
    payload = (plane_payload if grid.ndim == 2 else space_payload)(grid, name)
    journey = questions = None
    if shown is not None:
        journey, count = shown.payload(grid, name, voice, build=build, served=output is None)
        if output is None:
            questions = LogQuestions(grid, shown.log, count)
    if output is None:
        with PageServer(
            name, payload, port=port or 0, journey=journey, questions=questions
        ) as server:
            _serve(server, browser, voice)
    else:
        _write(name, payload, journey, output, force)
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


def _write(title: str, payload: bytes, journey: bytes | None, output: Path, force: bool) -> None:
    from oddsmap.atomic_write import atomic_output
    from oddsmap.viewer.document import single_page

    page = single_page(title, payload, journey)
    with atomic_output(output, force=force) as part:
        part.write_text(page, encoding="utf-8", newline="\n")


def _serve(server: PageServer, browser: bool, voice: Voice) -> None:
    """Serve the page until Ctrl-C, which is how it is meant to end."""
    import webbrowser

    from oddsmap.cli.interrupts import Interrupt

    # Whatever else is quiet: without the address there is no page.
    typer.echo(server.url)
    voice.say("         Ctrl-C ends it")
    try:
        if browser and not webbrowser.open(server.url):
            voice.say("         no browser was found: open this address in one")
        server.serve_forever()
    except (Interrupt, KeyboardInterrupt):
        voice.say("ended")
