"""Reasons why a cell is not good: a kind, which programs compare, and a sentence, which people read."""

from __future__ import annotations

from typing import Literal, NamedTuple

ReasonKind = Literal[
    "measurement",  # it is bad or missing, or its signals do not suffice
    "low-rate",  # fewer samples than the mode needs
    "no-mode",  # no resonance of the axis shows
    "tone",  # a periodic force, no resonance
    "unmeasured-force",  # or a disturbed torque
    "unexcited",  # the jerk is too soft, or has a null at the mode
    "unloaded",  # a flank loses contact under the test's own load
    "nearly-unloaded",  # between twice the remaining preload and the load at which a flank loses contact
    "uncertain",  # the standard uncertainty is large
    "few-repetitions",
    "frame",  # which of two modes is that of the axis
    "trips-differ",  # as if they were of different states of the axis
    "responses-differ",  # those of motor and nut
    "ripple",  # which is fitted with the mode
    "other",  # of documents without kinds
]


class Reason(NamedTuple):
    """Reason why a cell is not good.

    Parameters
    ----------
    kind : str
        Equal for equal causes.
    text : str
        Sentence with numbers, without full stop.
    """

    kind: ReasonKind
    text: str


def large_uncertainty(uncertainty: float, limit: float) -> Reason:
    """Reason of both methods for a cell whose frequency is too uncertain.

    Parameters
    ----------
    uncertainty : float
        Standard uncertainty of a frequency, Hz.
    limit : float
        Its upper limit, as a part of the frequency.
    """
    text = f"the standard uncertainty is ± {uncertainty:.1f} Hz, above {100 * limit:.3g} % of the frequency"
    return Reason("uncertain", text)
