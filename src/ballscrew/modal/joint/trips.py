"""Comparison of the trips of a run: their average describes a state of the axis only if they agree."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.blocks import make_block
from ballscrew.modal.joint.fit import JointFit, fit_blocks
from ballscrew.modal.joint.ripple import ForceOrders, forces_along
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.uncertainty import parameter_deviation
from ballscrew.modal.joint.windows import average_windows, subset
from ballscrew.modal.reason import Reason

_STEPS = 2  # steps of a fit that begins with the mode of the run: trips of the same state differ little
# A trip that differs from the others is reported if its difference exceeds both of these.
_CLEAR = 4.0  # over the standard uncertainty of the difference
_LEAST_DIFFERENCE = 0.003  # over the frequency


@dataclass(frozen=True, slots=True)
class TripShift:
    """Difference of the frequency of one trip from that of the run.

    Parameters
    ----------
    name : str
        Name of the trip.
    shift, uncertainty : float
        Frequency of the trip less that of the run, and its standard uncertainty, over the frequency.
    """

    name: str
    shift: float
    uncertainty: float


def trip_shifts(
    trips: Sequence[TripSignals],
    transients: Sequence[TransientRow],
    inertia: float,
    run_fit: JointFit,
    orders: ForceOrders,
) -> tuple[TripShift, ...]:
    """Estimate the frequency of every trip alone.

    Only the compliance is fitted, to the first block of a subset of the cells, from the start of sliding on;
    all other parameters are those of the run's fit.

    Parameters
    ----------
    trips : sequence of TripSignals
        Decimated recordings of the run.
    transients : sequence of TransientRow
        Complete transients; the file of each is the index of its trip.
    inertia : float
        Total inertia, in units of force per m/s².
    run_fit : JointFit
        The final fit of the run.
    orders : ForceOrders
        Orders of the forces in this fit.

    Returns
    -------
    tuple of TripShift
        One for each trip with enough transients; empty for a run of one trip.
    """
    if len(trips) < 2:
        return ()
    first, mode = run_fit.blocks[0], run_fit.modes[0]
    band, middle = first.windows.band, first.windows.middle
    out = []
    for number, trip in enumerate(trips):
        own = [replace(transient, file=0) for transient in transients if transient.file == number]
        w = average_windows([trip], own, inertia, band.low, band.high)
        if w is None:
            continue
        w = subset(w)
        # Positions from the middle of the run, and not of this trip.
        centred_position = w.centred_position + w.middle - middle
        w = replace(w, centred_position=centred_position, middle=middle)
        ripple, balls = forces_along([trip], w, orders)
        block = replace(make_block(first.name, w, ripple=ripple, balls=balls), taps=first.taps)
        fit = fit_blocks((block,), (mode,), ("compliance",), most_steps=_STEPS)
        # The frequency is proportional to 1/√compliance.
        shift = -math.log(fit.modes[0].compliance / mode.compliance) / 2
        uncertainty = parameter_deviation(fit, 0) / 2
        out.append(TripShift(trip.name or f"trip {number + 1}", shift, uncertainty))
    return tuple(out)


def trips_differ(shifts: Sequence[TripShift]) -> Reason | None:
    """Reason to make the cells suspect, if a trip differs clearly from the mean of the others; else None.

    An error of the model is common to all trips and cancels in the difference.
    """
    differing = []
    for number, trip in enumerate(shifts):
        others = [*shifts[:number], *shifts[number + 1 :]]
        if not others:
            return None
        mean = sum(other.shift for other in others) / len(others)
        mean_uncertainty = math.sqrt(sum(other.uncertainty**2 for other in others)) / len(others)
        difference, u = trip.shift - mean, math.hypot(trip.uncertainty, mean_uncertainty)
        if abs(difference) > max(_CLEAR * u, _LEAST_DIFFERENCE):
            differing.append(f"{trip.name} by {100 * difference:+.1f} ± {100 * u:.1f} %")
    if not differing:
        return None
    text = (
        f"trips differ in frequency from the others: {', '.join(differing)}; if preload, load or temperature "
        "differed, analyse them as different runs"
    )
    return Reason("trips-differ", text)
