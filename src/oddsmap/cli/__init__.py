# SPDX-License-Identifier: Apache-2.0
"""The command line: one file a command."""

from __future__ import annotations

__all__ = ["main"]


def main() -> None:
    """Run `oddsmap`; see `oddsmap.cli.app`."""
    from oddsmap.cli.app import run

    run()
