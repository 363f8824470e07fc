"""A run against its epoch: what it tells, and whether it belongs.

By itself a run has its own verdict. Against the epoch's reference it must be comparable, its masses must fit,
its whole FRF its own rigid body, and some change of the nut its cells.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.special import ndtri

from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.estimation.causes import compare_causes, gather_evidence
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.compliance import change_since, paired
from ballscrew.estimation.fusion import FusedChange, fuse_on_worn_nut
from ballscrew.estimation.mass_check import check_mass, mass_changes
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.features import of_run
from ballscrew.monitoring.reading import Reading

__all__ = ["Judged", "agree", "fused_change", "judge", "with_masses"]

_MOST_LOAD = 0.25  # of all that moves, as ``preload`` allows
_FRF = 0.02  # by which the FRF's equivalent mass may part from the rigid body's, of it
_SOFTEST = 1.0  # growth of the compliance: beyond it one flank carries the load, and no softer
_WOUND = 0.5  # of what a softer axis is wound up by more: friction changes too
_OF_REFERENCE = ("noise of the baseline", "the baseline's part")


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A run, its reading, and what it was told from.

    Parameters
    ----------
    run : Run
        Analysed.
    reading : Reading
        Of it.
    change, fused : ComplianceChange, FusedChange or None
        Against the epoch's reference; None where it cannot be told.
    """

    run: Run
    reading: Reading
    change: ComplianceChange | None = None
    fused: FusedChange | None = None


def fused_change(
    table: FrequencyTable, reference: FrequencyTable, model: CalibratedAxis, settings: MonitorSettings
) -> tuple[ComplianceChange, FusedChange]:
    """Change of the nut since the reference; the load on a worn nut counts by the preload that is sought.

    Parameters
    ----------
    table, reference : FrequencyTable
        Two runs with cells in common.
    model : CalibratedAxis
        Of the axis.
    settings : MonitorSettings
        What is taken for granted.

    Returns
    -------
    ComplianceChange, FusedChange
        Told as :func:`ballscrew.estimation.preload.preload` tells them, without its draws.
    """
    more = table.load - reference.load

    def change_at(ratio: float) -> ComplianceChange:
        return change_since(
            table, reference, model.model, model.bearing_share, 1.0, settings.assumptions, more, ratio
        )

    change, fused, _ = fuse_on_worn_nut(change_at)
    return change, fused


def with_masses(reading: Reading, run: Run) -> Reading:
    """A reading with what the run tells of masses and friction.

    Parameters
    ----------
    reading : Reading
        Of the run.
    run : Run
        Analysed.

    Returns
    -------
    Reading
        With nan for what it does not tell.
    """
    rigid, over = run.rigid_body, run.mass_over_preload_kg_per_N
    return replace(
        reading,
        equivalent_mass=_number(rigid.equivalent_mass_kg),
        friction=_number(rigid.coulomb_N),
        friction_uncertainty=_number(rigid.standard_uncertainty.get("coulomb_N")),
        features=MappingProxyType(dict(of_run(run))),
        mass_over_preload=math.nan if over is None else over.value,
        mass_over_preload_uncertainty=math.nan if over is None else over.standard_uncertainty,
    )


def judge(
    run: Run,
    table: FrequencyTable,
    reading: Reading,
    reference: tuple[Run, FrequencyTable] | None,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> Judged:
    """Judge a run by itself, and against its epoch's reference.

    Parameters
    ----------
    run : Run
        Analysed.
    table : FrequencyTable
        Its frequencies.
    reading : Reading
        With its masses.
    reference : tuple of Run and FrequencyTable, or None
        Of the epoch; None before a run was good.
    model : CalibratedAxis
        Of the axis.
    settings : MonitorSettings
        What is plausible.

    Returns
    -------
    Judged
        With its level where it is told, and the reasons where it does not count.
    """
    own = tuple(run.quality.reasons)
    if run.quality.verdict == "bad" or not len(table.frequency):
        if run.quality.verdict != "bad" and reference is not None:
            # What a probe shows is there all the same.
            lost, spread = _lost_motion(run, reference[0], _SOFTEST)
            reading = replace(reading, backlash=lost, backlash_uncertainty=spread)
        return Judged(run, replace(reading, verdict="refused", reasons=own or (_unread(run),)))
    if reference is None:
        return Judged(run, replace(reading, verdict="suspect", reasons=own or ("it is suspect",)))
    apart = _not_comparable(run, table, *reference, model)
    if apart:
        return Judged(run, replace(reading, verdict="suspect", reasons=(apart,)))
    change, fused = fused_change(table, reference[1], model, settings)
    reading = replace(
        reading,
        level=fused.level,
        random=fused.random,
        systematic=math.sqrt(
            sum(u**2 for name, (u, random) in fused.terms.items() if not random and name not in _OF_REFERENCE)
        ),
    )
    lost, spread = _lost_motion(run, reference[0], float(np.clip(np.mean(change.y), 0.0, _SOFTEST)))
    reading = replace(reading, backlash=lost, backlash_uncertainty=spread)
    wrong, notes = _against_the_epoch(run, reference[0], change, fused, model, settings)
    if run.quality.verdict != "good":
        wrong = [*(own or ("the measurement is suspect",)), *wrong]
    verdict = "suspect" if wrong else "good"
    return Judged(run, replace(reading, verdict=verdict, reasons=tuple(wrong or notes)), change, fused)


def _unread(run: Run) -> str:
    """Why a good measurement gave no frequency, in the words of most of its cells."""
    reasons = Counter(reason.split(":")[0] for cell in run.cells for reason in cell.reasons[:1])
    why = f": {reasons.most_common(1)[0][0]}" if reasons else ""
    return f"no cell of the run has a frequency{why}"


def _not_comparable(
    run: Run, table: FrequencyTable, reference: Run, other: FrequencyTable, model: CalibratedAxis
) -> str | None:
    plans = run.made.inputs.get("plan"), reference.made.inputs.get("plan")
    if None not in plans and plans[0] != plans[1]:
        return "it was measured by another plan than the epoch's reference"
    if abs(table.load - other.load) > _MOST_LOAD * (model.model.mass + other.load):
        return f"it was measured with {table.load:g} kg, the epoch's reference with {other.load:g} kg"
    if not paired(table, other)[0]:
        return "no cell of it has a frequency in the epoch's reference too"
    return None


def _against_the_epoch(
    run: Run,
    reference: Run,
    change: ComplianceChange,
    fused: FusedChange,
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> tuple[list[str], list[str]]:
    """What is wrong with a run, and what must be known with it."""
    kept = settings.assumptions
    far = float(-ndtri(settings.suspect / 2)) if settings.suspect > 0 else math.inf
    masses = mass_changes(run, reference, model.model, kept)
    heavy = masses is not None and abs(masses.inertia) > far * masses.inertia_spread
    misfit = fused.probability < settings.suspect
    wrong: list[str] = []
    notes: list[str] = []
    if heavy or misfit:
        found = compare_causes(gather_evidence(change, masses, kept))
        if heavy:
            by_kilogram = abs(float(fused.weights @ change.mass))
            spread = math.hypot(fused.spread, abs(fused.level) * model.standard_uncertainty("share"))
            mass = check_mass(
                masses, found, reference.rigid_body.equivalent_mass_kg or 0.0, by_kilogram / spread, kept
            )
            (notes if mass.decision in ("torque", "declared") else wrong).append(mass.text)
        if misfit and found[0].name not in ("nut", "local", "torque"):
            wrong.append(f"no change of the nut explains all cells; the likeliest cause is {found[0].text}")
        elif misfit:
            notes.append(f"the cells differ more than they should; likeliest is {found[0].text}")
    parted = _frf(run, reference)
    if parted is not None and abs(parted[0]) > max(_FRF, far * parted[1]):
        wrong.append(
            f"its FRF is {100 * abs(parted[0]):.1f} % {'smaller' if parted[0] > 0 else 'larger'} than its "
            "rigid body says, against the epoch's reference: has the accelerometer moved or come loose?"
        )
    return wrong, notes


def _frf(run: Run, reference: Run) -> tuple[float, float] | None:
    """Change of ln (FRF's equivalent mass over the rigid body's), which only the accelerometer can do.

    But for friction, whose remainder is in the FRF's mass: it falls as the nut wears, and the stated
    uncertainty holds it.
    """
    logs, spreads = [], []
    for one in (run.rigid_body, reference.rigid_body):
        mass, whole = one.frf_equivalent_mass_kg, one.equivalent_mass_kg
        if mass is None or whole is None or not (mass > 0 and whole > 0):
            return None
        logs.append(math.log(mass / whole))
        spreads.append(_number(one.standard_uncertainty.get("frf_equivalent_mass_kg")) / mass)
    spread = max(spreads)
    return logs[0] - logs[1], spread if spread > 0 else 0.0


def _lost_motion(run: Run, reference: Run, softer: float) -> tuple[float, float]:
    """Lost motion beyond what friction winds up, mean over the stops that both have.

    A softer axis is wound up by more, without any backlash: as its compliance has grown by the frequencies.
    """
    now, then = ({round(one.position_m, 6): one for one in each.lost_motion} for each in (run, reference))
    common = sorted(now.keys() & then.keys())
    if not common:
        return math.nan, math.nan
    wound = np.array([then[x].lost_m for x in common])
    more = np.array([now[x].lost_m for x in common]) - wound * (1 + softer)
    own = np.array([[one[x].standard_uncertainty_m for x in common] for one in (now, then)])
    told = math.sqrt(float(np.nansum(own**2))) / len(common)
    scatter = float(np.std(more, ddof=1)) / math.sqrt(len(common)) if len(common) > 1 else 0.0
    spread = math.hypot(max(told, scatter), _WOUND * softer * abs(float(wound.mean())))
    return (float(more.mean()), spread) if spread > 0 else (math.nan, math.nan)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def agree(
    one: tuple[Run, FrequencyTable],
    other: tuple[Run, FrequencyTable],
    model: CalibratedAxis,
    settings: MonitorSettings,
) -> bool:
    """Whether two runs belong to one state of the axis.

    Parameters
    ----------
    one, other : tuple of Run and FrequencyTable
        Good by themselves.
    model : CalibratedAxis
        Of the axis.
    settings : MonitorSettings
        What is plausible.

    Returns
    -------
    bool
        False where masses, FRF or cells say that something else has changed.
    """
    if _not_comparable(*one, *other, model):
        return False
    change, fused = fused_change(one[1], other[1], model, settings)
    return not _against_the_epoch(one[0], other[0], change, fused, model, settings)[0]
