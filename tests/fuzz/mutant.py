# SPDX-License-Identifier: Apache-2.0
"""What a mutator makes of a sample, and what may be expected of a reader then."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

__all__ = ["Change", "Expected", "Files", "Mutant", "Mutator", "on_file"]

Files = Mapping[str, bytes]
"""A sample: content by path."""

Expected = Literal["same", "any"]
"""Beside being refused in one line: "same", the same answer, or another with a word about it (a
count or a warning), because no value was changed or a checksum or count is there to notice it;
"any": another value may stand there now, which is as legal as the old one."""


class Mutant(NamedTuple):
    files: Files
    what: str
    expected: Expected


Mutator = Callable[[random.Random, Files], Mutant]
Change = Callable[[random.Random, bytes], tuple[bytes, str]]
"""What a mutator does to the bytes of one file; it says what."""


def on_file(
    name: str,
    change: Change,
    expected: Expected,
) -> Mutator:
    """A mutator of a sample from one of a file's bytes. A name that ends in * takes any such."""

    def mutate(rng: random.Random, files: Files) -> Mutant:
        names = [
            n
            for n in sorted(files)
            if n == name or (name[-1] == "*" and n[: len(name) - 1] == name[:-1])
        ]
        chosen = rng.choice(names)
        content, what = change(rng, files[chosen])
        return Mutant({**files, chosen: content}, f"{chosen}: {what}", expected)

    return mutate
