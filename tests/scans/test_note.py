# SPDX-License-Identifier: Apache-2.0
"""Notes are strings that programs can tell apart."""

from __future__ import annotations

import copy
import json
import pickle

from oddsmap.scans.note import Note


def test_a_note_is_its_text() -> None:
    note = Note("the scans have no stamps", code="pose.by_order", severity="warning")
    assert note == "the scans have no stamps"
    assert f"a.log: {note}" == "a.log: the scans have no stamps"
    assert json.dumps([note]) == '["the scans have no stamps"]'
    assert Note("x", code="y").severity == "info"


def test_copies_keep_code_and_severity() -> None:
    note = Note("text", code="a.b", severity="warning")
    for other in (pickle.loads(pickle.dumps(note)), copy.copy(note), copy.deepcopy(note)):
        assert (str(other), other.code, other.severity) == ("text", "a.b", "warning")


def test_a_note_is_one_line() -> None:
    note = Note("FLASER with " + "1, " * 5000 + "2 beams\x1b[31m\nnext", code="a.b")
    assert note.isprintable()
    assert len(note) < 420
    assert note.startswith("FLASER with 1, 1")
    assert note.endswith("2 beams\\x1b[31m next")
