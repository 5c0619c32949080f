# SPDX-License-Identifier: Apache-2.0
"""Parts of maps, packed and added up, against sums of whole numbers cell by cell."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap import EvidenceMap, MapTooLargeError
from oddsmap.evidence.stored_tiles import VOTES, Form
from oddsmap.scale.chunk_task import PartRef, Weights
from oddsmap.scale.group_tasks import Given, add_group
from oddsmap.scale.map_places import LocalPlace, UrlPlace
from oddsmap.scale.shard_records import (
    GROUP,
    PackedGroup,
    PackedShard,
    packed_group,
    packed_groups,
    split,
    totals_of,
)
from oddsmap.scale.shard_sums import add_shards, in_form
from oddsmap.scale.stored_forms import form_of, undecided
from oddsmap.scale.worker_versions import versions_here
from tests.kit import ONE, Votes, add_votes

SMALL = st.one_of(
    st.integers(0, 3).map(lambda n: n * ONE),
    st.integers(0, 300).map(lambda n: n * ONE),
    st.integers(0, 1 << 20),
)


def indices(d: int) -> st.SearchStrategy[tuple[int, ...]]:
    near = st.integers(-3, 3)
    return st.tuples(*[st.one_of(near, st.integers(-3000, 3000))] * d)


def cells(d: int) -> st.SearchStrategy[Votes]:
    weights = st.tuples(SMALL, SMALL).filter(any)
    return st.dictionaries(indices(d), weights, max_size=6)


def evidence_of(votes: Votes, d: int) -> EvidenceMap:
    evidence = EvidenceMap(1.0, ndim=d)
    if votes:
        add_votes(evidence, votes)
    return evidence


@given(st.sampled_from((2, 3)).flatmap(lambda d: st.tuples(st.just(d), st.lists(cells(d)))))
@settings(max_examples=20)
def test_parts_add_up_as_cells_do(drawn: tuple[int, list[Votes]]) -> None:
    d, parts = drawn
    total: Votes = {}
    for votes in parts:
        for cell, (hits, passes) in votes.items():
            before = total.get(cell, (0, 0))
            total[cell] = before[0] + hits, before[1] + passes
    whole = evidence_of(total, d)
    groups = [packed_groups(evidence_of(votes, d)) for votes in parts]
    for group in {name for each in groups for name in each}:
        sums = add_shards([split(each[group].content) for each in groups if group in each], d)
        edge = GROUP[d] * (1024 if d == 2 else 128)
        inside = {c: v for c, v in total.items() if tuple(i // edge for i in c) == group}
        own = evidence_of(inside, d)
        census = own.census()
        in_votes, in_lengths = totals_of(sums)
        assert in_votes._replace(bounds=None) == census._replace(bounds=None)
        assert np.array_equal(np.array(in_votes.bounds), np.array(census.bounds))
        assert in_lengths.bounds is None
        # What is packed of the sum is what is packed of the map.
        packed = split(packed_groups(own)[group].content)
        assert stored(sums, d) == stored(packed, d)
        # Adding up as the map is stored is adding up, and storing.
        how = {name: form_of([Weights.of(census)]) for name in VOTES}
        given = [split(each[group].content) for each in groups if group in each]
        assert [shard.arrays for shard in add_shards(given, d, how)] == [
            {name: in_form(array, how[name], d) for name, array in shard.arrays.items()}
            for shard in sums
        ]
    assert {name for each in groups for name in each} == set(packed_groups(whole))


def stored(shards: list[PackedShard], d: int) -> dict[tuple[object, str], bytes]:
    return {
        (shard.place, name): in_form(array, Form(1, np.dtype("uint64")), d).content
        for shard in shards
        for name, array in shard.arrays.items()
    }


def test_many_parts_in_any_order_and_by_way_of_sums(tmp_path: Path) -> None:
    place, versions = LocalPlace(str(tmp_path), "writing"), versions_here()
    rng = np.random.default_rng(0)
    whole, refs = EvidenceMap(1.0, ndim=3), []
    for number in range(9):
        part = EvidenceMap(1.0, ndim=3)
        index = rng.integers(0, 200, (50, 3))
        part.add_cells(index, np.full(50, ONE), np.full(50, 40 * ONE))
        whole.merge(part)
        (group,) = packed_groups(part).values()
        place.put(f"parts/{number}", group.content)
        refs.append(part_ref(f"parts/{number}", group))
    at_once = add_group(versions, place, Given(refs, 3), ())
    halves = [add_group(versions, place, Given(some, 3), ()) for some in (refs[4:], refs[3::-1])]
    by_halves = add_group(versions, place, Given((), 3), halves)
    assert isinstance(at_once, PackedGroup)
    assert isinstance(by_halves, PackedGroup)
    assert at_once.content == by_halves.content
    assert at_once.votes.largest == whole.census().largest
    (group,) = packed_groups(whole).values()
    assert stored(split(at_once.content), 3) == stored(split(group.content), 3)


def part_ref(name: str, group: PackedGroup) -> PartRef:
    return PartRef(name, 0, len(group.content), Weights.of(group.votes), Weights.of(group.lengths))


def weights(*each: float) -> list[Weights]:
    return [Weights(int(votes * ONE), votes % 1 == 0) for votes in each]


def test_which_groups_decide_about_the_type() -> None:
    # Nothing is near what a byte holds.
    assert undecided({(0,): weights(3, 4), (1,): weights(9)}) == set()
    # Two parts of one cell may add up to more than a byte holds, three of another do not.
    groups: dict[tuple[int, ...], list[Weights]] = {
        (0,): weights(200, 100),
        (1,): weights(9),
        (2,): weights(80, 80, 80),
    }
    assert undecided(groups) == {(0,)}
    # A part that needs two bytes has decided.
    assert undecided(groups | {(1,): weights(256)}) == set()
    # Parts of votes: there are some for certain, or they might add up to whole ones.
    assert undecided({(0,): weights(1.5), (1,): weights(2, 3)}) == set()
    assert undecided({(0,): weights(1.5, 2.5), (1,): weights(2, 3)}) == {(0,), (1,)}
    assert undecided({(0,): weights(0.5), (1,): weights(40000, 40000)}) == {(1,)}
    assert form_of(weights(3, 255)) == Form(ONE, np.dtype("uint8"))
    assert form_of(weights(3, 256)) == Form(ONE, np.dtype("uint16"))
    assert form_of(weights(0.5, 3)) == Form(1, np.dtype("uint32"))
    assert form_of([]) == Form(ONE, np.dtype("uint8"))


def test_lengths_go_along() -> None:
    parts = []
    for passes in (3, 5):
        part = EvidenceMap(1.0, votes="beam", path_lengths=True)
        assert part.lengths is not None
        part.add_cells([[0, 0]], [ONE], [0])  # type: ignore[arg-type]
        part.lengths.add_cells(np.array([[1500, 1]]), np.array([[0, passes]]))
        parts.append([shard for g in packed_groups(part).values() for shard in split(g.content)])
    sums = add_shards(parts, 2)
    votes, lengths = totals_of(sums)
    assert (votes.hits, votes.cells, lengths.passes) == (2 * ONE, 1, 8)
    assert lengths.bounds is not None
    assert [shard.place for shard in sums] == [(0, 0), (1, 0)]
    assert [set(shard.arrays) for shard in sums] == [{"hits"}, {"lengths"}]


def test_too_many_votes() -> None:
    heavy = EvidenceMap(1.0)
    heavy.add_cells([[0, 0]], [1 << 62], [0])  # type: ignore[arg-type]
    ((content, *_),) = packed_groups(heavy).values()
    for count in (2, 9):
        with pytest.raises(MapTooLargeError, match=r"pass 2\^46 votes"):
            add_shards([split(content)] * count, 2)


@pytest.mark.parametrize("cut", [3, 20, -1])
def test_a_damaged_part(cut: int) -> None:
    ((content, *_),) = packed_groups(evidence_of({(0, 0): (ONE, 0)}, 2)).values()
    with pytest.raises(ValueError, match="a part of a map"):
        split(content[:cut])
    assert packed_group(split(content)).content == content
    at = content.index(b'"uint8"')
    for changed in (content[:at] + b'"uint9"' + content[at + 7 :], b"\0" + content[1:]):
        with pytest.raises(ValueError, match="a part of a map is damaged"):
            split(changed)


def test_a_place_writes_whole_contents_and_none_after_its_end() -> None:
    with TemporaryDirectory() as folder:
        place = LocalPlace(folder, "writing")
        place.put("a/b", b"12345")
        place.put("a/b", b"12345")
        assert place.get("a/b", 1, 3) == b"234"
        with pytest.raises(OSError, match="3 bytes where 9 were written"):
            place.get("a/b", 2, 9)
        place.remove("a")
        with pytest.raises(OSError):
            place.get("a/b", 0, 1)
    with pytest.raises(OSError):
        place.put("a/b", b"late")
    assert not Path(folder).exists()


def test_a_place_at_a_url() -> None:
    pytest.importorskip("fsspec")
    place = UrlPlace("memory://places")
    place.put_all({"a/b": b"12345", "a/c": b"678"})
    place.put_all({})
    assert place.get_all([("a/b", 1, 3), ("a/c", 0, 2)]) == [b"234", b"67"]
    assert place.get_all([]) == []
    with pytest.raises(OSError, match="3 bytes where 9 were written"):
        place.get_all([("a/c", 0, 2), ("a/b", 2, 9)])
    with pytest.raises(OSError):
        place.get_all([("a/b", 0, 1), ("a/d", 0, 1)])
    place.remove("a")
    with pytest.raises(OSError):
        place.get("a/b", 0, 1)
