# SPDX-License-Identifier: Apache-2.0
"""Beams of scans as plain arrays, and the cells that each of them meets."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError, MapTooLargeError
from oddsmap.poses.product import product
from oddsmap.scans.scan import Scan
from oddsmap.short_repr import short_repr

__all__ = ["BeamCells", "Beams", "beam_cells"]


# A block of beams is listed at a time: this many cells (16 MB), and no more beams than this.
_BLOCK_CELLS = 1 << 20
_BLOCK_BEAMS = 1 << 16
# A beam with more cells is a mistake in the units.
_MAX_CELLS = 1 << 28
# How far the length of a unit vector may be off, and how far after a rotation of few digits, which
# poses are read with.
_UNIT, _ROUNDED = 1e-6, 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Beams in the map frame, each with the pose that it was taken from.

    Args:
        origins: sensor positions [m], shape (n, d), d = 2 or 3.
        directions: unit vectors along the beams' axes, shape (n, d).
        ranges: readings [m], shape (n,). +Inf = nothing seen, NaN or -Inf = no information.

    Raises:
        InputError: shapes that do not fit, a position that is not finite, or a direction that is
            no unit vector.
    """

    origins: FloatArray
    directions: FloatArray
    ranges: FloatArray

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name in ("origins", "directions", "ranges"):
            value = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, value)
        n = len(self.ranges)
        d = self.origins.shape[-1]
        if self.ranges.ndim != 1 or d not in (2, 3) or not (
            self.origins.shape == self.directions.shape == (n, d)
        ):  # fmt: skip
            raise InputError(
                "beams need origins and directions (n, 2) or (n, 3) and ranges (n,), got "
                f"{self.origins.shape}, {self.directions.shape} and {self.ranges.shape}"
            )
        lengths = np.linalg.norm(self.directions, axis=1)
        bad = ~(np.isfinite(self.origins).all(axis=1) & (np.abs(lengths - 1.0) < _UNIT))
        if bad.any():
            i = int(np.argmax(bad))
            raise InputError(
                f"beam {i} needs a finite origin and a unit vector, got "
                f"{self.origins[i].tolist()} and {self.directions[i].tolist()}"
            )

    def __len__(self) -> int:
        return len(self.ranges)

    @property
    def ndim(self) -> int:
        """2 for 2D beams, 3 for 3D beams."""
        return int(self.origins.shape[1])

    @classmethod
    def from_scans(cls, scans: Sequence[Scan]) -> tuple[Beams, Counter[str]]:
        """Put the beams of some scans one after the other, in the map frame.

        A direction that is no number becomes a range of NaN, so that it is counted. A matrix
        written with few digits scales directions: they are made unit vectors again.

        Returns:
            The beams of the scans with a finite pose, and how many scans were skipped, by reason.

        Raises:
            InputError: no scans, or 2D and 3D scans are mixed.
        """
        if len({scan.directions.shape[1] for scan in scans}) != 1:
            raise InputError("beams are taken from scans that are all 2D or all 3D")
        usable = [scan for scan in scans if scan.map_from_sensor.is_finite]
        d = scans[0].directions.shape[1]
        poses = [(scan.map_from_sensor, scan) for scan in usable]
        origins = [
            np.tile(p.translation, (s.size, 1))
            if s.beam_origins is None
            else p.transform(s.beam_origins)
            for p, s in poses
        ]
        with np.errstate(invalid="ignore"):  # directions that are no numbers
            turned = [product(s.directions, p.rotation.T) for p, s in poses]
        axes = np.concatenate([np.empty((0, d)), *turned])
        ranges = np.concatenate([np.empty(0), *(scan.ranges for scan in usable)])
        lengths = np.linalg.norm(axes, axis=1)
        none = ~np.isfinite(lengths)
        axes[none], ranges[none] = np.eye(d)[0], np.nan
        rounded = (np.abs(lengths - 1.0) >= _UNIT) & (np.abs(lengths - 1.0) < _ROUNDED)
        axes[rounded] /= lengths[rounded, None]
        beams = cls(np.concatenate([np.empty((0, d)), *origins]), axes, ranges)
        return beams, +Counter({"scan.nan_pose": len(scans) - len(usable)})


@dataclass(frozen=True, slots=True, eq=False)
class BeamCells:
    """The cells of some beams, from near to far: beam b has rows offsets[b] to offsets[b + 1].

    Args:
        offsets: shape (beams + 1,).
        cells: place of each cell in the window, x fastest, shape (m,), int32 or int64.
        bins: range bin of each cell, never falling along a beam, int32.
        fractions: share of the cell's angular extent that lies inside the cone, in (0, 1],
            float32; for a cone narrower than the cell, share of the cone that the cell takes up.
    """

    offsets: npt.NDArray[np.int64]
    cells: npt.NDArray[np.signedinteger]
    bins: npt.NDArray[np.int32]
    fractions: npt.NDArray[np.float32]


def beam_cells(
    beams: Beams,
    reaches: FloatArray,
    *,
    cone_deg: float,
    bin_width: float,
    range_bias: float,
    resolution: float,
    lo: npt.NDArray[np.int64],
    shape: Sequence[int],
) -> Iterator[tuple[slice, BeamCells]]:
    """List the cells that beams meet, a block of beams at a time, so that memory is bounded.

    Args:
        beams: where they start and point to; their ranges are not looked at.
        reaches: range up to which cells are listed [m], shape (n,); NaN: none.
        cone_deg: full opening angle of a beam [deg], up to 180.
        bin_width: width of a range bin [m].
        range_bias: added to the distance of a cell's nearest point [m].
        resolution: side of a cell [m].
        lo: first cell of the window, shape (d,), x first; cells outside of it are left out.
        shape: of the window's array, (ny, nx) or (nz, ny, nx).

    Yields:
        Which beams, in order, and their cells.

    Raises:
        MapTooLargeError: one beam meets more than 2^28 cells.
    """
    from oddsmap.kernels.trace.cone_cells import LEAST_HALF_ANGLE, list_cells

    origins = beams.origins / resolution
    counts = np.array(shape[::-1], np.int64)
    dtype: type[np.signedinteger] = np.int32 if math.prod(shape) < 2**31 else np.int64
    capacity, first = _BLOCK_CELLS, 0
    while first < len(beams):
        last = min(first + _BLOCK_BEAMS, len(beams))
        offsets = np.empty(last - first + 1, np.int64)
        cells = np.empty(capacity, dtype)
        bins = np.empty(capacity, np.int32)
        fractions = np.empty(capacity, np.float32)
        done = list_cells(
            origins[:last],
            beams.directions[:last],
            reaches[:last] / resolution,
            max(math.radians(cone_deg) / 2, LEAST_HALF_ANGLE),
            bin_width / resolution,
            range_bias / resolution,
            lo,
            counts,
            first,
            offsets,
            cells,
            bins,
            fractions,
        )
        if done == first:
            capacity *= 2
            if capacity > _MAX_CELLS:
                raise MapTooLargeError(
                    f"beam {first} meets more than {_MAX_CELLS} cells of {resolution} m: "
                    "lower range_max or cone_deg, or take larger cells"
                )
            continue
        used = int(offsets[done - first])
        yield (
            slice(first, done),
            BeamCells(offsets[: done - first + 1], cells[:used], bins[:used], fractions[:used]),
        )
        first = done
