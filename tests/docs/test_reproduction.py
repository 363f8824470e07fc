"""The page of the paper's experiments holds every claim that the command holds against the paper."""

from __future__ import annotations

import re

from tests.docs.pages import ROOT, page


def test_every_claim_is_on_the_page() -> None:
    text = page("docs/explanation/reproduction.md")
    parts = ("claims", "measured_claims", "preload_claims")
    sources = [(ROOT / f"src/ballscrew/reproduction/{part}.py").read_text(encoding="utf-8") for part in parts]
    claims = [
        words
        for source in sources
        for words in re.findall(r'(?:return Claim\(\n|words = \()\s*"([^"]+)"', source)
    ]
    assert len(claims) > 8
    for words in claims:
        assert words.strip() in text


def test_the_papers_words_for_the_verdicts() -> None:
    rows = [line for line in page("docs/explanation/reproduction.md").splitlines() if line.startswith("| ")]
    verdicts = {row.split("|")[3].strip() for row in rows[1:]}
    assert verdicts <= {"yes", "partly", "no", "open"}
