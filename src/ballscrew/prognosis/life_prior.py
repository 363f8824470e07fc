"""Prior of a life before its first run, as a transform of standard normal numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.special import ndtr

from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting

_STEEPEST = 1.5  # p of the steepest named law
_LEAST_NOISE = 0.3  # of the stated uncertainty: a law of wear is no truer, however little the runs scatter
_LEAST_FRICTION_NOISE = 0.5  # the same of the friction: oil and temperature drift in days
_MAY_BE_ZERO = ("exponent", "temperature", "bearing", "wander")


@dataclass(frozen=True, slots=True)
class LifePrior:
    """Prior of a life: medians, and standard deviations of logarithms where a number is positive.

    Parameters
    ----------
    rate, rate_spread : float
        r, part of δ₀ a day when new; by default one in a thousand, within a factor of 6.
    exponent, exponent_spread : float or None
        p; where None, uniform from 0 to 1.5, which averages over the laws.
    onset : float
        Days within which wear begins with a probability of one half; the distribution has a long tail.
    relaxing, relaxing_spread : float
        1 + a of the pace.
    relaxation, relaxation_spread : float
        τ, days.
    noise, noise_spread : float
        True scatter of a run over its stated uncertainty; 0.3 at least.
    temperature : float
        Standard deviation of the level's change by 1 K, 1/K.
    bearing : float
        Standard deviation of the final drift of the level by the bearing.
    bearing_days : float
        Days within which half of that drift occurs.
    load, load_spread : float
        Nut load of the duty over P₀, and its spread.
    friction_share : tuple of float
        Least and largest part of the friction that is proportional to the preload.
    friction_drift : float
        Relative standard deviation of the drift of the remaining friction over the history.
    friction_noise_spread : float
        Standard deviation of the logarithm of the friction's true over its stated uncertainty, which is 0.5
        at least.
    wander : float
        Random walk of the pace: standard deviation in days of wear after one day, √n times that after n.
        Grease and the work pieces change the pace.
    pace_spread : float
        Standard deviation of the logarithm of the future pace relative to the past: the duty is never quite
        the same.

    Raises
    ------
    InputError
        If a number is out of range.
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
    pace_spread: float = 0.05

    def __post_init__(self) -> None:
        """Check the numbers."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None and field.name == "exponent":
                continue
            zero = field.name in _MAY_BE_ZERO or "spread" in field.name or "friction" in field.name
            for number in np.atleast_1d(np.asarray(value, dtype=object)):
                if zero:
                    check_setting(f"a prior's {field.name}", number, least=0.0)
                else:
                    check_setting(f"a prior's {field.name}", number, above=0.0)
        low, high = self.friction_share
        if not low <= high <= 1:
            raise InputError(f"a prior's friction_share is {self.friction_share}; it must ascend up to 1.")


@dataclass(frozen=True, slots=True, eq=False)
class Lives:
    """m lives, each array of shape (m,) but ``wander``, of shape (m, 5); numbers as in :class:`LifePrior`."""

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


WAVES = 5
"""Waves of the random walk of the pace (:func:`~ballscrew.prognosis.likelihood.wander_waves`)."""

NUMBERS = len(fields(Lives)) - 1 + WAVES
"""Numbers of a life."""

OF_FRICTION = 4
"""The last of these numbers, which are omitted where no friction is known."""


def lives_from_normal(z: Array, prior: LifePrior, scale: float, offset: float, friction: float) -> Lives:
    """Lives from standard normal numbers.

    Parameters
    ----------
    z : ndarray, shape (m, 20) or (m, 16)
        Standard normal before anything is observed; those of the friction may be omitted.
    prior : LifePrior
        The prior.
    scale : float
        Relative standard uncertainty of the level that all runs share.
    offset : float
        Standard deviation of the reference's own error, as a level.
    friction : float
        Approximate initial friction; 1 where there is none.

    Returns
    -------
    Lives
        One life per row of ``z``.
    """
    if z.shape[1] < NUMBERS:
        z = np.hstack([z, np.zeros((len(z), NUMBERS - z.shape[1]))])
    begin = np.minimum(ndtr(z[:, 0]), 1 - 1e-12)
    if prior.exponent is None:
        exponent = _STEEPEST * ndtr(z[:, 2])
    else:
        # Folded, not clipped at 0: no mass of lives there.
        exponent = np.minimum(np.abs(prior.exponent + prior.exponent_spread * z[:, 2]), 2.0)
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
        friction_noise=np.maximum(np.exp(prior.friction_noise_spread * z[:, -2]), _LEAST_FRICTION_NOISE),
        friction_drift=prior.friction_drift * z[:, -1],
    )
