"""What is believed of a life before its first run: standard normal numbers, and what they stand for."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.special import ndtr

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown

__all__ = ["NUMBERS", "OF_FRICTION", "WAVES", "LifePrior", "Lives", "lives_of"]

_STEEPEST = 1.5  # p of the steepest named law
_LEAST_NOISE = 0.3  # of what a run tells: a law of wear is no truer, however little the runs scatter
_LEAST_RUB = 0.5  # the same of the friction: oil and warmth drift in days, which scatter does not show


@dataclass(frozen=True, slots=True)
class LifePrior:
    """Medians, and standard deviations of logarithms where a number is positive.

    Parameters
    ----------
    rate, rate_spread : float
        r, part of δ₀ a day when new; by default one in a thousand, times or through 6.
    exponent, exponent_spread : float or None
        p; where None, even from 0 to 1.5, which averages the laws and all between them.
    onset : float
        Days within which wear begins with a probability of one half; it may be long before it does.
    relaxing, relaxing_spread : float
        1 + a of the pace.
    relaxation, relaxation_spread : float
        τ, days.
    noise, noise_spread : float
        True scatter of a run over what it tells; 0.3 at least.
    temperature : float
        Standard deviation of the level's change by 1 K, 1/K.
    bearing : float
        Standard deviation of the level by which the bearing drifts in the end.
    bearing_days : float
        In which half of that is done.
    load, load_spread : float
        Nut load of the duty over P₀.
    friction_share : tuple of float
        Least and largest part of the friction that is the preload's.
    friction_drift : float
        Standard deviation by which the rest of the friction drifts over the history, as a part.
    friction_noise_spread : float
        Of true over told scatter of the friction, which is 0.5 at least.
    wander : float
        By how many days of wear the pace goes astray in one day; in n days by √n as many. Grease, and what
        is worked on, change it.
    chance : float
        Standard deviation of the logarithm of the future's pace: the duty is the same, but never quite.

    Raises
    ------
    InputError
        If a number cannot be.
    """

    rate: float = 1e-3
    rate_spread: float = 1.8
    exponent: float | None = None
    exponent_spread: float = 0.3
    onset: float = 20.0
    relaxing: float = 1.1
    relaxing_spread: float = 0.3
    relaxation: float = 12.0
    relaxation_spread: float = 0.7
    noise: float = 0.7
    noise_spread: float = 0.5
    temperature: float = 0.0033
    bearing: float = 0.004
    bearing_days: float = 60.0
    load: float = 0.15
    load_spread: float = 0.6
    friction_share: tuple[float, float] = (0.05, 0.95)
    friction_drift: float = 0.1
    friction_noise_spread: float = 0.5
    wander: float = 0.8
    chance: float = 0.05

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None and field.name == "exponent":
                continue
            numbers = value if isinstance(value, tuple) else (value,)
            least = 0.0 if field.name in ("exponent", "temperature", "bearing", "wander", "chance") else -1.0
            for one in numbers:
                good = isinstance(one, (int, float)) and math.isfinite(one) and one >= 0
                free = "spread" in field.name or "friction" in field.name or least == 0.0
                if not good or (one == 0 and not free):
                    allowed = "0 or more" if free else "more than 0"
                    raise InputError(f"a prior's {field.name} is {shown(value)}; it must be {allowed}.")
        low, high = self.friction_share
        if not low <= high <= 1:
            raise InputError(f"a prior's friction_share is {self.friction_share}; it must ascend up to 1.")


@dataclass(frozen=True, slots=True, eq=False)
class Lives:
    """Many lives, each array of shape (m,); ``wander`` is of shape (m, 5)."""

    onset: Array
    rate: Array
    exponent: Array
    relaxing: Array
    relaxation: Array
    noise: Array
    offset: Array
    temperature: Array
    scale: Array
    bearing: Array
    load: Array
    wander: Array
    friction: Array
    friction_share: Array
    friction_noise: Array
    friction_drift: Array


WAVES = 5  # of the pace's wander
NUMBERS = len(fields(Lives)) - 1 + WAVES
OF_FRICTION = 4  # the last of them; of no use where no friction is known


def lives_of(z: Array, prior: LifePrior, scale: float, offset: float, friction: float) -> Lives:
    """Lives from standard normal numbers.

    Parameters
    ----------
    z : ndarray, shape (m, 20) or (m, 16)
        Standard normal before anything is observed; those of the friction may be left out.
    prior : LifePrior
        What is believed.
    scale : float
        Relative standard uncertainty of the level that all runs share.
    offset : float
        Standard deviation of the reference's own error, as a level.
    friction : float
        About the friction in the beginning; 1 where there is none.

    Returns
    -------
    Lives
        Of the same order.
    """
    if z.shape[1] < NUMBERS:
        z = np.hstack([z, np.zeros((len(z), NUMBERS - z.shape[1]))])
    begin = np.minimum(ndtr(z[:, 0]), 1 - 1e-12)
    if prior.exponent is None:
        exponent = _STEEPEST * ndtr(z[:, 2])
    else:
        # Folded, not cut: no heap of lives at the ends.
        wide = prior.exponent + prior.exponent_spread * z[:, 2]
        exponent = np.minimum(np.abs(wide), 2.0)
    low, high = prior.friction_share
    return Lives(
        onset=prior.onset * begin / (1 - begin),
        rate=np.exp(math.log(prior.rate) + prior.rate_spread * z[:, 1]),
        exponent=exponent,
        relaxing=np.exp(math.log(prior.relaxing) + prior.relaxing_spread * z[:, 3]) - 1,
        relaxation=np.exp(math.log(prior.relaxation) + prior.relaxation_spread * z[:, 4]),
        noise=np.maximum(np.exp(math.log(prior.noise) + prior.noise_spread * z[:, 5]), _LEAST_NOISE),
        offset=offset * z[:, 6],
        temperature=prior.temperature * z[:, 7],
        scale=np.maximum(1 + scale * z[:, 8], 0.1),
        bearing=prior.bearing * z[:, 9],
        load=np.exp(math.log(prior.load) + prior.load_spread * z[:, 10]),
        wander=prior.wander * z[:, 11 : 11 + WAVES],
        friction=friction * np.exp(0.1 * z[:, -4]),
        friction_share=low + (high - low) * ndtr(z[:, -3]),
        friction_noise=np.maximum(np.exp(prior.friction_noise_spread * z[:, -2]), _LEAST_RUB),
        friction_drift=prior.friction_drift * z[:, -1],
    )
