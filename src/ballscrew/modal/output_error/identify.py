"""Identify an isolated cell from all its repetitions at once, without a click.

Output error in the frequency domain: starting values from averaged spectra, one to three resonators in two
structures each fitted to every line of every repetition, the best chosen by the Bayesian information
criterion, and those nearly as good averaged with it (J. A. Hoeting et al., Statist. Sci. 14 (1999) 382, DOI
10.1214/ss/1009212519).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballscrew.base.errors import InputError
from ballscrew.modal.output_error.candidates import Tried, belonging, starts, tried, without_modes
from ballscrew.modal.output_error.estimate import Candidate, CellEstimate, ModeEstimate
from ballscrew.modal.output_error.fit import one_step
from ballscrew.modal.output_error.lines import CellLines, cell_lines
from ballscrew.modal.output_error.model import Poles
from ballscrew.modal.unsure import unsure

__all__ = ["identify_cell"]

ORDERS = (1, 2, 3)
_WIDER = (0.4, 1.4)  # lines are taken from 0.4 × the band's foot to 1.4 × its head: the mode's skirts count
_USABLE = 0.45  # of the rate
_SAME = 0.06  # of the frequency, within which two models mean one mode
_DOUBT = 6.0  # of the criterion: a model that is no more than 20 times as likely
_SHOWN = (
    20.0  # of the criterion, by which a mode must beat none at all: the best of a hundred places does by 10
)
_WEAK = 0.02  # share of the modes' power, below which a mode is no candidate for the one asked for
_CERTAIN, _MOST = 0.01, 0.03  # of the frequency: standard uncertainty of a suspect and of a refused cell
_DAMPED = 0.2  # a resonator so broad is no mode


def identify_cell(
    force: NDArray[np.floating],
    response: NDArray[np.floating],
    rate: float,
    band: tuple[float, float],
    *,
    expected: float | None = None,
    order: int | None = None,
    delay: float | None = None,
    lines: tuple[float, float] | None = None,
) -> CellEstimate:
    """Identify the mode of an isolated cell.

    Parameters
    ----------
    force : ndarray, shape (repetitions, samples)
        Input as recorded: torque, or force. No window.
    response : ndarray, shape (responses, repetitions, samples) or (repetitions, samples)
        Accelerations as recorded, with shared poles.
    rate : float
        Samples per second, Hz.
    band : tuple of float
        Where the mode is looked for, Hz.
    expected : float, optional
        Where it is likeliest, Hz: among modes that are strong enough the nearest is taken. By default the
        strongest of the band.
    order : int, optional
        Number of modes, 1 to 3; by default chosen. Others are tried all the same, and if one fits better,
        that is told.
    delay : float, optional
        Of the response behind the force where it is known, s; knowing it is worth up to a fifth of the
        uncertainty. By default estimated.
    lines : tuple of float, optional
        Which lines are modelled, Hz; by default the band and its surroundings.

    Returns
    -------
    CellEstimate
        Frequency, damping and their uncertainties, or the reasons against.

    Raises
    ------
    InputError
        If the records are no records: shapes, numbers that are not finite, too short for the band.
    """
    if order is not None and order not in ORDERS:
        raise InputError(
            f"the number of modes is {order!r}; it must be one of {', '.join(map(str, ORDERS))}."
        )
    if len(force) < 2:
        return _refused("a single repetition tells nothing of its noise", len(force))
    span = lines or (_WIDER[0] * band[0], min(_WIDER[1] * band[1], _USABLE * rate))
    cell = cell_lines(force, response, rate, span)
    if not np.any(cell.force) or any(not np.any(each) for each in cell.response):
        return _refused("the force or a response is zero in the whole band", len(force))
    room = cell.response[0].size * 2 - len(force) * (4 + 2 * max(ORDERS))
    if 2 * len(cell.omega) <= 4 + 2 * max(ORDERS) + 4 or room < 30:
        return _refused(f"the records are too short: {len(cell.omega)} lines in the band", len(force))
    try:
        return _identify(cell, band, expected, order, delay)
    except np.linalg.LinAlgError:
        return _refused("the force does not excite the band: the fit is singular", len(force))


def _identify(
    cell: CellLines,
    band: tuple[float, float],
    expected: float | None,
    order: int | None,
    delay: float | None,
) -> CellEstimate:
    repetitions = len(cell.force)
    found = starts(cell, band, ORDERS)
    models = tried(cell, found, order, delay)
    kept = np.arange(len(cell.force))
    if models and len(kept := belonging(models[0].fit)) < len(cell.force):
        cell = cell.only(kept)
        again = {len(m.fit.poles.frequency): _general(m.fit.poles) for m in models}
        models = tried(cell, again, order, delay)
    dropped = tuple(int(k) for k in np.setdiff1d(np.arange(repetitions), kept))
    usable = [each for each in models if order in (None, each.candidate.order)]
    usable = [each for each in usable if _asked_for(each.candidate, band, expected) is not None]
    if not usable:
        if order is not None and models and models[0].candidate.order != order:
            best_order = models[0].candidate.order
            words = f"a model with {order} modes comes to no rest in the band, one with {best_order} does"
            return _refused(words, len(kept), dropped)
        return _refused("no model with a mode in the band fits", len(kept), dropped)
    best = usable[0]
    if best.candidate.criterion > without_modes(cell) - _SHOWN:
        return _refused("the records show no mode: a model without any fits as well", len(kept), dropped)
    mode = _asked_for(best.candidate, band, expected)
    assert mode is not None  # noqa: S101  usable are those that have one
    estimate = _averaged(usable, mode)
    estimate = replace(
        estimate,
        candidates=tuple(each.candidate for each in models),
        repetitions=len(kept),
        dropped=dropped,
        input_noise=float(np.sqrt(best.shape.input_noise)),
    )
    estimate = _with_lines_term(estimate, cell, best, mode)
    return _judged(estimate, models, mode)


def _general(poles: Poles) -> Poles:
    return replace(poles, structure="general", delay=0.0)


def _asked_for(
    candidate: Candidate, band: tuple[float, float], expected: float | None
) -> ModeEstimate | None:
    inside = [
        mode
        for mode in candidate.modes
        if band[0] <= mode.frequency <= band[1] and mode.share >= _WEAK and mode.damping < _DAMPED
    ]
    if not inside:
        return None
    if expected is None:
        return max(inside, key=lambda mode: mode.share)
    return min(inside, key=lambda mode: abs(np.log(mode.frequency / expected)))


def _same_mode(candidate: Candidate, mode: ModeEstimate) -> ModeEstimate | None:
    """The mode of another model that means this one."""
    near = [m for m in candidate.modes if abs(m.frequency / mode.frequency - 1) < _SAME and m.share >= _WEAK]
    return max(near, key=lambda m: m.share) if near else None


def _averaged(usable: Sequence[Tried], mode: ModeEstimate) -> CellEstimate:
    """The mode, averaged over models by their likelihood; what they disagree by is uncertainty."""
    least = usable[0].candidate.criterion
    pairs = [
        (np.exp(-0.5 * (each.candidate.criterion - least)), same)
        for each in usable
        if (same := _same_mode(each.candidate, mode)) is not None
    ]
    weight = np.array([w for w, _ in pairs])
    weight /= weight.sum()
    value = np.array([(m.frequency, m.damping) for _, m in pairs])
    deviation = np.array([(m.frequency_uncertainty, m.damping_uncertainty) for _, m in pairs])
    mean = weight @ value
    noise, models = weight @ deviation**2, weight @ (value - mean) ** 2
    return CellEstimate(
        frequency=float(mean[0]),
        uncertainty=float(np.sqrt(noise[0] + models[0])),
        damping=float(mean[1]),
        damping_uncertainty=float(np.sqrt(noise[1] + models[1])),
        verdict="good",
        reasons=(),
        best=usable[0].candidate,
        candidates=(),
        repetitions=0,
        terms=(("noise", float(np.sqrt(noise[0]))), ("model", float(np.sqrt(models[0])))),
    )


def _with_lines_term(
    estimate: CellEstimate, cell: CellLines, best: Tried, mode: ModeEstimate
) -> CellEstimate:
    """Add what other lines than those chosen would give, beyond what noise explains.

    Repetitions that share a model's error do not show it (J. A. Hausman, Econometrica 46 (1978) 1251, DOI
    10.2307/1913827).
    """
    count = len(cell.omega)
    at = int(np.argmin(np.abs(best.fit.poles.frequency - mode.frequency)))
    f = mode.frequency
    excess = []
    near = 2 * np.pi * best.fit.poles.frequency
    for part in (slice(0, count - count // 4), slice(count // 6, count)):
        omega = cell.omega[part]
        if len(omega) < 3 * len(near) + 8 or (near < omega[1]).any() or (near > omega[-2]).any():
            continue
        some = CellLines(omega, cell.force[:, part], cell.response[:, :, part])
        shift, own = one_step(some, best.fit.poles, best.shape.weight[:, part], best.shape.input_noise)
        expected = max(0.0, f**2 * own[at, at] - mode.frequency_uncertainty**2)
        excess.append(max(0.0, (f * shift[at]) ** 2 - expected))
    term = float(np.sqrt(np.mean(excess))) if excess else 0.0
    assert estimate.uncertainty is not None  # noqa: S101  only what is identified comes here
    return replace(
        estimate,
        uncertainty=float(np.hypot(estimate.uncertainty, term)),
        terms=(*estimate.terms, ("lines", term)),
    )


def _judged(estimate: CellEstimate, models: Sequence[Tried], mode: ModeEstimate) -> CellEstimate:
    """Say what is in doubt, and refuse what is no frequency."""
    assert estimate.frequency is not None  # noqa: S101
    assert estimate.uncertainty is not None  # noqa: S101
    assert estimate.best is not None  # noqa: S101
    u, f = estimate.uncertainty, estimate.frequency
    if u > _MOST * f:
        return replace(
            estimate, frequency=None, uncertainty=None, damping=None, damping_uncertainty=None,
            verdict="refused", reasons=(unsure(u, _MOST),), terms=(),
        )  # fmt: skip
    reasons = []
    if u > _CERTAIN * f:
        reasons.append(unsure(u, _CERTAIN))
    chosen = estimate.best
    others = [each.candidate for each in models if each.candidate.order != chosen.order]
    if others:
        rival = min(others, key=lambda each: each.criterion)
        words = f"{rival.order} mode{'s' if rival.order > 1 else ''} in place of {chosen.order}"
        if rival.criterion < chosen.criterion - _DOUBT:
            reasons.append(f"{words} fit better")
        elif rival.criterion < chosen.criterion + _DOUBT:
            same = _same_mode(rival, mode)
            where = f"at {same.frequency:.2f} Hz" if same else "elsewhere"
            reasons.append(f"{words} fit about as well, with the mode {where}")
    if estimate.dropped:
        reasons.append(f"{len(estimate.dropped)} repetitions do not belong: their residual is far larger")
    return replace(estimate, verdict="suspect" if reasons else "good", reasons=tuple(reasons))


def _refused(reason: str, repetitions: int, dropped: tuple[int, ...] = ()) -> CellEstimate:
    return CellEstimate(None, None, None, None, "refused", (reason,), None, (), repetitions, dropped)
