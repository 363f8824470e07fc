"""From the fused change of the compliance to the preload: every uncertain number drawn, and carried through.

P = P_ref (P₀/P_ref) (P/P₀), P/P₀ = u⁻³ and u = 1 + level/share: a power of a ratio, whose interval is not
symmetric. P_ref, the share and the baseline's level are drawn together from the calibration's posterior.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.quantity import Quantity
from ballscrew.health.assumptions import Assumptions
from ballscrew.health.calibrated import Calibrated
from ballscrew.health.change import Change
from ballscrew.health.estimate import Share
from ballscrew.health.fusion import Fused, draws, fuse, told
from ballscrew.health.observed import Observed
from ballscrew.health.relative import change_from_model

__all__ = ["Drawn", "share_spread"]

Array = NDArray[np.float64]
_SHARE = PARAMETERS.index("share")
_FORCE = PARAMETERS.index("preload")


def share_spread(model: Calibrated, assumptions: Assumptions) -> float:
    """Relative standard uncertainty of the nut's share: the calibration's, and the lumped model's own."""
    return math.hypot((1 - model.model.share) * model.standard_uncertainty("share"), assumptions.share)


class Drawn:
    """The model and the baseline's level as what they may be."""

    def __init__(self, model: Calibrated, base: Observed | None) -> None:
        self.model, self.base = model, base
        whole = np.block(
            [
                [model.covariance, model.cross_covariance],
                [model.cross_covariance.T, model.log_ratio_covariance],
            ]
        )
        drawn, self.beside = draws(whole, 4)
        self.vector, ratios = drawn[:, :7], drawn[:, 7:]
        logit = model.vector[_SHARE] + self.vector[:, _SHARE]
        self.share = 1 / (1 + np.exp(-logit))
        self.force = model.model.preload * np.exp(self.vector[:, _FORCE])
        self.level = 1.0
        self.levels = np.ones(len(drawn))
        group = next((one.group for one in model.runs if base is not None and one.id == base.id), None)
        if base is not None and group is not None:
            self.level = math.exp(model.log_ratios[group])
            self.levels = self.level * np.exp(ratios[:, group])
        elif base is not None:
            change = change_from_model(base, model.model, model.bearing_share)
            fused = fuse(change, model.covariance)
            u = self._roots(change, fused, np.ones_like(self.levels), self.beside[:, 3])
            self.level = (1 + fused.level) ** -3 if fused.level > -1 else math.nan
            self.levels = np.where(u > 0, np.maximum(u, 1e-9) ** -3, np.inf)

    def _roots(self, change: Change, fused: Fused, level: Array, noise: Array, share: float = 0.0) -> Array:
        """Tell (P/P₀)^(−1/3) of every draw."""
        model = self.model.model
        away = change.position - model.centre
        # Far draws of a level have no meaning; they only must not overflow.
        before = np.cbrt(1 / np.clip(level, 1e-3, 1e3))[:, None]
        softer = self.share * (1 + share * self.beside[:, 1])
        whole = 1 + model.slope * away + model.curve * away**2 + softer[:, None] * (before - 1)
        gain = (softer[:, None] * before / whole) @ fused.weights
        moved = fused.level + fused.spread * noise + self.vector @ fused.model
        return np.asarray(1 + moved / gain)

    def ratio(
        self, change: Change, fused: Fused, kept: Assumptions, warm: tuple[float, float]
    ) -> dict[str, Any] | None:
        """All that is told, or None where it has no limit."""
        value = 1 + fused.level
        if not (value > 0 and math.isfinite(self.level)):
            return None
        u = self._roots(change, fused, self.levels, self.beside[:, 0], kept.share)
        warmed = np.exp(-warm[0] - warm[1] * self.beside[:, 2])
        ratio = np.where(u > 0, np.maximum(u, 1e-9) ** -3, np.inf) * warmed
        best = value**-3 * math.exp(-warm[0])
        main = told(best, ratio)
        absolute = told(best * self.level, ratio * self.levels)
        force = told(best * self.level * self.model.model.preload, ratio * self.levels * self.force, "N")
        if main is None or absolute is None or force is None:
            return None
        random = 3 * best / value * fused.random
        rest = math.sqrt(max(main.standard_uncertainty**2 - random**2, 0.0))
        by_force = random * force.value / best
        terms = [Share(n, 3 * best / value * u, r) for n, (u, r) in fused.terms.items()]
        by_share = share_spread(self.model, kept)
        terms.append(Share("the nut's share", 3 * best / value * abs(fused.level) * by_share, False))
        by_model = float(np.sqrt(fused.model @ self.model.covariance @ fused.model))
        if by_model:
            terms.append(Share("the model's frequencies", 3 * best / value * by_model, False))
        if warm[1]:
            terms.append(Share("temperature", best * abs(warm[1]), False))
        rating = self.model.load_rating
        low, high = force.interval
        return {
            "preload_N": force,
            "preload_ratio": Quantity(
                force.value / rating, force.standard_uncertainty / rating, "", (low / rating, high / rating)
            ),
            "relative_to_baseline": None if self.base is None else main,
            "relative_to_model": absolute,
            "random_N": min(by_force, force.standard_uncertainty),
            "systematic_N": math.sqrt(max(force.standard_uncertainty**2 - by_force**2, 0.0)),
            "random_ratio": min(random, main.standard_uncertainty),
            "systematic_ratio": rest,
            "terms": tuple(sorted(terms, key=lambda one: -one.standard_uncertainty)),
        }
