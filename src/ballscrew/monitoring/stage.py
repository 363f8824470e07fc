"""Stage I, preload being lost, or II, preload gone and backlash growing: a probability, and from what.

Three things speak: the preload that frequencies tell; how much the nut softens under the test's own load,
which ties mass over preload without the nut's share; and lost motion beyond the baseline's, where a probe or
a linear scale shows it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ballscrew.base.quantity import Quantity
from ballscrew.monitoring.reading import Reading

__all__ = ["Stage", "stage"]

_GONE = 0.10  # of the baseline's preload: below it the nut's own load takes the flank off
_WIDTH = 0.25  # of ln P: how sharp that is
_ELASTIC = 0.3  # lost motion that a softer nut makes without backlash, of the larger one
_TYPICAL = 5e-7  # m, backlash that stage II has
_NEWEST = 3
_LEAST, _MOST = 0.001, 0.999


@dataclass(frozen=True, slots=True)
class Stage:
    """Probabilities, summing to 1.

    Parameters
    ----------
    I, II : float
        Preload is being lost, or is gone.
    how : str
        From what.
    """

    I: float  # noqa: E741  the paper's name
    II: float
    how: str


def stage(
    relative: Quantity | None,
    newest: Sequence[Reading],
    baseline: Sequence[Reading],
    since: Sequence[Reading] = (),
) -> Stage | None:
    """Tell the stage of the newest good run, and of what was measured since.

    Parameters
    ----------
    relative : Quantity or None
        P/P₀ of the newest good run.
    newest, baseline : sequence of Reading
        Good runs: the newest ones, and those of the baseline.
    since : sequence of Reading
        Later runs without a preload; their lost motion counts.

    Returns
    -------
    Stage or None
        None where no run tells a preload.
    """
    if relative is None:
        return None
    how = ["the preload that the frequencies tell"]
    low, high = (max(edge, 1e-3) for edge in relative.interval)
    value, spread = math.log(max(relative.value, 1e-3)), max(math.log(high / low) / 3.92, 1e-3)
    under_load = _by_nut_load(newest, baseline)
    if under_load is not None:
        weights = 1 / spread**2, 1 / under_load[1] ** 2
        value = (value * weights[0] + under_load[0] * weights[1]) / sum(weights)
        spread = 1 / math.sqrt(sum(weights))
        how.append("the nut's softening under the test's own load")
    gone = float(ndtr((math.log(_GONE) - value) / math.hypot(spread, _WIDTH)))
    odds = _odds(min(max(gone, _LEAST), _MOST))
    lost = _by_backlash([*newest, *since])
    if lost is None:
        how.append("backlash is not observable")
    else:
        odds += lost
        how.append("the lost motion beyond the baseline's")
    second = 1 / (1 + math.exp(-odds))
    return Stage(1 - second, second, "; ".join(how))


def _odds(probability: float) -> float:
    return math.log(probability / (1 - probability))


def _by_nut_load(newest: Sequence[Reading], baseline: Sequence[Reading]) -> tuple[float, float] | None:
    """Logarithm of P/P₀ and its standard uncertainty: mass over preload grows as the preload falls."""
    parts = []
    for runs in (newest[-_NEWEST:], baseline):
        told = [
            (math.log(one.mass_over_preload), one.mass_over_preload_uncertainty / one.mass_over_preload)
            for one in runs
            if one.mass_over_preload > 0 and one.mass_over_preload_uncertainty > 0
        ]
        if not told:
            return None
        parts.append((float(np.mean([t[0] for t in told])), float(np.mean([t[1] for t in told]))))
    (now, u), (then, u0) = parts
    return then - now, math.hypot(u, u0)


def _by_backlash(newest: Sequence[Reading]) -> float | None:
    """Log odds of backlash against none."""
    told = [one for one in newest[-_NEWEST:] if math.isfinite(one.backlash) and one.backlash_uncertainty > 0]
    if not told:
        return None
    lost = float(np.mean([one.backlash for one in told]))
    own = math.sqrt(sum(one.backlash_uncertainty**2 for one in told)) / len(told)
    spread = math.hypot(own, _ELASTIC * max(lost, 0.0))
    if spread > 5 * _TYPICAL:
        return 0.0
    # Backlash is exponential with a typical size; its likelihood under normal noise is in closed form.
    z = lost / spread - spread / _TYPICAL
    with_it = math.exp(0.5 * (spread / _TYPICAL) ** 2 - lost / _TYPICAL) * float(ndtr(z)) / _TYPICAL
    without = math.exp(-0.5 * (lost / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
    return max(min(math.log(max(with_it, 1e-300) / max(without, 1e-300)), 20.0), -20.0)
