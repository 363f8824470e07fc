"""What ties the scale that frequencies cannot know: known preloads, and the nut's softening under load."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ballscrew.axis.axial import PARAMETERS
from ballscrew.base.arrays import Array
from ballscrew.base.errors import InputError, shown
from ballscrew.base.quantity import Quantity
from ballscrew.base.units import parse
from ballscrew.calibration.frequency_table import FrequencyTable

__all__ = [
    "KNOWN",
    "LEVELS",
    "SOFTENING_LAW",
    "SOFTENING_REPEATS",
    "Row",
    "anchor_rows",
    "known_preload",
    "told_covariance",
]


KNOWN = 0.02
"""Relative standard uncertainty of a known preload that states none."""

SOFTENING_REPEATS = 0.8
"""Correlation between runs of what the nut's softening says: its law errs alike, its noise does not.

Of the same axis its error was found to be 5 % from axis to axis and 3 % from run to run."""

SOFTENING_LAW = 0.08
"""What the law of the nut's softening errs by on every axis and in every run alike, as a part of the preload.

On random axes two levels told mass over preload 8 % too small, by 5 % more or less. It is not taken out:
nobody knows yet whether other machines have it. So it counts as uncertainty."""

LEVELS = math.hypot(0.05, SOFTENING_LAW)
"""Relative standard uncertainty of the preload that two acceleration levels of one run tell."""

_MASS = 0.01  # of the table on a data sheet, for the force that accelerates it
_PLUS_MINUS = re.compile(r"\s*(?:±|\+/-|\+-)\s*")


@dataclass(frozen=True, slots=True)
class Row:
    """One anchor as a linear row: log P_ref and the log ratio of its group add up to ``told``.

    Parameters
    ----------
    kind : str
        ``"known preload"`` or ``"nut load"``.
    run : int
        Which run.
    group : int
        Of that run.
    told : float
        ln of the preload in N.
    spread : float
        Its standard uncertainty.
    law : float
        The part of it that every anchor of the kind errs by alike.
    """

    kind: str
    run: int
    group: int
    told: float
    spread: float
    law: float = 0.0

    def slopes(self, unknowns: int) -> Array:
        """Derivative by the unknowns."""
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
        ``"600N"`` or ``"600N±10N"`` (also ``+-``): value and standard uncertainty, 2 % where there is none.

    Returns
    -------
    Quantity
        N.

    Raises
    ------
    InputError
        If it is no force above 0 N, or its uncertainty not above 0 and below it.
    """
    value, *spread = _PLUS_MINUS.split(text.strip(), maxsplit=1)
    force = parse(value, "N")
    if not 0 < force < math.inf:
        raise InputError(f"a known preload of {shown(text)} was given; it must be more than 0 N.")
    sure = parse(spread[0], "N") if spread else KNOWN * force
    if not 0 < sure < force:
        raise InputError(
            f"a known preload of {shown(text)} was given; its uncertainty must lie between 0 N and itself."
        )
    return Quantity(force, sure, "N")


def anchor_rows(
    runs: Sequence[FrequencyTable], groups: Sequence[int], known: Mapping[str, Quantity], nut_mass: float
) -> tuple[Row, ...]:
    """Make a row of each known preload, once a group, and of each run's softening.

    Parameters
    ----------
    runs : sequence of FrequencyTable
        As they are calibrated with.
    groups : sequence of int
        Of each run.
    known : mapping of str to Quantity
        Stated preloads by run id, N.
    nut_mass : float
        Table and nut, kg.

    Returns
    -------
    tuple of Row
        Statements of one group count once, those of known preloads first.
    """
    rows = [_stated(group, runs, groups, known) for group in dict.fromkeys(groups)]
    soft_rows: list[Row] = []
    for index, (run, group) in enumerate(zip(runs, groups, strict=True)):
        soft = run.mass_over_preload
        if soft is not None and soft.standard_uncertainty > 0:
            mass = nut_mass + run.load
            spread = math.hypot(
                soft.standard_uncertainty / soft.value, _MASS * nut_mass / mass, SOFTENING_LAW
            )
            soft_rows.append(
                Row("nut load", index, group, math.log(mass / soft.value), spread, SOFTENING_LAW)
            )
    return (*(row for row in rows if row is not None), *soft_rows)


def _stated(
    group: int, runs: Sequence[FrequencyTable], groups: Sequence[int], known: Mapping[str, Quantity]
) -> Row | None:
    """What is stated of one preload, once: who states it of two runs has not measured it twice."""
    of = [i for i, run in enumerate(runs) if groups[i] == group and run.id in known]
    if not of:
        return None
    told = np.array([math.log(known[runs[i].id].value) for i in of])
    spread = np.array(
        [max(known[runs[i].id].standard_uncertainty / known[runs[i].id].value, 1e-6) for i in of]
    )
    weight = spread**-2 / np.sum(spread**-2)
    return Row("known preload", of[0], group, float(weight @ told), float(weight @ spread))


def told_covariance(rows: Sequence[Row]) -> Array:
    """Covariance of what the anchors say: softenings hang together, known preloads stand alone."""
    spread, law = np.array([row.spread for row in rows]), np.array([row.law for row in rows])
    left = np.sqrt(spread**2 - law**2)
    soft = np.array([row.kind == "nut load" for row in rows], dtype=bool)
    alike = np.where(np.outer(soft, soft), SOFTENING_REPEATS, 0.0)
    np.fill_diagonal(alike, 1.0)
    return np.asarray(alike * np.outer(left, left) + np.outer(law, law))
