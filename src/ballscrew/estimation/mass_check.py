"""Is the load what was declared?  The run's own masses against the baseline's, and what is done about it.

The equivalent mass of a run is force over acceleration. It grows by a heavier load, and as much by a torque
constant that has drifted with the motor's heat. A load also moves every frequency and parts the rotor-free
from the rotor-held one; a torque constant moves neither, but friction seems to change by as much. The rule:

1. No change beyond its 95 % interval: the declared load stands, but where all that the run shows says at odds
   of ten that it is wrong: then the run is refused.
2. The torque constant is said to be trusted: the load is corrected by the change of the equivalent mass.
3. Else all that the run shows decides, see :mod:`ballscrew.estimation.causes`: where a wrong load is thirty
   times as probable as a drifted torque the load is corrected, where the torque is, the declared load stands.
4. Else nobody can tell. The preload is read half way between the two, by their probabilities, with an
   interval that holds both; where the two are too far apart for that to be of use the run is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ballscrew.axis.axial import AxialModel
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.estimation.causes import Cause, Masses
from ballscrew.modal.run import Run

__all__ = ["Decision", "MassCheck", "check_mass", "mass_changes"]

Decision = Literal["declared", "corrected", "torque", "undecided", "unknown"]
_LEAST = 1e-9  # kg or N: no machine has less
_MOST = 10.0  # times itself by which a value may be uncertain and still tell anything


@dataclass(frozen=True, slots=True)
class MassCheck:
    """What was found, and what was decided.

    Parameters
    ----------
    decision : {"declared", "corrected", "torque", "undecided", "unknown"}
        The declared load stands; it is corrected; the torque constant has drifted; nobody can tell; the runs
        do not tell their equivalent masses.
    change : Quantity or None
        Of the equivalent mass since the baseline beyond what was declared, kg.
    correction : float
        What is added to the declared load, kg.
    standard_uncertainty : float
        Of the run's load, kg, where the masses tell it.
    text : str
        What was decided and why.
    unseen : float
        A plausible wrong load that the masses would not show, kg, where it would move the preload by more
        than its own interval; else 0.
    refused : bool
        Whether the preload cannot be told because of it.
    """

    decision: Decision
    change: Quantity | None
    correction: float
    standard_uncertainty: float
    text: str
    unseen: float = 0.0
    refused: bool = False

    def to_json(self) -> dict[str, Any]:
        """As ``preload --json`` prints it."""
        return {
            "decision": self.decision,
            "change_kg": None if self.change is None else self.change.to_json(),
            "correction_kg": self.correction,
            "standard_uncertainty_kg": self.standard_uncertainty,
            "unseen_kg": self.unseen,
            "refused": self.refused,
            "text": self.text,
        }


def mass_changes(run: Run, baseline: Run, model: AxialModel, assumptions: Assumptions) -> Masses | None:
    """Changes of masses and friction since the baseline.

    Parameters
    ----------
    run, baseline : Run
        Two runs of one axis.
    model : AxialModel
        What moves besides the load.
    assumptions : Assumptions
        What repeats.

    Returns
    -------
    Masses or None
        None where a run does not tell its equivalent mass.
    """
    now, then = run.rigid_body, baseline.rigid_body
    pair = [_known(body, "equivalent_mass_kg") for body in (now, then)]
    if pair[0] is None or pair[1] is None or run.mass_kg is None or baseline.mass_kg is None:
        return None
    (mass, u), (mass0, u0) = pair[0], pair[1]
    expected = mass0 + run.mass_kg - baseline.mass_kg
    if expected <= 0:
        return None
    # Most of what a fit may err by is friction and filters, the same in both runs.
    anew = 1 - assumptions.repeats
    spread = math.sqrt(anew * ((u / mass) ** 2 + (u0 / mass0) ** 2) + assumptions.mass_repeats**2)
    friction = {
        name: (math.log(one[0] / other[0]), math.hypot(one[1] / one[0], other[1] / other[0]))
        for name in ("viscous_N_s_per_m", "coulomb_N")
        if (one := _known(now, name)) is not None and (other := _known(then, name)) is not None
    }
    rubbing = friction.get("coulomb_N", (0.0, 0.0))[0]
    spread = math.hypot(spread, assumptions.mass_friction * rubbing)
    parted, parted_spread = _parted(run, baseline, model)
    moving = model.mass + baseline.mass_kg
    by_load = 1 / (model.rotor + moving) if math.isfinite(model.rotor) else 0.0
    return Masses(
        math.log(mass / expected), spread, 1 / mass0, parted, parted_spread, by_load, tuple(friction.values())
    )


def check_mass(
    masses: Masses | None,
    found: tuple[Cause, ...],
    mass: float,
    harm: float,
    assumptions: Assumptions,
) -> MassCheck:
    """Decide by the rule.

    Parameters
    ----------
    masses : Masses or None
        What the runs tell.
    found : tuple of Cause
        Compared on all that the run shows.
    mass : float
        Equivalent mass of the baseline, kg.
    harm : float
        By how much of its own standard uncertainty the preload would err by a kg, 1/kg.
    assumptions : Assumptions
        Whether the torque is trusted.

    Returns
    -------
    MassCheck
        With its reason in words.
    """
    if masses is None:
        text = "the runs do not tell their equivalent masses, so nothing checks the declared load"
        return MassCheck("unknown", None, 0.0, 0.0, text)
    change = Quantity(mass * math.expm1(masses.inertia), mass * masses.inertia_spread, "kg")
    seen = f"the equivalent mass has changed by {change.value:+.2f} kg ± {change.standard_uncertainty:.2f} kg"
    spread = change.standard_uncertainty
    chances = {cause.name: cause.probability for cause in found}
    load, torque = chances.get("load", 0.0), chances.get("torque", 0.0)
    if abs(change.value) <= NORMAL_95 * spread:
        if load > assumptions.priors.loud * (1 - load):
            text = (
                f"{seen}, which is within its interval, but the frequencies changed as by a load not as "
                f"declared (probability {load:.2f}): the preload cannot be told"
            )
            return MassCheck("undecided", change, 0.0, spread, text, refused=True)
        text = f"{seen}: the declared load stands"
        unseen = NORMAL_95 * min(spread, assumptions.wrong_load * mass)
        if unseen * harm <= NORMAL_95:
            return MassCheck("declared", change, 0.0, 0.0, text)
        text += (
            f", but one that is {unseen:.2g} kg off would not be seen, and would move the preload by more "
            "than its own interval"
        )
        return MassCheck("declared", change, 0.0, 0.0, text, unseen)
    if assumptions.torque_trusted:
        text = f"{seen}, and the torque constant is trusted: the declared load is corrected by that"
        return MassCheck("corrected", change, change.value, spread, text)
    if assumptions.torque_trusted is None and load > assumptions.priors.odds * torque:
        text = (
            f"{seen}, and the frequencies changed as by a load and not as by a drifted torque constant "
            f"({_times(load, torque)}): the declared load is corrected by that"
        )
        return MassCheck("corrected", change, change.value, spread, text)
    if assumptions.torque_trusted is False or torque > assumptions.priors.odds * load:
        text = (
            f"{seen}, but the frequencies did not change as by a load ({_times(torque, load)}): the torque "
            "constant has drifted, which moves no frequency, and the declared load stands"
        )
        return MassCheck("torque", change, 0.0, 0.0, text)
    both = f"{seen}, and a load not as declared explains it about as well as a drifted torque constant"
    if abs(change.value) * harm > assumptions.priors.apart:
        text = f"{both}: the preload cannot be told"
        return MassCheck("undecided", change, 0.0, abs(change.value), text, refused=True)
    part = load / max(load + torque, 1e-12)
    farther = abs(change.value) * max(part, 1 - part) / NORMAL_95
    text = f"{both}: the interval holds the preload with the correction and without it"
    return MassCheck("undecided", change, part * change.value, math.hypot(farther, part * spread), text)


def _times(more: float, less: float) -> str:
    return f"{more / less:.0f} times as probable" if less > more * 1e-3 else "1000 times as probable and more"


def _known(body: Any, name: str) -> tuple[float, float] | None:
    value, spread = getattr(body, name), body.standard_uncertainty.get(name)
    if value is None or spread is None or not (value > _LEAST and 0 <= spread < _MOST * value < math.inf):
        return None
    return float(value), float(spread)


def _parted(run: Run, baseline: Run, model: AxialModel) -> tuple[float | None, float | None]:
    """Change of ln (f_free/f_held)² beyond that of the declared loads; its error is one for all cells."""
    if not math.isfinite(model.rotor) or run.mass_kg is None or baseline.mass_kg is None:
        return None, None
    declared = math.log(
        (model.rotor + model.mass + run.mass_kg) / (model.rotor + model.mass + baseline.mass_kg)
    )
    values, spreads = [], []
    ratios = [_ratios(one) for one in (run, baseline)]
    for key in ratios[0].keys() & ratios[1].keys():
        (now, u), (then, u0) = ratios[0][key], ratios[1][key]
        values.append(now - then - declared)
        spreads.append(math.hypot(u, u0))
    if not values:
        return None, None
    return float(np.median(values)), float(np.median(spreads))


def _ratios(run: Run) -> dict[tuple[float, str, int], tuple[float, float]]:
    found = {}
    for cell in run.cells:
        f, held = cell.frequency_Hz, cell.rotor_held_frequency_Hz
        u, uh = cell.standard_uncertainty_Hz, cell.rotor_held_standard_uncertainty_Hz
        if cell.verdict == "refused" or not f or not held or u is None or uh is None or held <= 0 or f <= 0:
            continue
        found[cell.position_m, cell.condition, cell.motion] = (
            2 * math.log(f / held),
            2 * math.hypot(u / f, uh / held),
        )
    return found
