"""From the fused change of the compliance to the preload: every uncertain number drawn, and carried through.

P = P_ref (P₀/P_ref) (P/P₀), P/P₀ = u⁻³ and u = 1 + level/share: a power of a ratio, whose interval is not
symmetric. P_ref, the share and the baseline's level are drawn together from the calibration's posterior,
in which a tolerance of the data sheet has an end (:mod:`ballscrew.calibration.tolerances`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.tolerances import kept_within
from ballscrew.estimation.change import ComplianceChange
from ballscrew.estimation.compliance import change_from_model
from ballscrew.estimation.estimate import Share
from ballscrew.estimation.fusion import DRAWS, FusedChange, draws, fuse, told
from ballscrew.estimation.shared_terms import BASELINE, BASELINE_PART
from ballscrew.estimation.temperature import Warmth

__all__ = ["Drawn", "by_baseline", "share_uncertainty"]

_SHARE = PARAMETERS.index("share")
_FORCE = PARAMETERS.index("preload")

_MORE = 4  # draws, of which those are chosen that keep to the tolerances
_BEARING = 0.15  # of its share of the compliance: makers tell its rigidity to ± 30 %


def share_uncertainty(model: CalibratedAxis, assumptions: Assumptions) -> float:
    """Relative standard uncertainty of the nut's share: the calibration's, and the lumped model's own."""
    return math.hypot((1 - model.model.share) * model.standard_uncertainty("share"), assumptions.share)


def by_baseline(fused: FusedChange) -> float:
    """Standard uncertainty of ln P by what is the baseline's own error."""
    both = (fused.terms.get(name, (0.0, False))[0] for name in (BASELINE, BASELINE_PART))
    return 3 * math.hypot(*both) / max(1 + fused.level, 0.1)


class Drawn:
    """The model and the baseline's level as what they may be."""

    def __init__(self, model: CalibratedAxis, base: FrequencyTable | None, assumptions: Assumptions) -> None:
        self.model, self.base, self.kept = model, base, assumptions
        whole = np.block(
            [
                [model.covariance, model.cross_covariance],
                [model.cross_covariance.T, model.log_ratio_covariance],
            ]
        )
        drawn, beside = draws(whole, 4 + len(model.tolerated), (_MORE if model.tolerated else 1) * DRAWS)
        kept = kept_within(model.tolerated, model.prior_covariance, drawn[:, :7], beside[:, 4:], DRAWS)
        drawn, self.beside = drawn[kept], beside[kept]
        self.vector, ratios = drawn[:, :7], drawn[:, 7:]
        logit = model.vector[_SHARE] + self.vector[:, _SHARE]
        self.share = 1 / (1 + np.exp(-logit))
        self.force = model.model.preload * np.exp(self.vector[:, _FORCE])
        self.level = 1.0
        self.levels = np.ones(len(drawn))
        group = next((one.group for one in model.runs if base is not None and one.id == base.id), None)
        self.calibrated_with = base is None or group is not None
        if group is not None:
            self.level = math.exp(model.log_ratios[group])
            self.levels = self.level * np.exp(ratios[:, group])
        elif base is not None:
            change = change_from_model(base, model.model, model.bearing_share, assumptions)
            fused = fuse(change, model.covariance)
            u = self._roots(change, fused, np.ones_like(self.levels), self.beside[:, 3] * fused.spread)
            self.level = (1 + fused.level) ** -3 if fused.level > -1 else math.nan
            self.levels = np.where(u > 0, np.maximum(u, 1e-9) ** -3, np.inf)

    def _roots(
        self, change: ComplianceChange, fused: FusedChange, level: Array, noise: Array, share: float = 0.0
    ) -> Array:
        """Tell (P/P₀)^(−1/3) of every draw."""
        model = self.model.model
        away = change.position - model.centre
        # Far draws of a level have no meaning; they only must not overflow.
        before = np.cbrt(1 / np.clip(level, 1e-3, 1e3))[:, None]
        softer = self.share * (1 + share * self.beside[:, 1])
        whole = 1 + model.slope * away + model.curve * away**2 + softer[:, None] * (before - 1)
        gain = (softer[:, None] * before / whole) @ fused.weights
        moved = fused.level + noise + self.vector @ fused.model
        return np.asarray(1 + moved / gain)

    def _ratios(
        self, change: ComplianceChange, fused: FusedChange, level: Array, spread: float, warm: Warmth
    ) -> Array:
        """P over its reference of every draw, at the reference's temperature."""
        noise = self.beside[:, 0]
        u = self._roots(change, fused, level, spread * noise, self.kept.share)
        hot = np.zeros_like(noise)
        if warm.spread:
            told_by = 3 * spread / max(1 + fused.level, 0.1)
            # A baseline that reads high is high in the slope that it taught, and in what is corrected by it.
            common = warm.shared / (told_by * warm.spread) if told_by else 0.0
            common = min(max(common, -1.0), 1.0)
            hot = warm.spread * (common * noise + math.sqrt(1 - common**2) * self.beside[:, 2])
        return np.asarray(np.where(u > 0, np.maximum(u, 1e-9) ** -3, np.inf) * np.exp(-warm.shift - hot))

    def ratio(
        self,
        change: ComplianceChange,
        fused: FusedChange,
        warm: Warmth,
        alone: tuple[ComplianceChange, FusedChange] | None = None,
    ) -> dict[str, Any] | None:
        """All that is told, or None where the ratio has no limit.

        ``alone`` is the run against the model. It tells newtons where the calibration did not know the
        baseline: the baseline's own error would come in by its level and go out by the ratio.
        """
        value = 1 + fused.level
        if not (value > 0 and math.isfinite(self.level)):
            return None
        ratio = self._ratios(change, fused, self.levels, fused.spread, warm)
        best = value**-3 * math.exp(-warm.shift)
        main = told(best, ratio)
        if main is None:
            return None
        level, levels = best * self.level, ratio * self.levels
        if alone is not None:
            by_model = alone[1]
            level = max(1 + by_model.level, 0.0) ** -3 * math.exp(-warm.shift) if by_model.level > -1 else 0.0
            levels = self._ratios(alone[0], by_model, np.ones_like(self.levels), by_model.spread, warm)
        absolute = told(level, levels) if level > 0 else None
        reference = self.model.model.preload
        force = None if absolute is None else told(level * reference, levels * self.force, "N")
        random = min(3 * best / value * fused.random, main.standard_uncertainty)
        anew = random / best if alone is None else 3 * alone[1].random / max(1 + alone[1].level, 0.1)
        against = self.base is not None
        return _in_newtons(force, anew, self.model.load_rating) | {
            "relative_to_baseline": main if against else None,
            "relative_to_model": absolute if against else main,
            "relative_if_bearing_changed": None
            if self.base is None
            else self._if_bearing(change, fused, warm),
            "random_ratio": random,
            "systematic_ratio": math.sqrt(max(main.standard_uncertainty**2 - random**2, 0.0)),
            "terms": self._terms(fused, best, warm),
        }

    def _if_bearing(self, change: ComplianceChange, fused: FusedChange, warm: Warmth) -> Quantity | None:
        """P/P₀ wherever within ± ``bearing_change`` the bearing's rigidity may lie; None without limit."""
        part = self.kept.bearing_change
        by_bearing = float(fused.weights @ ((1 + change.y) * change.bearing))
        best = (1 + fused.level) ** -3 * math.exp(-warm.shift)
        own = math.sqrt(max(fused.spread**2 - fused.terms.get("bearing", (0.0, False))[0] ** 2, 0.0))
        # A bearing that is stiffer by a part hides a loss, one that is softer makes one up.
        worst = []
        for moved in (by_bearing * part / (1 + part), -by_bearing * part / max(1 - part, 1e-9)):
            other = replace(fused, level=fused.level + moved)
            spread = math.hypot(own, _BEARING * moved)
            one = told(best, self._ratios(change, other, self.levels, spread, warm))
            if one is None:
                return None
            worst.append(one.interval)
        low, high = min(worst[0][0], best), max(worst[1][1], best)
        return Quantity(best, (high - low) / 2 / NORMAL_95, "", (low, high))

    def _terms(self, fused: FusedChange, best: float, warm: Warmth) -> tuple[Share, ...]:
        part = 3 * best / (1 + fused.level)
        terms = [Share(n, part * u, r) for n, (u, r) in fused.terms.items()]
        by_share = share_uncertainty(self.model, self.kept)
        terms.append(Share("the nut's share", part * abs(fused.level) * by_share, False))
        by_model = float(np.sqrt(fused.model @ self.model.covariance @ fused.model))
        if by_model:
            terms.append(Share("the model's frequencies", part * by_model, False))
        if warm.spread:
            terms.append(Share(warm.name, best * warm.spread, False))
        return tuple(sorted(terms, key=lambda one: -one.standard_uncertainty))


def _in_newtons(force: Quantity | None, random: float, rating: float) -> dict[str, Any]:
    """The force, what part of it is load rating, and its two parts; None where it has no upper end."""
    if force is None:
        return dict.fromkeys(("preload_N", "preload_ratio", "random_N", "systematic_N"))
    low, high = force.interval
    anew = min(random * force.value, force.standard_uncertainty)
    return {
        "preload_N": force,
        "preload_ratio": Quantity(
            force.value / rating, force.standard_uncertainty / rating, "", (low / rating, high / rating)
        ),
        "random_N": anew,
        "systematic_N": math.sqrt(max(force.standard_uncertainty**2 - anew**2, 0.0)),
    }
