"""Comparison of the trips of a run: their average is a state of the axis only if they agree."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.blocks import make_block
from ballscrew.modal.joint.fit import JointFit, fit_blocks
from ballscrew.modal.joint.ripple import Force, forces_along
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.uncertainty import parameter_deviation
from ballscrew.modal.joint.windows import average_windows, subset
from ballscrew.modal.reason import Reason

_STEPS = 2  # steps of a fit, which begins with the mode of the run: trips of the same state differ little
# Least difference of a trip from the others that is reported: over its standard uncertainty, and over the
# frequency.
_CLEAR = 4.0
_LEAST_DIFFERENCE = 0.003


@dataclass(frozen=True, slots=True)
class TripShift:
    """Frequency of one trip less that of the run, as a fraction, with its standard uncertainty."""

    name: str
    shift: float
    uncertainty: float


def trip_shifts(
    trips: Sequence[TripSignals],
    transients: Sequence[TransientRow],
    inertia: float,
    found: JointFit,
    forces: Force,
) -> tuple[TripShift, ...]:
    """Fit the compliance of every trip alone to the first block, in motion; all else is as in the run.

    Parameters
    ----------
    trips : sequence of TripSignals
        The run.
    transients : sequence of TransientRow
        Complete ones.
    inertia : float
        Total inertia, in units of force per m/s².
    found : JointFit
        The final fit of the run.
    forces : Force
        Ripple and balls in this fit.

    Returns
    -------
    tuple of TripShift
        Of each trip with enough transients; none for a run of one trip.
    """
    if len(trips) < 2:
        return ()
    first, mode = found.blocks[0], found.modes[0]
    band, middle = first.windows.band, first.windows.middle
    out = []
    for number, trip in enumerate(trips):
        own = [replace(transient, file=0) for transient in transients if transient.file == number]
        w = average_windows([trip], own, inertia, band.low, band.high)
        if w is None:
            continue
        w = subset(w)
        w = replace(w, place=w.place + w.middle - middle, middle=middle)  # positions as in the run
        ripple, balls = forces_along([trip], w, forces)
        block = replace(make_block(first.name, w, ripple=ripple, balls=balls), filter=first.filter)
        fit = fit_blocks((block,), (mode,), ("compliance",), most_steps=_STEPS)
        # The frequency is proportional to 1/√compliance.
        shift = -math.log(fit.modes[0].compliance / mode.compliance) / 2
        uncertainty = parameter_deviation(fit, 0) / 2
        out.append(TripShift(trip.name or f"trip {number + 1}", shift, uncertainty))
    return tuple(out)


def disagreement(shifts: Sequence[TripShift]) -> Reason | None:
    """The reason to be suspect, if a trip differs clearly from the mean of the others; otherwise None.

    An error of the model is common to all trips and cancels in the difference.
    """
    differing = []
    for number, trip in enumerate(shifts):
        others = [*shifts[:number], *shifts[number + 1 :]]
        if not others:
            return None
        mean = sum(other.shift for other in others) / len(others)
        of_mean = math.sqrt(sum(other.uncertainty**2 for other in others)) / len(others)
        difference, u = trip.shift - mean, math.hypot(trip.uncertainty, of_mean)
        if abs(difference) > max(_CLEAR * u, _LEAST_DIFFERENCE):
            differing.append(f"{trip.name} by {100 * difference:+.1f} ± {100 * u:.1f} %")
    if not differing:
        return None
    text = (
        f"trips differ in frequency from the others: {', '.join(differing)}; if preload, load or temperature "
        "differed, analyse them as different runs"
    )
    return Reason("trips-differ", text)
