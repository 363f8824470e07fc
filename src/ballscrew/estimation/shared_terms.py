"""What the causes of error of two runs make of a change: what repeats cancels, the rest does not."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.frequency_table import FrequencyTable
from ballscrew.calibration.worn_nut import by_load
from ballscrew.estimation.change import Term

__all__ = ["BASELINE", "BASELINE_PART", "Causes", "causes_of", "repeating_terms"]

BASELINE = "noise of the baseline"
BASELINE_PART = "the baseline's part"


@dataclass(frozen=True, slots=True, eq=False)
class Causes:
    """Of one run, by their effects on Y.

    Parameters
    ----------
    anew : ndarray, shape (k, n)
        What another run draws anew.
    repeating : dict of (str, int) to ndarray, shape (n,)
        What repeats, by name and which of that name.
    """

    anew: Array
    repeating: dict[tuple[str, int], Array]


def causes_of(one: FrequencyTable, rows: list[int], scale: Array) -> Causes:
    """Split as :func:`ballscrew.calibration.frequency_table.joint_covariance` does.

    The nut's load is told as what does not repeat, since the estimator does not know how worn the nut is.
    Here wear is sought, and :func:`~ballscrew.calibration.worn_nut.softer_under_load` gives its effect:
    what is left of the load repeats.

    Parameters
    ----------
    one : FrequencyTable
        The run.
    rows : list of int
        Which of its cells.
    scale : ndarray, shape (rows,)
        Y by each Hz of them.

    Returns
    -------
    Causes
        Its causes.
    """
    seen: Counter[str] = Counter()
    repeating, anew = {}, []
    for name, again, effects in zip(one.shared_names, one.repeats, one.shared, strict=True):
        if again or by_load(name):
            repeating[name, seen[name]] = effects[rows] * scale
            seen[name] += 1
        else:
            anew.append(effects[rows] * scale)
    return Causes(np.array(anew).reshape(len(anew), len(rows)), repeating)


def repeating_terms(
    now: dict[tuple[str, int], Array], then: dict[tuple[str, int], Array], correlation: float, count: int
) -> list[Term]:
    """What is common to both runs acts by its difference; the rest of each is new.

    Parameters
    ----------
    now, then : dict
        Of :class:`Causes`, of the run and of the baseline.
    correlation : float
        From run to run.
    count : int
        Cells.

    Returns
    -------
    list of Term
        Three.
    """
    common, fresh, old = [], [], []
    for key in sorted(now.keys() | then.keys()):
        mine, theirs = now.get(key), then.get(key)
        if mine is not None and theirs is not None:
            common.append(math.sqrt(correlation) * (mine - theirs))
            fresh.append(math.sqrt(1 - correlation) * mine)
            old.append(math.sqrt(1 - correlation) * theirs)
        elif mine is not None:
            fresh.append(mine)
        elif theirs is not None:
            old.append(theirs)
    words = ("errors that repeat", False), ("this run's part of them", True), (BASELINE_PART, False)
    return [
        Term(name, random, np.array(rows).reshape(len(rows), count))
        for (name, random), rows in zip(words, (common, fresh, old), strict=True)
    ]
