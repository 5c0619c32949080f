"""Counting rays in 16 bits gives what the oracle says, past every limit of a count."""

from __future__ import annotations

import numpy as np
import pytest

import oddsmap.integrate.rays3d
from oddsmap import EvidenceMap, Pose3, Scan, add_scans
from tests.kit import Votes, votes_of
from tests.kit3d import add_rays, exact_votes
from tests.naive.mapping3d import Beam

ORIGIN = (0.25, 0.5, 0.125)
FAN: list[Beam] = [((9.5, y + 0.25, 3.5), (9.5, y + 0.25, 3.5), y % 3 > 0) for y in range(-4, 5)]


def times(votes: Votes, count: int) -> Votes:
    return {cell: (count * hit, count * free) for cell, (hit, free) in votes.items()}


@pytest.mark.parametrize("count", [1, 27, 28, 29, 100])
def test_one_scan_of_more_rays_through_a_cell_than_a_byte_counts(count: int) -> None:
    evidence = EvidenceMap(1.0, ndim=3, votes="beam")
    add_rays(evidence, ORIGIN, FAN * count)
    assert votes_of(evidence) == times(exact_votes(ORIGIN, FAN, "beam"), count)


def test_many_scans_over_one_cell() -> None:
    evidence = EvidenceMap(1.0, ndim=3, votes="beam")
    for _ in range(90):
        add_rays(evidence, ORIGIN, FAN)
    assert votes_of(evidence) == times(exact_votes(ORIGIN, FAN, "beam"), 90)


@pytest.mark.parametrize("more", [-1, 0, 1, 70_000])
def test_as_many_rays_as_a_count_holds_and_more(more: int) -> None:
    one: list[Beam] = [((5.5, 0.5, 0.125), (5.5, 0.5, 0.125), True)]
    count = oddsmap.integrate.rays3d.MOST_BEAMS + more
    evidence = EvidenceMap(1.0, ndim=3, votes="beam")
    add_rays(evidence, ORIGIN, one * count)
    assert votes_of(evidence) == times(exact_votes(ORIGIN, one, "beam"), count)


@pytest.mark.parametrize("most", [1, 4, 7, 9, 100])
def test_into_how_many_parts_a_scan_is_cut_changes_no_bit(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bundles too, as of a sensor that moves while it scans."""
    rng = np.random.default_rng(3)
    ways = rng.normal(size=(30, 3))
    places = np.repeat(rng.normal(size=(5, 3)), [1, 9, 2, 0, 18], axis=0)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    scan = Scan(Pose3(np.zeros(3), np.eye(3)), ways, rng.uniform(1.0, 9.0, 30), beam_origins=places)

    def mapped() -> Votes:
        evidence = EvidenceMap(0.5, ndim=3, votes="beam")
        add_scans(evidence, [scan, scan], threads=1)
        return votes_of(evidence)

    whole = mapped()
    assert len(whole) > 100
    monkeypatch.setattr(oddsmap.integrate.rays3d, "MOST_BEAMS", most)
    assert mapped() == whole
