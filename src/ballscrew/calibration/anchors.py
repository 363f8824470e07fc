"""Anchors of the preload's scale, which frequencies do not determine.

They are known preloads, and the softening of the nut under the load of the test: it gives the mass that the
nut accelerates over its preload.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.axial import PARAMETERS
from ballscrew.axis.axial_prior import KNOWN_PRELOAD
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.base.units import parse_named
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.modal.run import SOFTENING_SPREAD

SOFTENING_REPEATS = 0.8
"""Part of the variance by the softening's law (:data:`ballscrew.modal.run.SOFTENING_SPREAD`) common to runs.

The error by the law varied by 5 % from axis to axis, and by 3 % from run to run of an axis. The noise of a
run is independent of that of others."""

SOFTENING_LAW = 0.08
"""Relative error of the law of the nut's softening, common to every axis and run.

On random axes two acceleration levels gave mass over preload 8 ± 5 % too small. Whether other machines have
this error is unknown, so it is not corrected but counts as uncertainty."""

LEVELS = math.hypot(0.05, SOFTENING_LAW)
"""Relative standard uncertainty of the preload from two acceleration levels of one run."""

_MASS = 0.01  # relative uncertainty of the table's mass on a data sheet
_LEAST_SPREAD = 1e-6  # least standard uncertainty of the logarithm of a known preload
_PLUS_MINUS = re.compile(r"\s*(?:±|\+/-|\+-)\s*")


@dataclass(frozen=True, slots=True)
class AnchorRow:
    """One anchor as a linear row: ln P_ref and the log ratio of its group sum to ``log_preload``.

    Parameters
    ----------
    kind : str
        ``"known preload"`` or ``"nut load"``.
    run : int
        Index of the run.
    group : int
        Group of that run's preload.
    log_preload : float
        ln of the preload in N.
    spread : float
        Standard uncertainty of ``log_preload``.
    law : float
        Contribution to it of an error that is common to every anchor of the kind.
    """

    kind: str
    run: int
    group: int
    log_preload: float
    spread: float
    law: float = 0.0

    def slopes(self, unknowns: int) -> Array:
        """Derivatives of ``log_preload`` with respect to the unknowns of the fit, shape (unknowns,)."""
        row = np.zeros(unknowns)
        row[PARAMETERS.index("preload")] = 1.0
        if self.group > 0:
            row[len(PARAMETERS) + self.group - 1] = 1.0
        return row


def known_preload(text: str) -> Quantity:
    """Read a known preload.

    Parameters
    ----------
    text : str
        ``"600N"`` or ``"600N±10N"`` (also ``+-``): value and standard uncertainty, 2 % by default.

    Returns
    -------
    Quantity
        N.

    Raises
    ------
    InputError
        If it is not a force above 0 N, or its uncertainty not between 0 and the force.
    """
    if not isinstance(text, str):
        raise InputError(f"{shown(text)} is no force with its unit, such as '600 N'.")
    value, *spread = _PLUS_MINUS.split(text.strip(), maxsplit=1)
    force = parse_named("a known preload", value, "N")
    if not 0 < force < math.inf:
        raise InputError(f"a known preload of {shown(text)} was given; it must be more than 0 N.")
    uncertainty = KNOWN_PRELOAD * force
    if spread:
        uncertainty = parse_named("the uncertainty of a known preload", spread[0], "N")
    if not 0 < uncertainty < force:
        raise InputError(
            f"a known preload of {shown(text)} was given; its uncertainty must be more than 0 N and "
            "less than the preload."
        )
    return Quantity(force, uncertainty, "N")


def anchor_rows(
    runs: Sequence[FrequencyTable], groups: Sequence[int], known: Mapping[str, Quantity], nut_mass: float
) -> tuple[AnchorRow, ...]:
    """Rows of the known preloads, one per group, and of each run's softening.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        Of the calibration.
    groups : sequence of int
        Group of each run's preload.
    known : mapping of str to Quantity
        Known preloads by run id, N.
    nut_mass : float
        Table and nut, kg.

    Returns
    -------
    tuple of AnchorRow
        Those of known preloads first.
    """
    rows = []
    for group in dict.fromkeys(groups):
        members = [i for i, run in enumerate(runs) if groups[i] == group and run.id in known]
        if members:
            rows.append(_known_row(group, members, [known[runs[i].id] for i in members]))
    for index, (run, group) in enumerate(zip(runs, groups, strict=True)):
        softening = run.mass_over_preload
        if softening is not None and softening.standard_uncertainty > 0:
            mass = nut_mass + run.load
            measured = softening.standard_uncertainty / softening.value
            spread = math.hypot(measured, _MASS * nut_mass / mass, SOFTENING_LAW)
            log_preload = math.log(mass / softening.value)
            rows.append(AnchorRow("nut load", index, group, log_preload, spread, SOFTENING_LAW))
    return tuple(rows)


def _known_row(group: int, members: Sequence[int], known: Sequence[Quantity]) -> AnchorRow:
    """Known preloads of one group as one row: repeating a statement does not make it more certain."""
    values = np.array([math.log(preload.value) for preload in known])
    relative = [preload.standard_uncertainty / preload.value for preload in known]
    spreads = np.maximum(relative, _LEAST_SPREAD)
    weight = spreads**-2 / np.sum(spreads**-2)
    return AnchorRow("known preload", members[0], group, float(weight @ values), float(weight @ spreads))


def anchor_covariance(rows: Sequence[AnchorRow]) -> Array:
    """Covariance of the anchors' ln P, shape (m, m): softenings have common errors, known preloads none."""
    spread, law = np.array([row.spread for row in rows]), np.array([row.law for row in rows])
    without_law = np.sqrt(spread**2 - law**2)
    is_softening = np.array([row.kind == "nut load" for row in rows], dtype=bool)
    repeating = math.sqrt(SOFTENING_REPEATS) * is_softening * np.minimum(without_law, SOFTENING_SPREAD)
    covariance = np.outer(repeating, repeating) + np.outer(law, law)
    np.fill_diagonal(covariance, spread**2)
    return np.asarray(covariance)
