"""Lost samples: the position jumps while the axis moves, and a pause is short."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ballscrew.recording.kinematics import Kinematics
from ballscrew.recording.phases import Phase
from ballscrew.recording.quality.finding import Finding

__all__ = ["check_dropped", "jumps", "odd_pauses"]

_JUMP = 0.6  # of the way in a sample interval: one lost sample makes it 1
_QUIET = 0.3  # of that way: where the encoder's steps scatter more, it cannot tell single samples
_NEIGHBOURS = 9  # samples, whose median is the way that is expected
_FAST = 0.3  # of the cruising speed: below, the encoder's steps are as large as the way
_OFTEN = 98.0  # per cent of the time in which the speed is lower than the cruising speed, at most
_MANY = 10  # a few jumps spoil a few transients, many spoil all
_PAUSE = 6e-3  # s; a controller's cycle, and what friction does to the last micrometres
_PAUSE_TYPICAL = 10.0  # times the median deviation of all pauses
_FEW_PAUSES = 0.1  # of all: more odd ones than that are the machine's own


def jumps(motion: Kinematics) -> tuple[NDArray[np.intp], float] | None:
    """Samples at which the position jumps or halts in full motion.

    Parameters
    ----------
    motion : Kinematics
        Of one recording.

    Returns
    -------
    at : ndarray of int
        The samples before which it does.
    lost : float
        How many sample intervals the jumps are together; halts count nothing.
        None instead of both where the encoder is too coarse or too slow to tell.
    """
    step = np.diff(motion.position)
    # A jump spoils a smoothed speed around it, and not a median.
    usual = median_filter(step, _NEIGHBOURS, mode="nearest")
    # Many jumps are speeds of their own; what their neighbours go at is not.
    cruise = min(motion.cruise, float(np.percentile(np.abs(usual), _OFTEN)) * motion.rate)
    fast = np.abs(usual) * motion.rate > _FAST * cruise
    if cruise <= 0 or np.count_nonzero(fast) < 4 * _NEIGHBOURS:
        return None
    off = np.zeros_like(step)
    off[fast] = np.abs(step[fast] / usual[fast] - 1)
    if np.percentile(off[fast], 98) > _QUIET:
        return None
    at = np.flatnonzero(off > _JUMP)
    ahead = (step[at] - usual[at]) * np.sign(usual[at]) > 0
    return at + 1, float(np.sum(off[at][ahead]))


def odd_pauses(motion: Kinematics, phases: Sequence[Phase]) -> list[tuple[float, float, float]]:
    """Pauses between two moves that differ from all others.

    Parameters
    ----------
    motion : Kinematics
        Of one recording.
    phases : sequence of Phase
        Of it.

    Returns
    -------
    list of (start, duration, usual duration)
        s; empty where there are few pauses, or many odd ones.
    """
    pauses = np.array(
        [
            (one.stop, other.start - one.stop)
            for one, other in pairwise(phases)
            if other.condition.accelerating and not one.condition.accelerating
        ],
        dtype=np.float64,
    ).reshape(-1, 2)
    if len(pauses) < 8:
        return []
    usual = float(np.median(pauses[:, 1]))
    off = np.abs(pauses[:, 1] - usual)
    limit = max(_PAUSE * motion.rate, _PAUSE_TYPICAL * float(np.median(off)))
    odd = pauses[off > limit] / motion.rate
    if len(odd) > max(1.0, _FEW_PAUSES * len(pauses)):
        return []
    return [(float(start), float(length), usual / motion.rate) for start, length in odd]


def check_dropped(file: str, motion: Kinematics, phases: Sequence[Phase]) -> list[Finding]:
    """Findings on lost samples.

    Parameters
    ----------
    file : str
        For the messages.
    motion : Kinematics
        Of one recording.
    phases : sequence of Phase
        Of it.

    Returns
    -------
    list of Finding
        Empty where none are lost.
    """
    findings = []
    found = jumps(motion)
    if found is not None and len(found[0]):
        at, lost = found
        findings.append(
            Finding(
                "bad" if len(at) > _MANY else "suspect",
                "dropped",
                f"{file}: the position jumps at {len(at)} samples in full motion, the first at "
                f"{at[0] / motion.rate:.4g} s, over {lost:.3g} sample intervals in all: samples were dropped",
            )
        )
    odd = odd_pauses(motion, phases)
    if odd:
        start, length, usual = odd[0]
        findings.append(
            Finding(
                "suspect",
                "pause",
                f"{file}: the pause at {start:.4g} s takes {1e3 * length:.4g} ms, all others "
                f"{1e3 * usual:.4g} ms: samples were dropped, or the axis waited",
            )
        )
    return findings
