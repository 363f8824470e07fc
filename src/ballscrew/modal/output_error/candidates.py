"""All models of a cell that are worth a try, each fitted, with the criterion that chooses among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.modal.output_error.estimate import Candidate, ModeEstimate
from ballscrew.modal.output_error.fit import Fit, fit
from ballscrew.modal.output_error.lines import CellLines
from ballscrew.modal.output_error.model import DELAY_UNIT, Poles, forced
from ballscrew.modal.output_error.noise import Colour, colour
from ballscrew.modal.output_error.start import averages, with_one_more
from ballscrew.modal.output_error.uncertainty import pole_covariance

__all__ = ["Tried", "belonging", "starts", "tried", "without_modes"]

Real = NDArray[np.float64]
_STRAY = 4.0  # times the usual residual power, from which on a repetition does not belong
_LEAST_KEPT = 0.6  # of the repetitions
_HOPELESS, _FAR = 60.0, 40.0  # of the criterion: behind the best too far for weights, for more structures
_DELAY_SPREAD = 2e-4  # s, of delays that drives have
_ROUNDS = 12
_ROUGH = 1.0  # of the variance: how near the first fit comes, which only has to show the residual's colour
_OWN_PENALTY = 3.0  # of a parameter that is one repetition's own


@dataclass(frozen=True, slots=True)
class Tried:
    """A fitted model beside what is said of it."""

    fit: Fit
    candidate: Candidate
    shape: Colour


def starts(lines: CellLines, band: tuple[float, float], orders: Sequence[int]) -> dict[int, Poles]:
    """Starting values for every number of modes, found one resonator at a time.

    Parameters
    ----------
    lines : CellLines
        Of the cell.
    band : tuple of float
        Where modes are looked for, Hz.
    orders : sequence of int
        Numbers of modes wanted.

    Returns
    -------
    dict
        Poles of the general structure.
    """
    spectra = averages(lines)
    found: dict[int, Poles] = {}
    poles = None
    for order in range(1, max(orders) + 1):
        poles = with_one_more(spectra, poles, band)
        if order in orders:
            found[order] = poles
    return found


def belonging(found: Fit) -> NDArray[np.intp]:
    """Repetitions whose residual is about as large as those of the others."""
    power = np.sum(np.abs(found.residual) ** 2, axis=-1)
    usual = np.median(power, axis=1, keepdims=True)
    relative = np.max(power / np.maximum(usual, 1e-300), axis=0)
    kept = np.flatnonzero(relative <= _STRAY)
    return kept if len(kept) >= max(3, _LEAST_KEPT * len(relative)) else np.arange(len(relative))


def tried(
    lines: CellLines, first: dict[int, Poles], order: int | None = None, delay: float | None = None
) -> list[Tried]:
    """Fit every number of modes in both structures; the best first.

    Parameters
    ----------
    lines : CellLines
        Of the cell, without the repetitions that do not belong.
    first : dict
        Starting values for every number of modes.
    order : int, optional
        Number of modes asked for, which is tried in full whatever the others say.
    delay : float, optional
        Of the response behind the force where it is known, s.

    Returns
    -------
    list of Tried
        Those that came to rest. Each number of modes has its own colour of the residual, so that a mode too
        many has to explain more than coloured noise does; the classical structure is tried only where the
        general one is not hopeless.
    """
    general = []
    for poles in first.values():
        rough = fit(lines, poles, rounds=_ROUNDS, enough=_ROUGH)
        shape = colour(lines, rough)
        general.append(Tried(rough, _candidate(lines, rough, shape), shape))
    best = min(each.candidate.criterion for each in general)
    out = []
    for each in general:
        near = each.candidate.criterion < best + _HOPELESS
        weighted = _fitted(lines, each.fit.poles, each.shape) if near or _wanted(each, order) else each
        out += [weighted] if weighted.fit.converged else []
        if weighted.candidate.criterion < best + _FAR or _wanted(each, order):
            poles = replace(weighted.fit.poles, structure="classical")
            if delay is not None:
                poles = replace(poles, structure="prompt", delay=delay)
            classical = _fitted(lines, poles, each.shape)
            out += [classical] if classical.fit.converged else []
    return sorted(out, key=lambda each: each.candidate.criterion)


def without_modes(lines: CellLines) -> float:
    """Criterion of a model without any mode: what does not beat it by far shows none."""
    nothing = Poles(np.empty(0), np.empty(0), structure="general")
    rough = fit(lines, nothing, rounds=0)
    return _criterion(lines, rough, colour(lines, rough), 1.0)


def _wanted(each: Tried, order: int | None) -> bool:
    return each.candidate.order == order


def _fitted(lines: CellLines, poles: Poles, shape: Colour) -> Tried:
    found = fit(lines, poles, shape.weight, input_noise=shape.input_noise, rounds=_ROUNDS)
    return Tried(found, _candidate(lines, found, shape), shape)


def _criterion(lines: CellLines, found: Fit, shape: Colour, late_deviation: float) -> float:
    """Bayesian information criterion; what is one repetition's own is punished less, as each has few data.

    G. Schwarz, Ann. Statist. 6 (1978) 461, DOI 10.1214/aos/1176344136.
    """
    data = 2 * lines.response.size
    repetitions = len(lines.force)
    per_line = -2 * np.sum(np.log(shape.weight)) * 2 * repetitions
    # The likelihood's own variance is the residual's, without the allowance for what was fitted.
    share = found.free / data
    squares = float(np.sum(np.abs(found.residual * shape.weight[:, None, :]) ** 2))
    likelihood = per_line + data * np.log(share) + squares / share
    shared = found.factor.size + 2 * len(found.poles.frequency)
    own = len(lines.response) * repetitions * 2 * len(found.poles.frequency)
    late = 0.0
    if found.poles.structure == "classical":
        # A delay's Bayes factor: what it could be before over what it can be after the fit.
        late = 2 * np.log(max(_DELAY_SPREAD / (late_deviation * DELAY_UNIT), np.e))
    return float(likelihood + shared * np.log(data) + late + _OWN_PENALTY * own)


def _candidate(lines: CellLines, found: Fit, shape: Colour) -> Candidate:
    poles = found.poles
    count = len(poles.frequency)
    deviation = np.sqrt(np.maximum(np.diag(pole_covariance(found)), 0.0))
    share = _shares(lines, found)
    modes = tuple(
        ModeEstimate(
            float(poles.frequency[m]),
            float(poles.frequency[m] * deviation[m]),
            float(poles.damping[m]),
            float(poles.damping[m] * deviation[count + m]),
            float(share[m]),
        )
        for m in np.argsort(poles.frequency)
    )
    delay = None if poles.structure == "general" else poles.delay
    criterion = _criterion(lines, found, shape, max(float(deviation[-1]), 1e-9))
    return Candidate(count, poles.structure, criterion, modes, delay)


def _shares(lines: CellLines, found: Fit) -> Real:
    """Each mode's part of the power that the modes make of the force."""
    functions = forced(found.poles, lines.omega)
    count = len(found.poles.frequency)
    classical = found.poles.structure != "general"
    parts = functions[2:] if classical else functions[3:]
    factor = found.factor[:, 2:] if classical else found.factor[:, 3:]
    each = factor[:, :, None] * parts
    if not classical:
        each = each[:, :count] + each[:, count:]
    power = (np.abs(each) ** 2 @ (np.abs(lines.force) ** 2).sum(axis=0)).sum(axis=0)
    return np.asarray(power / max(float(power.sum()), 1e-300))
