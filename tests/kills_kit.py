# SPDX-License-Identifier: Apache-2.0
"""Processes that are killed while they replace an output, and what they leave."""

from __future__ import annotations

import multiprocessing
import signal
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from oddsmap.atomic_write import check_output
from oddsmap.errors import RecoveryWarning

if "fork" not in multiprocessing.get_all_start_methods():
    pytest.skip("needs children that can be killed", allow_module_level=True)

FORK: Any = multiprocessing.get_context("fork")
Content = Callable[[Path], Any]


def left_by(number: int, path: Path, content: Content, sides: Sequence[Any]) -> int:
    """Check what a killed run left, and that the next one clears it; which side it is of."""
    parent = path.parent
    hidden = [each.name for each in parent.iterdir() if each.name.startswith(".")]
    if number != signal.SIGKILL:
        assert hidden == []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecoveryWarning)
        check_output(parent / "another.txt")
    assert [each.name for each in parent.iterdir() if each.name.startswith(".")] == []
    found = content(path)
    assert found in sides
    return sides.index(found)


def copied(old: dict[Path, bytes]) -> Callable[[], None]:
    def restore() -> None:
        for path, content in old.items():
            path.write_bytes(content)

    return restore
