"""Conventions of the nut's rigidity compared by the data of a calibration.

A catalogue's K means a nut up to three times as stiff in one convention as in another, and a sheet may state
the wrong one. Each other convention is another reading of the sheet's K, with another κ, the nut's rigidity
over P^(1/3). Each reading is fitted to the same data with the same prior, the mean of which is moved to this
κ; its probability is that of its evidence. Frequencies at one preload hardly distinguish the readings: a nut
of twice the rigidity looks like a stiffer bearing. Samples of the share contain all readings in proportion to
their probabilities, so that an interval contains what the data do not exclude; the estimate itself is by the
convention that the sheet states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.axis import rigidity
from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.sheet import DataSheet
from ballscrew.axis.tolerances import tolerances
from ballscrew.base.arrays import Array
from ballscrew.base.errors import MeasurementError
from ballscrew.base.words import percent
from ballscrew.calibration.calibrated_axis import ConventionEvidence, Doubt
from ballscrew.calibration.fit import SIZE, Fit, solve
from ballscrew.calibration.model_forms import ModelForm
from ballscrew.calibration.tolerances import estimate_tolerances

WRONG = 0.4
"""Probability, before any data, that K has another convention than the sheet states.

Good intervals should contain the true value for each convention, not on average over catalogues, and
frequencies at one preload often do not decide: right sheets and wrong ones have the same evidence, from a
tenth to 1. Of 0.3, 0.4 and 0.5 it is the least with which at most 5 % of the good intervals miss for each
pair of true and stated convention, on 82 random axes with the errors of mode tables (seeds 500 to 581); on 41
axes with three times these errors the rate is consistent with 5 % (``benchmarks.conventions``).
"""

_SUBSTANTIAL = math.sqrt(10)
"""Evidence for the other conventions from which the best is named in a note (Kass and Raftery 1995,
10.1080/01621459.1995.10476572)."""

_DECISIVE = 100.0
"""Evidence from which a calibration is suspect (Jeffreys 1961, *Theory of Probability*, appendix B).

With less, the interval contains those of several conventions, and so the true value. A lower limit would make
axes suspect whose intervals are right, but not those whose data mislead: of a K with clearance, stated as
R_nu,ar, 9 % of the good intervals miss with √10, 7 % with 10 and 5 % with 100 (same seeds).
"""

_MOST_LOG_ODDS = 100.0  # so that their exponential does not overflow
_LIKELY = 0.8  # probability from which an unknown convention is named
_NEGLIGIBLE = 1e-3  # probability up to which a reading is not reported
_ROUNDING = 1e-12  # least probability in a divisor
_COMPLIANCE, _SHARE = PARAMETERS.index("compliance"), PARAMETERS.index("share")
_BENDS = [PARAMETERS.index("slope"), PARAMETERS.index("curve")]


def compare_conventions(form: ModelForm, fit: Fit, sheet: DataSheet) -> tuple[ConventionEvidence, ...]:
    """Other conventions of the sheet's K, with their probabilities by the data.

    Parameters
    ----------
    form : ModelForm
        Of the calibration.
    fit : Fit
        The calibration.
    sheet : DataSheet
        The axis. A K that is measured, or of unknown convention, has no other readings.

    Returns
    -------
    tuple of ConventionEvidence
        The most probable first, without those of a negligible probability.
    """
    screw, width = sheet.screw, tolerances(sheet)["rigidity"]
    if screw.rigidity_convention in ("measured", "unknown") or not width:
        return ()
    readings = rigidity.other_readings(screw)
    prior_odds = WRONG / len(readings) / (1 - WRONG)  # of a reading against the stated convention
    found = []
    for words, ratio in readings.items():
        moved = replace(form, mean=stiffer_nut(form.mean, ratio))
        other = _refit(moved, fit)
        if other is None:
            continue
        # Estimates of the sheet's numbers, in units of tolerance/√3.
        numbers = {n.field: n.estimate for n in estimate_tolerances(moved, other.unknown[:SIZE])}
        log_odds = min(other.log_evidence - fit.log_evidence, _MOST_LOG_ODDS)
        found.append(
            ConventionEvidence(
                convention=words,
                probability=prior_odds * math.exp(log_odds),  # odds, which are normalised below
                ratio=math.exp(numbers["rigidity"] * width / math.sqrt(3)),
                change=_change(other.unknown, fit.unknown),
                estimates=np.array([*numbers.values()]),
            )
        )
    total_odds = 1 + sum(reading.probability for reading in found)  # 1 for the stated convention
    found = [replace(reading, probability=reading.probability / total_odds) for reading in found]
    found.sort(key=lambda reading: -reading.probability)
    return tuple(reading for reading in found if reading.probability > _NEGLIGIBLE)


def likely_convention(form: ModelForm, fit: Fit, sheet: DataSheet) -> list[str]:
    """Note on the convention of a K for which the sheet states none.

    Parameters are as for :func:`compare_conventions`.

    Returns
    -------
    list of str
        Empty unless the data make one reading clearly more probable than the others together, each with the
        tolerance of a stated convention.
    """
    effect = form.tolerances.get("rigidity")
    if sheet.screw.rigidity_convention != "unknown" or effect is None:
        return []
    # Part of the variance by K that an unknown convention adds to the tolerance of a stated one.
    removed = max(0.0, 1 - (rigidity.TOLERANCE / tolerances(sheet)["rigidity"]) ** 2)
    covariance = form.covariance - removed * np.outer(effect, effect)
    evidence = {}
    for words, ratio in rigidity.other_readings(sheet.screw).items():
        other = _refit(ModelForm(form.name, stiffer_nut(form.mean, ratio), covariance), fit)
        evidence[words] = -math.inf if other is None else other.log_evidence
    best = max(evidence, key=lambda words: evidence[words])
    if evidence[best] == -math.inf:
        return []
    probability = 1 / sum(math.exp(value - evidence[best]) for value in evidence.values())
    if probability < _LIKELY:
        return []
    return [
        f"K of the data sheet, of unknown convention, is most likely that of {best}: look it up and state it"
    ]


def _refit(form: ModelForm, fit: Fit) -> Fit | None:
    """The same data with another prior of the working vector; None if no such axis fits them."""
    prior = fit.problem.prior.copy()
    prior[:SIZE, :SIZE] = form.covariance
    mean = np.append(form.mean, fit.problem.mean[SIZE:])
    try:
        return solve(replace(fit.problem, mean=mean, prior=prior), fit.unknown)
    except MeasurementError:
        return None


def explains_better(conventions: Sequence[ConventionEvidence]) -> bool:
    """Whether there is substantial evidence for other conventions of K than the stated one."""
    return _evidence(conventions) > _SUBSTANTIAL


def _evidence(conventions: Sequence[ConventionEvidence]) -> float:
    """Evidence for the other conventions together over that for the stated one: posterior over prior odds."""
    others = sum(reading.probability for reading in conventions)
    return others / max(1 - others, _ROUNDING) * (1 - WRONG) / WRONG


def add_convention(
    doubts: Sequence[Doubt], conventions: Sequence[ConventionEvidence]
) -> tuple[list[Doubt], list[str]]:
    """Doubts of the sheet's numbers, and notes, with the convention that fits better where there is one.

    Parameters
    ----------
    doubts : sequence of Doubt
        By the tolerances of the sheet.
    conventions : sequence of ConventionEvidence
        Other readings of K, the most probable first.

    Returns
    -------
    list of Doubt
        Those given; a doubt of the rigidity names the most probable convention if the evidence is decisive.
    list of str
        A note that names it, if the evidence is substantial but not decisive.
    """
    if not explains_better(conventions):
        return list(doubts), []
    best, remaining = conventions[0], 1 - sum(reading.probability for reading in conventions)
    probability = percent(remaining) if remaining > _NEGLIGIBLE else f"less than {percent(_NEGLIGIBLE)}"
    text = (
        f"the data fit a K of {best.convention} (ratio {best.ratio:.2f}) better: the probability of the "
        f"data sheet's convention falls from {percent(1 - WRONG)} to {probability}; check what the "
        "catalogue's K means"
    )
    if _evidence(conventions) <= _DECISIVE:
        return list(doubts), [text]
    stated = [doubt for doubt in doubts if doubt.name == "rigidity"]
    if stated:
        text = f"{stated[0].text}; {text}"
    return [*(doubt for doubt in doubts if doubt.name != "rigidity"), Doubt("rigidity", text)], []


def stiffer_nut(mean: Array, ratio: float) -> Array:
    """Working vector of the same axis with another nut.

    Parameters
    ----------
    mean : ndarray, shape (7,)
        Working vector.
    ratio : float
        κ over that of the vector.

    Returns
    -------
    ndarray, shape (7,)
        The nut's compliance divided by ``ratio``, all else unchanged.
    """
    share = 1 / (1 + math.exp(-float(mean[_SHARE])))
    whole = 1 + share * (1 / ratio - 1)  # compliance over that of the vector
    out = mean.copy()
    out[_COMPLIANCE] += math.log(whole)
    out[_BENDS] /= whole
    out[_SHARE] -= math.log(ratio)
    return out


def _change(other: Array, unknown: Array) -> Array:
    """Change of the working vector and of ln(P/P_ref) of each group, shape (7 + groups,); 0 for the first."""
    finite = np.isfinite(other) & np.isfinite(unknown)
    change = np.zeros_like(other)
    change[finite] = other[finite] - unknown[finite]
    return np.insert(change, SIZE, 0.0)
