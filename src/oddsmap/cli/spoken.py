# SPDX-License-Identifier: Apache-2.0
"""What the library says, in the words of the command line.

The library is called from Python, too, so its messages name a remedy as both do: "--skip-bad
(skip_bad=True)". At the command line the half that is typed there is enough.
"""

from __future__ import annotations

import re

__all__ = ["at_command_line"]

_BEHIND = re.compile(r" \((\w+)=[\w.]*\)")  # --poses FILE (poses=)
_WITHIN = re.compile(r", (\w+)=(?=\))")  # (--scans TOPIC, scans=)
_BEFORE = re.compile(r"\b([a-z]\w*) \((--[a-z][a-z-]*)\)")  # points_in (--points-in)


def at_command_line(message: str) -> str:
    """A message with the options alone, where it names an option and an argument of Python."""

    def dropped(found: re.Match[str]) -> str:
        return "" if _option(found[1]) in message else found[0]

    def option_alone(found: re.Match[str]) -> str:
        return found[2] if _option(found[1]) == found[2] else found[0]

    message = message.replace("use force=True", "use --force")
    return _WITHIN.sub(dropped, _BEHIND.sub(dropped, _BEFORE.sub(option_alone, message)))


def _option(argument: str) -> str:
    """The option that stands for an argument, whose name may end with its unit."""
    return "--" + argument.removesuffix("_s").replace("_", "-")
