"""Preload along the axis, and whether some stops are worn more than the others.

The frequencies of a run lie on one smooth curve along the axis, and each cell has a deviation of its own from
it. A worn place changes the frequencies of all conditions at a stop alike, while friction and motion change
those of the conditions differently. A deviation that all conditions of a stop have in common, and that the
baseline does not have, is therefore local wear, and the scatter of the conditions at one stop is the noise.

P(x) is modelled as a constant and a smooth random departure from it: a Gaussian process, the standard
deviation of which maximises the likelihood (Rasmussen and Williams, 2006, ch. 2 and 5). Local wear is
detected where the contrast between some neighbouring stops and the rest exceeds a limit, which is set for a
stated probability of a false alarm.
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

_LEAST_STOPS = 5  # three determine a parabola, one is the worn place, and one more is not worn
_LEAST_FREEDOM = 4  # least degrees of freedom of the noise
_LENGTH = 0.06  # m, correlation length of a departure: two to three nut lengths
# Standard deviations of the departure of u, of which that with the largest likelihood is selected.
_SIZES = np.concatenate([[0.01], np.geomspace(0.015, 0.6, 24)])
_SMALLEST_LOSS = 0.05  # relative loss of preload up to which a place is not reported
_LEAST_U = 0.05  # least u = (P/P₀)^(−1/3): that of a preload 8000 times as large, which no nut has
_MOST_WORN = 1 / 3  # part of the stops that a worn place may have: with more, the rest would be the exception
_BALANCING_ITERATIONS = 30  # one suffices where every stop has every condition
_TRIALS = 8_000  # simulated runs of an evenly worn axis: 40 of them exceed a limit for 1 in 200
_SEED = 4242  # of the random numbers of these runs, which are the same in every estimate
_NEGLIGIBLE = 1e-6  # over the longest shape: a shorter one consists of rounding errors


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
        Name of each condition and motion, such as "PA 0", and the ratio of preloads from its cells alone,
        whose uncertainty contains only their noise; groups whose interval has no upper end are omitted.
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

    ``position`` (m), ``nut_share`` (mean of the nut's share of the compliance) and ``count`` (of cells) have
    one value for each stop; ``stop_of_cell`` (index of the stop) and ``names`` (condition and motion) have
    one for each cell.
    """

    position: Array
    nut_share: Array
    count: Array
    stop_of_cell: NDArray[np.intp]
    names: tuple[str, ...]

    def mean(self, values: Array) -> Array:
        """Mean over the cells of each stop, shape (stops,), of values of the cells, shape (cells,)."""
        return np.asarray(np.bincount(self.stop_of_cell, values, len(self.position)) / self.count)

    def groups(self) -> dict[str, NDArray[np.bool_]]:
        """Mask of the cells of each condition and motion, shape (cells,), by their name."""
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
    run : Run
        Its cells state their deviations from the smooth curve.
    baseline : Run or None
        Likewise; None where the model is the reference.
    change : ComplianceChange
        Of the cells that were fused.
    fused : FusedChange
        The change of the nut that is common to these cells.
    share_uncertainty : float
        Relative standard uncertainty of the nut's share.
    curved : bool
        Whether the smooth compliance is a parabola along the axis, as of a screw with bearings at both ends,
        and not a line.
    assumptions : Assumptions
        With ``form``, the relative error of a frequency by which a stop may deviate without being worn, and
        ``local_alarm``, the probability of a false alarm.

    Returns
    -------
    PreloadProfile or None
        None where there are fewer than five stops, or too few cells at each to determine the noise.
    """
    stops = _group_by_stop(change)
    # A mean of each stop, and of each condition and motion, is subtracted; one of these is redundant.
    freedom = len(stops.names) - len(stops.position) - len(set(stops.names)) + 1
    if len(stops.position) < _LEAST_STOPS or freedom < _LEAST_FREEDOM:
        return None
    y = change.y + _deviations(run, change, curved)
    if baseline is not None:
        y = y - _deviations(baseline, change, curved)
    centred = _without_condition_means(y, stops)
    means = stops.mean(centred)
    cell_variance = float(np.sum((centred - means[stops.stop_of_cell]) ** 2)) / freedom
    cell_variance = max(cell_variance, float(np.mean(change.floor**2)))
    basis = _smooth_basis(stops, curved)
    # A stop may deviate by the error of the model's form, however many cells it has, independently of the
    # others. A relative error of the frequency is half of that of 1 + Y, which is about 1.
    noise = cell_variance / stops.count + (2 * assumptions.form) ** 2
    places = possible_places(len(stops.position))
    statistic, limit, best = largest_contrast(
        means, noise, freedom, stops.nut_share, basis, places, assumptions.local_alarm
    )
    # The frequencies determine the smooth part of Y, and the deviations the local part. The deviations may
    # have a smooth part too, since the smooth curve of a run depends on the weights of its cells. It is
    # replaced by that of the frequencies, and the difference has a standard uncertainty of its own size.
    smooth = _smooth_part(stops.mean(change.y) - means, stops.count, basis)
    u, covariance = _fit_profile(means + smooth, noise, stops, change, fused, np.outer(smooth, smooth))
    position, ratio = [], []
    for x, value, variance in zip(stops.position.tolist(), u.tolist(), np.diag(covariance), strict=True):
        spread = math.hypot(math.sqrt(variance), (value - 1) * share_uncertainty)
        quantity = _ratio_quantity(value, spread)
        if quantity is not None:
            position.append(x)
            ratio.append(quantity)
    first, end = places[best]
    inside = np.zeros(len(stops.position), dtype=bool)
    inside[first:end] = True
    worn = _loss(u, covariance, inside, share_uncertainty)
    found = statistic > limit and worn.value > _SMALLEST_LOSS
    start = stop = loss = None
    text = "no stop is significantly more worn than the others"
    if found:
        start = float(stops.position[first])
        stop = float(stops.position[end - 1])
        loss = worn
        text = (
            f"wear is local: from {1e3 * start:.0f} to {1e3 * stop:.0f} mm the preload is "
            f"{100 * worn.value:.0f} % ± {100 * worn.standard_uncertainty:.0f} % less than elsewhere"
        )
    return PreloadProfile(
        tuple(position), tuple(ratio), found, start, stop, loss, statistic, limit,
        _ratios_of_groups(y, change, stops, math.sqrt(cell_variance)), text,
    )  # fmt: skip


def possible_places(count: int) -> list[tuple[int, int]]:
    """All groups of neighbouring stops that may be a worn place.

    Parameters
    ----------
    count : int
        Number of stops.

    Returns
    -------
    list of (int, int)
        Index of the first stop of each group, and of the last plus 1. A group has at most a third of the
        stops, and at least one.
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
    nut_share: Array,
    basis: Array,
    places: Sequence[tuple[int, int]],
    false_alarm: float = LOCAL_ALARM,
) -> tuple[float, float, int]:
    """The place with the largest contrast, and its limit for an axis without local wear.

    A change common to the stops of a place, and a smooth change along the axis, are fitted to all stops. The
    contrast of the place is the first over its standard deviation. The limit is a quantile of the largest
    contrast in simulated runs without local wear.

    Parameters
    ----------
    means : ndarray, shape (stops,)
        Mean of Y over the cells of each stop.
    noise : ndarray, shape (stops,)
        Variance of each mean.
    freedom : int
        Degrees of freedom with which the variance was estimated.
    nut_share : ndarray, shape (stops,)
        The nut's share of the compliance at each stop.
    basis : ndarray, shape (stops, k)
        Changes of Y that are smooth along the axis.
    places : sequence of (int, int)
        As :func:`possible_places` lists them.
    false_alarm : float
        Probability that the largest contrast exceeds the limit without local wear.

    Returns
    -------
    statistic, limit : float
        The largest contrast and its limit, in standard deviations; that of a loss of preload is positive.
    best : int
        Index in ``places`` of that with the largest contrast.
    """
    weight = 1 / np.sqrt(noise)
    smooth = np.linalg.qr(weight[:, None] * basis)[0]
    # Weighted change of Y by each place, without its smooth part, and of length 1; 0 where nothing remains.
    shapes = np.zeros((len(places), len(means)))
    for shape, (first, end) in zip(shapes, places, strict=True):
        shape[first:end] = nut_share[first:end]
    shapes = shapes * weight
    shapes = shapes - (shapes @ smooth) @ smooth.T
    length = np.linalg.norm(shapes, axis=1)
    usable = length > _NEGLIGIBLE * max(float(length.max()), 1e-300)  # none where all lengths are 0
    divisor = np.where(usable, length, 1.0)
    shapes = np.where(usable[:, None], shapes / divisor[:, None], 0.0)
    contrasts = shapes @ (weight * means)
    rng = np.random.default_rng(_SEED)
    trials = rng.standard_normal((_TRIALS, len(means))) @ shapes.T
    noise_ratio = np.sqrt(rng.chisquare(freedom, _TRIALS) / freedom)  # estimated over true standard deviation
    limit = float(np.quantile(trials.max(axis=1) / noise_ratio, 1 - false_alarm))
    best = int(np.argmax(contrasts))
    return float(contrasts[best]), limit, best


def _group_by_stop(change: ComplianceChange) -> _Stops:
    """The cells grouped by their stops."""
    position = np.unique(change.position)
    stop_of_cell = np.searchsorted(position, change.position)
    count = np.bincount(stop_of_cell, minlength=len(position)).astype(np.float64)
    nut_share = np.bincount(stop_of_cell, change.nut_share, len(position)) / count
    cells = zip(change.condition, change.motion, strict=True)
    names = tuple(f"{condition} {motion}" for condition, motion in cells)
    return _Stops(position, nut_share, count, stop_of_cell, names)


def _deviations(run: Run, change: ComplianceChange, curved: bool) -> Array:
    """Change of Y if each cell has the smooth curve of its run plus its whole deviation, shape (cells,).

    Where a run states no deviation, it is that of the frequency from a smooth curve fitted here.
    """
    cells = {cell.key.rounded: cell for cell in run.cells}
    f = change.frequency.copy()
    deviation = np.full(len(change.y), np.nan)
    keys = zip(change.position.tolist(), change.condition, change.motion, strict=True)
    for row, (x, condition, motion) in enumerate(keys):
        match = cells.get(CellKey(x, condition, motion).rounded)
        if match is not None and match.frequency_Hz is not None and math.isfinite(match.frequency_Hz):
            f[row] = match.frequency_Hz
        if match is not None and match.deviation_Hz is not None:
            deviation[row] = match.deviation_Hz
    smooth = _smooth_frequency(change.position, f, curved)
    deviation = np.where(np.isnan(deviation), f - smooth, deviation)
    # A frequency f may contain a part of the cell's deviation already. The result is therefore the change of
    # Y from f to the smooth curve plus the whole deviation.
    return np.asarray((1 + change.y) * ((f / (smooth + deviation)) ** 2 - 1))


def _smooth_frequency(position: Array, frequency: Array, curved: bool) -> Array:
    """Smooth curve through frequencies (Hz): f⁻², in proportion to the compliance, is a polynomial."""
    basis = _powers(position, curved)
    smooth = basis @ np.linalg.lstsq(basis, frequency**-2.0, rcond=None)[0]
    return np.asarray(1 / np.sqrt(np.maximum(smooth, 1e-12)))


def _smooth_basis(stops: _Stops, curved: bool) -> Array:
    """Changes of Y by changes of the nut's compliance that are powers of x, shape (stops, 2 or 3)."""
    return np.asarray(stops.nut_share[:, None] * _powers(stops.position, curved))


def _powers(position: Array, curved: bool) -> Array:
    """Powers 1 and 0 of the position, shape (n, 2), or 2, 1 and 0 where the compliance is a parabola."""
    x = (position - position.mean()) / max(float(np.ptp(position)), 1e-9)
    return np.vander(x, 3 if curved else 2)


def _without_condition_means(values: Array, stops: _Stops) -> Array:
    """Values of the cells less the mean deviation of their condition and motion from the stops' means.

    ``values`` and the result have the shape (cells,). The subtraction changes the means of stops that do not
    have every condition, so it is repeated.
    """
    values = values.copy()
    groups = stops.groups()
    for _ in range(_BALANCING_ITERATIONS):
        means = stops.mean(values)
        for cells in groups.values():
            values[cells] -= float(np.mean(values[cells] - means[stops.stop_of_cell[cells]]))
    return values


def _smooth_part(means: Array, counts: Array, basis: Array) -> Array:
    """Fit of the stops' means by the basis, weighted with the number of cells, shape (stops,)."""
    weight = np.sqrt(counts)[:, None]
    return np.asarray(basis @ np.linalg.lstsq(weight * basis, weight[:, 0] * means, rcond=None)[0])


def _fit_profile(
    y: Array, noise: Array, stops: _Stops, change: ComplianceChange, fused: FusedChange, of_smooth_part: Array
) -> tuple[Array, Array]:
    """Estimate u = (P/P₀)^(−1/3) at the stops by a Gaussian process.

    ``y`` is the mean Y of each stop and ``noise`` its variance by scatter and model form, shape (stops,);
    ``of_smooth_part`` is the covariance of y by the smooth part that was added, shape (stops, stops). The
    results are u, shape (stops,), and its covariance.
    """
    count, nut = len(stops.position), stops.nut_share
    # averaging @ values of the cells are the means over the cells of each stop.
    averaging = (stops.stop_of_cell == np.arange(count)[:, None]) / stops.count[:, None]
    errors = averaging @ change_covariance(change) @ averaging.T + of_smooth_part
    # The scatter contains the cells' own errors, which the covariance of the change contains too. Only the
    # excess of the scatter over them is added.
    own_variance = change.floor**2
    if change.own is not None:
        own_variance = own_variance + change.own**2
    included = averaging**2 @ own_variance
    errors = errors + np.diag(np.maximum(noise - included, 0.0))
    distance = stops.position[:, None] - stops.position[None]
    correlation = np.exp(-0.5 * (distance / _LENGTH) ** 2)
    deviation = y - fused.level * nut
    largest = -math.inf  # log likelihood
    departure, covariance = np.zeros(count), np.zeros((count, count))
    for size in _SIZES.tolist():
        # + 1: a constant with a standard deviation of 1, which the data determine and not this prior
        prior = size**2 * correlation + 1.0
        total = nut[:, None] * prior * nut[None] + errors
        log_determinant = float(np.linalg.slogdet(total)[1])
        log_likelihood = -0.5 * (log_determinant + float(deviation @ np.linalg.solve(total, deviation)))
        if log_likelihood > largest:
            largest = log_likelihood
            with_deviation = prior * nut[None]  # covariance of the departure with the deviation
            gain = np.linalg.solve(total, with_deviation.T).T
            departure = gain @ deviation
            covariance = prior - gain @ with_deviation.T
    # A small variance is added, since rounding could make a variance negative.
    return np.asarray(1 + fused.level + departure), covariance + 1e-12 * np.eye(count)


def _ratio_quantity(u: float, spread: float) -> Quantity | None:
    """P/P₀ = u⁻³ from u and its standard uncertainty; None where its interval has no upper end."""
    half = NORMAL_95 * spread
    if not u - half > _LEAST_U:
        return None
    value = u**-3
    return Quantity(value, 3 * value / u * spread, "", ((u + half) ** -3, (u - half) ** -3))


def _loss(u: Array, covariance: Array, inside: NDArray[np.bool_], share_uncertainty: float) -> Quantity:
    """Loss of preload at the stops ``inside`` a place, relative to the mean of the others.

    ``u`` and ``inside`` have the shape (stops,); ``share_uncertainty`` is the relative standard uncertainty
    of the nut's share.
    """
    # Weights of the stops in the two means.
    mean_inside = inside / inside.sum()
    mean_outside = ~inside / (~inside).sum()
    u_inside = max(float(mean_inside @ u), _LEAST_U)
    u_outside = max(float(mean_outside @ u), _LEAST_U)
    ratio = u_inside / u_outside
    slope = mean_inside / u_inside - mean_outside / u_outside  # d ln ratio/du
    by_share = (1 - 1 / ratio) * share_uncertainty  # of ln ratio: u − 1 ∝ 1/share, u_outside ≈ 1
    spread = ratio * math.sqrt(float(slope @ covariance @ slope) + by_share**2)
    value = 1 - ratio**-3
    low = 1 - max(ratio - NORMAL_95 * spread, _LEAST_U) ** -3
    high = 1 - max(ratio + NORMAL_95 * spread, _LEAST_U) ** -3
    return Quantity(value, 3 * ratio**-4 * spread, "", (min(low, value), high))


def _ratios_of_groups(
    y: Array, change: ComplianceChange, stops: _Stops, noise: float
) -> tuple[tuple[str, Quantity], ...]:
    """P/P₀ from the cells of each condition and motion alone.

    ``y`` is Y of the cells, shape (cells,), and ``noise`` its standard deviation.
    """
    ratios = []
    for name, cells in stops.groups().items():
        nut = change.nut_share[cells]
        information = float(nut @ nut)  # about u, at a standard deviation of Y of 1
        u = 1 + float(nut @ y[cells]) / information  # least squares of Y = s (u − 1)
        quantity = _ratio_quantity(u, noise / math.sqrt(information))
        if quantity is not None:
            ratios.append((name, quantity))
    return tuple(ratios)
