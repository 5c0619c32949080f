# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export`: a map to what other software reads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

__all__ = ["HELP", "export"]

HELP = """Write a map as a ROS map, a picture, or arrays: the suffix of OUT decides.

\b
  oddsmap export intel.zarr intel.yaml                 ROS map_server: YAML and PGM
  oddsmap export intel.zarr intel.yaml --mode scale    the same with probabilities, as PNG
  oddsmap export intel.zarr intel.png                  a picture with axes in metres
  oddsmap export intel.zarr intel.npz --prior 0.2      cells, counts and probabilities
"""


def export(
    source: Annotated[Path, typer.Argument(metavar="MAP.zarr")],
    output: Annotated[Path, typer.Argument(metavar="OUT", help=".yaml, .png or .npz")],
    mode: Annotated[
        Literal["trinary", "scale", "raw"], typer.Option(help="How a ROS map writes probabilities.")
    ] = "trinary",
    posterior: Annotated[str, typer.Option(metavar="NAME", help="Which view.")] = "log-odds",
    prior: Annotated[
        str | None, typer.Option(metavar="P", help="p(occupied) before any reading.")
    ] = None,
    p_hit: Annotated[float | None, typer.Option(metavar="P", help="Belief in a hit.")] = None,
    p_miss: Annotated[float | None, typer.Option(metavar="P", help="Belief after a pass.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write a map as a ROS map, a picture, or arrays: see `HELP`."""
    from oddsmap.errors import ConfigError
    from oddsmap.store import load_map

    if posterior != "log-odds":
        raise ConfigError(f'--posterior {posterior}: not available, this version has "log-odds"')
    suffix = output.suffix.lower()
    if suffix not in (".yaml", ".yml", ".png", ".npz"):
        raise ConfigError(
            f"{output}: the suffix says what to write: .yaml (ROS map), .png (picture), "
            f'.npz (arrays); got "{output.suffix}"'
        )
    view = load_map(source).log_odds(p_hit=p_hit, p_miss=p_miss, prior=_number(prior))
    written = [output]
    if suffix == ".png":
        view.save_png(output, force=force)
    elif suffix == ".npz":
        view.save_npz(output, force=force)
    else:
        written = list(view.save_ros(output, mode=mode, force=force))
    typer.echo(f"wrote    {', '.join(str(path) for path in written)}")


def _number(prior: str | None) -> float | None:
    from oddsmap.errors import ConfigError

    if prior is None:
        return None
    try:
        return float(prior)
    except ValueError:
        raise ConfigError(
            f"--prior {prior}: a probability is needed; a map as the prior is not available yet"
        ) from None
