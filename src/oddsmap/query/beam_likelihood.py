# SPDX-License-Identifier: Apache-2.0
"""The beam model: readings beside what rays meet, for many poses."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError
from oddsmap.kernels.query.pose_likelihoods import BeamMixture, beam_log_likelihoods, place_beams
from oddsmap.query.given_numbers import check_numbers
from oddsmap.query.pose_batches import over_poses
from oddsmap.query.ray_caster import RayCaster
from oddsmap.query.scan_at_poses import Frame, Poses, PosesLike, ScanBeams
from oddsmap.scans.scan import Scan
from oddsmap.short_repr import described, in_bytes

__all__ = ["BeamLikelihood"]

# How far from 1 the weights' sum may be.
_SUM = 1e-9


class BeamLikelihood:
    """Rays through the states of a map at one moment, as a model of p(scan | map, pose).

    For each beam, with z its reading, range_max for a no-return, and z* the distance to the first
    occupied cell along its ray, at most range_max:

        p = z_hit N(z; z*, sigma_hit) / (its mass between 0 and range_max)
          + z_short lambda_short exp(-lambda_short z) / (1 - exp(-lambda_short z*)), if z <= z*
          + z_max, if z = range_max,    or z_rand / range_max otherwise

    The log likelihood of a scan is the sum of log p: beams are taken as independent. p is a density
    in z [1 / m], but for the mass z_max, as in the book. AMCL's BeamModel leaves out both
    normalisers, and sums p^3 in place of log p.

    Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), section 6.3 and table 6.1.

    Args:
        caster: the states of cells, in the frame that cells count from.
        frame: map_from_grid, if cells do not count from the map frame.
        range_max: readings from here on are no-returns [m].
        sigma_hit: standard deviation of a reading [m].
        lambda_short: rate of what is in the way and not in the map [1 / m].
        z_hit: weight of readings at obstacles.
        z_short: weight of shorter ones.
        z_max: weight of no-returns.
        z_rand: weight of random readings.

    Raises:
        ConfigError: an argument is outside its range, or the weights do not add up to 1.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield f"{self.ndim}D"
        yield f"cells of {self.resolution:g} m"
        for name in ("z_hit", "z_short", "z_max", "z_rand", "sigma_hit", "range_max"):
            yield f"{name} {getattr(self._model, name):g}"
        yield in_bytes(self.nbytes)

    def __init__(
        self,
        caster: RayCaster,
        *,
        frame: Frame | None,
        range_max: float,
        sigma_hit: float,
        lambda_short: float,
        z_hit: float,
        z_short: float,
        z_max: float,
        z_rand: float,
    ) -> None:
        for name, value in (
            ("range_max", range_max),
            ("sigma_hit", sigma_hit),
            ("lambda_short", lambda_short),
        ):
            check_numbers(**{name: value})
            if not 0.0 < value < math.inf:
                raise ConfigError(f"{name} lies above 0, got {value}")
        weights = {"z_hit": z_hit, "z_short": z_short, "z_max": z_max, "z_rand": z_rand}
        if not min(weights.values()) >= 0.0 or not abs(sum(weights.values()) - 1.0) <= _SUM:
            told = ", ".join(f"{name} {value:g}" for name, value in weights.items())
            raise ConfigError(f"weights are 0 or more and add up to 1, got {told}")
        self.ndim, self.resolution = caster.ndim, caster.resolution
        self._caster, self._frame = caster, frame
        self._model = BeamMixture(
            z_hit=float(z_hit), z_short=float(z_short), z_max=float(z_max), z_rand=float(z_rand),
            sigma_hit=float(sigma_hit), lambda_short=float(lambda_short),
            range_max=float(range_max),
        )  # fmt: skip

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self._caster.nbytes

    def log_likelihood(
        self,
        poses: PosesLike,
        scan: Scan,
        *,
        max_beams: int | None = None,
        threads: int = 1,
    ) -> FloatArray:
        """Log p(scan | map, pose) for each of many poses.

        Args:
            poses: of the sensor in the map frame: x, y, yaw [m, m, rad], shape (n, 3), in a 3D map
                matrices [R | t], shape (n, 4, 4); or `Pose` objects.
            scan: its own pose is not looked at.
            max_beams: at most so many beams, evenly spaced; None: all.
            threads: how many; the result is the same.

        Returns:
            The sum of log p of the beams, shape (n,); 0 where none of them says anything, -Inf
            where a weight of 0 rules a reading out.

        Raises:
            InputError: poses of another shape, not finite or too far away, or a scan of another
                dimension.
            ConfigError: another argument is outside its range.
        """
        at = Poses.of(poses, self, self._frame)
        beams = ScanBeams.of(scan, self.ndim, max_beams)
        reach = self._model.range_max
        readings = np.minimum(beams.ranges, reach)
        walk = self._caster.walker("occupied")

        def add_up(part: slice, out: FloatArray) -> None:
            count = len(out) * len(readings)
            starts, ways = np.empty((2, count, self.ndim))
            place_beams(
                at.rotations[part], at.positions[part], beams.origins, beams.directions,
                self.resolution, starts, ways,
            )  # fmt: skip
            distance = walk(starts, ways, reach / self.resolution)[0]
            beam_log_likelihoods(readings, distance, self.resolution, self._model, out)

        return over_poses(len(at), len(readings), add_up, threads)
