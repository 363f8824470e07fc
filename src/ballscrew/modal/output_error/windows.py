"""One cell through several windows: what they disagree by is uncertainty that no single one shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballscrew.modal.output_error.estimate import CellEstimate

__all__ = ["over_windows"]

_LEAST = 0.5  # of the windows, that must show the mode
_OFF = 4.0  # scaled median deviations, beyond which a window shows another mode
_FLOOR = 0.01  # of the frequency: what counts as the same mode in any case


def over_windows(estimates: Sequence[CellEstimate]) -> CellEstimate:
    """Join estimates of one cell from windows that are as good as each other.

    The windows share most of their data, so the spread is not divided by their number. The moving table,
    friction and the motion bias one window after another differently; repetitions alone do not show it.

    Parameters
    ----------
    estimates : sequence of CellEstimate
        Of one cell, one a window, the window preferred first.

    Returns
    -------
    CellEstimate
        That of the preferred window with the median frequency and damping, and a term ``windows``; refused
        where fewer than half of the windows show the mode.

    Raises
    ------
    ValueError
        If there is none.
    """
    if not estimates:
        raise ValueError("there is no estimate to join")
    found = [each for each in estimates if each.frequency is not None]
    if len(found) < max(1, _LEAST * len(estimates)):
        refused = next(each for each in estimates if each.frequency is None)
        words = f"only {len(found)} of {len(estimates)} windows show the mode: {refused.reasons[0]}"
        return replace(refused, reasons=(words,)) if found else refused
    value = np.array([(e.frequency, e.damping) for e in found], dtype=np.float64)
    deviation = np.array([(e.uncertainty, e.damping_uncertainty) for e in found], dtype=np.float64)
    middle = np.median(value, axis=0)
    distance = np.abs(value[:, 0] - middle[0])
    kept = distance <= max(_OFF * 1.48 * float(np.median(distance)), _FLOOR * float(middle[0]))
    value, deviation = value[kept], deviation[kept]
    middle = np.median(value, axis=0)
    spread = value.std(axis=0, ddof=1) if len(value) > 1 else np.zeros(2)
    noise = np.median(deviation, axis=0)
    first = found[int(np.flatnonzero(kept)[0])]
    return replace(
        first,
        frequency=float(middle[0]),
        uncertainty=float(np.hypot(noise[0], spread[0])),
        damping=float(middle[1]),
        damping_uncertainty=float(np.hypot(noise[1], spread[1])),
        terms=(*first.terms, ("windows", float(spread[0]))),
    )
