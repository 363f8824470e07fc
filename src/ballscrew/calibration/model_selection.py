"""Selection of the form of the model by its evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.calibrated_axis import FormEvidence
from ballscrew.calibration.fit import solve
from ballscrew.calibration.model_forms import ModelForm
from ballscrew.calibration.preparation import CalibrationInput
from ballscrew.calibration.robust_fit import RobustFit, fit_robustly

LOG_ODDS = 3.0
"""Difference of ln evidence from which another form replaces the sheet's: 20 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class SelectedForm:
    """The selected form.

    Parameters
    ----------
    form : ModelForm
        With its prior.
    robust : RobustFit
        Its fit and outliers.
    candidates : tuple of FormEvidence
        All forms, the best first.
    """

    form: ModelForm
    robust: RobustFit
    candidates: tuple[FormEvidence, ...]


def select_form(prepared: CalibrationInput) -> SelectedForm:
    """Fit every form and select the sheet's own, unless the evidence is 20 to 1 for another.

    A cell that is an outlier of the sheet's form may be evidence for another. So each form is fitted with its
    own search for outliers, and the evidence is compared with one covariance for all: only cells and runs
    that are outliers of every form have lost weight in it.

    Parameters
    ----------
    prepared : CalibrationInput
        Runs and forms.

    Returns
    -------
    SelectedForm
        The form with its own fit.

    Raises
    ------
    MeasurementError
        If a fit does not converge.
    """
    problems = list(map(prepared.problem, prepared.forms))
    robust_fits = list(map(fit_robustly, problems))
    covariance = problems[0].covariance + common_covariance(robust_fits)
    fits = []
    for problem, robust in zip(problems, robust_fits, strict=True):
        fits.append(solve(replace(problem, covariance=covariance), robust.fit.unknown))
    evidence = np.array([fit.log_evidence for fit in fits])
    selected = 0
    if evidence.max() > evidence[0] + LOG_ODDS:
        selected = int(np.argmax(evidence))
    candidates = []
    for index, (form, fit) in enumerate(zip(prepared.forms, fits, strict=True)):
        log_evidence = float(fit.log_evidence - evidence.max())
        candidates.append(FormEvidence(form.name, form.free, log_evidence, fit.chi2, index == selected))
    candidates.sort(key=lambda candidate: -candidate.log_evidence)
    return SelectedForm(prepared.forms[selected], robust_fits[selected], tuple(candidates))


def common_covariance(robust_fits: Sequence[RobustFit]) -> Array:
    """Covariance added for the outliers that all forms have in common: the mean over the forms.

    Parameters
    ----------
    robust_fits : sequence of RobustFit
        Of the same rows.

    Returns
    -------
    ndarray, shape (n + m, n + m)
        In addition to the covariance of the rows.
    """
    first, *others = robust_fits
    added = np.zeros_like(first.fit.problem.covariance)
    for cell in sorted(set(first.cells).intersection(*(other.cells for other in others))):
        added[cell, cell] += np.mean([robust.cells[cell] for robust in robust_fits])
    for run in sorted(set(first.runs).intersection(*(other.runs for other in others))):
        added += np.mean([robust.runs[run] for robust in robust_fits], axis=0)
    return added
