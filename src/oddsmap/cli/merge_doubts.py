# SPDX-License-Identifier: Apache-2.0
"""What is doubtful about two maps together, although they add up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.evidence.evidence import Evidence
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.scans.note import Note

__all__ = ["doubts_of_difference", "doubts_of_sum", "frames_differ", "votes_differ"]


def doubts_of_sum(total: EvidenceMap, more: EvidenceMap) -> Iterator[Note]:
    """What to know before trusting the sum of two maps.

    Args:
        total: the first map, whose settings stand.
        more: the one that is added.
    """
    from oddsmap.scans.note import Note

    known = {log for entry in total.provenance if (log := _log_of(entry))}
    twice = sorted({log[0] for entry in more.provenance if (log := _log_of(entry)) in known})
    if twice:
        yield Note(
            f"{', '.join(twice)} is in what it is added to as well, by name and number of scans: "
            "its evidence now counts twice",
            code="merge.same_log", severity="warning",
        )  # fmt: skip
    if said := votes_differ(total, more):
        yield Note(said, code="merge.resampled", severity="warning")
    if said := frames_differ(total, more):
        yield Note(said, code="merge.rotated", severity="warning")
    changes = [
        f"{section}.{name} is {_word(theirs)}, and {_word(own[name])} in the first map"
        for section, own, other in zip(
            ("sensor", "posterior"), _settings(total), _settings(more), strict=True
        )
        for name, theirs in other.items()
        if name in own and own[name] != theirs
    ]
    if changes:
        yield Note("; ".join(changes) + ", whose settings stand", code="merge.settings")


def doubts_of_difference(total: EvidenceMap, less: EvidenceMap) -> Iterator[Note]:
    """What to know before trusting a difference of two maps."""
    from oddsmap.scans.note import Note

    own = list(total.provenance)
    for entry in less.provenance:
        if entry in own:
            own.remove(entry)
            continue
        log = entry.get("source") or "evidence without a log"
        yield Note(
            f"{log} is not among what the first map was made from: what is taken out may be the "
            "evidence of others",
            code="subtract.other_log", severity="warning",
        )  # fmt: skip
        return


def votes_differ(one: Evidence, other: Evidence) -> str | None:
    """What to say where a cell of one map has more votes than one of the other by its making."""
    made = [_resampled_from(grid) for grid in (one, other)]
    if made[0] == made[1]:
        return None
    own, theirs = (
        f"resampled from {', '.join(f'{side:g}' for side in sides)} m" if sides else "not resampled"
        for sides in made
    )
    return (
        f"it is {theirs}, the first map {own}: a larger cell has the votes of all that lie in it, "
        "so the two weigh readings differently"
    )


def frames_differ(one: Evidence, other: Evidence) -> str | None:
    """What to say where one log was mapped twice, and one of the two maps was turned since."""
    own, theirs = _turns(one), _turns(other)
    logs = [{log for entry in grid.provenance if (log := _log_of(entry))} for grid in (one, other)]
    if bool(own) == bool(theirs) or not logs[0] & logs[1]:
        return None
    which = "it is" if theirs else "the first map is"
    return (
        f"{which} turned ({', then '.join(own or theirs)}), and both are of one log: they are not "
        "of one frame"
    )


def _turns(grid: Evidence) -> list[str]:
    """How a map was turned; empty where it was turned back since."""
    from oddsmap.evidence.frames import axes_of

    found = [str(entry["rotated"]) for entry in grid.provenance if "rotated" in entry]
    upright = [(axis, False) for axis in range(grid.ndim)]
    axes = upright
    for stated in found:
        source, is_reversed, _ = axes_of(stated, grid.ndim)
        axes = [
            (axes[old][0], axes[old][1] != flipped)
            for old, flipped in zip(source, is_reversed, strict=True)
        ]
    return [] if axes == upright else found


def _resampled_from(grid: Evidence) -> list[float]:
    found = {entry["resampled_from"] for entry in grid.provenance if "resampled_from" in entry}
    return sorted(found)


def _log_of(entry: dict[str, Any]) -> tuple[str, Any] | None:
    source = entry.get("source")
    return (str(source), entry.get("scans")) if source else None


def _settings(grid: EvidenceMap) -> tuple[dict[str, Any], dict[str, Any]]:
    config = grid.config.to_dict()
    return config["sensor"], config["posterior"]


def _word(value: object) -> str:
    return "not set" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
