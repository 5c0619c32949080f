# SPDX-License-Identifier: Apache-2.0
"""The page on scale: its block runs, on workers that are threads here."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.scale.conftest import clouds as clouds  # fixtures
from tests.scale.conftest import threads_of_dask as threads_of_dask

PAGE = Path(__file__).resolve().parents[1] / "docs" / "scale.md"


def test_the_block_prints_what_it_should(
    clouds: Path,
    threads_of_dask: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from oddsmap.scale import cluster

    shutil.copytree(clouds, tmp_path / "clouds")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "_local", lambda workers: _Kept(threads_of_dask))
    block = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)[0]
    exec(compile(block, PAGE.name, "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out == "10 scans in 5 chunks\nTrue\n"


class _Kept:
    """A client that others close."""

    cluster = None

    def __init__(self, client: Any) -> None:
        self._client = client

    def __getattr__(self, name: str) -> Any:
        return getattr(self._client, name)

    def close(self, timeout: float = 0.0) -> None:
        """Left to its owner."""
