"""Check of the declared load by the equivalent masses of run and baseline.

The equivalent mass of a run is force over acceleration. A heavier load increases it, and so does a torque
constant that has drifted as the motor warmed up. They differ in their other effects: a load changes every
frequency and the ratio of the rotor-free to the rotor-held one; a torque constant changes neither, but
friction appears to change in the same proportion as the mass. The first of these rules that applies decides:

1. The equivalent mass has not changed significantly, at 95 %: the declared load stands. If all observations
   together give odds of ten that it is wrong all the same, the run is refused.
2. The user states that the torque constant is trusted: the load is corrected by the change of the equivalent
   mass. The user states that it is not trusted: the load stands.
3. All observations together decide, see :mod:`ballscrew.estimation.causes`: where a wrong load is more than
   thirty times as probable as a drifted torque constant, the load is corrected; in the opposite case it
   stands.
4. The observations do not decide. The correction is the change times p/(p + q), with the probabilities p of a
   wrong load and q of a drifted torque constant, and the interval of the preload contains those without
   correction and with the whole one. Where these two preloads differ too much for such an interval to be
   useful, the run is refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ballscrew.axis.axial import AxialModel
from ballscrew.base.quantity import NORMAL_95, Quantity, quantity_json
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.causes import MassChanges, PossibleCause
from ballscrew.modal.cell import CellKey, CellResult
from ballscrew.modal.run import RigidBodyResult, Run

Decision = Literal["declared", "corrected", "torque", "undecided", "unknown"]
_LEAST_VALUE = 1e-9  # kg, N or N s/m: the logarithm of a smaller mass or friction is not compared
_LARGEST_UNCERTAINTY = 10.0  # relative standard uncertainty from which a value is not used

_ValueAndUncertainty = tuple[float, float]  # in one unit


@dataclass(frozen=True, slots=True)
class MassCheck:
    """Change of the equivalent mass and the decision on the declared load.

    Parameters
    ----------
    decision : {"declared", "corrected", "torque", "undecided", "unknown"}
        The declared load stands; it is corrected; it stands, since the torque constant has drifted or is not
        trusted; the observations do not decide; or it is not checked, since a run has no equivalent mass.
    change : Quantity or None
        Of the equivalent mass since the baseline beyond the declared change of the load, kg.
    correction : float
        Correction of the declared load, which is added to it, kg.
    standard_uncertainty : float
        Of the corrected load, kg; 0 where the declared load stands with its assumed uncertainty.
    text : str
        The decision and its reason in words.
    undetectable : float
        Largest plausible error of the load that the masses do not detect, kg, where it would change the
        preload by more than the half-width of its interval; else 0.
    refused : bool
        Whether the load is too uncertain to estimate the preload.
    """

    decision: Decision
    change: Quantity | None
    correction: float
    standard_uncertainty: float
    text: str
    undetectable: float = 0.0
    refused: bool = False

    def to_json(self) -> dict[str, Any]:
        """Object ``mass`` in the output of ``preload --json``."""
        return {
            "decision": self.decision,
            "change_kg": quantity_json(self.change),
            "correction_kg": self.correction,
            "standard_uncertainty_kg": self.standard_uncertainty,
            "undetectable_kg": self.undetectable,
            "refused": self.refused,
            "text": self.text,
        }


def mass_changes(
    run: Run, baseline: Run | None, model: AxialModel, assumptions: Assumptions
) -> MassChanges | None:
    """Changes of masses and friction since the baseline.

    Parameters
    ----------
    run : Run
        Analysed.
    baseline : Run or None
        Of the same axis.
    model : AxialModel
        With the moving mass and the rotor.
    assumptions : Assumptions
        With the errors that differ from run to run.

    Returns
    -------
    MassChanges or None
        None without a baseline, or where a run has no load or no equivalent mass.
    """
    if baseline is None or run.mass_kg is None or baseline.mass_kg is None:
        return None
    of_run = _with_repeatability(run.rigid_body, "equivalent_mass_kg", assumptions.repeats)
    of_baseline = _with_repeatability(baseline.rigid_body, "equivalent_mass_kg", assumptions.repeats)
    if of_run is None or of_baseline is None:
        return None
    mass, spread = of_run
    base_mass, base_spread = of_baseline
    expected = base_mass + run.mass_kg - baseline.mass_kg
    if expected <= 0:
        return None
    relative_spread = math.hypot(spread / mass, base_spread / base_mass, assumptions.mass_repeats)
    friction = _friction_changes(run.rigid_body, baseline.rigid_body)
    coulomb_change, _ = friction.get("coulomb_N", (0.0, 0.0))
    ratio, ratio_spread = _frequency_ratio_change(run, baseline, model)
    return MassChanges(
        log_mass=math.log(mass / expected),
        # The rigid-body fit does not separate a change of the friction from the mass completely.
        log_mass_spread=math.hypot(relative_spread, assumptions.mass_friction * coulomb_change),
        log_mass_by_load=1 / expected,
        log_frequency_ratio=ratio,
        log_frequency_ratio_spread=ratio_spread,
        # The ratio is 1 + m_t/m_r.
        log_frequency_ratio_by_load=1 / (model.rotor + (model.mass + run.mass_kg)),
        moving_mass=model.mass + run.mass_kg,
        log_friction=tuple(friction.values()),
    )


def _friction_changes(body: RigidBodyResult, baseline: RigidBodyResult) -> dict[str, _ValueAndUncertainty]:
    """Changes of ln friction with their standard uncertainties, of each friction that both runs determine."""
    changes = {}
    for name in ("viscous_N_s_per_m", "coulomb_N"):
        of_run = _with_repeatability(body, name)
        of_baseline = _with_repeatability(baseline, name)
        if of_run is not None and of_baseline is not None:
            value, spread = of_run
            base_value, base_spread = of_baseline
            changes[name] = math.log(value / base_value), math.hypot(spread / value, base_spread / base_value)
    return changes


def check_mass(
    masses: MassChanges | None,
    causes: Sequence[PossibleCause],
    sensitivity: float,
    assumptions: Assumptions,
) -> MassCheck:
    """Decide by the rules of this module whether the declared load stands.

    Parameters
    ----------
    masses : MassChanges or None
        Since the baseline; None where a run does not determine its equivalent mass.
    causes : sequence of PossibleCause
        By all observations of the run with its declared load.
    sensitivity : float
        Change of the preload per kg of load, over the standard uncertainty of the preload, 1/kg.
    assumptions : Assumptions
        Whether the torque constant is trusted, and the odds that decide.

    Returns
    -------
    MassCheck
        With its reason.
    """
    if masses is None:
        text = "a run has no equivalent mass, so the declared load could not be checked"
        return MassCheck("unknown", None, 0.0, 0.0, text)
    # Probabilities that the load is wrong, and that the torque constant has drifted.
    probabilities = {cause.name: cause.probability for cause in causes}
    load = probabilities.get("load", 0.0)
    torque = probabilities.get("torque", 0.0)
    expected = 1 / masses.log_mass_by_load  # equivalent mass with the declared load, kg
    change = Quantity(expected * math.expm1(masses.log_mass), expected * masses.log_mass_spread, "kg")
    found = (
        f"the equivalent mass has changed by {change.value:+.2f} kg ± {change.standard_uncertainty:.2f} kg"
    )
    if abs(change.value) <= NORMAL_95 * change.standard_uncertainty:
        plausible = assumptions.wrong_load * masses.moving_mass
        return _without_change(change, found, plausible, sensitivity, load, assumptions)
    trusted, odds = assumptions.torque_trusted, assumptions.priors.odds
    if trusted:
        text = f"{found}, and the torque constant is trusted: the declared load is corrected by this amount"
        return MassCheck("corrected", change, change.value, change.standard_uncertainty, text)
    if trusted is None and load > odds * torque:
        text = (
            f"{found}, and the frequencies changed as they would with another load, not with a drifted "
            f"torque constant ({_describe_odds(load, torque)}): the declared load is corrected by this amount"
        )
        return MassCheck("corrected", change, change.value, change.standard_uncertainty, text)
    if trusted is False:
        text = f"{found}, and the torque constant is not trusted: the declared load stands"
        return MassCheck("torque", change, 0.0, 0.0, text)
    if torque > odds * load:
        text = (
            f"{found}, but the frequencies did not change as they would with another load "
            f"({_describe_odds(torque, load)}): the torque constant has drifted, which changes no frequency, "
            "and the declared load stands"
        )
        return MassCheck("torque", change, 0.0, 0.0, text)
    return _undecided(change, found, sensitivity, load, torque, assumptions)


def _without_change(
    change: Quantity, found: str, plausible: float, sensitivity: float, load: float, assumptions: Assumptions
) -> MassCheck:
    """Rule 1: the equivalent mass has not changed significantly.

    ``change`` is that of the equivalent mass, ``found`` the beginning of the sentence, ``plausible`` the
    standard deviation of an error of the load (kg), and ``load`` the probability of such an error.
    """
    spread = change.standard_uncertainty
    if load > assumptions.priors.load_odds * (1 - load):
        text = (
            f"{found}, which is not significant, but the frequencies changed as they would with a wrongly "
            f"declared load (probability {load:.2f}): the preload cannot be estimated"
        )
        return MassCheck("undecided", change, 0.0, spread, text, refused=True)
    text = f"{found}: the declared load stands"
    undetectable = NORMAL_95 * min(spread, plausible)
    if undetectable * sensitivity <= NORMAL_95:
        return MassCheck("declared", change, 0.0, 0.0, text)
    text += (
        f", but an error of {undetectable:.2g} kg would not be detected, and would change the preload by "
        "more than its own interval"
    )
    return MassCheck("declared", change, 0.0, 0.0, text, undetectable)


def _undecided(
    change: Quantity, found: str, sensitivity: float, load: float, torque: float, assumptions: Assumptions
) -> MassCheck:
    """Rule 4: the odds of a wrong load against a drifted torque constant do not decide.

    ``change`` is that of the equivalent mass, ``found`` the beginning of the sentence, and ``load`` and
    ``torque`` are the probabilities of the two causes.
    """
    found += ", and a wrongly declared load explains it about as well as a drifted torque constant"
    size = abs(change.value)
    if size * sensitivity > assumptions.priors.separation:
        text = f"{found}: the preload cannot be estimated"
        return MassCheck("undecided", change, 0.0, size, text, refused=True)
    part = load / max(load + torque, 1e-12)  # of the change, by which the load is corrected
    # The 95 % interval about this correction contains no correction and that by the whole change.
    half_width = size * max(part, 1 - part)
    spread = math.hypot(half_width / NORMAL_95, part * change.standard_uncertainty)
    text = f"{found}: the interval contains the preload with and without the correction"
    return MassCheck("undecided", change, part * change.value, spread, text)


def _describe_odds(more: float, less: float) -> str:
    """Ratio of two probabilities in words; ``more`` is the larger one."""
    if less > more * 1e-3:
        return f"{more / less:.0f} times as probable"
    return "more than 1000 times as probable"


def _with_repeatability(
    body: RigidBodyResult, name: str, repeats: float = 0.0
) -> _ValueAndUncertainty | None:
    """Value and repeatability of a rigid-body result; None where it is missing or too uncertain.

    The repeatability is the standard uncertainty without the errors of the fit that are alike in both runs,
    such as those by filters. Where a run states none, the part ``repeats`` of the variance is assumed to be
    common to both runs.
    """
    value = getattr(body, name)
    whole_spread = body.standard_uncertainty.get(name)
    if value is None or whole_spread is None:
        return None
    spread = body.repeatability.get(name, math.sqrt(1 - repeats) * whole_spread)
    if not (value > _LEAST_VALUE and 0 <= spread < _LARGEST_UNCERTAINTY * value < math.inf):
        return None
    return float(value), float(spread)


def _frequency_ratio_change(run: Run, baseline: Run, model: AxialModel) -> tuple[float | None, float | None]:
    """Change of ln (f_free/f_held)² beyond that by the declared loads, and its standard uncertainty.

    (f_free/f_held)² is 1 + m_t/m_r with the moving mass m_t and the mass m_r of the rotor. Both results are
    medians over the cells that both runs have. The uncertainty is that of one cell, since the errors of all
    cells are common.
    """
    if not math.isfinite(model.rotor) or run.mass_kg is None or baseline.mass_kg is None:
        return None, None
    without_load = model.rotor + model.mass
    declared = math.log((without_load + run.mass_kg) / (without_load + baseline.mass_kg))
    ratios = _log_frequency_ratios(run)
    base_ratios = _log_frequency_ratios(baseline)
    changes, spreads = [], []
    for cell in ratios.keys() & base_ratios.keys():
        ratio, spread = ratios[cell]
        base_ratio, base_spread = base_ratios[cell]
        changes.append(ratio - base_ratio - declared)
        spreads.append(math.hypot(spread, base_spread))
    if not changes:
        return None, None
    return float(np.median(changes)), float(np.median(spreads))


def _log_frequency_ratios(run: Run) -> dict[CellKey, _ValueAndUncertainty]:
    """Value of ln (f_free/f_held)² and its standard uncertainty in each cell that has both frequencies."""
    ratios = {}
    for cell in run.cells:
        ratio = _log_frequency_ratio(cell)
        if ratio is not None and cell.verdict != "refused":
            ratios[cell.key.rounded] = ratio
    return ratios


def _log_frequency_ratio(cell: CellResult) -> _ValueAndUncertainty | None:
    """Value of ln (f_free/f_held)² in a cell with its standard uncertainty; None without both frequencies."""
    free, rotor_held = cell.frequency_Hz, cell.rotor_held_frequency_Hz
    free_spread, rotor_held_spread = cell.standard_uncertainty_Hz, cell.rotor_held_standard_uncertainty_Hz
    if free is None or rotor_held is None or free_spread is None or rotor_held_spread is None:
        return None
    if free <= 0 or rotor_held <= 0:
        return None
    spread = 2 * math.hypot(free_spread / free, rotor_held_spread / rotor_held)
    return 2 * math.log(free / rotor_held), spread
