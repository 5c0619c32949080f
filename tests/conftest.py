# SPDX-License-Identifier: Apache-2.0
"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real logs: ODDSMAP_DATA, or shared/data beside the repository."""
    default = Path(__file__).resolve().parents[1].parent / "shared" / "data"
    folder = Path(os.environ.get("ODDSMAP_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"real data not found in {folder}; set ODDSMAP_DATA")
    return folder
