"""Time and load of an analysed run, added or corrected without a new analysis."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from datetime import datetime

from ballscrew.axis.sheet import DataSheet
from ballscrew.base.errors import InputError
from ballscrew.base.provenance import digest
from ballscrew.base.settings import timestamp
from ballscrew.base.units import parse_named
from ballscrew.fcft.plan import Plan
from ballscrew.modal.run import RigidBodyResult, Run
from ballscrew.recording.quality.completeness import check_load
from ballscrew.recording.quality.finding import Finding, Quality
from ballscrew.recording.rigid_body import RigidBody

SUPERSEDES = "supersedes"
"""Key of ``made.inputs``: id of the run that an amended one replaces."""

_FITTED = ("equivalent_mass_kg", "viscous_N_s_per_m", "coulomb_N", "offset_N")


def amend(
    run: Run,
    *,
    measured_at: str | datetime | None = None,
    mass: str | float | None = None,
    axis: DataSheet | None = None,
    plan: Plan | None = None,
) -> Run:
    """Add or correct the time or the load of a run; with a load, its check is repeated.

    Parameters
    ----------
    run : Run
        Analysed.
    measured_at : str or datetime, optional
        ISO 8601.
    mass : str or float, optional
        Load on the table, ``"100 kg"``, a bare number in kg; requires the data sheet, and the plan where the
        run was analysed with one.
    axis : DataSheet, optional
        Data sheet of the analysis.
    plan : Plan, optional
        Plan of the analysis.

    Returns
    -------
    Run
        With an id of its own; ``made.inputs["supersedes"]`` is that of the given run.

    Raises
    ------
    InputError
        If nothing is to be changed, a document is not that of the analysis, or the load contradicts the
        equivalent mass by so much that the measurement would be bad.

    Examples
    --------
    >>> run = amend(Run.read("run.json"), measured_at="2026-01-31T08:00Z")  # doctest: +SKIP
    """
    if measured_at is None and mass is None:
        raise InputError("nothing is to be amended: give --measured-at or --mass.")
    amended = run
    if measured_at is not None:
        amended = replace(amended, measured_at=timestamp(measured_at, "measured_at"))
    if mass is not None:
        amended = _with_load(amended, _load(mass), axis, plan)
    identity = digest({SUPERSEDES: run.id, "measured_at": amended.measured_at, "mass_kg": amended.mass_kg})
    made = replace(run.made, inputs={**run.made.inputs, SUPERSEDES: run.id})
    return replace(amended, id=identity, made=made)


def current_runs(runs: Iterable[Run]) -> list[Run]:
    """Runs without those that another one of them supersedes.

    Parameters
    ----------
    runs : iterable of Run
        Amended or not.

    Returns
    -------
    list of Run
        In the order given.
    """
    given = list(runs)
    superseded = {run.made.inputs.get(SUPERSEDES) for run in given}
    return [run for run in given if run.id not in superseded]


def _load(mass: str | float) -> float:
    load = parse_named("the load (mass)", mass, "kg")
    if not 0 <= load < math.inf:
        raise InputError(f"the load on the table (mass) is {load:g} kg; it must be 0 kg or more.")
    return load


def _with_load(run: Run, load: float, sheet: DataSheet | None, plan: Plan | None) -> Run:
    _check_documents(run, sheet, plan)
    rigid = _rigid_body(run.rigid_body)
    former: tuple[Finding, ...] = ()
    if run.mass_kg is not None:
        former = check_load(plan, sheet, run.mass_kg, rigid)
    if any(finding.severity == "bad" for finding in former):
        raise InputError("the run was refused because of its load; analyse it again with --mass.")
    found = check_load(plan, sheet, load, rigid)
    for finding in found:
        if finding.severity == "bad":
            raise InputError(f"a load of {load:g} kg contradicts the run: {finding.message}.")
    return replace(run, mass_kg=load, quality=_quality(run.quality, former, found))


def _quality(quality: Quality, former: tuple[Finding, ...], found: tuple[Finding, ...]) -> Quality:
    """Verdict with the findings of another load; the other reasons stay."""
    outdated = {finding.message for finding in former}
    others = [reason for reason in quality.reasons if reason.rstrip(".") not in outdated]
    reasons = (*others, *(finding.message for finding in found))
    if quality.verdict == "bad":
        return Quality("bad", reasons, quality.notes)
    return Quality("suspect" if reasons else "good", reasons, quality.notes)


def _check_documents(run: Run, sheet: DataSheet | None, plan: Plan | None) -> None:
    """Check that data sheet and plan are those of the analysis."""
    for name, document in (("axis", sheet), ("plan", plan)):
        stated = run.made.inputs.get(name)
        if document is None and (stated is not None or name == "axis"):
            raise InputError(f"the check of the load requires the run's {name}; give it (--{name}).")
        if document is not None and stated not in (None, digest(document.to_settings())):
            raise InputError(f"the {name} given (--{name}) is not that of the analysis.")


def _rigid_body(body: RigidBodyResult) -> RigidBody | None:
    """Fit of the run, as far as RUN.json has it."""
    if body.equivalent_mass_kg is None:
        return None
    mass, viscous, coulomb, offset = (_number(getattr(body, name)) for name in _FITTED)
    spread = [_number(body.standard_uncertainty.get(name)) for name in _FITTED]
    uncertainty = (spread[0], spread[1], spread[2], spread[3])
    return RigidBody(mass, viscous, coulomb, offset, uncertainty, residual=math.nan, explained=math.nan)


def _number(value: float | None) -> float:
    return math.nan if value is None else value
