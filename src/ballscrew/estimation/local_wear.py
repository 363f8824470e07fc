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
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95, Quantity
from ballscrew.estimation.change import ComplianceChange, covariance_of
from ballscrew.estimation.contrast import CALM, largest_contrast, windows
from ballscrew.estimation.fusion import FusedChange
from ballscrew.modal.run import CellResult, Run

__all__ = ["Along", "along_the_axis", "largest_contrast", "windows"]

_LEAST_STOPS = 5
_LENGTH = 0.06  # m, over which a departure hangs together
_SPREADS = np.concatenate([[0.01], np.geomspace(0.015, 0.6, 24)])  # of u
_SMALL = 0.05  # less is no place worth a name
_LEAST_FREE = 4
_STIFF = 0.05  # u of a preload 8000 times as large: no nut has it
_Key = TypeVar("_Key")


@dataclass(frozen=True, slots=True)
class Along:
    """P(x).

    Parameters
    ----------
    position : tuple of float
        Of the stops, m; one whose interval has no upper end is left out.
    ratio : tuple of Quantity
        P over its reference at each.
    found : bool
        Whether some stops are worn more than the others.
    start, stop : float or None
        First and last stop of the place, m.
    loss : Quantity or None
        There, less than at the other stops, as a part of these.
    statistic, limit : float
        The largest contrast, and what as few evenly worn axes exceed as was asked for.
    groups : tuple of (str, Quantity)
        What each condition and motion alone says of P over its reference, by the noise of its cells; one
        whose interval has no upper end is left out.
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
    change: ComplianceChange,
    fused: FusedChange,
    share_uncertainty: float,
    curved: bool,
    form: float,
    alarm: float = CALM,
) -> Along | None:
    """Tell P(x), and whether wear is local.

    Parameters
    ----------
    run, baseline : Run
        Their cells hold the deviations from the smooth course.
    change : ComplianceChange
        Of the cells that were fused.
    fused : FusedChange
        Their level.
    share_uncertainty : float
        Relative standard uncertainty of the nut's share.
    curved : bool
        Whether the smooth course is a parabola: a screw held at both ends.
    form : float
        By what part of its frequency a stop may stand out without being worn.
    alarm : float
        Probability that an evenly worn axis is called locally worn.

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
    statistic, limit, best = largest_contrast(means, noise, free, nut, basis, places, alarm)
    u, errors = _course(
        means + _course_of(smooth - means, counts, basis), nut, at, change, noise, stops, fused
    )
    told = _told(
        (x, _ratio(level, math.hypot(s, (level - 1) * share_uncertainty)))
        for x, level, s in zip(stops.tolist(), u.tolist(), np.sqrt(np.diag(errors)).tolist(), strict=True)
    )
    inside = np.zeros(len(stops), dtype=bool)
    inside[slice(*places[best])] = True
    worn = _loss(u, errors, inside, share_uncertainty)
    found = statistic > limit and worn.value > _SMALL
    start, stop, loss = None, None, None
    text = "no stop is worn more than the others, as far as the run can tell"
    if found:
        start, stop = float(stops[inside][0]), float(stops[inside][-1])
        loss = worn
        text = (
            f"wear is local: from {1e3 * start:.0f} to {1e3 * stop:.0f} mm the preload is "
            f"{100 * worn.value:.0f} % ± {100 * worn.standard_uncertainty:.0f} % less than elsewhere"
        )
    groups = _groups(own, change, names, math.sqrt(scatter))
    position, ratio = tuple(x for x, _ in told), tuple(one for _, one in told)
    return Along(position, ratio, found, start, stop, loss, statistic, limit, groups, text)


def _own(run: Run, change: ComplianceChange, curved: bool) -> Array:
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
    y: Array,
    nut: Array,
    at: NDArray[np.intp],
    change: ComplianceChange,
    noise: Array,
    stops: Array,
    fused: FusedChange,
) -> tuple[Array, Array]:
    """Tell (P/P₀)^(−1/3) at every stop, and its covariance.

    A level and a departure of the likeliest size.
    """
    mean = np.zeros((len(stops), len(at)))
    mean[at, np.arange(len(at))] = 1.0
    mean /= mean.sum(axis=1, keepdims=True)
    errors = mean @ covariance_of(change) @ mean.T
    # The scatter that is seen holds what the cells tell of their own; only the rest of it is added.
    alone = change.floor**2 + (0.0 if change.own is None else change.own**2)
    errors = errors + np.diag(np.maximum(noise - np.diag(mean @ np.diag(alone) @ mean.T), 0.0))
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
    return np.asarray(1 + fused.level + kept[0]), kept[1] + 1e-12 * np.eye(len(stops))


def _ratio(u: float, spread: float) -> Quantity | None:
    """P over its reference; None where its interval has no upper end."""
    ends = u + NORMAL_95 * spread, u, u - NORMAL_95 * spread
    if not ends[-1] > _STIFF:
        return None
    low, middle, high = (v**-3 for v in ends)
    return Quantity(middle, 3 * middle / u * spread, "", (low, high))


def _told(given: Iterable[tuple[_Key, Quantity | None]]) -> list[tuple[_Key, Quantity]]:
    return [(key, one) for key, one in given if one is not None]


def _loss(u: Array, errors: Array, inside: NDArray[np.bool_], share_uncertainty: float) -> Quantity:
    """What is lost at some stops against the others, with what the course errs by there and here."""
    here, there = inside / inside.sum(), ~inside / (~inside).sum()
    near, far = max(float(here @ u), _STIFF), max(float(there @ u), _STIFF)
    more, slope = near / far, here / near - there / far
    by_share = (1 - 1 / more) * share_uncertainty
    spread = more * math.sqrt(float(slope @ errors @ slope) + by_share**2)
    low, high = (1 - max(more + side * NORMAL_95 * spread, _STIFF) ** -3 for side in (-1, 1))
    value = 1 - more**-3
    return Quantity(value, 3 * more**-4 * spread, "", (min(low, value), high))


def _groups(
    own: Array, change: ComplianceChange, names: Sequence[str], noise: float
) -> tuple[tuple[str, Quantity], ...]:
    told: list[tuple[str, Quantity | None]] = []
    groups = np.array(names)
    for name in dict.fromkeys(names):
        mine = groups == name
        nut = change.nut[mine]
        size = float(nut @ nut)
        u = 1 + float(nut @ own[mine]) / size
        told.append((name, _ratio(u, noise / math.sqrt(size))))
    return tuple(_told(told))
