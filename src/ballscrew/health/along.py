"""Preload along the axis: where wear is local, which stops are worn more than the others.

A run's frequencies lie on one smooth course, and each cell tells by how much its own data differ from that.
What all conditions of a stop say alike, beyond what they said in the baseline, is local: friction and motion
move conditions apart, a dent moves them together. How far conditions of one stop scatter is the noise against
which it is judged.

P(x) is a level and a smooth random departure from it (a Gaussian process), as large as the run shows it
(Rasmussen and Williams, 2006, ch. 2 and 5). Whether there is one at all is decided by the largest of all
contrasts of some neighbouring stops against the rest, with the limit that only so many good runs exceed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.quantity import Quantity
from ballscrew.health.change import Change, covariance_of
from ballscrew.health.fusion import Fused
from ballscrew.modal.run import CellResult, Run

__all__ = ["Along", "along_the_axis", "largest_contrast", "windows"]

Array = NDArray[np.float64]
_LEAST_STOPS = 5
_LENGTH = 0.06  # m, over which a departure hangs together
_SPREADS = np.concatenate([[0.01], np.geomspace(0.015, 0.6, 24)])  # of u
_WIDEST = 1 / 3  # of the stops that a local loss may hold: more is no place but a course
_CALM = 0.005  # probability that an evenly worn axis shows a place, one in two hundred
_SMALL = 0.05  # less is no place worth a name
_TRIALS = 8_000
_SEED = 4242
_NORMAL_95 = 1.959963984540054
_LEAST_FREE = 4


@dataclass(frozen=True, slots=True)
class Along:
    """P(x).

    Parameters
    ----------
    position : tuple of float
        Of the stops, m.
    ratio : tuple of Quantity
        P over its reference at each.
    found : bool
        Whether some stops are worn more than the others.
    start, stop : float or None
        First and last stop of the place, m.
    loss : Quantity or None
        There, less than at the other stops, as a part of these.
    statistic, limit : float
        The largest contrast, and what one in two hundred evenly worn axes exceeds.
    groups : tuple of (str, Quantity)
        What each condition and motion alone says of P over its reference, by the noise of its cells.
    text : str
        In words.
    """

    position: tuple[float, ...]
    ratio: tuple[Quantity, ...]
    found: bool
    start: float | None
    stop: float | None
    loss: Quantity | None
    statistic: float
    limit: float
    groups: tuple[tuple[str, Quantity], ...]
    text: str

    @property
    def places(self) -> tuple[float, ...]:
        """Stops that are worn more than the others, m; none where none is found."""
        if self.start is None or self.stop is None:
            return ()
        return tuple(x for x in self.position if self.start <= x <= self.stop)

    def to_json(self) -> dict[str, Any]:
        """As ``preload --json`` prints it."""
        return {
            "stops": [
                {"position_m": x, **ratio.to_json()}
                for x, ratio in zip(self.position, self.ratio, strict=True)
            ],
            "local": {
                "found": self.found,
                "start_m": self.start,
                "stop_m": self.stop,
                "loss": None if self.loss is None else self.loss.to_json(),
                "statistic": self.statistic,
                "limit": self.limit,
            },
            "groups": [{"cells": name, **ratio.to_json()} for name, ratio in self.groups],
            "text": self.text,
        }


def along_the_axis(
    run: Run,
    baseline: Run | None,
    change: Change,
    fused: Fused,
    share_spread: float,
    curved: bool,
    form: float,
) -> Along | None:
    """Tell P(x), and whether wear is local.

    Parameters
    ----------
    run, baseline : Run
        Their cells hold the deviations from the smooth course.
    change : Change
        Of the cells that were fused.
    fused : Fused
        Their level.
    share_spread : float
        Relative standard uncertainty of the nut's share.
    curved : bool
        Whether the smooth course is a parabola: a screw held at both ends.
    form : float
        By what part of its frequency a stop may stand out without being worn.

    Returns
    -------
    Along or None
        None where there are fewer than five stops, or too few cells a stop to tell noise from wear.
    """
    stops = np.unique(change.position)
    if len(stops) < _LEAST_STOPS:
        return None
    own = change.y + _own(run, change, curved) - (0.0 if baseline is None else _own(baseline, change, curved))
    at = np.searchsorted(stops, change.position)
    names = [f"{c} {m}" for c, m in zip(change.condition, change.motion, strict=True)]
    centred = _apart(own, names, at)
    counts = np.bincount(at, minlength=len(stops)).astype(np.float64)
    means = np.bincount(at, centred, len(stops)) / counts
    free = len(at) - len(stops) - len(set(names)) + 1
    if free < _LEAST_FREE:
        return None
    scatter = float(np.sum((centred - means[at]) ** 2)) / free
    scatter = max(scatter, float(np.mean(change.floor**2)))
    smooth = np.bincount(at, change.y, len(stops)) / counts
    nut = np.bincount(at, change.nut, len(stops)) / counts
    basis = _basis(stops, nut, curved)
    places = windows(len(stops))
    # No model's course is exact: a stop may stand out by that however many cells say so.
    noise = scatter / counts + (2 * form) ** 2
    statistic, limit, best = largest_contrast(means, noise, free, nut, basis, places)
    u, spread = _course(
        means + _course_of(smooth - means, counts, basis), nut, at, change, noise, stops, fused
    )
    ratio = tuple(
        _ratio(level, math.hypot(s, (level - 1) * share_spread)) for level, s in zip(u, spread, strict=True)
    )
    inside = np.zeros(len(stops), dtype=bool)
    inside[slice(*places[best])] = True
    worn = _loss(u, inside, max(statistic, 1e-9))
    found = statistic > limit and worn.value > _SMALL
    start, stop, loss = None, None, None
    text = "no stop is worn more than the others, as far as the run can tell"
    if found:
        start, stop = float(stops[inside][0]), float(stops[inside][-1])
        loss = worn
        text = (
            f"wear is local: from {1e3 * start:.0f} to {1e3 * stop:.0f} mm the preload is "
            f"{100 * worn.value:.0f} % less than elsewhere"
        )
    groups = _groups(own, change, names, math.sqrt(scatter))
    return Along(tuple(stops.tolist()), ratio, found, start, stop, loss, statistic, limit, groups, text)


def windows(count: int) -> list[tuple[int, int]]:
    """Every run of neighbouring stops that may be a place: first, and one past the last.

    Parameters
    ----------
    count : int
        Stops.

    Returns
    -------
    list of (int, int)
        Of a third of the stops at most.
    """
    widest = max(int(count * _WIDEST), 1)
    return [(a, a + n) for n in range(1, widest + 1) for a in range(count - n + 1)]


def largest_contrast(
    means: Array,
    noise: Array,
    free: int,
    nut: Array,
    basis: Array,
    places: Sequence[tuple[int, int]],
) -> tuple[float, float, int]:
    """The place that stands out most, and how far the largest does where nothing is there.

    Parameters
    ----------
    means : ndarray, shape (stops,)
        What each stop says beyond the smooth course.
    noise : ndarray, shape (stops,)
        Variance of each.
    free : int
        Degrees of freedom that the variance was told from.
    nut : ndarray, shape (stops,)
        The nut's share at each.
    basis : ndarray, shape (stops, k)
        What belongs to the smooth course.
    places : sequence of (int, int)
        As :func:`windows` lists them.

    Returns
    -------
    statistic, limit : float
        In standard deviations; a loss is positive.
    best : int
        Which of the places.
    """
    weight = 1 / np.sqrt(noise)
    course = np.linalg.qr(weight[:, None] * basis)[0]
    shapes = np.zeros((len(places), len(means)))
    for row, (first, past) in zip(shapes, places, strict=True):
        row[first:past] = nut[first:past]
    shapes = shapes * weight
    shapes = shapes - (shapes @ course) @ course.T
    length = np.linalg.norm(shapes, axis=1)
    usable = length > 1e-6 * max(float(length.max()), 1e-300)
    shapes = np.where(usable[:, None], shapes / np.where(usable, length, 1.0)[:, None], 0.0)
    told = shapes @ (weight * means)
    rng = np.random.default_rng(_SEED)
    drawn = rng.standard_normal((_TRIALS, len(means))) @ shapes.T
    guessed = np.sqrt(rng.chisquare(free, _TRIALS) / free)
    limit = float(np.quantile(drawn.max(axis=1) / guessed, 1 - _CALM))
    best = int(np.argmax(told))
    return float(told[best]), limit, best


def _own(run: Run, change: Change, curved: bool) -> Array:
    """What each cell's own data add to Y: its deviation from the run's smooth course, Y per Hz being −2/f."""
    cells = {(round(c.position_m * 1e6), c.condition, c.motion): c for c in run.cells}
    picked: list[CellResult | None] = [
        cells.get((round(x * 1e6), c, m))
        for x, c, m in zip(change.position.tolist(), change.condition, change.motion, strict=True)
    ]
    f = np.array([np.nan if c is None or c.frequency_Hz is None else c.frequency_Hz for c in picked])
    f = np.where(np.isfinite(f), f, change.frequency)
    smooth = _smooth(change.position, f, curved)
    off = np.array(
        [
            value - course if c is None or c.deviation_Hz is None else c.deviation_Hz
            for c, value, course in zip(picked, f, smooth, strict=True)
        ]
    )
    # The frequency that is told may hold a part of the local course already.
    return np.asarray((1 + change.y) * ((f / (smooth + off)) ** 2 - 1))


def _smooth(position: Array, frequency: Array, curved: bool) -> Array:
    """The course without local parts: compliance linear in the position, or a parabola."""
    x = (position - position.mean()) / max(float(np.ptp(position)), 1e-9)
    basis = np.vander(x, 3 if curved else 2)
    fitted = np.linalg.lstsq(basis, frequency**-2.0, rcond=None)[0]
    return np.asarray(1 / np.sqrt(np.maximum(basis @ fitted, 1e-12)))


def _apart(values: Array, names: Sequence[str], at: NDArray[np.intp]) -> Array:
    """Without what a condition has in common; both ways in turn, since not every stop has every condition."""
    left, groups = values.copy(), np.array(names)
    for _ in range(30):
        means = np.bincount(at, left) / np.bincount(at)
        for name in dict.fromkeys(names):
            mine = groups == name
            step = float(np.mean(left[mine] - means[at[mine]]))
            left[mine] -= step
    return left


def _basis(stops: Array, nut: Array, curved: bool) -> Array:
    """Smooth changes of the compliance over the compliance itself, which the nut's share is inverse to."""
    x = (stops - stops.mean()) / float(np.ptp(stops))
    return np.asarray(nut[:, None] * np.vander(x, 3 if curved else 2))


def _course_of(means: Array, counts: Array, basis: Array) -> Array:
    """What of the stops' means belongs to the smooth course, which is told already."""
    weight = np.sqrt(counts)[:, None]
    return np.asarray(basis @ np.linalg.lstsq(weight * basis, weight[:, 0] * means, rcond=None)[0])


def _course(
    y: Array, nut: Array, at: NDArray[np.intp], change: Change, noise: Array, stops: Array, fused: Fused
) -> tuple[Array, Array]:
    """Tell (P/P₀)^(−1/3) at every stop, and its standard deviation.

    A level and a departure of the likeliest size.
    """
    mean = np.zeros((len(stops), len(at)))
    mean[at, np.arange(len(at))] = 1.0
    mean /= mean.sum(axis=1, keepdims=True)
    errors = mean @ covariance_of(change) @ mean.T + np.diag(noise)
    near = np.exp(-0.5 * ((stops[:, None] - stops[None]) / _LENGTH) ** 2)
    off = y - fused.level * nut
    best, kept = -math.inf, (np.zeros(len(stops)), np.zeros((len(stops), len(stops))))
    for size in _SPREADS.tolist():
        # The level is free: a wide prior about what all cells say.
        prior = size**2 * near + 1.0
        whole = (nut[:, None] * prior * nut[None]) + errors
        likely = -0.5 * float(np.linalg.slogdet(whole)[1]) - 0.5 * float(off @ np.linalg.solve(whole, off))
        if likely > best:
            reach = prior * nut[None]
            gain = np.linalg.solve(whole, reach.T).T
            best, kept = likely, (gain @ off, prior - gain @ reach.T)
    return np.asarray(1 + fused.level + kept[0]), np.sqrt(np.clip(np.diag(kept[1]), 1e-12, None))


def _ratio(u: float, spread: float) -> Quantity:
    low, middle, high = (max(v, 0.05) ** -3 for v in (u + _NORMAL_95 * spread, u, u - _NORMAL_95 * spread))
    return Quantity(middle, 3 * middle / max(u, 0.05) * spread, "", (low, high))


def _loss(u: Array, inside: NDArray[np.bool_], statistic: float) -> Quantity:
    part = (float(np.mean(u[inside])) / float(np.mean(u[~inside]))) ** -3
    value = 1 - part
    return Quantity(value, abs(value) / statistic, "")


def _groups(
    own: Array, change: Change, names: Sequence[str], noise: float
) -> tuple[tuple[str, Quantity], ...]:
    told, groups = [], np.array(names)
    for name in dict.fromkeys(names):
        mine = groups == name
        nut = change.nut[mine]
        size = float(nut @ nut)
        u = 1 + float(nut @ own[mine]) / size
        told.append((name, _ratio(u, noise / math.sqrt(size))))
    return tuple(told)
