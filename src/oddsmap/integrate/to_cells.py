# SPDX-License-Identifier: Apache-2.0
"""Metres become cells: the segments of a batch of scans, and a window of tiles around each scan."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.kernels.trace.clip_beams import ScanCells, cell_bounds
from oddsmap.kernels.trace.hit_region import BeamShape
from oddsmap.limits import TOO_LONG, in_metres, memory_limit
from oddsmap.sensors.inverse_model import HitShape
from oddsmap.sensors.segments import Segments

__all__ = ["beam_shape", "cells_near_return", "check_size", "rays_of_scan", "to_cells"]


# A longer segment would leave fixed point (see kernels/trace/segments2d.py).
_MAX_LENGTH = 1 << 22


def beam_shape(shape: HitShape, resolution: float) -> BeamShape:
    """How the beams of a sensor vote around a return, in cells."""
    return BeamShape(
        share=shape.share,
        half_width=shape.half_width / resolution,
        sigma=shape.sigma / resolution,
        fade=shape.fade / resolution,
    )


def cells_near_return(shape: HitShape, resolution: float, d: int) -> int:
    """Bounds how many cells one beam's occupied region has, or its fading part.

    Raises:
        ConfigError: they are longer than any beam may be.
    """
    longest = max(2.0 * shape.half_width, shape.fade) / resolution
    if not longest < _MAX_LENGTH:
        raise ConfigError(
            f"a return would be spread over {2.0 * shape.half_width:.3g} m and free space fade "
            f"over {shape.fade:.3g} m, {longest:.1e} cells of {resolution:g} m: set smaller "
            "sensor.hit_width, sigma and fade"
        )
    return d * (math.ceil(longest) + 2) + 1


def to_cells(segments: Segments, resolution: float, side: int, max_window: int) -> ScanCells:
    """Scale segments to cells (their arrays are changed in place).

    Args:
        segments: what the sensor model made of a batch of scans.
        resolution: side of a cell [m].
        side: cells along a tile's side.
        max_window: how many cells one scan may span.

    Returns:
        The scans.

    Raises:
        MapTooLargeError: a scan spans too many cells, or memory could not hold it.
    """
    origins, offsets = segments.origins / resolution, segments.offsets
    lo, hi, way = origins.copy(), origins.copy(), np.zeros(len(origins))
    cell_bounds(segments.ends, offsets, resolution, lo, hi, way)
    for points in (segments.tips, segments.fades):
        if points is not segments.ends:
            cell_bounds(points, offsets, resolution, lo, hi, np.zeros_like(way))
    # A margin of one cell: rounding may carry a ray along a border to the cell next to it. (Exact
    # in floats: a tile's index has a bit less for every bit that a place within a tile has.)
    bundles = segments.bundles
    beams = np.diff(offsets)
    if len(bundles) <= len(origins):  # a scan of several bundles has one window for all
        begin = bundles[:-1]
        lo, hi = np.minimum.reduceat(lo, begin), np.maximum.reduceat(hi, begin)
        way, beams = np.add.reduceat(way, begin), np.add.reduceat(beams, begin)
    first, past = np.floor((np.floor(lo) - 1) / side), np.floor((np.floor(hi) + 1) / side) + 1
    if len(origins):
        check_size(beams, way, (past - first) * side, resolution, side, max_window)
    tiles_lo, tiles_hi = first.astype(np.int64), past.astype(np.int64)
    return ScanCells(
        origins,
        bundles,
        offsets,
        segments.ends,
        segments.tips,
        segments.fades,
        segments.hit,
        tiles_lo,
        tiles_hi,
    )


def rays_of_scan(scans: ScanCells, scan: int) -> tuple[FloatArray, IntArray, slice]:
    """Where the bundles of a scan start, the bundle of each segment, and its segments."""
    begin, end = int(scans.bundles[scan]), int(scans.bundles[scan + 1])
    rays = slice(int(scans.offsets[begin]), int(scans.offsets[end]))
    if end == begin + 1:
        whose = np.zeros(rays.stop - rays.start, np.int64)
    else:
        whose = np.repeat(np.arange(end - begin), np.diff(scans.offsets[begin : end + 1]))
    return scans.origins[begin:end], whose, rays


def check_size(
    beams: IntArray,
    way: FloatArray,
    extent: FloatArray,
    resolution: float,
    side: int,
    max_window: int,
) -> None:
    """Refuse scans that memory could not hold, before any of them is done.

    Args:
        beams: how many each has, shape (scans,).
        way: bounds how many cells the beams of each pass, shape (scans,).
        extent: of each one's window [cells], shape (scans, d).
        resolution: side of a cell [m].
        side: cells along a tile's side.
        max_window: how many cells one scan may span.

    Raises:
        MapTooLargeError: a scan spans too many cells, or memory could not hold it.
    """
    d = extent.shape[1]
    with np.errstate(over="ignore"):  # a reading of 1e300 m is too large, whatever the product
        window = extent.prod(axis=1)
        # Tiles of two bytes per cell: no more than a beam's way passes, nor than the window holds.
        bytes_needed = 2.0 * np.minimum((way / side + d * beams) * float(side) ** d, window)
    limit = memory_limit()
    too_large = (bytes_needed > limit) | (window > max_window) | (extent.max(axis=1) >= _MAX_LENGTH)
    if not too_large.any():
        return
    worst = int(np.argmax(np.where(too_large, window, 0.0)))
    metres = " x ".join(in_metres(length) for length in extent[worst] * resolution)
    if bytes_needed[worst] > limit:
        why = f"up to {bytes_needed[worst] / 1e9:.3g} GB of memory, there are {limit / 1e9:.3g} GB"
    else:
        why = f"a scan may span {max_window:.1e}, and {_MAX_LENGTH:.1e} along an axis"
    raise MapTooLargeError(
        f"one scan spans {metres} m, {window[worst]:.1e} cells of {resolution:g} m ({why}): "
        f"{TOO_LONG}"
    )
