"""Search for the modes of a run, and their fit, from initial values to the final fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.fcft.conditions import Condition
from ballscrew.modal.cell import TransientRow
from ballscrew.modal.joint.blocks import (
    ROTOR_HELD,
    Block,
    Projection,
    make_block,
    project,
    raw_columns,
    remaining_power,
    simulate,
    with_whitening,
)
from ballscrew.modal.joint.fit import CLEAR_REDUCTION, JointFit, fit_blocks, fit_modes
from ballscrew.modal.joint.frame import LEAST_REDUCTION_BESIDE_RIPPLE, FrameSearch, find_frame, is_frame
from ballscrew.modal.joint.initial import (
    InitialValues,
    expected_mass_over_preload,
    find_pitching_mode,
    search_frequencies,
)
from ballscrew.modal.joint.local_wear import UNKNOWN, LocalVariation
from ballscrew.modal.joint.mode import GUIDE_PART_MEAN, AxialMode
from ballscrew.modal.joint.parameters import Modes
from ballscrew.modal.joint.profile import INITIAL_INFLATION, Profile, fit_profile
from ballscrew.modal.joint.result import RippleOrder
from ballscrew.modal.joint.ripple import RippleFit, RippleModel, ripple_amplitudes
from ballscrew.modal.joint.settings import JointSettings
from ballscrew.modal.joint.signals import TripSignals
from ballscrew.modal.joint.trips import TripShift, trip_shifts
from ballscrew.modal.joint.windows import Windows, average_windows, subset

# Frequency of the pitching mode over that of the axial mode.
_LEAST_PITCH_RATIO = 0.6  # lower limit of the search with two accelerometers
# Largest ratio at which the pitching mode is fitted: a coupled one at 1.3 of the mode was located at 1.54.
_LARGEST_FITTED_PITCH = 1.6
_PITCH_RATIOS = np.geomspace(1.25, 2.5, 15)  # tried with a single accelerometer
# Frequencies of the pitching mode that are tried, over an estimated frequency of it.
_PITCH_SCALES = np.array([0.92, 0.95, 0.975, 1.0, 1.025, 1.05, 1.08])

_FIRST_ITERATIONS = 6  # largest number of iterations of a fit that locates the modes
_ITERATIONS = 8  # largest number of iterations of a fit of the whole profile

# Friction is negligible if the rms residual where the table begins to slide is below each of these.
# Friction of 15 % of the response, on axis 12 of the benchmarks, shifts the frequency by 0.5 Hz; on the bench
# it is below 5 %.
_FRICTION_RESIDUAL = 2.0  # over the rms residual elsewhere
_FRICTION_RESPONSE = 0.1  # over the rms response there, after subtraction of the noise elsewhere
_HIDES_FRICTION = 0.2  # over the rms response there, noise included: more noise could conceal friction
# The table begins to slide in this time around the first sample that is fitted in motion.
_BEFORE_SLIDING = 0.006  # s
_AFTER_SLIDING = 0.015  # s

AMBIGUOUS_LOAD_RATIO = 1.5
"""Ratio of the expected to the fitted mass over preload from which on the fit may have missed a worn nut."""

_WORN = 10.0  # initial mass over preload of the fit of a worn nut, over that by the nominal preload


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The final fit of a run, and the choices made before it.

    Parameters
    ----------
    fit, unwhitened : JointFit
        The final fit, with whitened residuals, and the one before it without.
    from_rest : bool
        Whether departures are fitted from standstill on, see
        :func:`~ballscrew.modal.joint.blocks.make_block`.
    variation : LocalVariation
        Variation of the compliance from stop to stop, as assumed in the priors of the final fit.
    profile : Profile
        Which parameters were fitted, with their priors.
    ripple : tuple of RippleOrder
        Forces of the motor fitted with the mode.
    frame : FrameSearch or None
        Mode of the frame or of the pitching table fitted with the axial one; None if there is none.
    trips : tuple of TripShift
        Difference of the frequency of each trip from that of the run; empty for a run of one trip.
    """

    fit: JointFit
    unwhitened: JointFit
    from_rest: bool
    variation: LocalVariation
    profile: Profile
    ripple: tuple[RippleOrder, ...] = ()
    frame: FrameSearch | None = None
    trips: tuple[TripShift, ...] = ()


def search(
    trips: Sequence[TripSignals],
    transients: Sequence[TransientRow],
    inertia: float,
    initial: InitialValues,
    names: Sequence[str],
    settings: JointSettings,
) -> SearchResult | None:
    """Search for the modes of a run and fit them.

    The steps: locate the axial and the pitching mode by their frequencies, with compliance, slope and damping
    alone; fit the whole profile; search for a mode of the frame; find a worn nut, fit again, and select the
    ripple of the motor; fit everything once more with whitened residuals.

    Parameters
    ----------
    trips : sequence of TripSignals
        Decimated recordings of the run.
    transients : sequence of TransientRow
        Complete transients; the file of each is the index of its trip.
    inertia : float
        Total inertia, in units of force per m/s².
    initial : InitialValues
        Values with which the search begins.
    names : sequence of str
        Names of the blocks to fit; those with the response of the nut come first.
    settings : JointSettings
        Settings of the method.

    Returns
    -------
    SearchResult or None
        None if no cell has a window.
    """
    # If there are accelerometers, the modes are located without the third block, "torque-motor".
    located_by = names[:2]
    located = _locate(trips, transients, inertia, initial, located_by, settings)
    if located is None:
        return None
    w, modes, pitch_measured = located
    profile = _profile(initial, w.middle, modes[0].middle_frequency)
    if pitch_measured and modes[0].pitch < _LARGEST_FITTED_PITCH * modes[0].middle_frequency:
        profile = replace(profile, pitch=modes[0].pitch)
    fit_with_ripple = partial(_fit_with_ripple, trips, names, initial)
    blocks = _unwhitened_blocks(located_by, subset(w))
    plain = fit_blocks(blocks, modes, profile.fields, profile.priors(INITIAL_INFLATION))
    modes = plain.modes
    frame = find_frame(plain, profile, pitch_measured=pitch_measured)
    fitted = None
    if frame is not None:
        # The axial mode may be at another frequency with it, so the windows are filtered for the band there.
        axial = frame.modes[0].middle_frequency
        low, high = settings.band_low * axial, settings.band_high * axial
        in_band = average_windows(trips, transients, inertia, low, high) or w
        with_frame = replace(_profile(initial, w.middle, axial), pitch=frame.modes[0].pitch, frame=True)
        beside_ripple = fit_with_ripple(in_band, frame.modes, with_frame)
        # Ripple is not fitted while a frame is searched for, and a frame may explain some of it.
        without = fit_with_ripple(in_band, modes, profile)
        reduction = without.ripple.fit.log_residual - beside_ripple.ripple.fit.log_residual
        if reduction >= LEAST_REDUCTION_BESIDE_RIPPLE and is_frame(beside_ripple.ripple.fit.modes[0]):
            fitted = beside_ripple
    if fitted is None:
        frame, fitted = None, fit_with_ripple(w, modes, profile)
    unwhitened, profile = fitted.ripple.fit, fitted.profile
    blocks = _whitened_blocks(unwhitened, settings)
    final, variation = fit_profile(blocks, unwhitened.modes, profile, fitted.ripple.variation, _ITERATIONS)
    ripple = ripple_amplitudes(final, fitted.ripple.orders.whole, initial.lead)
    shifts = trip_shifts(trips, transients, inertia, final, fitted.ripple.orders)
    return SearchResult(final, unwhitened, fitted.from_rest, variation, profile, ripple, frame, shifts)


def _profile(initial: InitialValues, position: float, frequency: float) -> Profile:
    """Parameters of the fit, with the prior by data sheet and frequency (Hz) estimated at a position (m)."""
    if initial.sheet is None:
        return Profile(initial.curved)
    expected = expected_mass_over_preload(initial.sheet, initial.load, position, frequency)
    return Profile(initial.curved, *expected, guide_part=initial.viscous > 0)


@dataclass(frozen=True, slots=True)
class _FitWithRipple:
    """Fit of the whole profile with the ripple, without whitening.

    ``from_rest`` and ``profile`` are the fields of :class:`SearchResult`.
    """

    ripple: RippleFit
    from_rest: bool
    profile: Profile


def _fit_with_ripple(
    trips: Sequence[TripSignals],
    names: Sequence[str],
    initial: InitialValues,
    w: Windows,
    modes: Modes,
    profile: Profile,
) -> _FitWithRipple:
    """Fit the whole profile along the axis, then again with the ripple of the motor."""
    worn = _WORN * initial.mass_over_preload
    modes = _fit_new_or_worn(_unwhitened_blocks(names, subset(w)), modes, profile, worn)
    blocks = _unwhitened_blocks(names, w)
    plain, variation = fit_profile(blocks, modes, profile, UNKNOWN, _ITERATIONS)
    plain, variation = _refit_with_expected_nut(blocks, plain, variation, profile)
    from_rest = all(map(_friction_is_negligible, blocks, plain.projections))
    model = RippleModel(trips, names, from_rest=False, initial=initial, profile=profile)
    with_ripple = model.fit(plain, variation)
    # The force of passing balls was in the noise, so the test of friction was too lenient.
    from_rest = from_rest and with_ripple.orders.balls is None
    if from_rest:
        with_ripple = replace(model, from_rest=True).fit(plain, variation)
    return _FitWithRipple(with_ripple, from_rest, profile)


def _locate(
    trips: Sequence[TripSignals],
    transients: Sequence[TransientRow],
    inertia: float,
    initial: InitialValues,
    names: Sequence[str],
    settings: JointSettings,
) -> tuple[Windows, tuple[AxialMode, ...], bool] | None:
    """Locate the modes: in a band around the initial frequency, then in a band around the located one.

    Returns the windows in the second band, a mode for each block, and whether the difference of the two
    accelerometers shows the pitching mode; None if no cell has a window.
    """
    low, high = settings.band_low * initial.rotor_free, settings.band_high * initial.rotor_free
    w = average_windows(trips, transients, inertia, low, high)
    if w is None:
        return None
    pitching = None  # frequency (Hz) and damping ratio
    if "torque-nut" in names:
        pitching = find_pitching_mode(w, _LEAST_PITCH_RATIO * initial.rotor_free, high)
    blocks = _unwhitened_blocks(names, subset(w))
    modes = search_frequencies(blocks, [initial.mode(b.mode_index) for b in blocks], pitching)
    modes = _first_fit(w, names, modes)
    axial = modes[0].middle_frequency
    ratios = _PITCH_RATIOS
    if pitching is not None:
        ratios = pitching[0] / axial * _PITCH_SCALES
    modes = _with_best_pitch(_unwhitened_blocks(names, w), modes, ratios)

    w = average_windows(trips, transients, inertia, settings.band_low * axial, settings.band_high * axial)
    if w is None:
        return None
    ratios = modes[0].pitch / axial * _PITCH_SCALES
    modes = _first_fit(w, names, modes)
    modes = _with_best_pitch(_unwhitened_blocks(names, w), modes, ratios)
    return w, modes, pitching is not None


def _unwhitened_blocks(names: Sequence[str], w: Windows) -> list[Block]:
    """Blocks by name, without whitening and ripple."""
    return [make_block(name, w) for name in names]


def _first_fit(w: Windows, names: Sequence[str], modes: tuple[AxialMode, ...]) -> tuple[AxialMode, ...]:
    """Modes, one per block, after a fit of compliance, damping and slope alone."""
    fields = ("compliance", "damping", "slope")
    return fit_modes(_unwhitened_blocks(names, w), modes, fields, most_steps=_FIRST_ITERATIONS)[0]


def _with_best_pitch(
    blocks: Sequence[Block], modes: Sequence[AxialMode], ratios: Array
) -> tuple[AxialMode, ...]:
    """Modes with the pitching frequency that leaves the least power unexplained.

    ``ratios`` are the frequencies tried, over the axial one.
    """
    projections = [project(b, mode) for b, mode in zip(blocks, modes, strict=True)]
    simulations = [simulate(b, mode) for b, mode in zip(blocks, modes, strict=True)]
    least, best = math.inf, tuple(modes)
    for ratio in ratios:
        pitch = float(ratio) * modes[0].middle_frequency
        trial = tuple(replace(mode, pitch=pitch) for mode in modes)
        cost = 0.0  # sum of the logarithms of the blocks' powers
        for b, mode, simulation, projection in zip(blocks, trial, simulations, projections, strict=True):
            power = remaining_power(b, raw_columns(b, mode, simulation), projection)
            cost += math.log(max(power, 1e-300))  # a power may be 0
        if cost < least:
            least, best = cost, trial
    return best


def _fit_new_or_worn(
    blocks: Sequence[Block], modes: tuple[AxialMode, ...], profile: Profile, worn: float
) -> tuple[AxialMode, ...]:
    """Fit the modes as given, and with a worn nut; those of the latter if it fits clearly better.

    A nut softens until the load is about three times its preload, where one flank loses contact, and stiffens
    beyond. The cost may therefore have two minima, and an iteration that begins near one may not reach the
    other. ``worn`` is the mass over preload of the second start, kg/N. Without a data sheet nothing is
    fitted.
    """
    if not profile.mass_over_preload > 0:
        return modes
    priors = profile.priors(INITIAL_INFLATION)
    with_worn_nut = [replace(mode, mass_over_preload=worn) for mode in modes]
    as_given, residual = fit_modes(blocks, modes, profile.fields, priors)
    as_worn, worn_residual = fit_modes(blocks, with_worn_nut, profile.fields, priors)
    if worn_residual < residual + CLEAR_REDUCTION:
        return as_worn
    return as_given


def _refit_with_expected_nut(
    blocks: Sequence[Block], fit: JointFit, variation: LocalVariation, profile: Profile
) -> tuple[JointFit, LocalVariation]:
    """Repeat a fit from the expected mass over preload; the clearly better fit with its local variation.

    Where the test unloads a nut that has worn locally, the cost has further minima. A fit with a value near
    the expected one is not repeated.
    """
    expected, fitted = profile.mass_over_preload, fit.modes[0].mass_over_preload
    if not expected > 0 or 1 / AMBIGUOUS_LOAD_RATIO < expected / fitted < AMBIGUOUS_LOAD_RATIO:
        return fit, variation
    modes = tuple(replace(mode, mass_over_preload=expected, guide_part=GUIDE_PART_MEAN) for mode in fit.modes)
    other, other_variation = fit_profile(blocks, modes, profile, variation, _ITERATIONS)
    if other.log_residual < fit.log_residual + CLEAR_REDUCTION:
        return other, other_variation
    return fit, variation


def _friction_is_negligible(b: Block, projection: Projection) -> bool:
    """Whether the residual where the table begins to slide shows no effect of friction.

    ``projection`` is that of a fit in motion alone; its model extends to the samples before.
    """
    w = b.windows
    before, after = round(_BEFORE_SLIDING * w.rate), round(_AFTER_SLIDING * w.rate)  # samples
    begins = np.zeros(len(w.centred_position), bool)  # samples in which the table begins to slide
    for (start, stop), cell in zip(w.spans, w.cells, strict=True):
        if Condition(cell.condition).accelerating:
            in_motion = start + int(np.argmax(w.in_motion[start:stop]))
            begins[max(start, in_motion - before) : min(stop, in_motion + after)] = True
    at_start, elsewhere = begins & w.from_rest, w.in_motion & ~begins
    if not at_start.any() or not elsewhere.any():
        return False
    squares = (b.target - projection.model) ** 2
    residual, noise = float(np.mean(squares[at_start])), float(np.mean(squares[elsewhere]))
    response = float(np.mean(b.target[at_start] ** 2))
    limits = (  # (m/s²)²
        _FRICTION_RESIDUAL**2 * noise,
        noise + _FRICTION_RESPONSE**2 * response,
        _HIDES_FRICTION**2 * response,
    )
    return residual < min(limits)


def _whitened_blocks(fit: JointFit, settings: JointSettings) -> list[Block]:
    """Blocks of a fit, with whitening of those that the torque drives.

    The block that the motor's motion drives stays unwhitened, since whitening does not improve it: on the
    bench, in eight runs of one and three trips, a filter for it too changes the median error of the
    rotor-free frequency by at most 0.01 Hz, and that of the rotor-held frequency by 0.03 Hz, up or down.
    """
    out = []
    for b, projection in zip(fit.blocks, fit.projections, strict=True):
        if b.mode_index == ROTOR_HELD:
            out.append(b)
            continue
        floor = settings.floor
        if b.name == "torque-motor":
            floor = settings.motor_floor
        out.append(with_whitening(b, projection.residual, floor))
    return out
