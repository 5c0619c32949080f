# SPDX-License-Identifier: Apache-2.0
"""The posterior of the recursive binary Bayes filter, as a view of the evidence.

Each reading adds a log Bayes factor to the cells that it speaks of,

    l_t = l_{t-1} + log p(x | z) / p(not x | z) - log p(x) / p(not x),

and adds nothing anywhere else. The factors of hits are all alike, and so are those of passes, so
the sum needs no recursion:

    l = logit(prior) + l_occ * hits - l_free * passes,

l_occ = logit(p_hit), l_free = -logit(p_miss), with p_hit and p_miss the inverse sensor model at
prior 1/2. Sensor model and prior can be changed after mapping.

Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), table 9.1 and equation 9.7.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence import EvidenceMap
from oddsmap.kernels.tiles import ONE
from oddsmap.probability_map import ProbabilityMap, Thresholds
from oddsmap.sensors.beam import logit

if TYPE_CHECKING:
    import xarray

    from oddsmap.export.ros_reader import RosMode
    from oddsmap.voxels import VoxelMap

__all__ = ["LogOdds", "sigmoid"]

FloatArray = npt.NDArray[np.float64]
Region = tuple[npt.ArrayLike, npt.ArrayLike]


def sigmoid(log_odds: npt.ArrayLike) -> FloatArray:
    """Probability of log odds: 1 / (1 + exp(-l)), without overflow."""
    x = np.asarray(log_odds, dtype=np.float64)
    small = np.exp(-np.abs(x))
    return np.where(x >= 0, 1.0, small) / (1.0 + small)


class LogOdds:
    """p(m | z_1:t) of each cell, cells independent of each other.

    Regions are pairs (lo, hi) of cell indices, x first, hi past the last cell; by default the
    box of known cells. Arrays have shape (ny, nx), row = y ascending; (nz, ny, nx) in space.

    Args:
        evidence: the map; what is added to it later shows in the view.

    Other Args:
        p_hit: p(x | z) of a hit at prior 1/2; default: the map's sensor model.
        p_miss: p(x | z) of a pass at prior 1/2; likewise.
        prior: p(x) of every cell; default: the map's configuration.
        thresholds: from which probability a cell is free or occupied; likewise.

    Raises:
        ConfigError: a probability is outside its range.
    """

    def __init__(
        self,
        evidence: EvidenceMap,
        *,
        p_hit: float | None = None,
        p_miss: float | None = None,
        prior: float | None = None,
        thresholds: Thresholds | None = None,
    ) -> None:
        self.evidence = evidence
        self.p_hit = evidence.sensor.p_hit if p_hit is None else p_hit
        self.p_miss = evidence.sensor.p_miss if p_miss is None else p_miss
        self.prior = evidence.config.posterior.prior if prior is None else prior
        self.thresholds = thresholds or evidence.config.posterior.thresholds
        for name in ("p_hit", "p_miss", "prior"):
            value = getattr(self, name)
            if not 0.0 < value < 1.0:
                raise ConfigError(f"{name} is a probability between 0 and 1, got {value}")
        if not self.p_miss < 0.5 < self.p_hit:
            raise ConfigError(
                f"a hit must speak for and a pass against a cell: p_miss < 0.5 < p_hit, "
                f"got p_miss {self.p_miss} and p_hit {self.p_hit}"
            )

    def of_votes(self, hits: npt.ArrayLike, passes: npt.ArrayLike) -> FloatArray:
        """Log odds of given weights of hits and passes [votes]."""
        gain = float(logit(self.p_hit)) * np.asarray(hits, np.float64)
        loss = float(logit(self.p_miss)) * np.asarray(passes, np.float64)
        return float(logit(self.prior)) + (gain + loss)

    def log_odds(self, region: Region | None = None) -> FloatArray:
        """Log odds of a region's cells; the prior's where there is no evidence."""
        return self.of_votes(*self.evidence.region(*self._region(region)))

    def probability(self, region: Region | None = None) -> FloatArray:
        """p(occupied) of a region's cells; the prior where there is no evidence."""
        return sigmoid(self.log_odds(region))

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True where a region's cells have any evidence, also where it cancels out."""
        hits, passes = self.evidence.region(*self._region(region))
        return (hits > 0) | (passes > 0)

    def state(self, region: Region | None = None) -> npt.NDArray[np.int8]:
        """Unknown, free, undecided or occupied: values of `oddsmap.State`."""
        hits, passes = self.evidence.region(*self._region(region))
        return self.thresholds.state(
            sigmoid(self.of_votes(hits, passes)), observed=(hits > 0) | (passes > 0)
        )

    def cells(self) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """The cells with evidence: index, shape (n, d), x first, and probability, shape (n,)."""
        index, hits, passes = self.evidence.cells()
        return index, sigmoid(self.of_votes(hits / ONE, passes / ONE))

    def to_probability_map(self, region: Region | None = None) -> ProbabilityMap:
        """Probabilities with their place in the world, without the counts."""
        if self.evidence.ndim != 2:
            raise InputError(
                "a picture or a ROS map needs a map of the plane, this one is of space: "
                "oddsmap.project makes one of a band of heights (--z-min, --z-max)"
            )
        lo, hi = self._region(region)
        resolution = self.evidence.resolution
        hits, passes = self.evidence.region(lo, hi)
        return ProbabilityMap(
            probability=sigmoid(self.of_votes(hits, passes)),
            observed=(hits > 0) | (passes > 0),
            resolution=resolution,
            origin=(float(lo[0]) * resolution, float(lo[1]) * resolution),
        )

    def to_voxels(self) -> VoxelMap:
        """Log odds of the known cells of a map of space, without the counts.

        Raises:
            InputError: a map of the plane.
        """
        from oddsmap.voxels import VoxelMap

        if self.evidence.ndim != 3:
            raise InputError("an OctoMap or a PLY needs a map of space, this one is of the plane")
        index, hits, passes = self.evidence.cells()
        return VoxelMap(index, self.of_votes(hits / ONE, passes / ONE), self.evidence.resolution)

    def to_xarray(self, region: Region | None = None) -> xarray.DataArray:
        """Probabilities with coordinates of the cells' centres [m]; needs the extra `xarray`.

        Raises:
            ConfigError: xarray is not installed.
        """
        try:
            import xarray
        except ImportError:
            raise ConfigError("xarray is not installed: pip install 'oddsmap[xarray]'") from None
        lo, hi = self._region(region)
        resolution = self.evidence.resolution
        names = ("x", "y", "z")[: self.evidence.ndim]
        axes = {
            name: (name, (np.arange(a, b) + 0.5) * resolution, {"units": "m"})
            for name, a, b in zip(names, lo, hi, strict=True)
        }
        return xarray.DataArray(
            self.probability(region),
            dims=names[::-1],
            coords=axes,
            name="probability",
            attrs={"resolution": resolution, "prior": self.prior},
        )

    def save_ros(
        self,
        path: str | os.PathLike[str],
        *,
        mode: RosMode = "trinary",
        force: bool = False,
    ) -> tuple[Path, Path]:
        """Write a ROS map_server map: see `oddsmap.export.ros.save_ros`."""
        from oddsmap.export.ros import save_ros

        return save_ros(
            self.to_probability_map(),
            Path(path),
            mode=mode,
            thresholds=self.thresholds,
            force=force,
        )

    def save_png(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Draw the map: see `oddsmap.plot.picture.save_png`."""
        from oddsmap.plot.picture import save_png

        save_png(self.to_probability_map(), Path(path), force=force)

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write cells, counts and probabilities: see `oddsmap.export.npz.save_npz`."""
        from oddsmap.export.npz import save_npz

        index, hits, passes = self.evidence.cells()
        save_npz(
            Path(path),
            index=index,
            hits=hits / ONE,
            passes=passes / ONE,
            probability=self.cells()[1].astype(np.float32),
            observed=np.ones(len(index), np.bool_),
            resolution=self.evidence.resolution,
            force=force,
        )

    def save_octomap(
        self,
        path: str | os.PathLike[str],
        *,
        clamp: tuple[float, float] | None = None,
        force: bool = False,
    ) -> None:
        """Write a `.bt` or `.ot`: see `oddsmap.export.octomap_writer.save_octomap`."""
        self.to_voxels().save_octomap(path, clamp=clamp, thresholds=self.thresholds, force=force)

    def save_ply(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write the occupied cells as points: see `oddsmap.export.ply.save_ply`."""
        self.to_voxels().save_ply(path, thresholds=self.thresholds, force=force)

    def _region(self, region: Region | None) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        if region is not None:
            return np.asarray(region[0], np.int64), np.asarray(region[1], np.int64)
        bounds = self.evidence.bounds()
        if bounds is None:
            nothing = np.zeros(self.evidence.ndim, np.int64)
            return nothing, nothing
        return bounds
