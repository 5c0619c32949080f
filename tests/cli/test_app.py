# SPDX-License-Identifier: Apache-2.0
"""The command line as a whole: help and version."""

from __future__ import annotations

import oddsmap
from tests.cli.conftest import Run


def test_help_and_version(run: Run) -> None:
    assert "oddsmap build" in run("--help").out
    assert oddsmap.__version__ in run("--version").out
