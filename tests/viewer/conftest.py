# SPDX-License-Identifier: Apache-2.0
"""The browser that the tests of a file share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from tests.viewer.browser_kit import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser


# Not of the session: Playwright keeps an event loop running in this thread while it is open, and
# tests that follow elsewhere start loops of their own.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Headless Chromium; the tests that ask for it skip where there is none."""
    with chromium() as found:
        yield found
