# SPDX-License-Identifier: Apache-2.0
"""Nothing is dropped in silence: each way from readings to a map counts each of its reasons."""

from __future__ import annotations

import ast
import dataclasses
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import (
    BeamSensor,
    ConeSensor,
    EvidenceMap,
    GridScan,
    OnlineFullMap,
    OverheadSensor,
    Pose2,
    Pose3,
    Scan,
    add_scans,
    build_full_map,
    build_map,
    build_reflection_map,
    score_map,
)
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from tests.kit import ONE

RESOLUTION = 0.125
TOO_FAR = 2.0**45 * RESOLUTION  # the first pose that is
Counts = Counter[str]

# ---- readings, each reason another number of times -------------------------------------------
# A count that is taken for another one so shows.

RETURN, NAN, BELOW, OVER, BODY, HIGH = "return", "nan", "below", "over", "body", "high"
HOW_OFTEN = {RETURN: 4, NAN: 2, BELOW: 3, OVER: 7, BODY: 5, HIGH: 6}
NAN_POSES, FAR_POSES, EMPTY = 8, 9, 10
RANGES = {RETURN: 1.0, NAN: np.nan, BELOW: 0.05, OVER: 3.0, BODY: 0.25, HIGH: 2.0}
LIMITS: dict[str, Any] = {"range_min": 0.1, "range_max": 3.0}
FILTERS: dict[str, Any] = {
    "mark_z_max": 1.0, "body_min": (-0.3, -0.3, -0.3), "body_max": (0.3, 0.3, 0.3),
}  # fmt: skip


def pose_of(d: int, x: float) -> Pose2 | Pose3:
    return Pose2(x, 0.3, 0.0) if d == 2 else Pose3(np.array([x, 0.3, 0.3]), np.eye(3))


def readings(d: int, kinds: Sequence[str], x: float = 0.3) -> Scan:
    """A scan of such readings; those that end too high look up, the others ahead."""
    up, ahead = np.eye(d)[-1], np.eye(d)[0]
    directions = np.array([up if kind == HIGH else ahead for kind in kinds])
    return Scan(pose_of(d, x), directions, np.array([RANGES[kind] for kind in kinds]))


def scans_of_ranges(d: int) -> list[Scan]:
    kinds = [kind for kind, count in HOW_OFTEN.items() for _ in range(count)]
    if d == 2:
        kinds = [kind for kind in kinds if kind not in (BODY, HIGH)]
    return [
        readings(d, kinds),
        *(readings(d, [RETURN], np.nan) for _ in range(NAN_POSES)),
        *(readings(d, [RETURN], sign * TOO_FAR) for sign in (-1, 1, *[1] * (FAR_POSES - 2))),
        *(readings(d, [NAN]) for _ in range(EMPTY)),
    ]


def images() -> list[DepthScan]:
    """The same readings as pixels of one row, which are depths along the axis of its pixel."""
    count = sum(HOW_OFTEN.values())
    # A long lens: all pixels look ahead, along z of the optical frame, but for 1e-4.
    camera = PinholeCamera(fx=1e5, fy=1e5, cx=0.0, cy=0.0, width=count, height=1)
    depth = np.repeat([RANGES[kind] for kind in HOW_OFTEN], list(HOW_OFTEN.values()))
    row = depth.astype(np.float32)[None]
    nothing, something = np.full_like(row, np.nan), np.full_like(row, 1.0)

    def at(x: float, pixels: np.ndarray[Any, Any]) -> DepthScan:
        return DepthScan(Pose3(np.array([x, 0.3, 0.3]), np.eye(3)), pixels, camera)

    return [
        at(0.3, row),
        *(at(np.nan, something) for _ in range(NAN_POSES)),
        *(at(TOO_FAR, something) for _ in range(FAR_POSES)),
        *(at(0.3, nothing) for _ in range(EMPTY)),
    ]


def grids() -> list[GridScan]:
    def at(x: float, seen: float) -> GridScan:
        return GridScan(Pose2(x, 0.3, 0.0), np.full((2, 2), seen), 0.5, (0.0, 0.0))

    return [
        at(0.3, 1.0),
        *(at(np.nan, 1.0) for _ in range(NAN_POSES)),
        *(at(-TOO_FAR, 1.0) for _ in range(FAR_POSES)),
        *(at(0.3, np.nan) for _ in range(EMPTY)),
    ]


# ---- the ways to a map -----------------------------------------------------------------------

OF_SCANS = {"scan.nan_pose": NAN_POSES, "scan.pose_too_far": FAR_POSES, "scan.empty": EMPTY}
OF_BEAMS = {
    **OF_SCANS,
    "beam.nan": HOW_OFTEN[NAN] + EMPTY,
    "beam.below_range_min": HOW_OFTEN[BELOW],
    "beam.no_return": HOW_OFTEN[OVER],
}
OF_SPACE = {
    **OF_BEAMS,
    "hit.outside_heights": HOW_OFTEN[HIGH],
    "hit.on_body": HOW_OFTEN[BODY],
}
OF_IMAGES = {**OF_SPACE, "beam.nan": HOW_OFTEN[NAN] + EMPTY * sum(HOW_OFTEN.values())}
# To the forward model a cone's reading at range_max is a no-return like any other.
OF_CONES_IN_A_FULL_MAP = {k: n for k, n in OF_BEAMS.items() if k != "beam.no_return"}

BEAM = BeamSensor(**LIMITS)
CONE = ConeSensor(cone_deg=10.0, **LIMITS)
BEAM_OF_SPACE, CONE_OF_SPACE = (
    BeamSensor(**LIMITS, **FILTERS),
    ConeSensor(cone_deg=10.0, **LIMITS, **FILTERS),
)


def filtered(scans: Sequence[Any], sensor: Any, method: str = "rays") -> Counts:
    report = build_map(scans, RESOLUTION, sensor=sensor, method=method).report
    assert report is not None
    return report.skipped


def by_threads(scans: Sequence[Any], sensor: Any) -> Counts:
    evidence = EvidenceMap(RESOLUTION, sensor=sensor, ndim=3 if sensor is BEAM_OF_SPACE else 2)
    return add_scans(evidence, scans, threads=3).skipped


def full(scans: Sequence[Scan], sensor: Any) -> Counts:
    report = build_full_map(scans, RESOLUTION, sensor=sensor).report
    assert report is not None
    return report.skipped


def online(scans: Sequence[Scan], sensor: Any) -> Counts:
    config = build_full_map(scans[:1], RESOLUTION, sensor=sensor).config
    return OnlineFullMap(config).add_scans(scans).skipped


def reflected(scans: Sequence[Scan], sensor: Any) -> Counts:
    return build_reflection_map(scans, RESOLUTION, sensor=sensor, sweeps=1).report.skipped


def scored(scans: Sequence[Scan], sensor: Any) -> Counts:
    belief = build_map(scans[:1], RESOLUTION, sensor=sensor).log_odds()
    return score_map(belief, scans, sensor).skipped


def projected(scans: Sequence[Any], sensor: Any) -> Counts:
    return filtered(scans, sensor, "projective")


# Ahead is up in the optical frame here: far pixels end too high.
BEAM_OF_IMAGES = BeamSensor(**LIMITS, **{**FILTERS, "mark_z_max": 1.8})

Way = tuple[Callable[..., Counts], Sequence[Any], Any, dict[str, int]]
WAYS: dict[str, Way] = {
    "beams of the plane": (filtered, scans_of_ranges(2), BEAM, OF_BEAMS),
    "beams of the plane, by threads": (by_threads, scans_of_ranges(2), BEAM, OF_BEAMS),
    "beams of space": (filtered, scans_of_ranges(3), BEAM_OF_SPACE, OF_SPACE),
    "beams of space, by threads": (by_threads, scans_of_ranges(3), BEAM_OF_SPACE, OF_SPACE),
    "cones of the plane": (filtered, scans_of_ranges(2), CONE, OF_BEAMS),
    "cones of space": (filtered, scans_of_ranges(3), CONE_OF_SPACE, OF_SPACE),
    "grids": (filtered, grids(), OverheadSensor(), OF_SCANS),
    "images by rays": (filtered, images(), BEAM_OF_IMAGES, OF_IMAGES),
    "images by projection": (projected, images(), BEAM_OF_IMAGES, OF_IMAGES),
    "full map of beams": (full, scans_of_ranges(2), BEAM, OF_BEAMS),
    "full map of cones": (full, scans_of_ranges(2), CONE, OF_CONES_IN_A_FULL_MAP),
    "full map of space": (
        full, scans_of_ranges(3), CONE, OF_CONES_IN_A_FULL_MAP
    ),
    "online map of beams": (online, scans_of_ranges(2), BEAM, OF_BEAMS),
    "online map of cones": (online, scans_of_ranges(2), CONE, OF_CONES_IN_A_FULL_MAP),
    "reflection map": (reflected, scans_of_ranges(2), CONE, OF_CONES_IN_A_FULL_MAP),
    "scores": (scored, scans_of_ranges(2), BEAM, OF_BEAMS),
}  # fmt: skip


@pytest.mark.parametrize("name", WAYS)
def test_each_reason_is_counted_on_each_way(name: str) -> None:
    way, scans, sensor, want = WAYS[name]
    assert dict(way(scans, sensor)) == want


# ---- evidence that fades ---------------------------------------------------------------------

T_REF = 10**11


def of_age(scan: Any, age_s: float) -> Any:
    return dataclasses.replace(scan, stamp_ns=T_REF - round(age_s * 1e9))


def empty_map(scan: Any, sensor: Any, **settings: Any) -> EvidenceMap:
    ndim = 2 if isinstance(scan.map_from_sensor, Pose2) else 3
    return EvidenceMap(RESOLUTION, sensor=sensor, ndim=ndim, **settings)


SHARED = BeamSensor(hit_width=2.0, share_hit=True)
# A detector that is all but undecided: a hundredth of a vote in each cell.
UNDECIDED = GridScan(Pose2(0.3, 0.3, 0.0), np.full((2, 2), 0.505), 0.5, (0.0, 0.0))
FADING: dict[str, tuple[Any, Any, bool]] = {
    "beams of the plane": (readings(2, [RETURN]), SHARED, False),
    "beams of space": (readings(3, [RETURN]), SHARED, False),
    "cones of the plane": (readings(2, [RETURN]), ConeSensor(cone_deg=60.0), False),
    "cones of space": (readings(3, [RETURN]), ConeSensor(cone_deg=60.0), False),
    "grids": (UNDECIDED, OverheadSensor(), False),
    "lengths in the plane": (readings(2, [RETURN]), BeamSensor(), True),
    "lengths in space": (readings(3, [RETURN]), BeamSensor(), True),
}


@pytest.mark.parametrize("name", FADING)
def test_what_is_forgotten_is_counted_on_each_way(name: str) -> None:
    """After 16 half-lives a vote is 1/65536, and less than half a vote is nothing."""
    scan, sensor, lengths = FADING[name]
    kept = {"votes": "beam", "path_lengths": True} if lengths else {}
    whole = empty_map(scan, sensor, **kept)
    add_scans(whole, [scan])
    votes = np.concatenate(whole.cells()[1:])
    small = {"vote.underflow": int(np.count_nonzero((votes > 0) & (votes < ONE // 2)))}
    if lengths:
        ways = whole.cell_lengths()[1]
        small["length.underflow"] = int(np.count_nonzero((ways > 0) & (ways < ONE // 2)))
    want = +Counter(small)
    assert len(want) == 1, "the example shows nothing"
    fading = empty_map(scan, sensor, half_life=1.0, t_ref_ns=T_REF, **kept)
    scans = [of_age(scan, age) for age in (16.0, 0.0, 17.1, 18.0, 30.0)]
    report = add_scans(fading, scans)
    assert report.skipped == want + Counter({"scan.forgotten": 3})
    assert report.scans == 2
    # Made for a later time it loses what has less than half a vote in all.
    later = fading.rescaled(T_REF + 16 * 10**9).provenance[-1]
    older = np.concatenate(fading.cells()[1:])
    assert later["vote.underflow"] == np.count_nonzero((older > 0) & (older < ONE // 2))
    if lengths:
        ways = fading.cell_lengths()[1]
        assert later["length.underflow"] == np.count_nonzero((ways > 0) & (ways < ONE // 2))


# ---- the list of docs/conventions.md ---------------------------------------------------------

REASON = re.compile(r"(container|line|scan|beam|hit|vote|length|observation)\.[a-z_]+")


def of_the_list() -> set[str]:
    page = Path(__file__).resolve().parents[1] / "docs" / "conventions.md"
    section = page.read_text(encoding="utf-8").split("## Skip reasons")[1].split("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {reason for row in rows for reason in re.findall(r"`([^`]+)`", row)}


def of_the_source() -> set[str]:
    """Every string of the source that is a reason, messages and docstrings left aside."""
    texts = {
        node.value
        for file in Path(oddsmap.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    return {text for text in texts if REASON.fullmatch(text)}


def test_the_list_of_reasons_is_that_of_the_source() -> None:
    listed = of_the_list()
    assert all(REASON.fullmatch(reason) for reason in listed)
    assert len(listed) > 20
    assert of_the_source() == listed
