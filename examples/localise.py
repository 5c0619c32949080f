# SPDX-License-Identifier: Apache-2.0
"""Monte-Carlo localisation in a CARMEN log: raw odometry and laser against a map of the same log.

python examples/localise.py intel-corrected.log.gz
python examples/localise.py intel-corrected.log.gz --global --particles 20000
python examples/localise.py intel-corrected.log.gz --model beam --plot localised.png

Not in the library: a filter has choices of its own (motion, resampling, recovery), and this one has
the plainest. `--global` starts anywhere in free space, and needs more particles.

The map is made of every second scan, at the log's corrected poses; the filter sees the other scans,
and of the robot's motion the raw odometry alone. That is in the ODOM lines of logs that were
corrected by CARMEN's tools: after each FLASER line they start anew from its corrected pose, and go
on by what the wheels say up to the next one. The filter's mean is compared with the corrected pose
of each scan that it has seen.

Source of the filter: Thrun, Burgard, Fox: Probabilistic Robotics (2005), tables 8.2 (MCL), 5.6
(motion by odometry) and 4.4 (low-variance resampling).
"""

from __future__ import annotations

import argparse
import bz2
import gzip
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

import oddsmap

FloatArray = npt.NDArray[np.float64]

RESOLUTION = 0.05
# Noise of odometry: turning by turning, turning by driving [rad / m], driving by driving, driving
# by turning [m / rad]; and what is there even without motion [m, m, rad].
ALPHA = (0.1, 0.1, 0.1, 0.05)
STEADY = (0.01, 0.01, math.radians(0.5))
# Beams lie close together and err together: each counts for a part.
BEAMS, TEMPER = 60, 0.25


@dataclass(frozen=True)
class Result:
    """How the filter did, one row per scan that it saw, and in which map.

    Attributes:
        true: corrected poses [m, m, rad], shape (n, 3).
        mean: the filter's, likewise.
        reckoned: odometry alone from the first pose on, likewise.
        view: the map.
    """

    true: FloatArray
    mean: FloatArray
    reckoned: FloatArray
    view: oddsmap.LogOdds

    def errors(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance [m] and angle [deg] from the corrected poses."""
        off = poses - self.true
        return np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(wrapped(off[:, 2])))


def wrapped(angle: FloatArray) -> FloatArray:
    """The same angle between -pi and pi."""
    return np.asarray((angle + math.pi) % (2.0 * math.pi) - math.pi)


def after(pose: FloatArray, motion: FloatArray) -> FloatArray:
    """Poses after motions in their own frames, shape (..., 3)."""
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = pose[..., 0] + cos * motion[..., 0] - sin * motion[..., 1]
    y = pose[..., 1] + sin * motion[..., 0] + cos * motion[..., 1]
    return np.stack([x, y, pose[..., 2] + motion[..., 2]], axis=-1)


def between(start: FloatArray, end: FloatArray) -> FloatArray:
    """The motion from one pose to another, in the frame of the first."""
    cos, sin = math.cos(start[2]), math.sin(start[2])
    dx, dy = end[:2] - start[:2]
    turn = math.remainder(end[2] - start[2], 2.0 * math.pi)
    return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, turn])


def odometry(path: Path) -> FloatArray:
    """The motion before each FLASER line as the wheels have it, shape (scans, 3); first: none."""
    content = path.read_bytes()
    if path.suffix in (".gz", ".bz2"):
        content = (gzip if path.suffix == ".gz" else bz2).decompress(content)
    motions: list[FloatArray] = []
    first: FloatArray | None = None
    last: FloatArray | None = None
    for line in content.decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["ODOM"]:
            last = np.array(words[1:4], np.float64)
            first = last if first is None else first
        elif words[:1] == ["FLASER"]:
            if motions and first is not None and last is not None:
                motions.append(between(first, last))
            else:
                motions.append(np.zeros(3))
            first = last = None
    return np.array(motions)


def moved(particles: FloatArray, motion: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Particles after a motion that odometry tells with noise (table 5.6)."""
    way = math.hypot(motion[0], motion[1])
    # A step of a centimetre has no direction that could be told.
    turn = math.atan2(motion[1], motion[0]) if way > 0.01 else 0.0
    rest = motion[2] - turn
    a, b, c, d = ALPHA
    noise = rng.normal(size=(3, len(particles)))
    turns = turn + noise[0] * (a * abs(turn) + b * way)
    ways = way + noise[1] * (c * way + d * (abs(turn) + abs(rest)))
    rests = rest + noise[2] * (a * abs(rest) + b * way)
    steps = np.stack([ways * np.cos(turns), ways * np.sin(turns), turns + rests], axis=1)
    return after(particles, steps + rng.normal(size=steps.shape) * STEADY)


def resampled(weights: FloatArray, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Which particles go on, at equal steps through their weights (table 4.4)."""
    n = len(weights)
    at = (rng.random() + np.arange(n)) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), at), n - 1)


def numbers(pose: object) -> list[float]:
    """X, y, yaw of a pose in the plane [m, m, rad]."""
    if not isinstance(pose, oddsmap.Pose2):
        raise oddsmap.InputError("this is a filter for poses in the plane: give a 2D log")
    return [pose.x, pose.y, pose.theta]


def start_anywhere(view: oddsmap.LogOdds, count: int, rng: np.random.Generator) -> FloatArray:
    """Particles all over the free cells, looking any way."""
    cells, p = view.cells()
    free = cells[p <= view.thresholds.free]
    chosen = view.evidence.centre_of(free[rng.integers(len(free), size=count)])
    return np.column_stack([chosen, rng.uniform(-math.pi, math.pi, count)])


def localise(
    path: Path,
    *,
    particle_count: int = 2000,
    anywhere: bool = False,
    model: str = "field",
    scan_count: int | None = None,
    seed: int = 0,
    threads: int = 2,
) -> Result:
    """Map every second scan, and follow the robot through the others."""
    log = oddsmap.open_log(path)
    scans = list(log)
    poses = np.array([numbers(scan.map_from_sensor) for scan in scans])
    motions = odometry(path)
    if len(motions) != len(scans):
        raise oddsmap.InputError(
            f"{path}: {len(motions)} FLASER lines and {len(scans)} scans: their motions cannot be "
            "told apart"
        )
    view = oddsmap.build_map(scans[::2], RESOLUTION).log_odds()
    reach = float(log.sensor["range_max"])
    score = view.likelihood_field(reach) if model == "field" else view.beam_likelihood(reach)

    rng = np.random.default_rng(seed)
    if anywhere:
        particles = start_anywhere(view, particle_count, rng)
    else:
        particles = poses[0] + rng.normal(size=(particle_count, 3)) * (0.5, 0.5, 0.2)
    weights = np.full(particle_count, 1.0 / particle_count)
    reckoned = poses[0]
    true, means, blind = [], [], []
    for i, scan in enumerate(scans[:scan_count]):
        particles = moved(particles, motions[i], rng)
        reckoned = after(reckoned, motions[i])
        if i % 2 == 0:
            continue
        logs = TEMPER * score.log_likelihood(particles, scan, max_beams=BEAMS, threads=threads)
        weights = weights * np.exp(logs - logs.max())
        weights /= weights.sum()
        x, y = weights @ particles[:, :2]
        means.append([x, y, math.atan2(*(weights @ f(particles[:, 2]) for f in (np.sin, np.cos)))])
        true.append(poses[i])
        blind.append(reckoned)
        if 1.0 / (weights @ weights) < particle_count / 2:
            particles = particles[resampled(weights, rng)]
            weights = np.full(particle_count, 1.0 / particle_count)
    return Result(np.array(true), np.array(means), np.array(blind), view)


def draw(result: Result, path: Path) -> None:
    """The map, the corrected path, the filter's, and where odometry alone would be."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    lo, hi = result.view.bounds() or ((0, 0), (1, 1))
    p = result.view.probability()
    x0, y0, x1, y1 = (float(c) * RESOLUTION for c in (*lo, *hi))
    figure, axes = plt.subplots(figsize=(8, 7), layout="constrained")
    axes.imshow(1.0 - p, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=(x0, x1, y0, y1))
    for poses, style, name in (
        (result.reckoned, "--", "odometry alone"),
        (result.true, "-", "corrected"),
        (result.mean, ":", "filter"),
    ):
        axes.plot(poses[:, 0], poses[:, 1], style, label=name, linewidth=1.5)
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x [m]", ylabel="y [m]")
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Localise, and say how far off it is."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--particles", type=int, default=2000)
    parser.add_argument("--global", dest="anywhere", action="store_true", help="start anywhere")
    parser.add_argument("--model", choices=("field", "beam"), default="field")
    parser.add_argument("--scans", type=int, help="only the first of them")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plot", type=Path, metavar="PNG", help="also draw the paths")
    given = parser.parse_args()
    result = localise(
        given.log, particle_count=given.particles, anywhere=given.anywhere, model=given.model,
        scan_count=given.scans, seed=given.seed,
    )  # fmt: skip
    for name, poses in (("filter", result.mean), ("odometry alone", result.reckoned)):
        away, angle = result.errors(poses)
        print(
            f"{name}: {len(away)} scans, off by {np.median(away):.3f} m and "
            f"{np.median(angle):.2f} deg (median), {away.max():.3f} m and {angle.max():.2f} deg "
            "(most)"
        )
    found = np.flatnonzero(result.errors(result.mean)[0] > 0.5)
    if len(found):
        print(f"within 0.5 m from scan {found[-1] + 1} of these on")
    if given.plot is not None:
        draw(result, given.plot)


if __name__ == "__main__":
    main()
