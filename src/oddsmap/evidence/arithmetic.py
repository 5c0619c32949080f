# SPDX-License-Identifier: Apache-2.0
"""Maps added, taken out of each other, made coarser and cut: sums of whole numbers, so exact."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.config.config import Config, MapConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.tile_counts import retiled
from oddsmap.evidence.tiles import TileStore
from oddsmap.kernels.units import HITS, ONE, PASSES

__all__ = [
    "add_scaled",
    "check_same_kind",
    "coarser",
    "crop_tiles",
    "difference",
    "factor_of",
    "how_to_match",
    "merge_tiles",
]

# Decimal fractions are rounded in binary: 0.15 is not three times 0.05 to the last bit.
_SAME = 1e-9


def check_same_kind(mine: Config, theirs: Config, *, any_sensor: bool, done: str) -> None:
    """Refuse maps whose cells or votes do not mean the same.

    Args:
        mine: configuration of the map that is to change.
        theirs: that of what is to be added to it, or taken out.
        any_sensor: whether the kinds of sensor may differ.
        done: "added" or "subtracted", for the message.

    Raises:
        InputError: see `Evidence.merge`.
    """
    for field in dataclasses.fields(MapConfig):
        own, other = getattr(mine.map, field.name), getattr(theirs.map, field.name)
        if own != other:
            raise InputError(
                f"maps of different {field.name} cannot be {done}: {own} here, {other} there; "
                f"{_remedy(field.name, own, other)}"
            )
    if mine.sensor.kind != theirs.sensor.kind and not any_sensor:
        raise InputError(
            f"a map of a sensor of kind {theirs.sensor.kind} is not {done} to one of kind "
            f"{mine.sensor.kind}: their votes could not be told apart any more; any_sensor=True "
            "(--any-sensor) does it, and this map's sensor model will weigh all"
            if done == "added"
            else f"a map of a sensor of kind {theirs.sensor.kind} is not {done} from one of kind "
            f"{mine.sensor.kind}; any_sensor=True (--any-sensor) does it"
        )


def how_to_match(resolution: float, other: float) -> str:
    """What to do with maps of two resolutions [m], so that their cells are the same."""
    fine, coarse = sorted((resolution, other))
    if _whole(coarse / fine):
        return f"resample the finer one to {coarse:g} m first (it then has more votes a cell)"
    return "neither is a whole multiple of the other: build one again at the other's"


def _remedy(name: str, own: object, other: object) -> str:
    if name == "resolution" and isinstance(own, float) and isinstance(other, float):
        return how_to_match(own, other)
    if name == "t_ref_ns" and None not in (own, other):
        return (
            "build both with the later map.t_ref_ns, or take the earlier one there with rescaled, "
            "which rounds"
        )
    if name == "ref_scan" and None not in (own, other):
        return "build both with the later map.ref_scan"
    return f"build one again with the other's map.{name}"


def merge_tiles(to: TileStore, tiles: TileStore) -> None:
    """Add all weights of a store, whose tiles may have another side."""
    if to.side == tiles.side:
        to.merge(tiles)
    else:
        index, hits, passes = tiles.cells()
        to.add_cells(index, np.stack([hits, passes], axis=1))


def difference(tiles: TileStore, less: TileStore, resolution: float) -> TileStore:
    """A new store: the weights of one less those of another; tiles left empty are gone.

    Raises:
        InputError: a weight would become negative; the first such cell is named.
    """
    if less.side != tiles.side:
        less = retiled(less, tiles.side)
    both = np.concatenate([tiles.coords, less.coords])
    _, number = np.unique(both, axis=0, return_inverse=True)
    number = number.ravel()
    slot_of = np.full(len(both), -1, np.int64)
    slot_of[number[: tiles.count]] = np.arange(tiles.count)
    at = slot_of[number[tiles.count :]]  # where each tile of `less` lies in `tiles`
    left = TileStore(tiles.ndim, tiles.side)
    partner = np.full(tiles.count, -1, np.int64)
    partner[at[at >= 0]] = np.flatnonzero(at >= 0)
    nowhere = np.flatnonzero(at < 0)
    for slots in np.array_split(nowhere, len(nowhere) // _TILES + 1):
        units = less.units(slots)
        _check_enough(less.coords[slots], np.zeros_like(units), units, tiles.side, resolution)
    for slots in np.array_split(np.arange(tiles.count), tiles.count // _TILES + 1):
        units, has = tiles.units(slots), partner[slots] >= 0
        taken = less.units(partner[slots[has]])
        _check_enough(tiles.coords[slots[has]], units[has], taken, tiles.side, resolution)
        units[has] -= taken
        some = units.any(axis=(1, 2))
        left.fill(tiles.coords[slots[some]], units[some])
    return left


# Tiles widened to 64 bits at a time.
_TILES = 4096


def _check_enough(
    coords: IntArray, there: IntArray, taken: IntArray, side: int, resolution: float
) -> None:
    """Refuse to take out more than is there."""
    lacking = taken > there
    if not lacking.any():
        return
    tile, _, within = (int(each[0]) for each in np.nonzero(lacking))
    d = coords.shape[1]
    cell = coords[tile] * side + np.array(np.unravel_index(within, (side,) * d)[::-1])
    place = ", ".join(f"{(i + 0.5) * resolution:g}" for i in cell.tolist())
    has, wants = (
        f"{units[tile, HITS, within] / ONE:g} hits and {units[tile, PASSES, within] / ONE:g} passes"
        for units in (there, taken)
    )
    raise InputError(
        f"the map does not hold the evidence that is to be taken out: its cell at ({place}) m has "
        f"{has}, the other {wants}; only what was added before can be subtracted"
    )


def factor_of(own: float, resolution: float) -> int:
    """How many cells one of a coarser resolution spans along each axis.

    Args:
        own: side of the cells that there are [m].
        resolution: side of the larger cell [m].

    Raises:
        ConfigError: not a whole number of them, or less than one.
    """
    if not 0.0 < resolution < math.inf:
        raise ConfigError(f"a resolution is the side of a cell in metres, got {resolution}")
    ratio = resolution / own
    if ratio < 1.0 - _SAME:
        raise ConfigError(
            f"cells of {own:g} m cannot be split into cells of {resolution:g} m: what was seen "
            "within them is not kept; build the map again from its logs"
        )
    if not _whole(ratio):
        nearest = " or ".join(f"{own * n:.6g}" for n in (math.floor(ratio), math.ceil(ratio)))
        raise ConfigError(
            f"{resolution:g} m is not a whole multiple of the {own:g} m of the map's cells, whose "
            f"evidence cannot be split: give {nearest}"
        )
    return round(ratio)


def _whole(ratio: float) -> bool:
    return abs(ratio - round(ratio)) <= _SAME * ratio


def coarser(to: TileStore, tiles: TileStore, factor: int) -> None:
    """Add to each cell of a store the weights of the factor^d cells that lie in it.

    Raises:
        MapTooLargeError: a cell would pass 2^46 votes.
    """
    for index, hits, passes in tiles.parts():
        to.add_cells(index // factor, np.stack([hits, passes], axis=1))


def crop_tiles(to: TileStore, tiles: TileStore, first: IntArray, last: IntArray) -> None:
    """Add to an empty store the cells of a box: from `first` on and before `last`, (ndim,)."""
    side, d = tiles.side, tiles.ndim
    for coords, units in tiles.chunks(first // side, -(-last // side)):
        # Which of a tile's cells lie in the box, axis by axis.
        along = coords[:, :, None] * side + np.arange(side)
        inside = (along >= first[:, None]) & (along < last[:, None])
        kept = inside[:, 0]
        for axis in range(1, d):
            kept = (inside[:, axis, :, None] & kept[:, None, :]).reshape(len(coords), -1)
        cut = units * kept[:, None, :]
        some = cut.any(axis=(1, 2))
        to.fill(coords[some], cut[some])


def add_scaled(to: TileStore, tiles: TileStore, factor: float) -> int:
    """Add weights times a factor; returns how many above 0 became 0."""
    underflowed = 0
    for coords, units in tiles.chunks():
        scaled = np.rint(units * factor).astype(np.int64)
        underflowed += int(np.count_nonzero((units > 0) & (scaled == 0)))
        kept = scaled.any(axis=(1, 2))
        to.add(coords[kept], scaled[kept])
    return underflowed
