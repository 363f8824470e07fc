"""How the tests read the documentation."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look there for their own module
    spec.loader.exec_module(module)
    return module


WALK = load(DOCS / "tutorial" / "walk.py")
blocks = WALK.blocks


def page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def section(text: str, heading: str) -> str:
    """Text under a heading of the second level."""
    found = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    assert found, f"there is no section {heading!r}"
    return found[1]


def first_column(text: str) -> list[str]:
    """Every code word in the first cell of the rows of tables."""
    rows = re.findall(r"^\|([^|]*)\|", text, re.M)
    return [word for row in rows for word in re.findall(r"`([^`]+)`", row)]


_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?\Z")
_FRAME = str.maketrans("", "", "┏━┳┓┡╇┩│└┴┘─┃•")


def words(text: str) -> list[str]:
    """Words of an output, without frames and the ids of runs, and with the same slash on every system."""
    return re.sub(r"\b[0-9a-f]{12}\b", "ID", text.translate(_FRAME)).replace("\\", "/").split()


def alike(printed: list[str], shown: list[str]) -> list[str]:
    """Words that differ; numbers may differ by 2 %, uncertainties by 20 %."""
    wrong = []
    for i, (word, other) in enumerate(zip(printed, shown, strict=True)):
        if _NUMBER.match(word) and _NUMBER.match(other):
            part = 0.2 if printed[i - 1] == "±" else 0.02
            if abs(float(word) - float(other)) <= max(0.05, part * abs(float(other))):
                continue
        if word != other:
            wrong.append(f"{word}, not {other}")
    return wrong
