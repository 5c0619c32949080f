# SPDX-License-Identifier: Apache-2.0
"""Whole commands, from the log on disk to the map on disk: CPU time, wall time, peak memory.

    python benchmarks/end_to_end.py                              # all of it, some ten minutes
    python benchmarks/end_to_end.py --part octomap --part commands
    python benchmarks/end_to_end.py --against ../older/src --python ../older/venv/bin/python
    python benchmarks/end_to_end.py --data DIR --json result.json

Parts: `octomap` (the same files through octomap-python, with its defaults and with its fast
setting), `commands` (build, info, every export, loading). Each command is a process of its own,
with kernels compiled before; contenders take turns, and the best of the rounds counts. The floor
beside them reads the same files and writes as many bytes. The town is simulated, as in lidar3d.py.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

Row = dict[str, Any]

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src"
PEER = ROOT / "benchmarks" / "peers" / "octomap_command.py"

# The floor: what no command that does this can do without.
FLOOR = """
import pathlib, sys
out, size, *paths = sys.argv[1:]
for path in paths:
    pathlib.Path(path).read_bytes()
pathlib.Path(out).write_bytes(bytes(int(size)))
"""
LOAD = """
import sys, time
import oddsmap
started = time.process_time()
grid = oddsmap.load_map(sys.argv[1])
print(time.process_time() - started, grid.cell_count())
"""


@dataclass(frozen=True, slots=True)
class Case:
    """A log to map."""

    name: str
    log: Path
    resolution: float
    poses: Path | None = None

    @property
    def files(self) -> list[Path]:
        """What has to be read."""
        return sorted(self.log.iterdir()) if self.log.is_dir() else [self.log]


@dataclass(frozen=True, slots=True)
class Cost:
    """What a process took."""

    cpu_s: float
    wall_s: float
    peak_mb: float


@dataclass(frozen=True, slots=True)
class Tree:
    """An oddsmap to time: its sources and the Python to run it with."""

    name: str
    source: Path
    python: str

    def command(self, *words: object) -> list[str]:
        """A command line of it."""
        return [self.python, "-m", "oddsmap", *map(str, words)]

    def run(self, words: list[str]) -> Cost:
        """Run one of its command lines."""
        return run(words, {**os.environ, "PYTHONPATH": str(self.source)})


def run(words: list[str], env: dict[str, str] | None = None) -> Cost:
    """Run a command to its end; raises SystemExit, with what it printed, where it fails."""
    with tempfile.TemporaryFile() as output:
        started = time.perf_counter()
        process = subprocess.Popen(words, stdout=output, stderr=output, env=env)
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            output.seek(0)
            text = output.read().decode(errors="replace")
            raise SystemExit(f"{' '.join(words)} failed:\n{text}")
    return Cost(used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 1024)


def best(costs: list[Cost]) -> Cost:
    """The least of each."""
    return Cost(*(min(getattr(cost, name) for cost in costs) for name in Cost.__slots__))


def size_of(path: Path) -> int:
    """Bytes on disk."""
    if path.is_dir():
        return sum(part.stat().st_size for part in path.rglob("*") if part.is_file())
    return path.stat().st_size


def first_scans(folder: Path, count: int, into: Path) -> Case:
    """A folder with the first scans of another, as links."""
    chosen = into / f"{folder.name}-{count}"
    chosen.mkdir(exist_ok=True)
    for path in sorted(folder.glob("*.pcd"))[:count]:
        (chosen / path.name).symlink_to(path)
    lines = (folder / "poses_kitti.txt").read_text().splitlines(keepends=True)
    poses = chosen / "poses_kitti.txt"
    poses.write_text("".join(lines[:count]))
    return Case(f"{folder.name}, {count} scans", chosen, 0.1, poses)


def build(tree: Tree, case: Case, out: Path, *more: object) -> list[str]:
    """The command that maps a case."""
    poses = ("--poses", case.poses) if case.poses else ()
    where = ("--resolution", case.resolution, "-o", out, "--force")
    return tree.command("build", case.log, *poses, *where, *more)


def floor(case: Case, size: int, out: Path) -> Cost:
    """What reading the files and writing the bytes takes."""
    words = [sys.executable, "-c", FLOOR, str(out), str(size), *map(str, case.files)]
    return best([run(words) for _ in range(3)])


# ---- against OctoMap ---------------------------------------------------------------------------


def check_threads(tree: Tree, case: Case, work: Path) -> None:
    """One thread and two must write the same bytes."""
    maps = []
    for threads in (1, 2):
        out = work / f"threads{threads}.zarr"
        tree.run(build(tree, case, out, "--threads", threads))
        shards = (path for path in out.rglob("*") if path.is_file() and path.name != "zarr.json")
        maps.append({path.relative_to(out): path.read_bytes() for path in shards})
        shutil.rmtree(out)
    if maps[0] != maps[1]:
        raise SystemExit(f"{case.name}: one and two threads differ")


def against_octomap(tree: Tree, cases: list[Case], work: Path, rounds: int) -> list[Row]:
    """Both from the same files; OctoMap once, as it takes a minute, we `rounds` times."""
    rows = []
    for case in cases:
        check_threads(tree, case, work)
        out = work / "map.zarr"
        ours = best([tree.run(build(tree, case, out)) for _ in range(rounds)])
        row: Row = {"case": case.name, "resolution": case.resolution, "oddsmap": asdict(ours)}
        row["bytes"] = size_of(out)
        row["floor"] = asdict(floor(case, row["bytes"], work / "bytes"))
        for name, more in (("OctoMap", []), ("OctoMap, fast", ["--fast"])):
            words = [sys.executable, str(PEER), str(case.log), str(case.poses)]
            words += [str(case.resolution), str(work / "map.bt"), *more]
            row[name] = asdict(run(words))
            ratio = row[name]["cpu_s"] / ours.cpu_s
            print(f"{case.name}, {case.resolution:g} m: {name} {row[name]['cpu_s']:.1f} s of CPU, ")
            print(f"    oddsmap {ours.cpu_s:.2f} s: {ratio:.1f} times as fast", flush=True)
        rows.append(row)
    return rows


# ---- every command -----------------------------------------------------------------------------


def every_command(trees: list[Tree], cases: list[Case], work: Path, rounds: int) -> list[Row]:
    """Build, info, exports and loading of each case, by each tree."""
    rows = []
    for case in cases:
        jobs: list[tuple[str, str | None]] = [("build", None), ("info", None), ("load", None)]
        flat = case.poses is None and case.log.is_file()
        suffixes = ("png", "yaml", "npz") if flat else ("bt", "ot", "ply", "npz")
        jobs += [("export", suffix) for suffix in suffixes]
        for what, suffix in jobs:
            costs: dict[str, list[Cost]] = {tree.name: [] for tree in trees}
            for _ in range(rounds):
                for tree in trees:
                    saved = work / f"{tree.name}.zarr"
                    words = {
                        "build": build(tree, case, saved),
                        "info": tree.command("info", saved),
                        "load": [tree.python, "-c", LOAD, str(saved)],
                        "export": tree.command(
                            "export", saved, work / f"out.{suffix or 'npz'}", "--force"
                        ),
                    }[what]
                    costs[tree.name].append(tree.run(words))
            job = f"{what} .{suffix}" if suffix else what
            row: Row = {"case": case.name, "resolution": case.resolution, "job": job}
            row |= {tree.name: asdict(best(costs[tree.name])) for tree in trees}
            rows.append(row)
            print(f"{case.name} {case.resolution:g} m, {job}: {_words(row, trees)}", flush=True)
    return rows


def _words(row: Row, trees: list[Tree]) -> str:
    costs = (row[tree.name] for tree in trees)
    return " -> ".join(
        f"{cost['cpu_s']:.2f} s CPU, {cost['wall_s']:.2f} s, {cost['peak_mb']:.0f} MB"
        for cost in costs
    )


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--part", action="append", choices=["octomap", "commands"])
    parser.add_argument("--data", type=Path, default=os.environ.get("ODDSMAP_DATA"))
    parser.add_argument("--against", type=Path, help="sources of another oddsmap")
    parser.add_argument("--python", default=sys.executable, help="the Python to run those with")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="the smallest cases, one round")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    data = Path(options.data or ROOT.parent / "shared" / "data").resolve()
    if not data.is_dir():
        raise SystemExit(f"SKIPPED: no logs at {data}: give --data DIR")
    rounds = 1 if options.quick else options.rounds
    parts = options.part or ["octomap", "commands"]
    report: dict[str, Any] = {"machine": f"{platform.processor()}, {os.cpu_count()} cores"}
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        tree = Tree("oddsmap", SOURCE, sys.executable)
        # By a process of its own: what this one holds would count as its children's.
        town, hall = work / "town", data / "lidar3d" / "hall_os0"
        run([sys.executable, str(ROOT / "benchmarks" / "town_folder.py"), str(town)])
        forty, ten = first_scans(town, 40, work), first_scans(town, 10, work)
        hundred = first_scans(town, 100, work)
        fine = Case(ten.name, ten.log, 0.05, ten.poses)
        laser = data / "laser2d"
        flat = [
            Case("Intel", laser / "intel-corrected.log.gz", 0.05),
            Case("freiburg-079", laser / "freiburg-079-corrected.log.gz", 0.05),
        ]
        # The first run compiles.
        trees = [tree]
        if options.against:
            trees.insert(0, Tree("before", options.against.resolve(), options.python))
        for each in trees:
            for case in (ten, flat[0]):
                each.run(build(each, case, work / "warm.zarr"))
        if "octomap" in parts:
            if importlib.util.find_spec("octomap") is None:
                print("NOT AVAILABLE: pip install octomap-python")
            else:
                cases = [ten] if options.quick else [forty, fine]
                report["octomap"] = against_octomap(tree, cases, work, rounds)
        if "commands" in parts:
            coarse = Case(hundred.name, hundred.log, 0.2, hundred.poses)
            space = [coarse, hundred, fine, Case("hall_os0", hall, 0.1, hall / "poses_kitti.txt")]
            camera = Case("7-Scenes", data / "rgbd" / "7scenes", 0.05)
            cases = [flat[0]] if options.quick else [*space, camera, *flat]
            report["commands"] = every_command(trees, cases, work, rounds)
    if options.json:
        options.json.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
