"""Table of :mod:`benchmarks.other_machines`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks.other_worlds import WORLDS

__all__ = ["fewest_misses", "world_table"]

PROMISED = 0.05  # of the intervals of good answers may miss
ONE_SIDED = 0.01
Answer = Mapping[str, Any]


def world_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Worlds, then all together; stiffness and nut beside each other."""
    heads = ["world", "on the sheet", "what differs", "expected", "axial stiffness: good / suspect / refused"]
    heads += ["good: covered", "error, rms", "95 %", "nut: expected", "good / suspect / refused"]
    heads += ["good: covered", "error, rms", "95 %"]
    out = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for world in WORLDS:
        of_world = [row for row in rows if row["world"] == world.name]
        if not of_world:
            continue
        stiffness, nut = (_columns(of_world, name) for name in ("stiffness", "nut"))
        on_sheet = "yes" if world.on_sheet else "no"
        out.append(
            f"| {world.name} | {on_sheet} | {world.differs} | {world.stiffness} | {stiffness} | "
            f"{world.nut} | {nut} |"
        )
    stiffness, nut = (_columns(rows, name) for name in ("stiffness", "nut"))
    out.append(f"| all | | | | {stiffness} | | {nut} |")
    described = {world.name for world in WORLDS if world.on_sheet}
    selected = [row for row in rows if row["world"] in described and row["contact"]]
    stiffness, nut = (_columns(selected, name) for name in ("stiffness", "nut"))
    out.append(f"| on the sheet, 2.83 P above the nut load | yes | | good | {stiffness} | good | {nut} |")
    return out


def _columns(rows: Sequence[Mapping[str, Any]], name: str) -> str:
    """Verdicts; of the good answers how many cover, their error and the median half-width."""
    verdicts = Counter(row[name]["verdict"] for row in rows)
    counts = " / ".join(str(verdicts[verdict]) for verdict in ("good", "suspect", "refused"))
    good = [row for row in rows if row[name]["verdict"] == "good" and "value" in row[name]]
    if not good:
        return f"{counts} | – | – | –"
    answers = [row[name] for row in good]
    misses = np.array([not _covers(answer) for answer in answers])
    error = np.array([answer["value"] - answer["true"] for answer in answers])
    half = [(answer["interval"][1] - answer["interval"][0]) / 2 for answer in answers]
    axes = np.array([row["axis"] for row in good])
    covered = f"{np.sum(~misses)} of {len(good)}"
    if fewest_misses(misses, axes) > PROMISED:
        covered = f"**{covered}**"
    return f"{counts} | {covered} | {np.sqrt(np.mean(error**2)):.3f} | ± {np.median(half):.3f}"


def _covers(answer: Answer) -> bool:
    low, high = answer["interval"]
    return bool(low <= answer["true"] <= high)


def fewest_misses(misses: np.ndarray, clusters: np.ndarray) -> float:
    """Lower one-sided 99 % limit of the part of intervals that miss.

    Exact binomial limit (Clopper and Pearson, 1934, doi:10.1093/biomet/26.4.404) with both numbers divided by
    the design effect 1 + (m − 1) ρ of clusters of m answers, ρ the intraclass correlation by analysis of
    variance (Rao and Scott, 1992, doi:10.2307/2532311).

    Parameters
    ----------
    misses : ndarray of bool, shape (n,)
        Whether each interval misses.
    clusters : ndarray of int, shape (n,)
        Cluster of each answer.

    Returns
    -------
    float
        0 without a miss.
    """
    count, missed = len(misses), int(np.sum(misses))
    if missed == 0:
        return 0.0
    names, index, sizes = np.unique(clusters, return_inverse=True, return_counts=True)
    effect = float(count) if len(names) == 1 else 1.0  # one cluster shows no ρ: taken as 1
    if 1 < len(names) < count:
        means = np.bincount(index, misses) / sizes
        within = np.sum((misses - means[index]) ** 2) / (count - len(names))
        between = np.sum(sizes * (means - misses.mean()) ** 2) / (len(names) - 1)
        size = (count - np.sum(sizes**2) / count) / (len(names) - 1)
        total = between + (size - 1) * within
        correlation = max(0.0, (between - within) / total) if total > 0 else 0.0
        effect = 1 + (float(np.sum(sizes**2)) / count - 1) * correlation
    k, n = missed / effect, count / effect
    return float(beta.ppf(ONE_SIDED, k, n - k + 1))
