"""Preload along the axis, and whether some stops are worn more than the others.

The frequencies of a run lie on one smooth curve along the axis, and each cell has a deviation of its own from
it. A worn place shifts all conditions of a stop together, while friction and motion shift the conditions
against each other. A deviation that all conditions of a stop have in common, and that the baseline does not
have, is therefore local wear, and the scatter of the conditions at one stop is the noise.

P(x) is modelled as a constant and a smooth random departure from it: a Gaussian process whose size is that of
the maximum likelihood (Rasmussen and Williams, 2006, ch. 2 and 5). Local wear is detected where the contrast
between some neighbouring stops and the rest exceeds a limit, which is set for a stated rate of false alarms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.arrays import Array
from ballscrew.base.quantity import NORMAL_95, Quantity, quantity_json
from ballscrew.calibration.assumptions import LOCAL_ALARM, Assumptions
from ballscrew.estimation.change import ComplianceChange, change_covariance
from ballscrew.estimation.fusion import FusedChange
from ballscrew.modal.cell import CellKey
from ballscrew.modal.run import Run

_LEAST_STOPS = 5  # three for a parabola, a place that departs from it, and another
_LEAST_FREEDOM = 4  # least degrees of freedom of the noise
_LENGTH = 0.06  # m, correlation length of a departure: two to three nut lengths
# Standard deviations of the departure of u among which the maximum of the likelihood is selected.
_SIZES = np.concatenate([[0.01], np.geomspace(0.015, 0.6, 24)])
_SMALLEST_LOSS = 0.05  # relative loss of preload up to which a place is not reported
_LEAST_U = 0.05  # u = (P/P₀)^(−1/3) of a preload 8000 times as large, which no nut has
_MOST_WORN = 1 / 3  # of all stops, for a worn place: if more are worn, the others are the exception
_BALANCING_ITERATIONS = 30  # one suffices where every stop has every condition
_TRIALS = 8_000  # simulated runs of an evenly worn axis: 40 exceed the limit at a rate of 1 in 200
_SEED = 4242  # of their random numbers: every estimate has the same


@dataclass(frozen=True, slots=True)
class PreloadProfile:
    """Preload along the axis, P(x).

    Parameters
    ----------
    position : tuple of float
        Of the stops, m; stops whose interval has no upper end are omitted.
    ratio : tuple of Quantity
        P/P₀, or P/P_ref without a baseline, at each.
    found : bool
        Whether local wear is detected.
    start, stop : float or None
        First and last stop of the worn place, m.
    loss : Quantity or None
        Loss of preload of the worn place, relative to the mean of the other stops.
    statistic, limit : float
        The largest contrast, and its limit, in standard deviations: see :func:`largest_contrast`.
    groups : tuple of (str, Quantity)
        Condition and motion, and the same ratio from the cells of these alone, with their noise as
        uncertainty; groups whose interval has no upper end are omitted.
    text : str
        The result in words.
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
        """Stops of the worn place, m; none where no local wear is detected."""
        if self.start is None or self.stop is None:
            return ()
        return tuple(x for x in self.position if self.start <= x <= self.stop)

    def to_json(self) -> dict[str, Any]:
        """Object ``profile`` in the output of ``preload --json``."""
        stops = zip(self.position, self.ratio, strict=True)
        return {
            "stops": [{"position_m": x, **ratio.to_json()} for x, ratio in stops],
            "local": {
                "found": self.found,
                "start_m": self.start,
                "stop_m": self.stop,
                "loss": quantity_json(self.loss),
                "statistic": self.statistic,
                "limit": self.limit,
            },
            "groups": [{"cells": name, **ratio.to_json()} for name, ratio in self.groups],
            "text": self.text,
        }


@dataclass(frozen=True, slots=True, eq=False)
class _Stops:
    """Cells grouped by stops.

    ``position`` (m), ``nut`` (its share of the compliance) and ``count`` (of cells) have one value a stop;
    ``at`` (index of the stop) and ``names`` (condition and motion) have one a cell.
    """

    position: Array
    nut: Array
    count: Array
    at: NDArray[np.intp]
    names: tuple[str, ...]

    def mean(self, values: Array) -> Array:
        """Mean of a value of the cells over each stop, shape (stops,)."""
        return np.asarray(np.bincount(self.at, values, len(self.position)) / self.count)

    def groups(self) -> dict[str, NDArray[np.bool_]]:
        """Mask of the cells of each condition and motion, shape (cells,)."""
        names = np.array(self.names)
        return {name: names == name for name in dict.fromkeys(self.names)}


def preload_profile(
    run: Run,
    baseline: Run | None,
    change: ComplianceChange,
    fused: FusedChange,
    share_uncertainty: float,
    curved: bool,
    assumptions: Assumptions,
) -> PreloadProfile | None:
    """Estimate P(x), and detect local wear.

    Parameters
    ----------
    run, baseline : Run
        Their cells contain the deviations from the smooth curve.
    change : ComplianceChange
        Of the cells that were fused.
    fused : FusedChange
        The change of the nut that is common to them.
    share_uncertainty : float
        Relative standard uncertainty of the nut's share.
    curved : bool
        Whether the smooth compliance is a parabola along the axis, as of a screw with bearings at both ends,
        and not a line.
    assumptions : Assumptions
        ``form``, the relative error of a frequency by which a stop may deviate without being worn, and
        ``local_alarm``.

    Returns
    -------
    PreloadProfile or None
        None for fewer than five stops, or too few cells a stop to determine the noise.
    """
    stops = _group_by_stop(change)
    # A mean of each stop, and of each condition and motion, is subtracted; one of these is redundant.
    freedom = len(stops.at) - len(stops.position) - len(set(stops.names)) + 1
    if len(stops.position) < _LEAST_STOPS or freedom < _LEAST_FREEDOM:
        return None
    y = change.y + _deviations(run, change, curved)
    if baseline is not None:
        y = y - _deviations(baseline, change, curved)
    centred = _without_condition_means(y, stops)
    means = stops.mean(centred)
    scatter = float(np.sum((centred - means[stops.at]) ** 2)) / freedom
    scatter = max(scatter, float(np.mean(change.floor**2)))
    basis = _smooth_basis(stops, curved)
    # The form of the model is not exact: a stop may deviate by that, however many cells it has. A factor of 2
    # converts a relative error of the frequency to one of Y.
    noise = scatter / stops.count + (2 * assumptions.form) ** 2
    places = windows(len(stops.position))
    statistic, limit, best = largest_contrast(
        means, noise, freedom, stops.nut, basis, places, assumptions.local_alarm
    )
    # The smooth part of Y is that of the frequencies, the local part that of the deviations. The smooth curve
    # of a run depends on the weights of its cells, so a smooth part may be missing in the deviations: it is
    # added, with a standard uncertainty of its own size.
    smooth = _projection(stops.mean(change.y) - means, stops.count, basis)
    u, covariance = _smoothed(means + smooth, noise, stops, change, fused, np.outer(smooth, smooth))
    position, ratio = [], []
    for x, value, variance in zip(stops.position.tolist(), u.tolist(), np.diag(covariance), strict=True):
        spread = math.hypot(math.sqrt(variance), (value - 1) * share_uncertainty)
        quantity = _ratio_quantity(value, spread)
        if quantity is not None:
            position.append(x)
            ratio.append(quantity)
    first, past = places[best]
    inside = np.zeros(len(stops.position), dtype=bool)
    inside[first:past] = True
    worn = _loss(u, covariance, inside, share_uncertainty)
    found = statistic > limit and worn.value > _SMALLEST_LOSS
    start = stop = loss = None
    text = "no stop is significantly more worn than the others"
    if found:
        start, stop, loss = float(stops.position[first]), float(stops.position[past - 1]), worn
        text = (
            f"wear is local: from {1e3 * start:.0f} to {1e3 * stop:.0f} mm the preload is "
            f"{100 * worn.value:.0f} % ± {100 * worn.standard_uncertainty:.0f} % less than elsewhere"
        )
    return PreloadProfile(
        tuple(position), tuple(ratio), found, start, stop, loss, statistic, limit,
        _by_group(y, change, stops, math.sqrt(scatter)), text,
    )  # fmt: skip


def windows(count: int) -> list[tuple[int, int]]:
    """All groups of neighbouring stops that may be a worn place.

    Parameters
    ----------
    count : int
        Number of stops.

    Returns
    -------
    list of (int, int)
        Index of the first stop, and of the last plus 1; at most a third of the stops, at least one.
    """
    widest = max(int(count * _MOST_WORN), 1)
    places: list[tuple[int, int]] = []
    for width in range(1, widest + 1):
        places += [(first, first + width) for first in range(count - width + 1)]
    return places


def largest_contrast(
    means: Array,
    noise: Array,
    freedom: int,
    nut: Array,
    basis: Array,
    places: Sequence[tuple[int, int]],
    alarm: float = LOCAL_ALARM,
) -> tuple[float, float, int]:
    """The place with the largest contrast, and its limit for an axis without local wear.

    The contrast of a place is the change common to its stops over its standard deviation, in a fit of this
    change and of a smooth change along the axis to all stops.

    Parameters
    ----------
    means : ndarray, shape (stops,)
        Mean of Y over the cells of each stop.
    noise : ndarray, shape (stops,)
        Variance of each mean.
    freedom : int
        Degrees of freedom with which the variance was estimated.
    nut : ndarray, shape (stops,)
        The nut's share at each.
    basis : ndarray, shape (stops, k)
        Changes of Y that are smooth along the axis.
    places : sequence of (int, int)
        As :func:`windows` lists them.
    alarm : float
        Probability that the largest contrast exceeds the limit without local wear.

    Returns
    -------
    statistic, limit : float
        In standard deviations; a loss of preload is positive.
    best : int
        Index in ``places`` of that with the largest contrast.
    """
    weight = 1 / np.sqrt(noise)
    smooth = np.linalg.qr(weight[:, None] * basis)[0]
    # Weighted change of Y by each place, without its smooth part, and of length 1; 0 where nothing remains.
    shapes = np.zeros((len(places), len(means)))
    for shape, (first, past) in zip(shapes, places, strict=True):
        shape[first:past] = nut[first:past]
    shapes = shapes * weight
    shapes = shapes - (shapes @ smooth) @ smooth.T
    length = np.linalg.norm(shapes, axis=1)
    usable = length > 1e-6 * max(float(length.max()), 1e-300)
    shapes = np.where(usable[:, None], shapes / np.where(usable, length, 1.0)[:, None], 0.0)
    contrasts = shapes @ (weight * means)
    rng = np.random.default_rng(_SEED)
    trials = rng.standard_normal((_TRIALS, len(means))) @ shapes.T
    estimated_noise = np.sqrt(rng.chisquare(freedom, _TRIALS) / freedom)
    limit = float(np.quantile(trials.max(axis=1) / estimated_noise, 1 - alarm))
    best = int(np.argmax(contrasts))
    return float(contrasts[best]), limit, best


def _group_by_stop(change: ComplianceChange) -> _Stops:
    """The cells grouped by their stops."""
    position = np.unique(change.position)
    at = np.searchsorted(position, change.position)
    count = np.bincount(at, minlength=len(position)).astype(np.float64)
    cells = zip(change.condition, change.motion, strict=True)
    names = tuple(f"{condition} {motion}" for condition, motion in cells)
    return _Stops(position, np.bincount(at, change.nut, len(position)) / count, count, at, names)


def _deviations(run: Run, change: ComplianceChange, curved: bool) -> Array:
    """Change of Y by the deviation of each cell from the smooth curve of its run, shape (n,)."""
    cells = {cell.key.rounded: cell for cell in run.cells}
    f, deviation = change.frequency.copy(), np.full(len(change.y), np.nan)
    keys = zip(change.position.tolist(), change.condition, change.motion, strict=True)
    for row, (x, condition, motion) in enumerate(keys):
        match = cells.get(CellKey(x, condition, motion).rounded)
        if match is not None and match.frequency_Hz is not None and math.isfinite(match.frequency_Hz):
            f[row] = match.frequency_Hz
        if match is not None and match.deviation_Hz is not None:
            deviation[row] = match.deviation_Hz
    smooth = _smooth_frequency(change.position, f, curved)
    deviation = np.where(np.isnan(deviation), f - smooth, deviation)
    # A frequency f may contain a part of the cell's deviation already: only the rest is added, as the change
    # of Y from f to the smooth curve plus the deviation.
    return np.asarray((1 + change.y) * ((f / (smooth + deviation)) ** 2 - 1))


def _smooth_frequency(position: Array, frequency: Array, curved: bool) -> Array:
    """Frequencies (Hz) of a compliance that is a line or parabola along the axis, fitted to those given."""
    x = (position - position.mean()) / max(float(np.ptp(position)), 1e-9)
    basis = np.vander(x, 3 if curved else 2)
    compliance = basis @ np.linalg.lstsq(basis, frequency**-2.0, rcond=None)[0]  # up to a factor
    return np.asarray(1 / np.sqrt(np.maximum(compliance, 1e-12)))


def _smooth_basis(stops: _Stops, curved: bool) -> Array:
    """Changes of Y by changes of the nut's compliance that are powers of x, shape (stops, 2 or 3)."""
    x = (stops.position - stops.position.mean()) / float(np.ptp(stops.position))
    return np.asarray(stops.nut[:, None] * np.vander(x, 3 if curved else 2))


def _without_condition_means(values: Array, stops: _Stops) -> Array:
    """Values of the cells less the mean deviation of their condition and motion from the stops' means.

    Iterated, since not every stop has every condition.
    """
    values, groups = values.copy(), stops.groups()
    for _ in range(_BALANCING_ITERATIONS):
        means = stops.mean(values)
        for cells in groups.values():
            values[cells] -= float(np.mean(values[cells] - means[stops.at[cells]]))
    return values


def _projection(means: Array, counts: Array, basis: Array) -> Array:
    """Smooth part of the stops' means: their fit by the basis, weighted with the number of cells."""
    weight = np.sqrt(counts)[:, None]
    return np.asarray(basis @ np.linalg.lstsq(weight * basis, weight[:, 0] * means, rcond=None)[0])


def _smoothed(
    y: Array, noise: Array, stops: _Stops, change: ComplianceChange, fused: FusedChange, further: Array
) -> tuple[Array, Array]:
    """Estimate u = (P/P₀)^(−1/3) at the stops, shape (stops,), by a Gaussian process; with its covariance.

    ``y`` is the mean Y of each stop and ``noise`` its variance by the scatter of the cells, shape (stops,);
    ``further`` is the covariance of further errors, shape (stops, stops).
    """
    count, nut = len(stops.position), stops.nut
    # Matrix of the mean over the cells of each stop, shape (stops, cells).
    mean = (stops.at == np.arange(count)[:, None]) / stops.count[:, None]
    errors = mean @ change_covariance(change) @ mean.T + further
    # The scatter contains the cells' own errors, which are in the covariance already: the rest is added.
    own_variance = change.floor**2
    if change.own is not None:
        own_variance = own_variance + change.own**2
    included = mean**2 @ own_variance
    errors = errors + np.diag(np.maximum(noise - included, 0.0))
    distance = stops.position[:, None] - stops.position[None]
    correlation = np.exp(-0.5 * (distance / _LENGTH) ** 2)
    deviation = y - fused.level * nut
    best = -math.inf  # log likelihood
    departure, covariance = np.zeros(count), np.zeros((count, count))
    for size in _SIZES.tolist():
        prior = size**2 * correlation + 1.0  # + 1: a constant with a standard deviation of 1, nearly free
        total = nut[:, None] * prior * nut[None] + errors
        log_determinant = float(np.linalg.slogdet(total)[1])
        log_likelihood = -0.5 * (log_determinant + float(deviation @ np.linalg.solve(total, deviation)))
        if log_likelihood > best:
            best = log_likelihood
            gain = np.linalg.solve(total, (prior * nut[None]).T).T
            departure, covariance = gain @ deviation, prior - gain @ (prior * nut[None]).T
    # A small variance is added so that rounding makes none negative.
    return np.asarray(1 + fused.level + departure), covariance + 1e-12 * np.eye(count)


def _ratio_quantity(u: float, spread: float) -> Quantity | None:
    """P/P₀ = u⁻³ from u and its standard uncertainty; None where its interval has no upper end."""
    half = NORMAL_95 * spread
    if not u - half > _LEAST_U:
        return None
    value = u**-3
    return Quantity(value, 3 * value / u * spread, "", ((u + half) ** -3, (u - half) ** -3))


def _loss(u: Array, covariance: Array, inside: NDArray[np.bool_], share_uncertainty: float) -> Quantity:
    """Loss of preload at the stops ``inside`` a place, relative to the mean of the others."""
    mean_inside, mean_outside = inside / inside.sum(), ~inside / (~inside).sum()  # weights of two means
    u_inside, u_outside = max(float(mean_inside @ u), _LEAST_U), max(float(mean_outside @ u), _LEAST_U)
    ratio = u_inside / u_outside
    slope = mean_inside / u_inside - mean_outside / u_outside  # d ln ratio/du
    by_share = (1 - 1 / ratio) * share_uncertainty
    spread = ratio * math.sqrt(float(slope @ covariance @ slope) + by_share**2)
    value = 1 - ratio**-3
    low = 1 - max(ratio - NORMAL_95 * spread, _LEAST_U) ** -3
    high = 1 - max(ratio + NORMAL_95 * spread, _LEAST_U) ** -3
    return Quantity(value, 3 * ratio**-4 * spread, "", (min(low, value), high))


def _by_group(
    y: Array, change: ComplianceChange, stops: _Stops, noise: float
) -> tuple[tuple[str, Quantity], ...]:
    """P/P₀ from the cells of each condition and motion alone; ``noise`` is the standard deviation of Y."""
    ratios = []
    for name, cells in stops.groups().items():
        nut = change.nut[cells]
        information = float(nut @ nut)
        u = 1 + float(nut @ y[cells]) / information  # least squares of Y = s (u − 1)
        quantity = _ratio_quantity(u, noise / math.sqrt(information))
        if quantity is not None:
            ratios.append((name, quantity))
    return tuple(ratios)
