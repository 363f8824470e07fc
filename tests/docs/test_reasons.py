"""Every reason is explained and quoted correctly."""

from __future__ import annotations

import ast
import re

from tests.docs.pages import ROOT, page


def codes_in_the_source() -> set[str]:
    found: set[str] = set()
    for path in (ROOT / "src" / "ballscrew" / "recording").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            is_finding = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Finding"
            if is_finding and isinstance(node.args[1], ast.Constant):  # type: ignore[attr-defined]
                found.add(str(node.args[1].value))  # type: ignore[attr-defined]
    return found


def test_every_finding_has_a_row_and_every_row_a_finding() -> None:
    text = page("docs/howto/quality.md").split("\n## Cells")[0]
    codes = re.findall(r"^\|[^|]*\(`([\w-]+)`\) \|", text, re.M)
    assert len(codes) == len(set(codes))
    assert set(codes) == codes_in_the_source()


def sentences() -> str:
    """Every text of the two subpackages that give reasons, with an ellipsis in place of each value."""
    found = []
    for subpackage in ("recording", "modal"):
        for path in sorted((ROOT / "src" / "ballscrew" / subpackage).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    parts = [p.value if isinstance(p, ast.Constant) else "…" for p in node.values]
                    found.append("".join(map(str, parts)))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(node.value)
    return "\n".join(found)


def test_every_reason_is_quoted_correctly() -> None:
    printed = sentences()
    rows = re.findall(r"^\| (?!-|reason \||verdict|\*)([^|]*) \|", page("docs/howto/quality.md"), re.M)
    phrases = [p for row in rows for p in re.sub(r" \(`[\w-]+`\)$", "", row).split("; ")]
    assert len(phrases) > 40
    wrong = []
    for phrase in phrases:
        parts = [re.escape(part.strip()) for part in phrase.replace("`", "").split("…") if part.strip()]
        if not re.search("[^\n]*".join(parts), printed):
            wrong.append(phrase)
    assert wrong == []
