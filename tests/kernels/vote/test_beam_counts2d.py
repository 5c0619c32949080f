"""Counting beams in 16 bits gives what counting them in 64 gives, past every limit of a count."""

from __future__ import annotations

import pytest

import oddsmap.integrate.rays2d
from oddsmap.evidence_map import EvidenceMap
from oddsmap.kernels.vote.beam_counts2d import MOST_BEAMS
from tests.kit import ONE, Votes, add_beams, votes_of
from tests.naive.columns import passed
from tests.naive.mapping import Beam, map_scan

ORIGIN = (0.25, 0.5)
FAN: list[Beam] = [((9.5, y + 0.25), (9.5, y + 0.25), y % 3 > 0) for y in range(-4, 5)]


def expected(beams: list[Beam], times: int) -> Votes:
    exact = map_scan(ORIGIN, beams, "beam", False, passed)
    return {
        cell: (times * round(hit * ONE), times * round(free * ONE))
        for cell, (hit, free) in exact.items()
    }


@pytest.mark.parametrize("times", [1, 27, 28, 29, 100, 1000])
def test_one_scan_of_more_beams_through_a_cell_than_a_byte_counts(times: int) -> None:
    evidence = EvidenceMap(1.0, votes="beam")
    add_beams(evidence, ORIGIN, FAN * times)
    assert votes_of(evidence) == expected(FAN, times)


def test_many_scans_over_one_cell() -> None:
    evidence = EvidenceMap(1.0, votes="beam")
    for _ in range(90):
        add_beams(evidence, ORIGIN, FAN)
    assert votes_of(evidence) == expected(FAN, 90)


@pytest.mark.parametrize("beams", [MOST_BEAMS - 1, MOST_BEAMS, MOST_BEAMS + 1, MOST_BEAMS + 9])
def test_as_many_beams_as_a_count_holds_and_more(beams: int) -> None:
    """All through the same cells; the first one too many goes the slow way."""
    one: list[Beam] = [((5.5, 0.5), (5.5, 0.5), True)]
    evidence = EvidenceMap(1.0, votes="beam")
    add_beams(evidence, ORIGIN, one * beams)
    assert votes_of(evidence) == expected(one, beams)


def test_every_beam_of_a_scan_is_counted_the_slow_way_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(oddsmap.integrate.rays2d, "MOST_BEAMS", 8)
    evidence = EvidenceMap(1.0, votes="beam")
    add_beams(evidence, ORIGIN, FAN)
    add_beams(evidence, ORIGIN, FAN[:5])
    add_beams(evidence, ORIGIN, FAN[5:])
    assert votes_of(evidence) == expected(FAN, 2)
