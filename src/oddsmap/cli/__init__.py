# SPDX-License-Identifier: Apache-2.0
"""The command line: one file a command."""

from __future__ import annotations

import os
import sys

__all__ = ["INTERRUPTED", "main"]

INTERRUPTED = "interrupted: each output is as it was, or new and complete"


def main() -> None:
    """Run `oddsmap`; see `oddsmap.cli.app`. Ctrl-C at any moment is one line and status 130."""
    try:
        # OpenBLAS starts a thread per core when NumPy is loaded, and again for SciPy: 0.1 s of CPU
        # each, and no command multiplies large matrices.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Pydantic, which checks options for Typer, asks every installed package if it is a plugin.
        os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
        from oddsmap.cli.interrupts import interruptible

        with interruptible():
            from oddsmap.cli.app import run

            run()
    except KeyboardInterrupt:
        # Plain print: Typer may not have been imported yet.
        print(f"oddsmap: {INTERRUPTED}", file=sys.stderr)  # noqa: T201
        sys.exit(130)
