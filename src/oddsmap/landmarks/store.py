# SPDX-License-Identifier: Apache-2.0
"""Landmark maps on disk: JSON with all observations, to go on with; CSV, a table to look at.

Numbers are written with the digits that give the same float64 back.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
from collections.abc import Sequence
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

from oddsmap.atomic_write import atomic_output
from oddsmap.errors import InputError
from oddsmap.landmarks.landmark import Landmark
from oddsmap.readers.compression import open_source

__all__ = ["read_json", "save_csv", "save_json"]

_FORMAT = "oddsmap landmarks"
_VERSION = 1


def save_json(content: dict[str, Any], path: Path, *, force: bool = False) -> None:
    """Write all of a map, as `LandmarkMap.to_dict` gives it."""
    with atomic_output(path, force=force) as part:
        whole = {"format": _FORMAT, "version": _VERSION, **content}
        whole["digest"] = _digest(whole)
        part.write_text(json.dumps(whole, allow_nan=False) + "\n", encoding="utf-8")


def save_csv(landmarks: Sequence[Landmark], ndim: int, path: Path, *, force: bool = False) -> None:
    """Write a table of the landmarks."""
    axes = "xyz"[:ndim]
    pairs = list(combinations_with_replacement(range(ndim), 2))
    names = [f"cov_{axes[i]}{axes[j]}" for i, j in pairs]
    with (
        atomic_output(path, force=force) as part,
        part.open("w", encoding="utf-8", newline="") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["id", *axes, *names, "count"])
        for mark in landmarks:
            spread = [float(mark.covariance[pair]) for pair in pairs]
            table.writerow([mark.id, *mark.mean.tolist(), *spread, mark.count])


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what `save_json` wrote; whether it is complete shows when a map is made of it.

    Raises:
        InputError: no such file, or not a landmark map of this version.
    """
    name = os.fspath(path)
    try:
        content = json.loads(open_source(path).content)
        if content["format"] != _FORMAT:
            raise ValueError
        version = content["version"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"{name}: not a landmark map in JSON: load what `save` or `oddsmap landmarks` wrote "
            "to a .json (a .csv is a table to look at)"
        ) from None
    if version != _VERSION:
        raise InputError(
            f"{name}: a landmark map of version {version}, this oddsmap reads version {_VERSION}"
        )
    digest = content.pop("digest", None)
    if digest is not None and digest != _digest(content):
        raise InputError(
            f"{name}: damaged: not what was saved (its digest; set that to null if you have "
            "edited the file)"
        )
    return dict(content)


def _digest(content: dict[str, Any]) -> str:
    """SHA-256 of a map but its digest."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
