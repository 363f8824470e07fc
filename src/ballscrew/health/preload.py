"""How much preload is left: the frequencies of a run, a calibrated model, and a baseline where there is one.

With a baseline only the nut's share of the compliance is asked of the model, and errors that repeat from run
to run cancel. Without one the model's own frequencies take the baseline's place, and all that it errs by
counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError, shown
from ballscrew.base.provenance import Made
from ballscrew.health.along import along_the_axis
from ballscrew.health.assumptions import Assumptions
from ballscrew.health.calibrated import Calibrated
from ballscrew.health.causes import Cause, causes, seen
from ballscrew.health.change import Change, Term
from ballscrew.health.drawn import Drawn, share_spread
from ballscrew.health.estimate import PreloadEstimate
from ballscrew.health.fusion import Fused, fuse
from ballscrew.health.mass_check import MassCheck, check_mass, masses_of
from ballscrew.health.method import one_method
from ballscrew.health.observed import Observed, observed
from ballscrew.health.relative import change_from_model, change_since, paired
from ballscrew.health.verdict import beside, no_limit, why_not_good
from ballscrew.modal.run import Run

__all__ = ["PreloadEstimate", "preload", "warmth"]

Array = NDArray[np.float64]
_MOST_LOAD = 0.25  # of all that moves: beyond it the model's mass decides, not the nut
_TURNS = 12
_BENT = 1e-3  # of the compliance: a screw that is held at one end has no curve


def preload(
    run: Run,
    model: Calibrated,
    baseline: Run | None = None,
    *,
    more: Sequence[Run] = (),
    assumptions: Assumptions | None = None,
) -> PreloadEstimate:
    """Tell the preload of a run.

    Parameters
    ----------
    run : Run
        Analysed.
    model : Calibrated
        Of the same axis.
    baseline : Run, optional
        What the preload is told relative to; the same plan at the same load.
    more : sequence of Run
        Further runs of the baseline's days: they teach what the temperature does.
    assumptions : Assumptions, optional
        What no run can show.

    Returns
    -------
    PreloadEstimate
        Refused, with the reasons, where the run cannot tell it.

    Raises
    ------
    InputError
        If run, model and baseline are not of one axis, one plan and one load, or a number cannot be.
    """
    kept = assumptions or Assumptions()
    _check(run, model, baseline, more)
    job = _Job(run, model, baseline, tuple(more), kept)
    if run.quality.verdict == "bad":
        return job.refused("the measurement is bad: " + "; ".join(run.quality.reasons or ("it was refused",)))
    table = observed(run, rotor=model.rotor)
    if not len(table.frequency):
        return job.refused("no cell of the run has a frequency")
    base = None
    if baseline is not None:
        base = observed(baseline, rotor=model.rotor)
        if baseline.quality.verdict == "bad" or not len(base.frequency):
            return job.refused("the baseline has no cell with a frequency")
        if not paired(table, base)[0]:
            return job.refused("no cell of the run has a frequency in the baseline too")
    return job.told(table, base)


def warmth(
    levels: Sequence[tuple[float, float]], temperatures: Sequence[float], assumptions: Assumptions
) -> tuple[float, float]:
    """What a kelvin does to ln P, learned from runs between which nothing wore.

    Parameters
    ----------
    levels : sequence of (float, float)
        ln P of each against the first, with its random standard uncertainty.
    temperatures : sequence of float
        Of each less the first's, K.
    assumptions : Assumptions
        Says what is believed before: 0 ± so much.

    Returns
    -------
    slope, standard_uncertainty : float
        1/K.
    """
    information, pull = 1 / max(assumptions.temperature, 1e-9) ** 2, 0.0
    for (level, spread), warmer in zip(levels, temperatures, strict=True):
        weight = 1 / max(spread, 1e-6) ** 2
        information += weight * warmer**2
        pull += weight * warmer * level
    return pull / information, 1 / math.sqrt(information)


@dataclass(frozen=True)
class _Job:
    run: Run
    model: Calibrated
    baseline: Run | None
    more: tuple[Run, ...]
    kept: Assumptions

    def refused(self, reason: str, **others: Any) -> PreloadEstimate:
        nothing: dict[str, Any] = dict.fromkeys(
            (
                "preload_N",
                "preload_ratio",
                "relative_to_baseline",
                "relative_to_model",
                "random_N",
                "systematic_N",
                "random_ratio",
                "systematic_ratio",
                "chi2",
                "degrees",
                "probability",
                "mass",
                "along",
                "change",
                "fused",
            )
        )
        nothing |= {"terms": (), "notes": (), "causes": (), "corrections": (), "verdict": "refused"}
        return PreloadEstimate(**(self._head() | nothing | {"reasons": (reason,)} | others))

    def _head(self) -> dict[str, Any]:
        inputs = {"run": self.run.id}
        if self.baseline is not None:
            inputs["baseline"] = self.baseline.id
        for index, one in enumerate(self.more):
            inputs[f"baseline {index + 2}"] = one.id
        return {
            "run": self.run.id,
            "baseline": None if self.baseline is None else self.baseline.id,
            "axis": self.run.axis,
            "measured_at": self.run.measured_at,
            "made": Made(inputs=inputs, settings=asdict(self.kept)),
        }

    def told(self, table: Observed, base: Observed | None) -> PreloadEstimate:
        drawn = Drawn(self.model, base)
        own = None if base is not None else self.model.covariance
        change, fused = self._fused(table, base, drawn.level, own)
        warmer = self._warmer()
        masses = None
        if self.baseline is not None:
            masses = masses_of(self.run, self.baseline, self.model.model, self.kept)
        found = causes(seen(change, masses, self.kept, warmer=warmer, model_covariance=own))
        mass, corrections = None, []
        if self.baseline is not None:
            mass = self._mass(change, fused, masses, found)
            if mass.correction:
                change, fused = self._fused(table, base, drawn.level, own, mass.correction)
                corrections.append(f"load: {mass.correction:+.2f} kg")
            if mass.standard_uncertainty:
                change = _other_load(change, mass.standard_uncertainty)
            if mass.decision != "declared":
                fused = fuse(change, own)
        slope, slope_spread = self._warmth(base) if warmer else (0.0, 0.0)
        if warmer and slope:
            corrections.append(f"temperature: {-100 * slope * warmer:+.1f} % for {warmer:+.1f} K")
        numbers = drawn.ratio(change, fused, self.kept, (slope * (warmer or 0), slope_spread * (warmer or 0)))
        given = {
            "chi2": fused.chi2,
            "degrees": fused.degrees,
            "probability": fused.probability,
            "causes": found,
            "mass": mass,
            "corrections": tuple(corrections),
            "change": change,
            "fused": fused,
        }
        if mass is not None and mass.decision == "undecided" and "cannot" in mass.text:
            return self.refused(mass.text, **given)
        if numbers is None:
            return self.refused(no_limit(fused), **given)
        axial = self.model.model
        curved = abs(axial.curve) * float(np.ptp(change.position)) ** 2 > _BENT
        doubt = share_spread(self.model, self.kept)
        local = along_the_axis(self.run, self.baseline, change, fused, doubt, curved, self.kept.form)
        reasons = why_not_good(self.run, self.baseline, self.kept, change, fused, found, mass, local, numbers)
        verdict = "suspect" if reasons else "good"
        notes = beside(self.run, self.baseline, self.model, self.kept, found, mass)
        return PreloadEstimate(
            **(
                self._head()
                | given
                | numbers
                | {
                    "along": local,
                    "verdict": verdict,
                    "reasons": tuple(reasons),
                    "notes": tuple(notes),
                }
            )
        )

    def _fused(
        self, table: Observed, base: Observed | None, level: float, own: Array | None, correction: float = 0.0
    ) -> tuple[Change, Fused]:
        """The load on the nut counts by the preload that is sought: a few turns settle it."""
        ratio = 1.0
        for _ in range(_TURNS):
            change = self._change(table, base, level, correction, ratio)
            fused = fuse(change, own)
            # Half way: the two pull each other, and would swing.
            ratio = 0.5 * (ratio + min(max(1 + fused.level, 0.5), 2.0) ** -3)
        return change, fused

    def _change(
        self, table: Observed, base: Observed | None, level: float, correction: float, ratio: float
    ) -> Change:
        bearing, model = self.model.bearing_share, self.model.model
        if base is None:
            return change_from_model(table, model, bearing, self.kept, ratio)
        more = table.load - base.load + correction
        return change_since(table, base, model, bearing, level, self.kept, load_change=more, ratio=ratio)

    def _mass(self, change: Change, fused: Fused, masses: Any, found: tuple[Cause, ...]) -> MassCheck:
        assert self.baseline is not None  # noqa: S101  asked for only then
        by_kilogram = abs(float(fused.weights @ change.mass))
        spread = math.hypot(fused.spread, abs(fused.level) * self.model.standard_uncertainty("share"))
        mass = self.baseline.rigid_body.equivalent_mass_kg or 0.0
        return check_mass(masses, found, mass, by_kilogram / max(spread, 1e-12), self.kept)

    def _warmer(self) -> float | None:
        if self.baseline is None or self.run.temperature_C is None or self.baseline.temperature_C is None:
            return None
        return self.run.temperature_C - self.baseline.temperature_C

    def _warmth(self, base: Observed | None) -> tuple[float, float]:
        levels, temperatures = [], []
        if base is not None and self.baseline is not None and self.baseline.temperature_C is not None:
            for one in self.more:
                other = observed(one, rotor=self.model.rotor)
                if one.temperature_C is None or one.id == self.run.id or not paired(other, base)[0]:
                    continue
                fused = fuse(self._change(other, base, 1.0, 0.0, 1.0))
                levels.append((-3 * math.log(max(1 + fused.level, 0.1)), 3 * max(fused.random, 1e-4)))
                temperatures.append(one.temperature_C - self.baseline.temperature_C)
        return warmth(levels, temperatures, self.kept)


def _other_load(change: Change, spread: float) -> Change:
    """The run's masses say how sure its load is, in the place of what is taken for granted."""
    terms = [
        Term(t.name, t.random, (change.mass * spread)[None]) if t.name == "declared load" else t
        for t in change.terms
    ]
    return replace(change, terms=tuple(terms))


def _check(run: Run, model: Calibrated, baseline: Run | None, more: Sequence[Run]) -> None:
    method = one_method([run, *([] if baseline is None else [baseline]), *more])
    for used in model.runs:
        if method is not None and used.method not in (None, method):
            raise InputError(
                f"the run is by method {method}, the model was calibrated with runs by method {used.method}; "
                "they must be by one method: analyse them again."
            )
    for one, what in ((run, "the run"), (baseline, "the baseline"), *((m, "a baseline") for m in more)):
        if one is None:
            continue
        if one.axis is not None and model.axis and one.axis != model.axis:
            raise InputError(
                f"{what} is of the axis {shown(one.axis)}, the model of {shown(model.axis)}; they must be of "
                "one axis."
            )
        if one.mass_kg is None:
            raise InputError(f"{what} {shown(one.id)[1:13]} tells no load; analyse it with --mass.")
        plan, other = one.made.inputs.get("plan"), run.made.inputs.get("plan")
        if plan is not None and other is not None and plan != other:
            raise InputError(
                f"{what} was measured by another plan than the run; a change takes the same plan for both."
            )
        moving = model.model.mass + (run.mass_kg or 0.0)
        if abs(one.mass_kg - (run.mass_kg or 0.0)) > _MOST_LOAD * moving:
            raise InputError(
                f"{what} was measured with {one.mass_kg:g} kg, the run with {run.mass_kg:g} kg; a change "
                "takes about the same load."
            )
