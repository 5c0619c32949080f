# SPDX-License-Identifier: Apache-2.0
"""Groups of shards, added up by their owners and written; the map's zarr.json comes last."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

from oddsmap.evidence.evidence import Evidence
from oddsmap.evidence.store import attributes_of, extent_of
from oddsmap.evidence.stored_tiles import Form, stored_tiles
from oddsmap.evidence.tiles import NOTHING, Census
from oddsmap.map_files.zarr_folder import SHARD
from oddsmap.scale.chunk_task import PartRef
from oddsmap.scale.cluster import Cluster
from oddsmap.scale.cluster_output import ClusterOutput
from oddsmap.scale.group_tasks import FAN_IN, Given, add_group, weights_of, write_group
from oddsmap.scale.shard_records import Index
from oddsmap.scale.stored_forms import form_of, undecided

__all__ = ["write_on_cluster"]

T = TypeVar("T")


def write_on_cluster(
    cluster: Cluster,
    output: ClusterOutput,
    groups: Mapping[Index, Sequence[PartRef]],
    empty: Evidence,
    cells: Census,
) -> Census:
    """Add up all groups, and write the map.

    Args:
        cluster: whose workers do it.
        output: where the map goes.
        groups: what chunks have found.
        empty: a map of the configuration, with its provenance.
        cells: bounds of all.

    Returns:
        What is in the map.
    """
    d = empty.ndim
    # What is still to be added up, and by which tasks: many parts go through others.
    given = {group: _sums_of(cluster, output, group, parts, d) for group, parts in groups.items()}
    forms = _forms(cluster, output, groups, given, empty)
    lo, hi, first, shape = extent_of([cells], d)
    with output.new_map(shape) as folder:
        for stored in stored_tiles(empty):
            stored.create(folder, forms[stored.names[0]])
        tasks = [
            cluster.submit(
                f"write-{output.parts}-{_words(group)}", write_group, output.place, *of_group,
                forms, (first // SHARD[d]).tolist(), output.folder, output.parts,
            )
            for group, of_group in given.items()
        ]  # fmt: skip
        written: dict[str, dict[Index, int]] = {name: {} for name in forms}
        votes = NOTHING
        for _, group in cluster.results(tasks):
            votes = votes.joined(group.votes)
            for name, at, checksum in group.files:
                written[name][at] = checksum
        folder.seal(attributes_of(empty, first, lo, hi), written)
    return votes


def _forms(
    cluster: Cluster,
    output: ClusterOutput,
    groups: Mapping[Index, Sequence[PartRef]],
    given: dict[Index, tuple[Given, list[Any]]],
    empty: Evidence,
) -> dict[str, Form]:
    """The form of each array of the map; groups that have to be added up for it then are."""
    d = empty.ndim
    votes = {group: [part.votes for part in parts] for group, parts in groups.items()}
    lengths = {group: [part.lengths for part in parts] for group, parts in groups.items()}
    first = sorted(undecided(votes) | undecided(lengths))
    for group in first:
        name = f"sum-{output.parts}-{_words(group)}"
        summed = cluster.submit(name, add_group, output.place, *given[group])
        given[group] = Given((), d), [summed]
    tasks = [
        cluster.submit(f"weights-{output.parts}-{_words(group)}", weights_of, given[group][1][0])
        for group in first
    ]
    for number, (of_votes, of_lengths) in cluster.results(tasks):
        votes[first[number]], lengths[first[number]] = [of_votes], [of_lengths]
    return {
        name: form_of(each for of_group in weights.values() for each in of_group)
        for stored, weights in zip(stored_tiles(empty), (votes, lengths), strict=False)
        for name in stored.names
    }


def _sums_of(
    cluster: Cluster, output: ClusterOutput, group: Index, parts: Sequence[PartRef], d: int
) -> tuple[Given, list[Any]]:
    """What is to be added up at once: parts, or, of many, what tasks make of some of them."""
    if len(parts) <= FAN_IN:
        return Given(parts, d), []
    name, height = f"sum-{output.parts}-{_words(group)}", 0
    level = [
        cluster.submit(f"{name}-0-{i}", add_group, output.place, Given(run, d), [])
        for i, run in enumerate(_runs(parts))
    ]
    while len(level) > FAN_IN:
        height += 1
        level = [
            cluster.submit(f"{name}-{height}-{i}", add_group, output.place, Given((), d), run)
            for i, run in enumerate(_runs(level))
        ]
    return Given((), d), level


def _runs(each: Sequence[T]) -> Iterator[Sequence[T]]:
    for begin in range(0, len(each), FAN_IN):
        yield each[begin : begin + FAN_IN]


def _words(group: Index) -> str:
    return ",".join(map(str, group))
