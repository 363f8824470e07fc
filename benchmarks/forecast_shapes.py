"""Histories of preload and of friction torque of six shapes, made here and by no prior of the package."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.prognosis.preload_history import PreloadHistory, preload_history

__all__ = ["SHAPES", "Lived", "preload_life", "torque_series"]

HALF = 0.5
HEALTHY = (5.0, 40.0)  # days
LASTING = (40.0, 300.0)  # days of wear until half of the preload is lost
STATED = (0.0015, 0.005)  # of the level, by a run: twice the frequency's, over the nut's share
TRUE = (0.5, 1.2)  # of the stated uncertainty
ODD, ODD_SIZE = 0.03, 4.0
SCALE = 0.1  # of all levels
WARM, WARMTH = 5.0, 0.003  # K; level by a kelvin, at most
DETECTED = 4.0  # stated uncertainties lost at the alarm, 2 to 6 % of the preload
READINGS, HOURS = 30, 35.0  # as in the wear test of the folder xjtu
LOST = (0.2, 0.6)  # of the torque, at the last reading
FIRST_TORQUE = 0.4  # N m

Course = Callable[[Array], Array]


def _slowing(random: np.random.Generator) -> Course:
    if random.uniform() < 0.5:
        power = random.uniform(0.5, 0.85)
        return lambda s: np.asarray(s**power)
    rate = random.uniform(0.7, 2.0)
    return lambda s: np.asarray(np.expm1(-rate * s) / np.expm1(-rate))


def _straight(_: np.random.Generator) -> Course:
    return lambda s: s


def _power(random: np.random.Generator) -> Course:
    power = random.uniform(1.3, 2.2)
    return lambda s: np.asarray(s**power)


def _exponential(random: np.random.Generator) -> Course:
    rate = random.uniform(1.5, 3.5)
    return lambda s: np.asarray(np.expm1(rate * s) / np.expm1(rate))


def _broken(random: np.random.Generator) -> Course:
    at, faster = random.uniform(0.3, 0.7), random.uniform(2.0, 4.0)
    whole = at + faster * (1 - at)
    return lambda s: np.asarray((s + (faster - 1) * np.maximum(s - at, 0.0)) / whole)


def _stepped(random: np.random.Generator) -> Course:
    count = int(random.integers(4, 11))
    at = np.append(np.sort(random.uniform(0.0, 1.0, count - 1)), 1.0)
    even = random.uniform(0.2, 0.5)
    size = random.gamma(2.0, size=count)
    size *= (1 - even) / size.sum()
    return lambda s: np.asarray(even * s + np.sum(size * (s[..., None] >= at), axis=-1))


SHAPES: dict[str, Callable[[np.random.Generator], Course]] = {
    "slowing down": _slowing,
    "straight": _straight,
    "power": _power,
    "exponential": _exponential,
    "with a break": _broken,
    "in steps": _stepped,
}
"""Shape to a random course of the loss, from 0 to 1; no family has the powers and the steps."""


@dataclass(frozen=True, eq=False)
class Lived:
    """A history of preload, the day of its alarm, and that on which half of the preload is lost."""

    history: PreloadHistory
    alarm: float
    end: float


def preload_life(shape: str, every: float, seed: int) -> Lived:
    """A life of a shape, measured every so many days until half of its preload is lost."""
    random = np.random.default_rng([seed, list(SHAPES).index(shape), int(every), 0xF0])
    onset = random.uniform(*HEALTHY)
    lasting = float(np.exp(random.uniform(*np.log(LASTING))))
    course = SHAPES[shape](random)
    end = onset + lasting
    days = np.arange(0.0, end, every)
    ratio = 1 - HALF * course(np.maximum(days - onset, 0.0) / lasting)
    level = ratio ** (-1 / 3) - 1
    stated = float(np.exp(random.uniform(*np.log(STATED))))
    n = len(days)
    odd = np.where(random.uniform(size=n) < ODD, ODD_SIZE, 1.0)
    noise = random.uniform(*TRUE) * stated * odd * random.standard_normal(n)
    warmer = WARM * random.uniform(-1, 1, n)
    warmer = warmer - warmer[0]
    measured = level * (1 + SCALE * random.standard_normal()) + noise - noise[0]
    measured = measured + random.uniform(-WARMTH, WARMTH) * warmer
    history = preload_history(days, measured, np.full(n, stated), temperature=warmer, scale=SCALE)
    detected = np.flatnonzero(level >= DETECTED * stated)
    alarm = float(days[detected[0]]) if len(detected) else float(days[-1])
    return Lived(history, alarm, end)


def torque_series(shape: str, seed: int, scatter: Array) -> tuple[Array, Array]:
    """Hours and readings of a screw's friction torque, N m.

    ``scatter`` are relative residuals of measured readings, of which the readings' own are drawn.
    """
    random = np.random.default_rng([seed, list(SHAPES).index(shape), 0xF1])
    part = np.arange(READINGS) / (READINGS - 1)
    lost = random.uniform(*LOST) * SHAPES[shape](random)(part)
    torque = FIRST_TORQUE * (1 - lost) * (1 + random.choice(scatter, READINGS))
    return HOURS * np.arange(READINGS, dtype=np.float64), np.asarray(torque)
