# SPDX-License-Identifier: Apache-2.0
"""`oddsmap view`: a map in the browser."""

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
    from oddsmap.viewer.server import PageServer

__all__ = ["HELP", "view"]

HELP = """Look at a map in the browser, and tune the sensor model on it.

\b
  oddsmap view intel.zarr                 serves it to this machine, opens it
  oddsmap view intel.zarr intel.log.gz    with its log: where the sensor was,
                                          and which beams voted on a cell
  oddsmap view intel.log.gz               maps the log first
  oddsmap view intel.zarr -o intel.html   one file that needs no network
  oddsmap view sonar.zarr --with sonar-full.zarr
                                          the full map as another posterior
  oddsmap view old.yaml                   a ROS map; also OctoMaps
  oddsmap view yard.zarr --landmarks trees.csv
                                          landmarks on top; also alone
  oddsmap view intel.zarr --foxglove      in Foxglove (oddsmap[foxglove])

A 3D map is shown as its occupied voxels, to turn and to fly through.
Where the map has hits and passes the page works out every posterior itself:
its sliders act at once. Maps of probabilities have thresholds alone. A copied
command writes what is on the screen. Only this machine can reach the page,
and only with its address; Ctrl-C ends it.
Read the log as oddsmap build did, with the same options.
"""


@takes_log_options
def view(
    *,
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A saved map or a full map (.zarr), an OctoMap (.bt, .ot), a ROS map (.yaml), "
            "landmarks (.csv, .json), or a log.",
        ),
    ],
    log: Annotated[
        Path | None, typer.Argument(metavar="LOG", help="The log that a saved map was made of.")
    ] = None,
    beside: Annotated[
        list[Path] | None,
        typer.Option(
            "--with",
            metavar="MAP",
            help="A map of probabilities of the same cells, such as a full map, to be chosen as "
            "another posterior; may be repeated.",
        ),
    ] = None,
    landmarks: Annotated[
        Path | None,
        typer.Option(
            "--landmarks",
            metavar="FILE",
            help="Landmarks to be drawn on a 2D map: the .csv or .json of oddsmap landmarks; by "
            "default none.",
        ),
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
    from oddsmap.cli.files import check_files, check_logs, check_suffix
    from oddsmap.cli.view_foxglove import serve_to_foxglove
    from oddsmap.cli.view_sources import counts_page, page_of
    from oddsmap.errors import ConfigError
    from oddsmap.viewer.questions import LogQuestions
    from oddsmap.viewer.server import PageServer

    voice = Voice(quiet=quiet, verbose=verbose)
    if output is not None:
        if port is not None or not browser:
            raise ConfigError("--port and --no-browser say how a map is served, -o writes a file")
        check_suffix(output, (".html", ".htm"), "a page has a name that ends in .html")
        if foxglove:
            raise ConfigError("--foxglove serves a map, -o writes a file: leave one of them out")
    if log is not None:
        check_logs([log])
    beside = list(beside or ())
    files = [source, log, *beside, landmarks, *log_options.files(log or source)]
    check_files(files, output, force=force)
    if foxglove:
        if not browser:
            raise ConfigError("--foxglove opens no page: leave --no-browser out")
        if log is not None or beside or landmarks is not None:
            raise ConfigError("--foxglove serves one map alone: leave out the log and other maps")
        serve_to_foxglove(source, port, voice)
        return
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
        page = counts_page(grid, name, beside, landmarks, voice)
    else:
        with working(f"reading {name}", quiet=voice.still):
            page = page_of(source, beside, landmarks, voice)
        if log is not None:
            if page.grid is None:
                raise ConfigError(
                    f"{source}: has no hits and passes, which a log could be compared with: give "
                    f"the saved map (.zarr) that was made of {log}, or no log"
                )
            shown = open_viewed(log, log_options, voice)
            shown.doubt_of_map(page.grid, name, voice)
    journey = questions = None
    if shown is not None and page.grid is not None:
        served = output is None
        journey, count = shown.payload(page.grid, name, voice, build=build, served=served)
        if served:
            questions = LogQuestions(page.grid, shown.log, count)
    if output is None:
        with PageServer(
            name, page.payload, port=port or 0, journey=journey, questions=questions
        ) as server:
            _serve(server, browser, voice)
    else:
        _write(name, page.payload, journey, output, force)
        voice.say(f"wrote    {output}")


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
