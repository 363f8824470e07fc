"""What the run says of the load on its nut, without the preload that the data sheet states."""

from __future__ import annotations

import math

import numpy as np

from ballscrew.modal.joint.fit import Fit
from ballscrew.modal.joint.local import Scatter
from ballscrew.modal.joint.uncertainty import overdone

__all__ = ["held_to_new", "mass_over_preload"]

_LAW = 0.10  # of it: law of the nut and data sheet's share, which no run's scatter shows
_MOST = 0.35  # of its logarithm: what is less certain tells nothing that the data sheet does not


def held_to_new(found: Fit, seen: Scatter) -> float:
    """By how much the nut's load is that of a new nut and not what the run tells, 0 to 1."""
    if ("load", None) not in found.keys:
        return 0.0
    at = found.keys.index(("load", None))
    return float(min(max(seen.tied * np.linalg.pinv(found.hessian)[at, at], 0.0), 1.0))


def mass_over_preload(found: Fit, seen: Scatter, expected: float) -> tuple[float, float] | None:
    """What the nut moves over its preload, with what held it to the data sheet's taken off again.

    Parameters
    ----------
    found : Fit
        With the load among its keys.
    seen : Scatter
        What its priors were made of.
    expected : float
        The data sheet's, kg/N.

    Returns
    -------
    value, standard uncertainty : float
        kg/N; None where the run tells less than the tolerances of a data sheet do. A test with two
        accelerations tells most.
    """
    if ("load", None) not in found.keys or not expected > 0:
        return None
    at = found.keys.index(("load", None))
    whole = 1 / float(np.linalg.pinv(found.hessian)[at, at])
    own = whole - seen.tied
    if not own > 0.01 * whole:
        return None
    spread = math.sqrt(overdone(found, at) / own)
    if spread > _MOST:
        return None
    now = math.log(found.shapes[0].load)
    value = math.exp(now + seen.tied / own * (now - math.log(expected)))
    return value, value * math.hypot(spread, _LAW)
