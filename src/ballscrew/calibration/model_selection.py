"""Which form of the model the data ask for, each form with its own search for what does not fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.calibrated_axis import FormEvidence
from ballscrew.calibration.fit import solve
from ballscrew.calibration.model_forms import ModelForm
from ballscrew.calibration.preparation import Prepared
from ballscrew.calibration.robust_fit import Robust, fit_robustly

__all__ = ["Choice", "choose", "common"]


ASK = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The form that is taken.

    Parameters
    ----------
    form : ModelForm
        It.
    robust : Robust
        Its fit, and what did not fit it.
    candidates : tuple of FormEvidence
        All forms, the best first.
    """

    form: ModelForm
    robust: Robust
    candidates: tuple[FormEvidence, ...]


def choose(ready: Prepared) -> Choice:
    """Fit every form and take the sheet's own, unless the evidence is 20 to 1 for another.

    A cell that does not fit the sheet's form may be what asks for another. So each form is fitted with its
    own search for such cells, and the evidence is compared with one covariance for all: only cells and runs
    that fit no form at all have lost weight in it.

    Parameters
    ----------
    ready : Prepared
        Runs and forms.

    Returns
    -------
    Choice
        The form with its own fit.

    Raises
    ------
    MeasurementError
        If a fit does not settle.
    """
    problems = [ready.problem(form) for form in ready.forms]
    robusts = [fit_robustly(problem) for problem in problems]
    alike = problems[0].covariance + common(robusts)
    fits = [
        solve(replace(problem, covariance=alike), one.fit.unknown)
        for problem, one in zip(problems, robusts, strict=True)
    ]
    evidence = np.array([fit.log_evidence for fit in fits])
    chosen = int(np.argmax(evidence)) if evidence.max() > evidence[0] + ASK else 0
    candidates = [
        FormEvidence(form.name, form.free, float(told - evidence.max()), fit.chi2, i == chosen)
        for i, (form, told, fit) in enumerate(zip(ready.forms, evidence, fits, strict=True))
    ]
    candidates.sort(key=lambda one: -one.log_evidence)
    return Choice(ready.forms[chosen], robusts[chosen], tuple(candidates))


def common(robusts: Sequence[Robust]) -> Array:
    """Covariance that excuses those cells and runs that fit none of several forms, in the mean of them.

    Parameters
    ----------
    robusts : sequence of Robust
        Of the same rows.

    Returns
    -------
    ndarray, shape (n, n)
        To be added to that of the rows.
    """
    extra = np.zeros_like(robusts[0].problem.covariance)
    for cell in set(robusts[0].cells).intersection(*(one.cells for one in robusts[1:])):
        extra[cell, cell] += np.mean([one.cells[cell] for one in robusts])
    for run in set(robusts[0].excused).intersection(*(one.excused for one in robusts[1:])):
        extra += np.mean([one.excused[run] for one in robusts], axis=0)
    return extra
