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

from ballscrew.base.arrays import Array
from ballscrew.base.provenance import Made
from ballscrew.base.threads import single_threaded
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable, frequency_table
from ballscrew.estimation.cause import Cause
from ballscrew.estimation.causes import Masses, compare_causes, gather_evidence
from ballscrew.estimation.change import ComplianceChange, Term
from ballscrew.estimation.comparable import check_comparable
from ballscrew.estimation.compliance import WORN, change_from_model, change_since, paired
from ballscrew.estimation.estimate import PreloadEstimate
from ballscrew.estimation.fusion import FusedChange, fuse, fuse_on_worn_nut
from ballscrew.estimation.inflation import widened
from ballscrew.estimation.local_wear import along_the_axis
from ballscrew.estimation.mass_check import MassCheck, check_mass, mass_changes
from ballscrew.estimation.samples import Drawn, by_baseline, share_uncertainty
from ballscrew.estimation.temperature import NO_WARMTH, Warmth, warmed, warmth
from ballscrew.estimation.verdict import beside, no_limit, why_not_good
from ballscrew.modal.run import Run

__all__ = ["PreloadEstimate", "preload", "warmth"]

_WORTH_A_WORD = 0.05  # % of the preload
_BENT = 1e-3  # of the compliance: a screw that is held at one end has no curve


@single_threaded
def preload(
    run: Run,
    model: CalibratedAxis,
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
    model : CalibratedAxis
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
    check_comparable(run, model, baseline, more)
    job = _Job(run, model, baseline, tuple(more), kept)
    if run.quality.verdict == "bad":
        return job.refused("the measurement is bad: " + "; ".join(run.quality.reasons or ("it was refused",)))
    table = frequency_table(run, rotor=model.rotor)
    if not len(table.frequency):
        return job.refused("no cell of the run has a frequency")
    base = None
    if baseline is not None:
        base = frequency_table(baseline, rotor=model.rotor)
        if baseline.quality.verdict == "bad" or not len(base.frequency):
            return job.refused("the baseline has no cell with a frequency")
        if not paired(table, base)[0]:
            return job.refused("no cell of the run has a frequency in the baseline too")
    return job.told(table, base)


@dataclass(frozen=True)
class _Job:
    run: Run
    model: CalibratedAxis
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

    def told(self, table: FrequencyTable, base: FrequencyTable | None) -> PreloadEstimate:
        drawn = Drawn(self.model, base, self.kept)
        if not math.isfinite(drawn.level):
            return self.refused(
                "the baseline's frequencies lie above those of an infinitely stiff nut: it belongs to "
                "another axis or load, or the model does"
            )
        own = None if base is not None else self.model.covariance
        change, fused, ratio = self._fused(table, base, drawn.level, own)
        warmer = _warmer(table, base)
        masses = None
        if self.baseline is not None:
            masses = mass_changes(self.run, self.baseline, self.model.model, self.kept)
        shown_ = gather_evidence(change, masses, self.kept, warmer=warmer, model_covariance=own)
        found = compare_causes(shown_, self.kept)
        mass, corrections = None, []
        if base is not None:
            mass = self._mass(change, fused, masses, found, base)
            if mass.correction:
                change, fused, ratio = self._fused(table, base, drawn.level, own, mass.correction)
                corrections.append(f"load: {mass.correction:+.2f} kg")
            if mass.standard_uncertainty:
                change = _other_load(change, mass.standard_uncertainty)
            if mass.decision != "declared":
                fused = fuse(change, own)
        corrections += self._worn(table, base, drawn.level, fused, ratio, mass)
        fused = widened(fused, shown_, found, self.kept)
        warm = self._warmth(base, warmer)
        alone = None if drawn.calibrated_with else self._alone(table, mass)
        numbers = drawn.ratio(change, fused, warm, alone)
        given = {
            "chi2": fused.chi2,
            "degrees": fused.degrees,
            "probability": fused.probability,
            "causes": found,
            "mass": mass,
            "corrections": (*corrections, *warm.corrections),
            "change": change,
            "fused": fused,
        }
        if mass is not None and mass.refused:
            return self.refused(mass.text, **given)
        if numbers is None:
            return self.refused(no_limit(fused, found), **given)
        axial, kept = self.model.model, self.kept
        curved = abs(axial.curve) * float(np.ptp(change.position)) ** 2 > _BENT
        doubt = share_uncertainty(self.model, kept)
        local = along_the_axis(
            self.run, self.baseline, change, fused, doubt, curved, kept.form, kept.local_alarm
        )
        reasons = why_not_good(self.run, self.baseline, kept, change, fused, found, mass, local, numbers)
        reasons += warm.reasons
        notes = beside(self.run, self.baseline, self.model, kept, found, mass, numbers)
        others = {
            "along": local,
            "verdict": "suspect" if reasons else "good",
            "reasons": tuple(reasons),
            "notes": (*notes, *warm.notes),
        }
        return PreloadEstimate(**(self._head() | given | numbers | others))

    def _fused(
        self,
        table: FrequencyTable,
        base: FrequencyTable | None,
        level: float,
        own: Array | None,
        correction: float = 0.0,
    ) -> tuple[ComplianceChange, FusedChange, float]:
        """The load on the nut counts by the preload that is sought."""
        return fuse_on_worn_nut(
            lambda ratio: self._change(table, base, level, correction, ratio, self.kept), own
        )

    def _change(
        self,
        table: FrequencyTable,
        base: FrequencyTable | None,
        level: float,
        correction: float,
        ratio: float,
        kept: Assumptions,
    ) -> ComplianceChange:
        bearing, model = self.model.bearing_share, self.model.model
        if base is None:
            heavier = replace(table, load=table.load + correction)
            return change_from_model(heavier, model, bearing, kept, ratio)
        return change_since(
            table, base, model, bearing, level, kept, load_change=table.load - base.load + correction,
            ratio=ratio, covariance=self.model.covariance,
        )  # fmt: skip

    def _alone(self, table: FrequencyTable, mass: MassCheck | None) -> tuple[ComplianceChange, FusedChange]:
        """Return the run against the model, with the load as it is known by now."""
        own = self.model.covariance
        change, fused, _ = self._fused(table, None, 1.0, own, mass.correction if mass is not None else 0.0)
        if mass is not None and mass.standard_uncertainty:
            change = _other_load(change, mass.standard_uncertainty)
            fused = fuse(change, own)
        return change, fused

    def _worn(
        self,
        table: FrequencyTable,
        base: FrequencyTable | None,
        level: float,
        fused: FusedChange,
        ratio: float,
        mass: MassCheck | None,
    ) -> list[str]:
        """What the correction for the load on a worn nut makes of the ratio, in words."""
        plain = replace(self.kept, nut_load=0.0)
        before = self._change(table, base, level, 0.0 if mass is None else mass.correction, ratio, plain)
        without = 1 + float(fused.weights @ before.y)
        if not (without > 0 and fused.level > -1):
            return []
        more = 100 * ((without / (1 + fused.level)) ** 3 - 1)
        spread = 300 * fused.terms[WORN][0] / (1 + fused.level)
        if abs(more) < _WORTH_A_WORD:
            return []
        return [f"load on a worn nut: {more:+.1f} % ± {spread:.1f} % of the preload"]

    def _mass(
        self,
        change: ComplianceChange,
        fused: FusedChange,
        masses: Masses | None,
        found: tuple[Cause, ...],
        base: FrequencyTable,
    ) -> MassCheck:
        by_kilogram = abs(float(fused.weights @ change.mass))
        spread = math.hypot(fused.spread, abs(fused.level) * self.model.standard_uncertainty("share"))
        mass = 0.0 if base.equivalent_mass is None else base.equivalent_mass.value
        return check_mass(masses, found, mass, by_kilogram / max(spread, 1e-12), self.kept)

    def _warmth(self, base: FrequencyTable | None, warmer: float | None) -> Warmth:
        if base is None or warmer == 0:
            return NO_WARMTH
        levels, temperatures, own = [], [], 0.0
        for one in self.more:
            other = frequency_table(one, rotor=self.model.rotor)
            apart = _warmer(other, base)
            if apart is None or other.id == self.run.id or not paired(other, base)[0]:
                continue
            fused = fuse(self._change(other, base, 1.0, 0.0, 1.0, self.kept))
            levels.append((-3 * math.log(max(1 + fused.level, 0.1)), 3 * max(fused.random, 1e-4)))
            temperatures.append(apart)
            own = max(own, by_baseline(fused))
        return warmed(warmer, levels, temperatures, self.kept, own)


def _warmer(table: FrequencyTable, base: FrequencyTable | None) -> float | None:
    if base is None or table.temperature is None or base.temperature is None:
        return None
    return table.temperature - base.temperature


def _other_load(change: ComplianceChange, spread: float) -> ComplianceChange:
    """The run's masses say how sure its load is, in the place of what is taken for granted."""
    terms = [
        Term(t.name, t.random, (change.mass * spread)[None]) if t.name == "declared load" else t
        for t in change.terms
    ]
    return replace(change, terms=tuple(terms))
