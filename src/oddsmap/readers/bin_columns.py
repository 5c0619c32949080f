# SPDX-License-Identifier: Apache-2.0
"""How many columns the `.bin` scans of a folder have: by their sizes, and by what stands in them.

Read with a wrong count, columns mix: x, y and z of the map are garbage all over the range. So the
count must be sure. Every size must be a multiple of it. And numbers that stand a whole number of
points apart are of one kind (z is small, an intensity never negative, a ring a whole number): of
the counts from 3 to 16 the smallest that explains as much as any is the one.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.readers.bin_points import KITTI_COLUMNS
from oddsmap.readers.compression import open_source
from oddsmap.scans.note import Note

__all__ = ["find_bin_columns"]

_LAYOUTS = {3: ("x", "y", "z"), 4: KITTI_COLUMNS, 5: (*KITTI_COLUMNS, "ring")}
_COUNTS = range(3, 17)

# Files that are looked into, and numbers of each: enough for any real scan, and 2 ms.
_SAMPLED_FILES = 3
_SAMPLED_NUMBERS = 40_000

# With fewer numbers in all, what stands in them proves nothing; nor does a share of their variety
# below this, in sum over the three properties that are looked at, and more of few numbers, of which
# chance explains a part. Scans of KITTI have 1.2, of nuScenes 2.0.
_MIN_NUMBERS = 120
_MIN_EXPLAINED, _BY_CHANCE = 0.06, 20.0
# Another count explains as much if it has this share of the best, which may be a multiple that
# meets the rhythm of the beams, too. A third or half of the true count has up to half of it.
_AS_MUCH = 0.75

# Beam numbers of a LIDAR; the largest has 128 of them.
_MAX_RING = 1023
_FARTHEST_M = 1e5

Numbers = npt.NDArray[np.float32]


def find_bin_columns(path: str, files: Sequence[Path]) -> tuple[tuple[str, ...], tuple[Note, ...]]:
    """Decide on the columns of the scans in a folder.

    Args:
        path: the folder: what messages start with.
        files: its `.bin` files.

    Returns:
        Their names, and what to know of the decision.

    Raises:
        InputError: it cannot be told.
    """
    samples = _samples(files)
    fitting = _fitting_counts(files, samples)
    count = _count(samples, fitting, sure_by_size=len(files) >= 4 and len(fitting) == 1)
    if count in _LAYOUTS and _is_layout(count, samples):
        columns = _LAYOUTS[count]
        if count == len(KITTI_COLUMNS):
            return columns, ()
        text = f"points of {count} float32 are seen in the .bin files: {' '.join(columns)}"
        return columns, (Note(text, code="bin.columns"),)
    seen = f"{count} columns are seen that are not those of KITTI or nuScenes" if count else ""
    fit = ", ".join(str(c) for c in fitting) or "no count from 3 to 16"
    raise InputError(
        f"{path}: what the columns of its .bin files are cannot be told "
        f"({seen or f'by size, {fit} float32 a point are possible'}): "
        "say it with --columns x,y,z,intensity,ring (columns=)"
    )


def _samples(files: Sequence[Path]) -> list[Numbers]:
    """Numbers of some files; those that cannot be read speak when their turn comes."""
    picked = np.unique(np.linspace(0, len(files) - 1, _SAMPLED_FILES).round().astype(int))
    samples = []
    for i in picked:
        try:
            content = open_source(files[i]).content
        except InputError:
            continue
        samples.append(np.frombuffer(content[: len(content) // 4 * 4], "<f4"))
    return samples


def _fitting_counts(files: Sequence[Path], samples: Sequence[Numbers]) -> list[int]:
    """The counts whose multiples most of the sizes are; a broken file may have any size."""
    sizes = [4 * len(sample) for sample in samples]
    if not _is_packed(files[0]):
        for file in files:
            with suppress(OSError):  # said when its turn comes
                sizes.append(file.stat().st_size)
    fits = {c: sum(size % (4 * c) == 0 for size in sizes) for c in _COUNTS}
    most = max(fits.values())
    return [c for c in _COUNTS if fits[c] == most and 2 * most > len(sizes)]


def _is_packed(file: Path) -> bool:
    """Whether a file is compressed: its own size then says nothing, nor do those beside it."""
    try:
        with file.open("rb") as opened:
            return opened.read(3).startswith((b"\x1f\x8b", b"BZh"))
    except OSError:
        return False


def _count(samples: Sequence[Numbers], fitting: Sequence[int], *, sure_by_size: bool) -> int | None:
    """The count of columns, or None."""
    numbers = sum(len(sample) for sample in samples)
    if numbers < _MIN_NUMBERS:
        possible = [c for c in fitting if c in _LAYOUTS and _is_layout(c, samples)]
        return possible[0] if len(possible) == 1 else None
    explained = {c: _explained(samples, c) for c in _COUNTS}
    best = max(explained.values())
    if best < _MIN_EXPLAINED + _BY_CHANCE / numbers:
        return fitting[0] if sure_by_size else None
    count = next(c for c in _COUNTS if explained[c] >= _AS_MUCH * best)
    return count if count in fitting else None


def _explained(samples: Sequence[Numbers], count: int) -> float:
    """Which share of the variety of numbers their columns explain, as adjusted R^2, summed."""
    values = np.concatenate([s[: min(len(s), _SAMPLED_NUMBERS) // count * count] for s in samples])
    if len(values) < 2 * count:
        return 0.0
    with np.errstate(all="ignore"):
        known = np.nan_to_num(values.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        size = np.log(np.clip(np.abs(known), 1e-3, 1e3))
    total = 0.0
    for feature in (known < 0.0, known == np.round(known), size):
        columns = feature.astype(np.float64).reshape(-1, count)
        whole = float(columns.var())
        if whole > 0.0:
            unexplained = float(columns.var(axis=0).mean()) / whole
            total += 1.0 - unexplained * (len(values) - 1) / (len(values) - count)
    return total


def _is_layout(count: int, samples: Sequence[Numbers]) -> bool:
    """Whether the columns can be those of the layout of this count."""
    rows = np.concatenate([s[: len(s) // count * count].reshape(-1, count) for s in samples])
    points = np.abs(rows[:, :3][np.isfinite(rows[:, :3]).all(axis=1)])
    if points.size and float(points.max()) > _FARTHEST_M:
        return False
    intensity, ring = rows[:, 3:4], rows[:, 4:5]
    return bool(
        (intensity >= 0.0).all()
        and np.isfinite(intensity).all()
        and (ring >= 0.0).all()
        and (ring <= _MAX_RING).all()
        and (ring == np.round(ring)).all()
    )
