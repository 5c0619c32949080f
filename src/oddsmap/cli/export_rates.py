# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export --posterior` writes beside log odds: reflection and decay rates."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.files import check_files
from oddsmap.cli.map_regions import read_part
from oddsmap.cli.options import flag
from oddsmap.cli.picture_options import OF_PICTURES, PICTURES, frame_options
from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.evidence_map import EvidenceMap

__all__ = ["write_decay", "write_reflection"]

Options = Mapping[str, Any]

_OF_INTERVALS = ("interval-width", "lower", "upper")


def write_reflection(
    source: Path, output: Path, options: Options, force: bool, voice: Voice
) -> Written:
    """Write the reflection map, see `oddsmap.posterior.reflection.Reflection`."""
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.map_files.ros_writer import image_beside
    from oddsmap.posterior.reflection import Reflection
    from oddsmap.scans.note import Note

    suffix = output.suffix.lower()
    if suffix not in (*PICTURES, ".npz", ".yaml", ".yml"):
        raise ConfigError(
            f"{output}: a reflection map is written as .png, .pdf, .svg, .npz or .yaml"
        )
    if options.get("show") == "p-pass":
        raise ConfigError("--show p-pass belongs to --posterior decay")
    if "show" in options and suffix not in PICTURES:
        raise ConfigError(f"--show says what a picture shows, not {output.name}")
    _check_uses(options, output)
    _check_picture(options, output)
    names = {
        "beta_a": "a", "beta_b": "b", "threshold": "threshold", "level": "level", "interval": "kind"
    }  # fmt: skip
    arguments = {names[name]: value for name, value in options.items() if name in names}
    Reflection(EvidenceMap(1.0, votes="beam"), **arguments)  # refuses what is right for no map
    plane = suffix in (".yaml", ".yml")
    beside = image_beside(output, options.get("mode", "scale")) if plane else None
    check_files([source, options.get("trajectory")], output, beside=beside, force=force)
    grid = _with_counts(source, options)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        view = Reflection(grid, **arguments)
    for warning in caught:
        doubt = Note(str(warning.message), code="view.doubt", severity="warning")
        voice.note(source, doubt, err=True)
    if suffix == ".npz":
        view.save_npz(output, force=force)
    elif suffix in PICTURES:
        show = options.get("show", "mean")
        view.save_png(output, show=show, force=force, **frame_options(options))
    else:
        mode = options.get("mode", "scale")
        return Written(list(view.save_ros(output, mode=mode, force=force)))
    return Written([output])


def _check_uses(options: Options, output: Path) -> None:
    """Refuse an option of the reflection view that would change nothing in this output."""
    from oddsmap.errors import ConfigError

    suffix, show = output.suffix.lower(), options.get("show", "mean")
    interval = suffix == ".npz" or (suffix in PICTURES and show in _OF_INTERVALS)
    for name, used, where in (
        ("level", interval, ".npz and --show interval-width, lower or upper"),
        ("interval", interval, ".npz and --show interval-width, lower or upper"),
        ("threshold", suffix in PICTURES and show == "p-above", "--show p-above"),
    ):
        if name in options and not used:
            raise ConfigError(f"{flag(name)} changes {where} alone, not {output.name}")


def write_decay(source: Path, output: Path, options: Options, force: bool, voice: Voice) -> Written:
    """Write the decay rates, see `oddsmap.posterior.decay_rate.DecayRate`."""
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import EvidenceMap

    suffix, show = output.suffix.lower(), options.get("show", "mean")
    if suffix not in (*PICTURES, ".npz"):
        raise ConfigError(f"{output}: a map of decay rates is written as .png, .pdf, .svg or .npz")
    if "show" in options and suffix not in PICTURES:
        raise ConfigError(f"--show says what a picture shows, not {output.name}")
    if show == "p-above":
        raise ConfigError("--show p-above belongs to --posterior reflection")
    if "level" in options and suffix in PICTURES and show not in _OF_INTERVALS:
        raise ConfigError(
            f"--level changes .npz and --show interval-width, lower or upper alone, "
            f"not {output.name}"
        )
    _check_picture(options, output)
    level = options.get("level", 0.95)
    EvidenceMap(1.0, votes="beam", path_lengths=True).decay_rate(level=level)
    check_files([source, options.get("trajectory")], output, force=force)
    view = _with_counts(source, options).decay_rate(level=level)
    if suffix == ".npz":
        view.save_npz(output, force=force)
    else:
        view.save_png(output, show=show, force=force, **frame_options(options))
    return Written([output])


def _check_picture(options: Options, output: Path) -> None:
    from oddsmap.errors import ConfigError

    stated = [name for name in OF_PICTURES if name in options]
    if stated and output.suffix.lower() not in PICTURES:
        raise ConfigError(f"{flag(stated[0])} shapes a picture, not {output.name}")


def _with_counts(source: Path, options: Options) -> EvidenceMap:
    from oddsmap.errors import ConfigError
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap

    if is_octomap(source) or is_full_map(source):
        raise ConfigError(f"{source}: this view needs hits and passes, this map has none")
    return read_part(source, box=options.get("box"))
