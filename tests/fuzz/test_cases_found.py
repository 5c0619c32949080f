# SPDX-License-Identifier: Apache-2.0
"""Inputs that once ended in a traceback, a hang, or an answer that was wrong in silence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from oddsmap.errors import OddsmapError
from tests.fuzz import answers
from tests.fuzz.answers import Answer
from tests.fuzz.samples import SCANS

_READ: dict[str, Callable[[Path], Answer]] = {
    "landmark-json": answers.of_landmark_map,
    "landmark": answers.of_landmarks,
    "octomap-bt": answers.of_octomap,
    "octomap-ot": answers.of_octomap,
    "ros": answers.of_ros,
    "toml": lambda path: answers.of_config(path, SCANS),
    "": answers.of_log,
}
# A landmark at 1e9 m among others is a counted skip; the rest is damage that can be seen.
_ANSWERED = {"landmark-csv-a2fbeb", "landmark-npz-a2fbeb"}


@pytest.mark.realdata
def test_an_answer_or_one_line(data_folder: Path) -> None:
    folder = data_folder / "cases" / "fuzz"
    if not folder.is_dir():
        pytest.skip(f"no inputs in {folder}")
    found = {case.name: _outcome(case) for case in sorted(folder.iterdir()) if case.is_dir()}
    assert {case for case, outcome in found.items() if outcome == "answered"} == _ANSWERED
    assert {case: said for case, said in found.items() if said not in ("answered", "line")} == {}


def _outcome(case: Path) -> str:
    inputs = [path for path in sorted(case.iterdir()) if path.name != "why.txt"]
    path = inputs[0] / "m.yaml" if inputs[0].name == "ros" else inputs[0]
    read = next(read for name, read in _READ.items() if case.name.startswith(name))
    try:
        answer = read(path)
    except OddsmapError as error:
        text = str(error).replace(str(path), "")
        return "line" if text.isprintable() and len(text) < 420 else f"pages: {text[:500]}"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:100]}"
    return "answered" if any("out_of_scale" in word for word in answer.said) else "in silence"
