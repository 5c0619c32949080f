# SPDX-License-Identifier: Apache-2.0
"""One case: mutate, read, and say what came of it."""

from __future__ import annotations

import random
import traceback
import warnings
from pathlib import Path
from typing import NamedTuple

from oddsmap.errors import OddsmapError
from tests.fuzz.answers import Answer
from tests.fuzz.mutant import Files, Mutant
from tests.fuzz.readers import Reader

__all__ = ["BAD", "KINDS", "Outcome", "judge", "mutant_of"]

KINDS = (
    "ok-same", "ok-legal", "refused", "silent", "traceback", "long-message", "hang", "memory",
    "crash",
)  # fmt: skip
BAD = KINDS[3:]

_LONGEST = 420  # characters of a message: a handful of lines on a screen


class Outcome(NamedTuple):
    kind: str
    what: str
    """The mutation, and what was said."""


def mutant_of(reader: Reader, sample: Files, seed: int, number: int) -> Mutant:
    """The input of a case: the same on each machine."""
    rng = random.Random(f"{reader.name} {seed} {number}")  # noqa: S311 - no secret
    return rng.choice(reader.mutators)(rng, sample)


def judge(reader: Reader, mutant: Mutant, good: Answer, folder: Path) -> Outcome:
    """Read a mutant and compare with the answer of the sample.

    Args:
        reader: what reads it.
        mutant: the input.
        good: the answer of the sample.
        folder: an empty folder, the working directory.
    """
    for name, content in mutant.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            answer = reader.read(Path(reader.path))
    except OddsmapError as error:
        kind = "refused" if _is_line(str(error)) else "long-message"
        return Outcome(kind, f"{mutant.what}: {str(error)[:600]}")
    except MemoryError as error:
        return Outcome("memory", f"{mutant.what}: {error} {_place(error)}")
    except Exception as error:
        text = f"{type(error).__name__}: {str(error)[:200]} {_place(error)}"
        return Outcome("traceback", f"{mutant.what}: {text}")
    for said in answer.said:
        if not _is_line(said):
            return Outcome("long-message", f"{mutant.what}: {said[:600]}")
    if answer.digest == good.digest:
        return Outcome("ok-same", mutant.what)
    if mutant.expected == "any" or set(answer.said) - set(good.said):
        return Outcome("ok-legal", mutant.what)
    return Outcome("silent", mutant.what)


def _is_line(text: str) -> bool:
    return text.isprintable() and 0 < len(text) <= _LONGEST


def _place(error: BaseException) -> str:
    """The last line of ours, and where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/oddsmap/" in f.filename.replace("\\", "/")]
    return " from ".join(f"{Path(f.filename).name}:{f.lineno}" for f in (*ours[-1:], *frames[-1:]))
