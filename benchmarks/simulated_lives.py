"""Lives whose end is known, as the history of an epoch: for :mod:`benchmarks.remaining_life`.

At the level of the level: (P/P₀)^(−1/3) − 1 of a life, with the errors that a run makes and those that all
runs share. The wear is integrated in small steps here; nothing of :mod:`ballscrew.prognosis` is used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history
from ballscrew.testbed.pace import Pace, worn_days

__all__ = ["Lived", "live"]

NAMED = (0.0, 1 / 3, 2 / 3, 1.0)  # n of the laws of travel
LIFE = (80.0, 300.0)  # days of wear until the end
HEALTHY = (10.0, 30.0)
STATED = (0.004, 0.015)  # of a run, of the level: twice the frequency's, over the nut's share
SHARP = (0.0015, 0.003)  # the same, of sharp runs
TRUE = (0.45, 0.75)  # of the stated uncertainty
FRICTION = 45.0  # N
RUBS, SHARE, OIL = (0.02, 0.03), (0.2, 0.8), 0.05  # scatter; the preload's share; drift of the rest
LASTS, STATED_FRICTION = 10.0, 0.037  # days by which half of the scatter is alike; as monitor states it
ODD, ODD_SIZE = 0.03, 4.0
MISSED = 0.05
SCALE = 0.1
WARM, WARMTH = 10.0, 0.005  # K; level by a kelvin, at most
BEARING = 0.003  # of the level in the end
ROUGH = 0.3  # of a day's wear
_STEP = 0.25  # days


@dataclass(frozen=True, eq=False)
class Lived:
    """One life.

    Parameters
    ----------
    history : PreloadHistory
        A run a day, to the end of the life.
    end : float
        Day since the first run on which P/P₀ reaches the failure.
    onset : float
        Day on which wear begins.
    exponent : float
        n of the law.
    """

    history: PreloadHistory
    end: float
    onset: float
    exponent: float


def live(
    seed: int,
    failure: float = 0.5,
    worn_out: float | None = None,
    rubs: bool = False,
    sharp: bool = False,
) -> Lived:
    """Draw a life.

    Parameters
    ----------
    seed : int
        The same seed gives the same life.
    failure : float
        P/P₀ at the end.
    worn_out : float, optional
        P/P₀ that is reached after 80 to 300 days of wear; by default the failure's.
    rubs : bool
        Whether the runs are sharp and tell their friction, which scatters and drifts.
    sharp : bool
        Whether they are sharp and tell none.

    Returns
    -------
    Lived
        With all confounders.
    """
    random = np.random.default_rng([seed, 0x11FE])
    exponent = float(random.choice(NAMED)) if random.uniform() < 0.5 else float(random.uniform(0, 1))
    onset = float(random.uniform(*HEALTHY))
    lasting = float(np.exp(random.uniform(*np.log(LIFE))))
    greased = tuple(np.cumsum(random.uniform(60, 120, 40)).tolist())
    pace = Pace(
        running_in=0.4 * math.exp(0.3 * random.standard_normal()),
        running_in_days=5.0 * math.exp(0.3 * random.standard_normal()),
        dry=0.3 * math.exp(0.3 * random.standard_normal()),
        greased=greased,
        roughness=ROUGH,
        seed=int(random.integers(2**31)),
    )
    rate = _rate(pace, lasting, exponent, worn_out or failure)
    fine = np.arange(0.0, lasting + _STEP, _STEP)
    remaining = _remaining(rate * worn_days(pace, fine), exponent)
    gone = failure ** (2 / 3)
    end = onset + float(np.interp(-gone, -remaining, fine))
    days = np.arange(0.0, end + 1)
    days = days[(random.uniform(size=len(days)) >= MISSED) | (days == 0)]
    level = np.interp(np.maximum(days - onset, 0.0), fine, remaining) ** -0.5 - 1
    history = _measured(days, level, end, random, SHARP if rubs or sharp else STATED)
    return Lived(_with_friction(history, level, end, seed) if rubs else history, end, onset, exponent)


def _with_friction(history: PreloadHistory, level: Array, end: float, seed: int) -> PreloadHistory:
    """With friction: half of its scatter lasts for days, half is independent; the rest drifts."""
    random = np.random.default_rng([seed, 0xF1])
    n = len(history.days)
    share, size = random.uniform(*SHARE), random.uniform(*RUBS)
    lasting = np.zeros(n)
    lasting[0] = random.standard_normal()
    for k, gap in enumerate(np.diff(history.days)):
        correlation = math.exp(-gap / LASTS)
        lasting[k + 1] = correlation * lasting[k] + math.sqrt(1 - correlation**2) * random.standard_normal()
    scatter = size * math.sqrt(0.5) * (lasting + random.standard_normal(n))
    rest = (1 - share) * (1 + OIL * random.standard_normal() * history.days / end)
    force = FRICTION * (rest + share * (1 + level) ** -3.0) * (1 + scatter)
    return replace(history, friction=force, friction_uncertainty=STATED_FRICTION * force)


def _measured(
    days: Array, level: Array, end: float, random: np.random.Generator, sharp: tuple[float, float]
) -> PreloadHistory:
    """Levels as measured by the runs."""
    n = len(days)
    stated = float(np.exp(random.uniform(*np.log(sharp))))
    odd = np.where(random.uniform(size=n) < ODD, ODD_SIZE, 1.0)
    noise = random.uniform(*TRUE) * stated * odd * random.standard_normal(n)
    season = WARM / 2 * np.sin(2 * np.pi * (days / random.uniform(40, 365) + random.uniform()))
    warmer = season + WARM / 2 * random.uniform(-1, 1, n)
    warmer = warmer - warmer[0]
    measured = level * (1 + SCALE * random.standard_normal())
    measured = measured + random.uniform(-WARMTH, WARMTH) * warmer + noise - noise[0]
    measured = measured + BEARING * random.standard_normal() * days / end
    return preload_history(days, measured, np.full(n, stated), temperature=warmer, scale=SCALE)


def _remaining(spent: Array, exponent: float) -> Array:
    """1 − w/δ₀ by −du/dS = u^(1.5 n), in steps of the middle."""
    remaining = np.ones_like(spent)
    p = 1.5 * exponent
    for k, step in enumerate(np.diff(spent)):
        half = max(remaining[k] - step / 2 * remaining[k] ** p, 1e-6)
        remaining[k + 1] = max(remaining[k] - step * half**p, 1e-6)
    return remaining


def _rate(pace: Pace, lasting: float, exponent: float, ratio: float) -> float:
    """The rate with which a ratio is reached after so many days."""
    steps = np.linspace(0.0, 40.0, 40001)
    remaining = _remaining(steps, exponent)
    return float(np.interp(-(ratio ** (2 / 3)), -remaining, steps)) / float(worn_days(pace, lasting))
