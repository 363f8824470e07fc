"""What a calibration says of its runs, its anchors and its scatter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ballscrew.axis.axial import PARAMETERS, from_vector
from ballscrew.base.arrays import Array
from ballscrew.calibration.calibrated_axis import Anchor, CalibrationRun
from ballscrew.calibration.fit import FULL, Fit, Problem
from ballscrew.calibration.identifiability import posterior
from ballscrew.calibration.method import method_of
from ballscrew.calibration.preparation import Prepared
from ballscrew.calibration.robust_fit import Robust
from ballscrew.modal.run import Run

__all__ = ["anchors_learned", "complaints", "runs_used"]


def runs_used(
    ready: Prepared, robust: Robust, fit: Fit, ratios: Array, spread: Array, runs: Mapping[str, Run]
) -> tuple[CalibrationRun, ...]:
    """Each run that was used, in the order given: what it gave, and how well it fits."""
    used, start = [], 0
    for index, (one, group) in enumerate(zip(ready.runs, ready.groups, strict=True)):
        stop = start + len(one.frequency)
        out = [i - start for i in robust.cells if start <= i < stop]
        plan = runs[one.id].made.inputs.get("plan")
        used.append(
            CalibrationRun(
                id=one.id,
                load=one.load,
                measured_at=one.measured_at,
                group=group,
                cells=len(one.frequency),
                log_ratio=float(ratios[group]),
                log_ratio_uncertainty=float(np.sqrt(max(spread[group, group], 0.0))),
                plan=plan if isinstance(plan, str) else None,
                method=method_of(runs[one.id]),
                level=float(np.mean(fit.residual[start:stop])),
                weight=float(robust.weights[index]),
                outliers=tuple(
                    f"{1e3 * one.position[i]:g} mm {one.condition[i]} ({off:+.2f} %)"
                    for i, off in zip(out, 1e2 * fit.residual[start + np.array(out, dtype=int)], strict=True)
                ),
            )
        )
        start = stop
    return tuple(used)


def anchors_learned(ready: Prepared, rows: Problem, fit: Fit) -> tuple[Anchor, ...]:
    """Each anchor, and what it settled: the spread without it and with it."""
    n = len(rows.position)
    every = np.arange(len(rows.told))
    at_share, at_preload = PARAMETERS.index("share"), PARAMETERS.index("preload")
    share = from_vector(fit.unknown[:FULL], ready.centre).share
    whole = posterior(rows, fit, every)
    found = []
    for index, row in enumerate(ready.rows):
        without = posterior(rows, fit, np.delete(every, n + index))
        sd = [float(np.sqrt(c[k, k])) for c in (without, whole) for k in (at_preload, at_share)]
        value = float(np.exp(row.told))
        found.append(
            Anchor(
                row.kind, ready.runs[row.run].id, value, value * row.spread,
                sd[0], sd[2], share * (1 - share) * sd[1], share * (1 - share) * sd[3],
            )
        )  # fmt: skip
    return tuple(found)


def complaints(ready: Prepared, robust: Robust) -> list[str]:
    """Say which runs and anchors do not fit the others."""
    said = []
    for index, weight in enumerate(robust.weights):
        if weight < 1:
            run = ready.runs[index]
            said.append(
                f"run {run.id[:12]} ({run.load:g} kg) does not fit the others and counts "
                f"{100 * weight:.0f} %: is its load or its preload another?"
            )
    if robust.unfinished:
        said.append(
            f"the search for cells and runs that do not fit stopped after {len(robust.cells)} cells and "
            f"{len(robust.excused)} runs: more do not fit"
        )
    if robust.disagree:
        names = ", ".join(ready.runs[i].id[:12] for i in robust.disagree)
        said.append(
            f"runs {names} do not fit each other at one preload, and nothing tells which is wrong: say when "
            "they were measured, if not on one day"
        )
    for index, score in robust.anchors:
        row = ready.rows[index]
        said.append(
            f"the {row.kind} of run {ready.runs[row.run].id[:12]}, {np.exp(row.told):.0f} N, lies "
            f"{abs(score):.1f} standard deviations {'above' if score > 0 else 'below'} what all else says"
        )
    return said
