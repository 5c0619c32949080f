# SPDX-License-Identifier: Apache-2.0
"""Fixtures and options that all tests share."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Kernels compile in the first example of a test: a deadline would measure that. In CI the examples
# are the same each time; elsewhere each run tries new ones.
settings.register_profile(
    "oddsmap",
    deadline=None,
    derandomize="CI" in os.environ,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("oddsmap")

# By default garbage is looked for after every 700 new objects, and again and again among all
# modules, tests and compiled kernels: 6.0 s of the 23 s in which the tests are collected (1.3 s
# so), and 10.4 s of the 70 s in which ten slow ones ran (3.2 s so).
gc.set_threshold(100_000, 20, 20)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="also run the tests marked slow")


# Threads that break their rules may crash the interpreter in any test that follows, and nothing is
# reported then. So the tests that name such a fault go first, and a failure of theirs ends the run.
_BEFORE_ALL = "test_threads.py"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name != _BEFORE_ALL)
    if not config.getoption("--slow"):
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="slow: run with --slow"))


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()  # the tests themselves stay until the end


def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    failed = call.excinfo is not None and not call.excinfo.errisinstance(pytest.skip.Exception)
    if failed and item.path.name == _BEFORE_ALL:
        item.session.shouldfail = f"{item.name}: threads break their rules, the rest may crash"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real logs: ODDSMAP_DATA, or shared/data beside the repository."""
    default = Path(__file__).resolve().parents[1].parent / "shared" / "data"
    folder = Path(os.environ.get("ODDSMAP_DATA", default))
    if not folder.is_dir():
        pytest.skip(f"real data not found in {folder}; set ODDSMAP_DATA")
    return folder
