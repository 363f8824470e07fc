"""The tests that the page names exist."""

from __future__ import annotations

import re

from tests.docs.pages import ROOT

NAMED = re.compile(r"`([\w/]+\.py)(?:::(test_\w+))?`")


def test_every_test_on_the_page_exists() -> None:
    page = (ROOT / "docs" / "explanation" / "robustness.md").read_text(encoding="utf-8")
    named = NAMED.findall(page)
    assert len(named) > 40
    for file, name in named:
        text = (ROOT / "tests" / file).read_text(encoding="utf-8")
        assert not name or re.search(rf"^ *def {name}\(", text, re.M), (file, name)
