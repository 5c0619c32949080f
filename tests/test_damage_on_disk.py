# SPDX-License-Identifier: Apache-2.0
"""A bit that has flipped on the disk never makes another map."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import OddsmapError
from tests.saved_maps_kit import KINDS


def outcomes(kind: str, path: Path, tries: int, seed: int) -> Counter[str]:
    """Flip one bit after the other, of any file of a map, each file as likely as its bytes."""
    make, load, content = KINDS[kind]
    grid = make(1)
    grid.save(path)
    expected = content(load(path))
    assert expected == content(grid)
    files = [file for file in sorted(path.rglob("*")) if file.is_file()]
    # Half of the flips in what the map says of itself: those are few bytes.
    texts = [file for file in files if file.suffix == ".json"]
    shards = [file for file in files if file.suffix != ".json"]
    rng, found = np.random.default_rng(seed), Counter[str]()
    for i in range(tries):
        group = texts if i % 2 else shards
        sizes = np.array([each.stat().st_size for each in group])
        file = group[int(rng.choice(len(group), p=sizes / sizes.sum()))]
        whole = file.read_bytes()
        at, bit = int(rng.integers(len(whole))), int(rng.integers(8))
        file.write_bytes(whole[:at] + bytes([whole[at] ^ (1 << bit)]) + whole[at + 1 :])
        try:
            again = content(load(path))
        except OddsmapError as error:
            found["pages" if "\n" in str(error) else "refused"] += 1
        else:
            found["same" if again == expected else "another"] += 1
        file.write_bytes(whole)
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_no_flipped_bit_makes_another_map(kind: str, tmp_path: Path) -> None:
    found = outcomes(kind, tmp_path / "a.zarr", 60, seed=1)
    assert found["another"] == found["pages"] == 0
    assert found["refused"] > 30  # the centres of cells are there for others, and not read


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_bit_of_many(kind: str, tmp_path: Path) -> None:
    found = outcomes(kind, tmp_path / "a.zarr", 1000, seed=2)
    print(kind, dict(found))  # noqa: T201
    assert found["another"] == found["pages"] == 0
