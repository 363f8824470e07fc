"""Links, lines and versions."""

from __future__ import annotations

import re

import pytest
from tests.docs.pages import DOCS, ROOT, page

import ballscrew


def test_no_line_is_lost() -> None:
    """A line that begins with a per cent sign is a comment in these pages, and silently omitted."""
    lost = [
        f"{path.name}: {line}"
        for path in sorted(DOCS.rglob("*.md"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if line.startswith("%")
    ]
    assert lost == []


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_lead_somewhere(name: str) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", page(name))
    missing = [link for link in links if "://" not in link and not (ROOT / link).exists()]
    assert missing == []


def test_the_citation_is_of_this_version() -> None:
    assert f"version: {ballscrew.__version__}\n" in page("CITATION.cff")
