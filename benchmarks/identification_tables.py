"""Tables of :mod:`benchmarks.identification`, from what it keeps of every run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["bench_table", "changes", "errors", "nearest", "random_table", "write"]

Key = tuple[float, str, int]
Kept = dict[str, Any]


def nearest(truth: Sequence[Sequence[float]], position: float) -> float:
    """The truth at the stop nearest to a position."""
    return min(truth, key=lambda row: abs(row[0] - position))[1]


def errors(kept: Kept, method: str) -> dict[Key, tuple[float, float]]:
    """Of each cell told its error and its standard uncertainty (NaN where there is none), Hz."""
    truth = kept["held" if "rotor held" in method else "truth"]
    rows = kept["methods"].get(method, {"rows": []})["rows"]
    return {
        (x, condition, motion): (f - nearest(truth, x), np.nan if u is None else u)
        for x, condition, motion, f, u in rows
    }


def _numbers(runs: Sequence[Kept], method: str) -> np.ndarray:
    return np.array([e for kept in runs for e in errors(kept, method).values()]).reshape(-1, 2)


def _of_intervals(rows: np.ndarray) -> str:
    """Two columns: coverage and half-width of 95 % intervals."""
    if not len(rows) or np.isnan(rows[:, 1]).any():
        return "– | –"
    inside = 100 * np.mean(np.abs(rows[:, 0]) <= 1.96 * rows[:, 1])
    return f"{inside:.0f} % | ±\u2009{1.96 * np.median(rows[:, 1]):.2f}"


def changes(runs: Sequence[tuple[Kept, Kept]], method: str) -> list[np.ndarray]:
    """Of each pair of runs the error of the change in each cell that both told, Hz."""
    out = []
    for one, other in runs:
        before, after = errors(one, method), errors(other, method)
        shared = sorted(set(before) & set(after))
        if shared:
            out.append(np.array([after[key][0] - before[key][0] for key in shared]))
    return out


def random_table(runs: Sequence[tuple[Kept, Kept]], methods: Sequence[str]) -> list[str]:
    """Rows of the table of random axes."""
    out = [
        (
            "| method | median | 90th percentile | cells reported | change of the run, rms | "
            "coverage | 95 % | s a run |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    flat = [kept for pair in runs for kept in pair]
    cells = sum(kept["cells"] for kept in flat)
    for method in methods:
        rows = _numbers(flat, method)
        if not len(rows):
            out.append(f"| {method} | – | – | 0 % | – | – | – | – |")
            continue
        size = np.abs(rows[:, 0])
        shift = [float(d.mean()) for d in changes(runs, method)]
        few = "" if len(shift) == len(runs) else f" ({len(shift)} axes)"
        change = f"{np.sqrt(np.mean(np.square(shift))):.2f}{few}" if shift else "–"
        took = np.median([kept["methods"][method]["seconds"] for kept in flat])
        out.append(
            f"| {method} | {np.median(size):.2f} | {np.quantile(size, 0.9):.2f} | "
            f"{100 * len(rows) / cells:.0f} % | {change} | "
            f"{_of_intervals(rows)} | {took:.1f} |"
        )
    return out


def bench_table(states: Mapping[str, Sequence[Kept]], methods: Sequence[str]) -> list[str]:
    """Rows of the table of the bench: for each sheet its two states."""
    out = [
        (
            "| method | data sheet | 4 %: median / 90th | 2 %: median / 90th | cells reported | "
            "change, median cell | coverage | 95 % |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    for method in methods:
        for name, runs in states.items():
            if not all(method in kept["methods"] for kept in runs):
                continue
            rows = _numbers(runs, method)
            each = [np.abs(_numbers([kept], method)[:, 0]) for kept in runs]
            told = [f"{np.median(e):.2f} / {np.quantile(e, 0.9):.2f}" if len(e) else "–" for e in each]
            cells = sum(kept["cells"] for kept in runs)
            gone = changes([(runs[0], runs[1])], method)
            change = f"{np.median(np.abs(gone[0])):.2f}" if gone else "–"
            sheet = "none" if "no sheet" in method else name
            out.append(
                f"| {method} | {sheet} | {' | '.join(told)} | {len(rows)}/{cells} | {change} | "
                f"{_of_intervals(rows)} |"
            )
    return out


def write(page: Path, name: str, lines: Sequence[str]) -> None:
    """Put a table between its marks in a page."""
    text = page.read_text(encoding="utf-8")
    marks = f"<!-- {name} -->", f"<!-- end of {name} -->"
    pattern = re.compile(f"{re.escape(marks[0])}.*?{re.escape(marks[1])}", re.S)
    assert pattern.search(text), f"{page} has no marks of the table {name!r}"
    block = "\n".join([marks[0], *lines, "", marks[1]])
    page.write_text(pattern.sub(lambda _: block, text), encoding="utf-8", newline="\n")
