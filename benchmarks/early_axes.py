"""Axes for :mod:`benchmarks.early`: their levels, lives and disturbances, all known.

A run is simulated as its level, not as its mode table: each axis's curve of level over preload, and the
stated and the true scatter of its runs are taken from its own mode tables first, through calibration,
``change_since`` and ``fuse``. Levels are then sampled around the curve, which is thousands of times as fast.
Ten lives are simulated from mode tables for comparison (``--check``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballscrew.axis.wear import WEAR_LAWS, end_of_preload
from ballscrew.base.arrays import Array
from ballscrew.calibration.calibrated_axis import CalibratedAxis
from ballscrew.calibration.calibration import calibrate
from ballscrew.calibration.frequency_table import frequency_table
from ballscrew.estimation.fusion import FusedChange
from ballscrew.monitoring.assessment import fused_change
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.testbed.pace import Pace, worn_days
from ballscrew.testbed.trip import prepared
from benchmarks.preload import Axis, axis

__all__ = ["Course", "Curve", "Life", "course", "curve", "draw_life", "levels", "of_day", "repeats"]

RATIOS = (1.35, 1.15, 1.05, 1.0, 0.95, 0.9, 0.8, 0.65, 0.5, 0.35, 0.25)
LEFT = 0.05  # of the preload, where a law never ends: worn out
WARM = 0.01  # of ln P by a kelvin, standard deviation over axes
READ = 0.2  # K, of the temperature channel
REMOUNTED = 0.005  # of the level, standard deviation
MISSED = 0.05
ODD, ODD_SIZE = 0.03, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Level of an axis's runs over P/P₀, stated and true scatter, share, part of the friction by the nut.

    And the compliance of the support bearing over the nut's, by the model.
    """

    seed: int
    gain: float
    bend: float
    uncertainty: float
    scatter: float
    share: float
    drag: float
    bearing: float = 0.0


@dataclass(frozen=True, slots=True)
class Life:
    """Healthy until ``onset``, worn out ``days`` later."""

    onset: float
    days: float
    law: str
    pace: Pace
    warm: float
    scatter: float
    tight: float


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Days of the runs, the axis's temperature on them, true and recorded, and the remount."""

    days: Array
    temperature: Array
    read: Array
    remount: float
    step: float


def curve(seed: int) -> tuple[Curve, Axis, CalibratedAxis]:
    """Level of an axis over its preload, from its mode tables."""
    simulated = axis(seed)
    runs = simulated.experiment()
    model, settings = calibrate(runs, simulated.sheet), MonitorSettings()
    base = frequency_table(simulated.measured(400))

    def level_of(run_seed: int, ratio: float = 1.0) -> FusedChange:
        table = frequency_table(simulated.measured(run_seed, ratio))
        return fused_change(table, base, model, settings)[1]

    fused = [level_of(401 + k) for k in range(40)]
    new = np.array([each.level for each in fused])
    means = []
    for i, ratio in enumerate(RATIOS):
        worn = [level_of(500 + 10 * i + k, ratio).level for k in range(4)]
        means.append(np.mean(worn))
    gain, bend = fitted(np.log(RATIOS), np.array(means) - np.median(new))
    spread = float(np.median(np.abs(new - np.median(new)))) * 1.4826
    c = prepared(simulated.machine, simulated.load, simulated.plan)
    return (
        Curve(
            seed,
            gain,
            bend,
            float(np.median([each.random for each in fused])),
            spread,
            model.model.share,
            c.drag / (c.drag + c.coulomb),
            model.bearing_share / model.model.share,
        ),
        simulated,
        model,
    )


def fitted(log: Array, level: Array) -> tuple[float, float]:
    """Level = gain g + bend g², g = (P/P₀)^(−1/3) − 1: smooth, so that scatter adds no corners."""
    grown = np.expm1(-log / 3)
    gain, bend = np.linalg.lstsq(np.stack([grown, grown**2], axis=1), level, rcond=None)[0]
    return float(gain), float(bend)


def draw_life(seed: int) -> Life:
    """Sample of a life, from a stream of its own."""
    random = np.random.default_rng([seed, 0xE1])
    law = str(random.choice(list(WEAR_LAWS)))
    days = float(random.uniform(80, 300))
    running_in, dry = np.exp(0.3 * random.standard_normal(2))
    pace = Pace(
        running_in=0.4 * float(running_in),
        dry=0.3 * float(dry),
        greased=tuple(float(d) for d in range(28, int(days) + 1, 28)),
        roughness=0.3,
        seed=int(random.integers(2**31)),
    )
    return Life(
        onset=float(random.uniform(10, 30)),
        days=days,
        law=law,
        pace=pace,
        warm=WARM * float(random.standard_normal()),
        scatter=2.0 ** float(random.uniform(-1, 1)),
        tight=1 + 0.15 * float(random.uniform(-1, 1)),
    )


def of_day(life: Life, days: Array) -> Array:
    """P/P₀ on days of the history."""
    gone = worn_days(life.pace, np.maximum(days - life.onset, 0.0))
    whole = float(worn_days(life.pace, life.days))
    if life.law in ("contact-pressure", "external-load"):
        half = whole / float(end_of_preload(life.law, 1.0))
    else:  # at the day on which it is worn out a twentieth is left
        half = whole * (np.log(2) / -np.log(LEFT) if life.law == "exponential" else 0.259921 / 1.714418)
    return np.asarray(WEAR_LAWS[life.law](gone, 1.0, half))


def course(seed: int, end: float, every: float = 1.0) -> Course:
    """Draw when it is measured and how warm it is; some runs are missed, and a sensor is remounted."""
    random = np.random.default_rng([seed, 0xC0])
    whole = np.arange(0.0, end, every)
    days = whole[(random.uniform(size=len(whole)) > MISSED) | (whole == 0)]
    phase, slow = random.uniform(0, 2 * np.pi), random.uniform(2, 5)
    weather = np.zeros(len(whole))
    for k in range(1, len(whole)):
        weather[k] = 0.8**every * weather[k - 1] + 2.5 * np.sqrt(1 - 0.64**every) * random.standard_normal()
    warm = slow * np.sin(2 * np.pi * whole / 365 + phase) + weather
    warm = np.clip(warm, -10, 10)[np.isin(whole, days)]
    return Course(
        days,
        warm,
        warm + READ * random.standard_normal(len(days)),
        float(random.uniform(0.2, 0.9) * end),
        REMOUNTED * float(random.standard_normal()),
    )


def levels(of: Curve, life: Life, when: Course, ratio: Array, stream: int = 0) -> Array:
    """Draw the levels of runs."""
    return _true(of, life, when, ratio) + _noise(of, life, len(ratio), (stream,))[0]


def repeats(of: Curve, life: Life, when: Course, ratio: Array, stream: int, stays: float = 0.0) -> Array:
    """Levels of a second run on each day; a part of the odd runs is off by the same again."""
    again = _noise(of, life, len(ratio), (stream, 0xA6))[0]
    noise, odd = _noise(of, life, len(ratio), (stream,))
    random = np.random.default_rng([of.seed, stream, 0x57])
    same = odd & (random.uniform(size=len(ratio)) < stays)
    return _true(of, life, when, ratio) + np.where(same, noise, again)


def _noise(of: Curve, life: Life, count: int, stream: tuple[int, ...]) -> tuple[Array, NDArray[np.bool_]]:
    random = np.random.default_rng([of.seed, *stream, 0x1E])
    odd = random.uniform(size=count) < ODD
    noise = of.scatter * life.scatter * np.where(odd, ODD_SIZE, 1.0) * random.standard_normal(count)
    return np.asarray(noise), odd


def _true(of: Curve, life: Life, when: Course, ratio: Array) -> Array:
    log = np.log(np.maximum(ratio, 1e-3)) + life.warm * when.temperature
    # Against a new preload that is not the nominal one the curve is another part of itself.
    tight = np.log(life.tight)
    level = _read(of, log + tight) - _read(of, tight)
    return np.asarray(level + np.where(when.days >= when.remount, when.step, 0.0))


def _read(of: Curve, log: Array | float) -> Array:
    grown = np.expm1(-np.asarray(log) / 3)
    return np.asarray(of.gain * grown + of.bend * grown**2)
