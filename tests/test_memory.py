# SPDX-License-Identifier: Apache-2.0
"""Whatever is done again and again needs no more memory from one time to the next."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections.abc import Callable
from functools import cache
from inspect import getattr_static
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType, FrameType

import numpy as np
import pytest

import oddsmap
from tests import memory_files_kit as files_kit
from tests import memory_kit as kit
from tests.memory_kit import FADING, LIDAR, SONAR, TOF, Repeat, Workload

WORKLOADS: dict[str, Workload] = {
    "2D, votes by scan": kit.mapping(kit.lidar),
    "2D, votes by beam": kit.mapping(kit.lidar, votes="beam", sensor=LIDAR),
    "2D, fading passes": kit.mapping(kit.lidar, sensor=FADING),
    "2D, half-life": kit.mapping(kit.lidar, half_life=5.0),
    "2D, path lengths": kit.mapping(kit.lidar, votes="beam", path_lengths=True),
    "2D, cones": kit.mapping(kit.sonar, sensor=SONAR),
    "2D, cones, votes by scan": kit.mapping(kit.sonar, sensor=SONAR, votes="scan"),
    "2D, overhead": kit.mapping(kit.overhead),
    "2D, one map": kit.adding,
    "2D, merge and crop": kit.merging,
    "3D, depth images": kit.depth_images,
    "3D, votes by scan": kit.mapping(kit.turns),
    "3D, votes by beam": kit.mapping(kit.turns, votes="beam", sensor=LIDAR),
    "3D, fading passes": kit.mapping(kit.turns, sensor=FADING),
    "3D, half-life": kit.mapping(kit.turns, half_life=5.0),
    "3D, path lengths": kit.mapping(kit.turns, votes="beam", path_lengths=True),
    "3D, cones": kit.mapping(kit.tof, sensor=TOF),
    "3D, images by rays": kit.mapping(kit.images),
    "3D, images by projection": kit.mapping(kit.images, method="projective"),
    **{
        f"full maps, {method}, {schedule}": kit.full_maps(
            kit.few, SONAR, method=method, schedule=schedule, sweeps=2
        )
        for method, schedule in product(
            ("sum-product", "gibbs", "map"), ("sequential", "chunks", "parallel")
        )
    },
    "full maps, windows": kit.full_maps(
        kit.few, SONAR, method="gibbs", prior_model="windows", sweeps=2
    ),
    "full maps of space": kit.full_maps(kit.tof, TOF, sweeps=1),
    "full map, samples": kit.sampling,
    "full map, online, anew": kit.online_anew,
    "full map, online, one map": kit.online_on,
    "reflection maps, ep": kit.reflection_maps(method="ep"),
    "reflection maps, adf": kit.reflection_maps(method="adf"),
    "reflection maps, em": kit.reflection_maps(method="em"),
    "calibration of cones": kit.calibrating(lambda: kit.sonar()[:1], SONAR),
    "calibration of beams": kit.calibrating(lambda: kit.lidar()[:1], LIDAR, noise_only=True),
    "score of a full map": kit.scoring(kit.full_map, kit.sonar, SONAR),
    "score of a view": kit.scoring(kit.view, lambda: kit.lidar()[:5], LIDAR),
    "doubts of a log": kit.doubting,
    "diagnosis of a log": kit.diagnosing,
    "questions in 2D": kit.asking(kit.plane),
    "questions in 3D": kit.asking(kit.room),
    "poses, localised": kit.localising,
    "whose votes": kit.asking_why,
    "where to drive": kit.driving,
    "cleaning": kit.cleaning,
    "evaluation": kit.evaluating,
    "exact posterior": kit.exact,
    "views": files_kit.views,
    "views of space": files_kit.views_of_space,
    "files": files_kit.files,
    "pictures": files_kit.pictures,
    "files of space": files_kit.files_of_space,
    "logs": files_kit.logs,
    "landmarks": files_kit.landmarks,
}

# Without a leak a repetition adds 0 to 8 kB, some 100 kB at first where Zarr or Matplotlib is at
# work. Kernels that did not free what they were given lost 1.2 MB or more in each repetition.
BOUND = 256
"""How much memory may grow by in RUN repetitions [kB]."""
RUN = 3
MOST = 12
"""Repetitions after which it must have been steady."""
RUINOUS = 100_000
"""Growth after which no more need be seen [kB]: other tests want memory, too."""


# ---- how much memory is in use ---------------------------------------------------------------


def trimmer() -> Callable[[int], int] | None:
    """What gives freed memory back to the system, where the C library has it."""
    if sys.platform != "linux":
        return None
    trim: Callable[[int], int] | None = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim


TRIM = trimmer()
USE = Path("/proc/self/smaps_rollup")
pytestmark = [
    # Elsewhere there is the peak alone, which a leak does not move after another test's.
    pytest.mark.skipif(
        TRIM is None or not USE.exists(), reason="reads /proc/self/smaps_rollup, and uses glibc"
    ),
    pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled"),
]


def in_use() -> int:
    """Memory that the process has made its own [kB], swapped out or not.

    Pages of files are left out: they come and go with what else the machine does. What was freed
    is given back first, in all arenas: only then is what remains the same to within some pages.
    `smaps_rollup` goes through the pages; on many kernels `statm` adds up counters that are behind
    by up to 32 pages or more for each processor.
    """
    gc.collect()
    assert TRIM is not None
    TRIM(0)
    lines = (line.split() for line in USE.read_text(encoding="ascii").splitlines()[1:])
    return sum(int(value) for name, value, _ in lines if name in ("Anonymous:", "Swap:"))


def growth(repeat: Repeat) -> list[int]:
    """Memory gained by each repetition [kB], until it is steady; [] where it is at last.

    It need not be steady at once: caches fill, and threads get their arenas. A leak loses memory
    each time, so RUN quiet repetitions acquit, whatever came before them.
    """
    repeat()
    gc.collect()
    gc.freeze()  # what is there already need not be gone through for each reading
    try:
        memory = [in_use()]
        for _ in range(MOST):
            repeat()
            memory.append(in_use())
            if len(memory) > RUN and memory[-1] - memory[-1 - RUN] <= BOUND:
                return []
            if memory[-1] - memory[0] > RUINOUS:
                break
    finally:
        gc.unfreeze()
    return np.diff(memory).tolist()


def test_what_is_kept_is_seen() -> None:
    """A small leak, and one that is not waited for. Ones: memory is in use when written to."""
    kept: list[object] = []
    steps = growth(lambda: kept.append(np.ones(BOUND * 1024 // 2 // 8)))
    assert len(steps) == MOST
    assert len(growth(lambda: kept.append(np.ones(RUINOUS * 1024 // 2 // 8)))) < MOST


def test_what_is_freed_or_kept_once_is_not() -> None:
    kept: dict[int, object] = {}

    def repeat() -> None:
        np.ones(4_000_000)
        [np.ones(1000) for _ in range(4000)]
        if len(kept) < 4:
            kept[len(kept)] = np.ones(1_000_000)

    assert growth(repeat) == []


# ---- what is done ----------------------------------------------------------------------------


@cache
def used(name: str) -> set[CodeType]:
    """The functions that a workload calls, in Python, when it is done for the second time."""
    called = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            called.add(frame.f_code)

    with TemporaryDirectory() as folder:
        WORKLOADS[name](Path(folder))()  # compiles
        before = sys.getprofile()
        sys.setprofile(note)
        try:
            WORKLOADS[name](Path(folder))()
        finally:
            sys.setprofile(before)
    return called


@pytest.mark.parametrize("name", WORKLOADS)
def test_memory_is_steady(name: str, tmp_path: Path) -> None:
    used(name)
    steps = growth(WORKLOADS[name](tmp_path))
    assert steps == [], f"memory [kB] goes on growing: {steps}"


@pytest.mark.realdata
@pytest.mark.parametrize(
    "name", ["laser2d/orebro-corrected.log.gz", "octomap/spherical_scan.graph", "rgbd/7scenes"]
)
def test_memory_is_steady_as_real_logs_are_read(name: str, data_folder: Path) -> None:
    def repeat() -> None:
        assert sum(scan.size for scan in oddsmap.open_log(data_folder / name)) > 0

    steps = growth(repeat)
    assert steps == [], f"memory [kB] goes on growing: {steps}"


# What is not done above, and why.
NOT_USED = {
    "Log": "a protocol: nobody makes one",
    **dict.fromkeys(("State", "Verdict"), "an enumeration: its members are made once"),
    **dict.fromkeys(
        ("ConfigError", "InputError", "MapTooLargeError", "OddsmapError", "OutputError"),
        "says what is wrong",
    ),
}


def test_every_public_name_is_used() -> None:
    """A class where it is made, a function where it is called."""
    called = {code for name in WORKLOADS for code in used(name)}
    unused = set()
    for name in oddsmap.__all__:
        value = getattr(oddsmap, name)
        if callable(value):
            maker = getattr_static(value, "__init__") if isinstance(value, type) else value
            if getattr(maker, "__code__", None) not in called:
                unused.add(name)
    assert unused == set(NOT_USED)
