# SPDX-License-Identifier: Apache-2.0
"""The commands together, and how failures end: one line on stderr, exit status 1."""

from __future__ import annotations

import sys
from pathlib import Path

import typer

from oddsmap.cli.build import HELP as BUILD_HELP
from oddsmap.cli.build import build
from oddsmap.cli.calibrate import HELP as CALIBRATE_HELP
from oddsmap.cli.calibrate import calibrate
from oddsmap.cli.clean import HELP as CLEAN_HELP
from oddsmap.cli.clean import clean
from oddsmap.cli.command import Command
from oddsmap.cli.compare import HELP as COMPARE_HELP
from oddsmap.cli.compare import compare
from oddsmap.cli.config import HELP as CONFIG_HELP
from oddsmap.cli.config import config
from oddsmap.cli.costmap import HELP as COSTMAP_HELP
from oddsmap.cli.costmap import costmap
from oddsmap.cli.crop import HELP as CROP_HELP
from oddsmap.cli.crop import crop
from oddsmap.cli.demo import HELP as DEMO_HELP
from oddsmap.cli.demo import demo
from oddsmap.cli.doctor import HELP as DOCTOR_HELP
from oddsmap.cli.doctor import doctor
from oddsmap.cli.endings import ended_by_signals
from oddsmap.cli.export import HELP as EXPORT_HELP
from oddsmap.cli.export import export
from oddsmap.cli.history import HELP as HISTORY_HELP
from oddsmap.cli.history import history
from oddsmap.cli.info import HELP as INFO_HELP
from oddsmap.cli.info import info
from oddsmap.cli.landmarks import HELP as LANDMARKS_HELP
from oddsmap.cli.landmarks import landmarks
from oddsmap.cli.merge import HELP as MERGE_HELP
from oddsmap.cli.merge import merge
from oddsmap.cli.resample import HELP as RESAMPLE_HELP
from oddsmap.cli.resample import resample
from oddsmap.cli.rotate_frame import HELP as ROTATE_FRAME_HELP
from oddsmap.cli.rotate_frame import rotate_frame
from oddsmap.cli.score import HELP as SCORE_HELP
from oddsmap.cli.score import score
from oddsmap.cli.subtract import HELP as SUBTRACT_HELP
from oddsmap.cli.subtract import subtract
from oddsmap.cli.view import HELP as VIEW_HELP
from oddsmap.cli.view import view
from oddsmap.cli.why import HELP as WHY_HELP
from oddsmap.cli.why import why
from oddsmap.errors import OddsmapError

__all__ = ["app", "run"]

_HELP = """Range-sensor readings from known poses in, a probabilistic map of the world out.

\b
  oddsmap demo                          see it work, no data needed
  oddsmap info intel.log.gz             what is in a log, or in a map
  oddsmap doctor run.bag                what is wrong with a log
  oddsmap build intel.log.gz --resolution 0.05 -o intel.zarr
                                        log to map
  oddsmap view intel.zarr               look at it, tune it
  oddsmap export intel.zarr intel.yaml  map to ROS; also .png and .npz
  oddsmap costmap intel.zarr costs.yaml --inscribed-radius 0.22
                                        costs for Nav2's planners
  oddsmap score sonar.zarr sonar.npz --held-out
                                        how well it predicts readings
  oddsmap why intel.zarr intel.log.gz 3.04 -1.2
                                        which beams voted on a cell
  oddsmap calibrate sonar.npz --resolution 0.1 -o sonar.toml
                                        rates and noise of a sensor
  oddsmap merge a.zarr b.zarr -o both.zarr
                                        maps added; also subtract,
                                        crop, resample, compare,
                                        rotate-frame, history
  oddsmap clean town/ --resolution 0.2 -o static.ply
                                        points without what moved
  oddsmap landmarks seen.csv -o trees.csv
                                        points in place of cells

oddsmap COMMAND -h explains a command, oddsmap config lists all settings.
"""

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command, page in (
    (build, BUILD_HELP),
    (view, VIEW_HELP),
    (export, EXPORT_HELP),
    (costmap, COSTMAP_HELP),
    (info, INFO_HELP),
    (doctor, DOCTOR_HELP),
    (config, CONFIG_HELP),
    (calibrate, CALIBRATE_HELP),
    (score, SCORE_HELP),
    (why, WHY_HELP),
    (merge, MERGE_HELP),
    (subtract, SUBTRACT_HELP),
    (history, HISTORY_HELP),
    (crop, CROP_HELP),
    (rotate_frame, ROTATE_FRAME_HELP),
    (compare, COMPARE_HELP),
    (resample, RESAMPLE_HELP),
    (clean, CLEAN_HELP),
    (landmarks, LANDMARKS_HELP),
    (demo, DEMO_HELP),
):
    # The first line of a page is its summary; where there is none, the parser cuts one out.
    app.command(
        cls=Command,
        help=page,
        short_help=page.splitlines()[0],
        # Where numbers are words of their own, -1.2 is none of the options.
        context_settings={"ignore_unknown_options": command is why},
    )(command)


def _show_version(show: bool) -> None:
    if show:
        from oddsmap import __version__

        typer.echo(f"oddsmap {__version__}")
        raise typer.Exit


@app.callback(help=_HELP)
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Show the version."
    ),
) -> None:
    pass


def run() -> None:
    """Run a command; known failures end with one line on stderr and exit status 1."""
    try:
        with ended_by_signals():
            app(standalone_mode=True)
    except OddsmapError as error:
        _fail(str(error))
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    except MemoryError:
        _fail("out of memory: use a coarser resolution, or fewer threads")
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}")
    except Exception as error:
        if not {"-v", "--verbose"}.isdisjoint(sys.argv):
            raise
        _fail(_unexpected(error))


def _unexpected(error: Exception) -> str:
    """What to say of an error that is no user's mistake."""
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    where = f" ({Path(place.tb_frame.f_code.co_filename).name}:{place.tb_lineno})" if place else ""
    said = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"unexpected {said[:300]}{where}; this is a fault of oddsmap: please report it, with what "
        "the same command says with -v"
    )


def _fail(message: str) -> None:
    from oddsmap.cli.spoken import at_command_line

    print(f"oddsmap: {at_command_line(message)}", file=sys.stderr)  # noqa: T201
    sys.exit(1)
