# SPDX-License-Identifier: Apache-2.0
"""Landmark maps on disk: JSON with all observations, to go on with; CSV, a table to look at.

Numbers are written with the digits that give the same float64 back.
"""

from __future__ import annotations

import csv
import json
import os
from collections import Counter
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.atomic_write import atomic_output
from oddsmap.errors import ConfigError, InputError, OddsmapError
from oddsmap.landmarks.landmark import Track
from oddsmap.landmarks.landmark_map import LandmarkMap
from oddsmap.landmarks.likelihood import POLAR_COLUMNS, Linear
from oddsmap.readers.compression import open_source

__all__ = ["load", "save"]

_FORMAT = "oddsmap landmarks"
_VERSION = 1
_OPTIONS = ("gate", "new_gate", "min_count", "depth_ratio_max", "ndim")


def save(landmarks: LandmarkMap, path: str | os.PathLike[str], *, force: bool = False) -> Path:
    """Write a map; see `LandmarkMap.save`."""
    path = Path(path)
    writers = {".json": _write_json, ".csv": _write_csv}
    if path.suffix.lower() not in writers:
        raise ConfigError(
            f'{path}: landmarks are written to .json (all) or .csv (a table), not "{path.suffix}"'
        )
    with atomic_output(path, force=force) as part:
        writers[path.suffix.lower()](landmarks, part)
    return path


def load(path: str | os.PathLike[str]) -> LandmarkMap:
    """Read a map from JSON; see `LandmarkMap.load`."""
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
    try:
        return _from_dict(content)
    except OddsmapError as error:
        raise InputError(f"{name}: {error}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{name}: a damaged landmark map ({type(error).__name__}: {error}): write it again"
        ) from None


def _write_csv(landmarks: LandmarkMap, path: Path) -> None:
    axes = "xyz"[: landmarks.ndim]
    pairs = list(combinations_with_replacement(range(landmarks.ndim), 2))
    names = [f"cov_{axes[i]}{axes[j]}" for i, j in pairs]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["id", *axes, *names, "count"])
        for mark in landmarks.landmarks:
            spread = [float(mark.covariance[pair]) for pair in pairs]
            table.writerow([mark.id, *mark.mean.tolist(), *spread, mark.count])


def _write_json(landmarks: LandmarkMap, path: Path) -> None:
    reported = {mark.id: mark for mark in landmarks.landmarks}
    rows = []
    for name, track in sorted(landmarks.tracks.items()):
        mark = reported.get(name)
        rows.append(
            {
                "id": name,
                "count": track.count,
                "mean": None if mark is None else mark.mean.tolist(),
                "covariance": None if mark is None else mark.covariance.tolist(),
                "track": _track_to_dict(track),
            }
        )
    content = {
        "format": _FORMAT,
        "version": _VERSION,
        "options": {option: getattr(landmarks, option) for option in _OPTIONS},
        "known_ids": landmarks.known_ids,
        "skipped": dict(landmarks.skipped),
        "landmarks": rows,
    }
    path.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")


def _track_to_dict(track: Track) -> dict[str, Any]:
    gaussian = track.gaussian
    return {
        "anchor": track.anchor.tolist(),
        "information": track.linear.information.tolist(),
        "vector": track.linear.vector.tolist(),
        "polar": track.polar.tolist(),
        "estimate": None if gaussian is None else [part.tolist() for part in gaussian],
    }


def _from_dict(content: dict[str, Any]) -> LandmarkMap:
    landmarks = LandmarkMap(**{option: content["options"][option] for option in _OPTIONS})
    landmarks.known_ids = content["known_ids"]
    landmarks.skipped = Counter({str(k): int(v) for k, v in content["skipped"].items()})
    d = landmarks.ndim
    for row in content["landmarks"]:
        written = row["track"]
        track = Track(_array(written["anchor"], d))
        track.count = int(row["count"])
        track.linear = Linear(_array(written["information"], d, d), _array(written["vector"], d))
        columns = len(POLAR_COLUMNS)
        track.polar = _array(written["polar"] or np.empty((0, columns)), -1, columns)
        if written["estimate"] is not None:
            mean, covariance = written["estimate"]
            track.gaussian = _array(mean, d), _array(covariance, d, d)
        landmarks.tracks[int(row["id"])] = track
    return landmarks


def _array(numbers: Any, *shape: int) -> npt.NDArray[np.float64]:
    """Numbers as an array of that shape, -1 standing for any.

    Raises:
        ValueError: another shape, or a number that is not finite.
    """
    array = np.array(numbers, dtype=np.float64)
    if array.ndim != len(shape) or any(
        side not in (-1, n) for side, n in zip(shape, array.shape, strict=True)
    ):
        raise ValueError(f"shape {array.shape} where {shape} is needed")
    if not np.isfinite(array).all():
        raise ValueError("a number that is not finite")
    return array
