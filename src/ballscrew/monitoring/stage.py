"""Stage I, preload being lost, or II, preload gone and backlash growing: probabilities and their evidence.

Evidence is the preload by the frequencies; the softening of the nut under the test's own load, which gives
mass over preload without the nut's share; and lost motion in excess of the baseline's, where a displacement
probe or a linear scale measures it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ballscrew.base.quantity import Quantity
from ballscrew.monitoring.reading import Reading

_GONE = 0.10  # of the baseline's preload: below it the test's own load unloads a flank
_WIDTH = 0.25  # of ln P: width of that transition
_ELASTIC = 0.3  # part of lost motion that a softer nut causes without backlash
_TYPICAL = 5e-7  # m, mean backlash in stage II
_LARGEST_SPREAD = 5 * _TYPICAL  # of a conclusive lost motion
_NEWEST = 3  # runs
_LEAST, _MOST = 0.001, 0.999  # probability of stage II by the preload
_LEAST_RATIO = 1e-3  # of P/P₀
_INTERVAL = 3.92  # standard deviations in a 95 % interval
_LARGEST_EVIDENCE = 20.0  # log odds of the lost motion


@dataclass(frozen=True, slots=True)
class Stage:
    """Probabilities of the stages, summing to 1.

    Parameters
    ----------
    I, II : float
        Preload is being lost, or is gone.
    how : str
        Evidence, in words.
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
    """Stage at the newest good run, or one whose own load unloads the nut.

    Parameters
    ----------
    relative : Quantity or None
        P/P₀; its interval begins at 0 where only an upper limit is known.
    newest, baseline : sequence of Reading
        Good runs: the newest ones, and those of the baseline.
    since : sequence of Reading
        Later runs without a preload; their lost motion counts.

    Returns
    -------
    Stage or None
        None where there is no preload.
    """
    if relative is None:
        return None
    evidence = ["the preload by the frequencies"]
    if not relative.interval[0] > 0:
        evidence = ["the test's own load, which unloads the nut"]
    low, high = np.log(np.maximum(relative.interval, _LEAST_RATIO)).tolist()
    value, spread = math.log(max(relative.value, _LEAST_RATIO)), max((high - low) / _INTERVAL, 1e-3)
    by_load = _log_ratio_by_nut_load(newest, baseline)
    if by_load is not None:
        values, information = np.array([value, by_load[0]]), np.array([spread, by_load[1]]) ** -2.0
        value = float(values @ information / information.sum())
        spread = 1 / math.sqrt(information.sum())
        evidence.append("the nut's softening under the test's own load")
    gone = float(ndtr((math.log(_GONE) - value) / math.hypot(spread, _WIDTH)))
    gone = min(max(gone, _LEAST), _MOST)
    log_odds = math.log(gone / (1 - gone))
    by_backlash = _log_odds_by_backlash([*newest, *since][-_NEWEST:])
    if by_backlash is None:
        evidence.append("backlash is not observable")
    else:
        log_odds += by_backlash
        evidence.append("the lost motion in excess of the baseline's")
    second = 1 / (1 + math.exp(-log_odds))
    return Stage(1 - second, second, "; ".join(evidence))


def _log_ratio_by_nut_load(
    newest: Sequence[Reading], baseline: Sequence[Reading]
) -> tuple[float, float] | None:
    """Logarithm of P/P₀ and its standard uncertainty: mass over preload grows as the preload decreases."""
    now, then = _log_mass_over_preload(newest[-_NEWEST:]), _log_mass_over_preload(baseline)
    if now is None or then is None:
        return None
    return then[0] - now[0], math.hypot(now[1], then[1])


def _log_mass_over_preload(readings: Sequence[Reading]) -> tuple[float, float] | None:
    """Mean logarithm of mass over preload, and mean of its standard uncertainties."""
    logarithms, uncertainties = [], []
    for reading in readings:
        value, uncertainty = reading.mass_over_preload, reading.mass_over_preload_uncertainty
        if value > 0 and uncertainty > 0:
            logarithms.append(math.log(value))
            uncertainties.append(uncertainty / value)
    if not logarithms:
        return None
    return float(np.mean(logarithms)), float(np.mean(uncertainties))


def _log_odds_by_backlash(newest: Sequence[Reading]) -> float | None:
    """Log odds of backlash against none."""
    table = np.array([(reading.backlash, reading.backlash_uncertainty) for reading in newest]).reshape(-1, 2)
    lost, uncertainty = table[np.isfinite(table[:, 0]) & (table[:, 1] > 0)].T
    if not len(lost):
        return None
    mean = float(lost.mean())
    own = math.sqrt(float((uncertainty**2).sum())) / len(lost)
    spread = math.hypot(own, _ELASTIC * max(mean, 0.0))
    if spread > _LARGEST_SPREAD:
        return 0.0
    # Backlash is exponential with a typical size; its likelihood under normal noise is in closed form.
    z = mean / spread - spread / _TYPICAL
    with_backlash = math.exp(0.5 * (spread / _TYPICAL) ** 2 - mean / _TYPICAL) * float(ndtr(z)) / _TYPICAL
    without = math.exp(-0.5 * (mean / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
    log_odds = math.log(max(with_backlash, 1e-300) / max(without, 1e-300))
    return min(max(log_odds, -_LARGEST_EVIDENCE), _LARGEST_EVIDENCE)
