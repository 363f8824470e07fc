"""Prints the table of the page *The paper's experiments* from what ``ballscrew reproduce`` left.

Usage: python docs/reproduction_table.py FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def table(document: dict[str, list[dict[str, str]]]) -> str:
    """Rows of Markdown, one per claim."""
    rows = [
        f"| {claim['paper']} | {claim['measured']} | {claim['holds']} | {claim['remark']} |"
        for claim in document["claims"]
    ]
    return "\n".join(
        [
            "| claim of the paper | result | confirmed | remarks |",
            "|---|---|---|---|",
            *rows,
        ]
    )


if __name__ == "__main__":
    print(table(json.loads((Path(sys.argv[1]) / "reproduce.json").read_text(encoding="utf-8"))))  # noqa: T201
