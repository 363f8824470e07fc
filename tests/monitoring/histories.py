"""Histories of the model axis with known wear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from tests.estimation.made_runs import run_of

from ballscrew.modal.cell import CellResult
from ballscrew.modal.reason import Reason
from ballscrew.modal.run import Run

BEGIN = datetime(2026, 1, 1, 8, tzinfo=UTC)


def at(day: float) -> str:
    """Time of a day, as a document has it."""
    return (BEGIN + timedelta(days=day)).isoformat()


def history(
    days: Sequence[float],
    ratio: Callable[[float], float] = lambda _: 1.0,
    *,
    scatter: float = 1e-4,
    seed: int = 0,
    outliers: dict[int, float] | None = None,
    temperature: Callable[[float], float] | None = None,
    drag_share: float = 0.4,
    **others: Any,
) -> list[Run]:
    """A run on each day.

    ``outliers`` are further relative errors of the frequency of single runs; ``drag_share`` is the nut's part
    of the friction.
    """
    random = np.random.default_rng([seed, 0x415])
    runs = []
    for index, day in enumerate(days):
        level = scatter * random.standard_normal() + (outliers or {}).get(index, 0.0)
        warm = temperature(day) if temperature else None
        ratio_now = ratio(day)
        friction = 1 - drag_share + drag_share * ratio_now
        name = f"run {seed} {index:03d}"
        run = run_of(ratio_now, name=name, level=level, seed=index, friction=friction, **others)
        runs.append(replace(run, measured_at=at(day), temperature_C=warm))
    return runs


def worn(onset: float, life: float) -> Callable[[float], float]:
    """P/P₀ by the law of the contact pressure."""
    return lambda day: max(1 - max(day - onset, 0.0) / life, 0.01) ** 3


def unloading(load: float, runs: Sequence[Run], *, refused: bool = False) -> list[Run]:
    """Runs of which each cell states a load on the nut over its preload, refused by it or not."""
    stated = []
    for run in runs:
        cells = [replace(cell, nut_load_over_preload=load) for cell in run.cells]
        if refused:
            reason = Reason("unloaded", "the test's own load unloads the nut")
            refusals = [CellResult.refused(cell.key, 10, "joint", [reason]) for cell in cells]
            cells = [replace(cell, nut_load_over_preload=load) for cell in refusals]
        stated.append(replace(run, cells=tuple(cells)))
    return stated
