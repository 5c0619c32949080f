# SPDX-License-Identifier: Apache-2.0
"""Lines as wide as the screen, in two columns."""

from __future__ import annotations

import re
import shutil
import textwrap

__all__ = ["fitted", "screen_width"]

_LABEL = re.compile(r"\S+( \S+)*\s{2,}|\s*")


def screen_width() -> int:
    """Columns of the terminal, or what COLUMNS says; 80 where neither is known."""
    return max(shutil.get_terminal_size().columns, 40)


def fitted(line: str, width: int) -> str:
    """A line broken at that width, its further lines below its text.

    Args:
        line: a label, two or more blanks, and text; or either alone.
        width: columns.
    """
    if len(line) <= width:
        return line
    label = _LABEL.match(line)
    start = label.end() if label else 0
    parts = textwrap.wrap(
        line[start:], width - start, break_long_words=False, break_on_hyphens=False
    )
    return f"\n{' ' * start}".join([line[:start] + parts[0], *parts[1:]])
