# SPDX-License-Identifier: Apache-2.0
"""The files that a command is given: the last of what is checked before any work is done.

First what does not go together and what the settings say, then what is to be read, then the name of
what is to be written, and in the end whether that exists: `--force` is no remedy for a mistake.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

__all__ = ["HISTORY", "check_appendable", "check_files", "check_logs", "check_suffix"]

HISTORY = ".icechunk"
"""The suffix of a map that is kept with all that it was, as `oddsmap history` does."""


def check_files(
    read: Iterable[Path | None],
    write: Path | None = None,
    *,
    beside: Path | None = None,
    force: bool,
    is_map: bool = False,
    is_bag: bool = False,
) -> None:
    """Check that what is read is there, and what is written may be.

    Args:
        read: files and folders; None: one that is not given.
        write: the output, if there is one.
        beside: a file that is written with it.
        force: whether they may replace others.
        is_map: whether it is a map's folder.
        is_bag: whether it is the folder of a ROS 2 bag.

    Raises:
        InputError: there is no such file, or it may not be read.
        ConfigError: the output is one of the inputs.
        OutputError: see `check_output`.
    """
    from oddsmap.atomic_write import check_output
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.ros_bag import check_bag_output
    from oddsmap.map_files.zarr_folder import check_map_output

    inputs = [path for path in read if path is not None]
    for path in inputs:
        _check_input(path)
    if write is None:
        return
    if write.exists() and any(write.samefile(path) for path in inputs):
        raise ConfigError(f"{write}: is the input; give another name to write to")
    if is_bag:
        check_bag_output(write, "ros2-bag", force=force)
    else:
        (check_map_output if is_map else check_output)(write, force=force)
    if beside is not None:
        check_output(beside, force=force)


def _check_input(path: Path) -> None:
    from oddsmap.errors import InputError

    if str(path) == "-":
        raise InputError("-: standard input is not read; write it to a file and give its name")
    try:
        path.stat()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file or folder: check the path") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({why}): check the path") from None
    if (path / "refs" / "branch.main" / "ref.json").is_file():
        raise InputError(
            f"{path}: is a map with its history: write a state of it first: oddsmap history {path} "
            "-o MAP.zarr"
        )
    if not os.access(path, os.R_OK):
        raise InputError(
            f"{path}: cannot be read (Permission denied): check the file and its permissions"
        )


def check_logs(logs: Iterable[Path]) -> None:
    """Refuse maps where logs are to be read.

    Raises:
        InputError: one is a map.
    """
    from oddsmap.errors import InputError

    for path in logs:
        if (path / "zarr.json").is_file():
            raise InputError(
                f"{path}: is a saved map, not a log: give the log; oddsmap info and oddsmap export "
                "read maps"
            )


def check_appendable(output: Path) -> None:
    """Refuse to add to what is no saved map that counts hits and passes, or one with a history.

    Raises:
        InputError: there is none, or it is another.
    """
    from oddsmap.errors import InputError
    from oddsmap.map_files.zarr_folder import EVIDENCE_MAP, FULL_MAP, format_of
    from oddsmap.map_files.zarr_snapshot import settled

    if output.suffix.lower() == HISTORY:
        from oddsmap.evidence_map import EvidenceMap

        EvidenceMap.history(output).commit()
        return
    if not settled(output).exists():
        raise InputError(f"{output}: there is no map to add to: make it without --append")
    kind = format_of(output)
    if kind == FULL_MAP:
        raise InputError(f"{output}: is a full map, which has no counts to add to")
    if kind != EVIDENCE_MAP:
        raise InputError(f"{output}: is no saved map, and --append adds to one")


def check_suffix(output: Path, known: Iterable[str], meaning: str) -> None:
    """Refuse an output whose suffix does not say what to write.

    Args:
        output: the file to be written.
        known: the suffixes that do, in lower case.
        meaning: what they say: the sentence of the message.

    Raises:
        ConfigError: it is none of them.
    """
    from oddsmap.errors import ConfigError, did_you_mean

    suffix = output.suffix.lower()
    if suffix not in known:
        question = did_you_mean(suffix, known) if suffix else ""
        raise ConfigError(f'{output}: {meaning}; got "{output.suffix}"{question}')
