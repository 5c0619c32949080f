# SPDX-License-Identifier: Apache-2.0
"""Landmark maps on disk: all that is stored comes back, and one can go on from there."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.landmarks import LandmarkMap
from oddsmap.poses.pose import Pose2
from tests.landmarks.kit import cluttered_drive, drive, observe, world


def a_map(**options: float) -> LandmarkMap:
    """Ranges, bearings and positions, landmarks not located yet among them."""
    rng = np.random.default_rng(0)
    marks = rng.uniform(-10.0, 10.0, (6, 2))
    landmarks = LandmarkMap(**options)  # type: ignore[arg-type]
    for kind in ("range-bearing", "position", "bearing"):
        for scan in drive(kind, marks, rng, scans=3):
            landmarks.add(scan)
    landmarks.add(observe("bearing", Pose2(0.0, 0.0, 0.0), marks[:1], rng, [77]))
    landmarks.add(observe("bearing", Pose2(0.0, 0.0, 0.0), marks[:1] * np.nan, rng, [5]))
    return landmarks


def test_save_and_load_is_identity(tmp_path: Path) -> None:
    landmarks = a_map(gate=0.9, min_count=2, depth_ratio_max=0.15)
    landmarks.save(tmp_path / "a.json")
    again = LandmarkMap.load(tmp_path / "a.json")
    again.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert again.unlocated == 1
    assert again.skipped == {"observation.nan": 1}
    for one, other in zip(landmarks.landmarks, again.landmarks, strict=True):
        assert (one.id, one.count) == (other.id, other.count)
        assert np.array_equal(one.mean, other.mean)
        assert np.array_equal(one.covariance, other.covariance)
    for option in ("gate", "new_gate", "min_count", "depth_ratio_max", "ndim", "known_ids"):
        assert getattr(again, option) == getattr(landmarks, option)


def test_going_on_after_loading_changes_no_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    marks = world(rng, count=10, apart=3.0)
    scans = list(cluttered_drive("range-bearing", marks, rng, scans=20, clutter=2.0))
    straight, halted = LandmarkMap(), LandmarkMap()
    for scan in scans:
        straight.add(scan)
    for scan in scans[:10]:
        halted.add(scan)
    halted.save(tmp_path / "half.json")
    halted = LandmarkMap.load(tmp_path / "half.json")
    for scan in scans[10:]:
        halted.add(scan)
    straight.save(tmp_path / "straight.json")
    halted.save(tmp_path / "halted.json")
    straight_bytes = (tmp_path / "straight.json").read_bytes()
    assert straight_bytes == (tmp_path / "halted.json").read_bytes()


def test_table(tmp_path: Path) -> None:
    landmarks = a_map()
    with landmarks.save(tmp_path / "a.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["id"]) for row in rows] == [0, 1, 2, 3, 4, 5]
    for row, mark in zip(rows, landmarks.landmarks, strict=True):
        assert [float(row["x"]), float(row["y"])] == mark.mean.tolist()
        spread = [float(row[f"cov_{pair}"]) for pair in ("xx", "xy", "yy")]
        assert spread == mark.covariance[[0, 0, 1], [0, 1, 1]].tolist()
        assert int(row["count"]) == mark.count == 9


def test_names_and_files_in_the_way(tmp_path: Path) -> None:
    landmarks = a_map()
    with pytest.raises(ConfigError, match=r"\.json \(all\) or \.csv"):
        landmarks.save(tmp_path / "a.txt")
    path = landmarks.save(tmp_path / "a.json")
    before = path.read_bytes()
    landmarks.add(
        observe("bearing", Pose2(0, 0, 0), np.ones((1, 2)), np.random.default_rng(0), [9])
    )
    with pytest.raises(OutputError, match="exists already"):
        landmarks.save(path)
    assert path.read_bytes() == before
    landmarks.save(path, force=True)
    assert path.read_bytes() != before


def test_damaged_files(tmp_path: Path) -> None:
    path = a_map().save(tmp_path / "a.json")
    fine = json.loads(path.read_text(encoding="utf-8")) | {"digest": None}  # edited on purpose

    def refused(content: object) -> str:
        path.write_text(json.dumps(content), encoding="utf-8")
        with pytest.raises(InputError) as caught:
            LandmarkMap.load(path)
        message = str(caught.value)
        assert message.startswith(f"{path}: ")
        assert "\n" not in message
        return message

    others: list[object] = [[], 3, None, {}, {"format": "else"}]
    for foreign in others:
        assert "not a landmark map" in refused(foreign)
    assert "version 2" in refused(fine | {"version": 2})
    assert "gate" in refused(fine | {"options": fine["options"] | {"gate": 7}})
    assert "damaged" in refused(fine | {"options": {}})
    assert "damaged" in refused({k: v for k, v in fine.items() if k != "landmarks"})
    for key, value in (("polar", [[1.0, 2.0]]), ("anchor", [1.0]), ("vector", [float("nan"), 0.0])):
        first = fine["landmarks"][0]
        track = first["track"] | {key: value}
        assert "damaged" in refused(fine | {"landmarks": [first | {"track": track}]})
    path.write_bytes(b"id,x,y\n")
    with pytest.raises(InputError, match="not a landmark map"):
        LandmarkMap.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.update(known_ids=2), "known_ids is true, false or null, got 2"),
        (lambda content: content["landmarks"][0].update(id=1.5), "1.5 is no count and no id"),
        (lambda content: content["landmarks"][0].update(count=2.5), "2.5 is no count and no id"),
        (lambda content: content["landmarks"][0].update(count=True), "True is no count and no id"),
        (lambda content: content["landmarks"][0].update(count=-1), "-1 is no count and no id"),
        (lambda content: content["landmarks"][0].update(count=float("inf")), "inf is no count"),
        (lambda content: content["landmarks"][0]["track"].update(anchor=[10**400, 0]), "Overflow"),
        (lambda content: content["landmarks"].append(content["landmarks"][0]), "0 is there twice"),
        (lambda content: content.update(skipped=[]), "AttributeError"),
        (lambda content: content.update(options=10**3000), "TypeError"),
    ],
)
def test_a_value_that_cannot_be(
    change: Callable[[dict[str, Any]], None], message: str, tmp_path: Path
) -> None:
    path = a_map().save(tmp_path / "a.json")
    content = json.loads(path.read_text())
    del content["digest"]  # what is checked behind it
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as caught:
        LandmarkMap.load(path)
    assert f"{path}: a damaged landmark map (" in str(caught.value)
    assert message in str(caught.value)


def test_a_flipped_bit_makes_no_other_map(tmp_path: Path) -> None:
    path = a_map().save(tmp_path / "a.json")
    whole, expected = path.read_bytes(), LandmarkMap.load(path).to_dict()
    rng, refused = np.random.default_rng(0), 0
    for _ in range(200):
        at, bit = int(rng.integers(len(whole))), int(rng.integers(8))
        path.write_bytes(whole[:at] + bytes([whole[at] ^ (1 << bit)]) + whole[at + 1 :])
        try:
            assert LandmarkMap.load(path).to_dict() == expected
        except InputError:
            refused += 1
    assert refused > 150
    older = json.loads(whole)
    del older["digest"]
    path.write_text(json.dumps(older))
    assert LandmarkMap.load(path).to_dict() == expected
