"""A browser for the tests of a file."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser
from tests.service.pages.browser import chromium, find_chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Chromium; skipped where it is not installed, unless BALLSCREW_REQUIRE_CHROMIUM is set."""
    program = find_chromium()
    if program is None:
        reason = "Chromium is not installed: apt-get install chromium"
        if os.environ.get("BALLSCREW_REQUIRE_CHROMIUM") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    with chromium(program) as found:
        yield found
