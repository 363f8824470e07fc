"""How much lower a worn nut is read than a new one, since the test's own load softens it more."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.calibration.assumptions import Assumptions
from ballscrew.calibration.frequency_table import FrequencyTable

__all__ = ["by_load", "load_term", "softer_under_load"]

_LEAST = 1e-3  # a ratio that is none must not reach the logarithm


def softer_under_load(
    one: FrequencyTable, rows: Sequence[int], ratio: float, assumptions: Assumptions
) -> tuple[Array, Array]:
    """What the test's own load leaves in the frequencies of a worn nut.

    The estimator holds the nut's softening to that of a new nut as far as one run does not show it. By the
    nut's law the part that is left grows with the wear; how much of it is left depends on the load on the
    nut and on how far the run's own data moved it, and a run tells neither. What it tells is the size of the
    two, as its term "load". The correction is a stated multiple of that, so uncertain that its 95 % interval
    holds none at all and twice as much.

    Parameters
    ----------
    one : FrequencyTable
        Where the nut was as the ratio counts it from; tells the term.
    rows : sequence of int
        Which of its cells.
    ratio : float
        P over the preload of that run.
    assumptions : Assumptions
        How many times the term it is, and how sure that is.

    Returns
    -------
    ndarray, shape (rows,)
        Part of f by which it is read too low.
    ndarray, shape (rows,)
        Its standard deviation.
    """
    size = load_term(one)
    part = size[list(rows)] / one.frequency[list(rows)] * -math.log(max(ratio, _LEAST))
    return part * assumptions.nut_load, np.abs(part) * assumptions.nut_load_spread


def load_term(one: FrequencyTable) -> Array:
    """What a run tells as its term "load", Hz of each cell; 0 where it tells none."""
    told = zip(one.shared_names, one.shared, strict=True)
    effects = [effect for name, effect in told if by_load(name)]
    return np.sqrt(np.sum(np.square(effects), axis=0)) if effects else np.zeros_like(one.frequency)


def by_load(name: str) -> bool:
    """Whether a cause is the nut's load; older documents part it into a level and a tilt."""
    return name.split(":")[0] == "load"
