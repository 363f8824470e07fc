"""Tables of :mod:`benchmarks.identification`, from what it keeps of every run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["bench_table", "changes", "errors", "nearest", "random_table", "write"]

Key = tuple[float, str, int]
StoredRun = dict[str, Any]


def nearest(truth: Sequence[Sequence[float]], position: float) -> float:
    """The truth at the stop nearest to a position."""
    return min(truth, key=lambda row: abs(row[0] - position))[1]


def errors(stored: StoredRun, method: str) -> dict[Key, tuple[float, float]]:
    """Error and standard uncertainty (NaN where there is none) of each reported cell, Hz."""
    truth = stored["held" if "rotor held" in method else "truth"]
    rows = stored["methods"].get(method, {"rows": []})["rows"]
    return {
        (x, condition, motion): (f - nearest(truth, x), np.nan if u is None else u)
        for x, condition, motion, f, u in rows
    }


def _numbers(runs: Sequence[StoredRun], method: str) -> np.ndarray:
    return np.array([e for stored in runs for e in errors(stored, method).values()]).reshape(-1, 2)


def _of_intervals(rows: np.ndarray) -> str:
    """Two columns: coverage and half-width of 95 % intervals."""
    if not len(rows) or np.isnan(rows[:, 1]).any():
        return "– | –"
    inside = 100 * np.mean(np.abs(rows[:, 0]) <= 1.96 * rows[:, 1])
    return f"{inside:.0f} % | ±\u2009{1.96 * np.median(rows[:, 1]):.2f}"


def changes(runs: Sequence[tuple[StoredRun, StoredRun]], method: str) -> list[np.ndarray]:
    """Error of the change in each cell that both runs of a pair report, Hz, for each pair."""
    out = []
    for one, other in runs:
        before, after = errors(one, method), errors(other, method)
        shared = sorted(set(before) & set(after))
        if shared:
            out.append(np.array([after[key][0] - before[key][0] for key in shared]))
    return out


def random_table(runs: Sequence[tuple[StoredRun, StoredRun]], methods: Sequence[str]) -> list[str]:
    """Rows of the table of random axes."""
    out = [
        (
            "| method | median | 90th percentile | cells reported | change of the run, rms | "
            "coverage | 95 % | s a run |"
        ),
        "|---|---|---|---|---|---|---|---|",
    ]
    flat = [stored for pair in runs for stored in pair]
    cells = sum(stored["cells"] for stored in flat)
    for method in methods:
        rows = _numbers(flat, method)
        if not len(rows):
            out.append(f"| {method} | – | – | 0 % | – | – | – | – |")
            continue
        size = np.abs(rows[:, 0])
        shift = [float(d.mean()) for d in changes(runs, method)]
        few = "" if len(shift) == len(runs) else f" ({len(shift)} axes)"
        change = f"{np.sqrt(np.mean(np.square(shift))):.2f}{few}" if shift else "–"
        took = np.median([stored["methods"][method]["seconds"] for stored in flat])
        out.append(
            f"| {method} | {np.median(size):.2f} | {np.quantile(size, 0.9):.2f} | "
            f"{100 * len(rows) / cells:.0f} % | {change} | "
            f"{_of_intervals(rows)} | {took:.1f} |"
        )
    return out


def bench_table(states: Mapping[str, Sequence[StoredRun]], methods: Sequence[str]) -> list[str]:
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
            if not all(method in stored["methods"] for stored in runs):
                continue
            rows = _numbers(runs, method)
            each = [np.abs(_numbers([stored], method)[:, 0]) for stored in runs]
            medians = [f"{np.median(e):.2f} / {np.quantile(e, 0.9):.2f}" if len(e) else "–" for e in each]
            cells = sum(stored["cells"] for stored in runs)
            gone = changes([(runs[0], runs[1])], method)
            change = f"{np.median(np.abs(gone[0])):.2f}" if gone else "–"
            sheet = "none" if "no sheet" in method else name
            out.append(
                f"| {method} | {sheet} | {' | '.join(medians)} | {len(rows)}/{cells} | {change} | "
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
