# SPDX-License-Identifier: Apache-2.0
"""`oddsmap view`: a map in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from oddsmap.cli.options import Quiet, Verbose, force_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "view"]

HELP = """Look at a map in the browser, and tune the sensor model on it.

\b
  oddsmap view intel.zarr                 serves it to this machine, opens it
  oddsmap view intel.zarr -o intel.html   one file that needs no network
  oddsmap view sonar.zarr --with sonar-full.zarr
                                          the full map as another posterior
  oddsmap view old.yaml                   a ROS map; also OctoMaps
  oddsmap view yard.zarr --landmarks trees.csv
                                          landmarks on top; also alone

A 3D map is shown as its occupied voxels, to turn and to fly through.
Where the map has hits and passes the page works out every posterior itself:
its sliders act at once. Maps of probabilities have thresholds alone. A copied
command writes what is on the screen. Only this machine can reach the page,
and only with its address; Ctrl-C ends it.
"""


def view(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A saved map or a full map (.zarr), an OctoMap (.bt, .ot), a ROS map (.yaml), or "
            "landmarks (.csv, .json).",
        ),
    ],
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
    from oddsmap.cli.files import check_files, check_suffix
    from oddsmap.cli.view_sources import page_of
    from oddsmap.errors import ConfigError

    voice = Voice(quiet=quiet, verbose=verbose)
    if output is not None:
        if port is not None or not browser:
            raise ConfigError("--port and --no-browser say how a map is served, -o writes a file")
        check_suffix(output, (".html", ".htm"), "a page has a name that ends in .html")
    beside = list(beside or ())
    check_files([source, *beside, landmarks], output, force=force)
    name = source.name or source.resolve().name  # "." has none of its own
    with working(f"reading {name}", quiet=voice.still):
        payload = page_of(source, beside, landmarks, voice)
    if output is None:
        _serve(name, payload, port, browser, voice)
    else:
        _write(name, payload, output, force)
        voice.say(f"wrote    {output}")


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
