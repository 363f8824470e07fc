"""Mode of the machine's frame or of the pitching table near the axial one: search, and which is the axis.

The frequencies of two coupled modes do not show which of them is the axis. Three facts do, and all are in the
model: the axial mode changes with the table's position and the frame's does not; the axial frequency is lower
with the rotor held and the frame's is the same; the table moves against its motor in the axial mode.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ballscrew.base.arrays import Array
from ballscrew.modal.joint.blocks import ROTOR_HELD, Block, project, raw_columns_of
from ballscrew.modal.joint.fit import JointFit, fit_blocks, fit_modes, log_residual
from ballscrew.modal.joint.mode import INITIAL_DAMPING, AxialMode
from ballscrew.modal.joint.parameters import Modes, with_rotor_parts
from ballscrew.modal.joint.profile import INITIAL_INFLATION, Profile

# Least value of the highest of `frame_scores` with which a frame is searched for. On 40 random axes of
# benchmarks/other_worlds.py without a frame it is 0.04 at most on 38. With frames of 4 to 20 times the moving
# mass at 1.3 to 1.8 of the mode that the search finds on 16 axes, it is 0.03 at least where the pitching mode
# imitates none.
_LEAST_SCORE = 0.025
_SCORED_SCALES = np.geomspace(0.55, 1.8, 13)  # frequencies of the frame in `frame_scores`, over the axial one
_HIGH_PITCH = 2.5  # frequency of the pitching mode, over the axial one, at which it imitates no frame
# Least score with which the search is repeated with a high pitching mode, over the part of the residual that
# the pitching mode explains. It is 0.77 at least in eight runs where this mode imitated a coupled mode of
# axis and frame, 0.58 at most on the independent bench, whose accelerometers do not show its pitching mode.
_LEAST_PART = 0.65
# Least reduction of the log residual by a frame that the pitching mode imitates. Where no accelerometer shows
# this mode, it is 0.87 at least in three runs of a finite-element machine with a frame of 10 times the moving
# mass at 1.25 to 1.8 of the mode, and 0.43 on a random axis with one at 1.6. Without a frame it is 0.22 at
# most in 34 runs of other such machines and of random axes.
_LEAST_REDUCTION_BY_PITCHING = 0.4
_SCORED_COUPLING = 1e-3  # moving mass over the frame's in `frame_scores`: nearly 0

# Start of the fit: frequencies of axis and frame, over that of the fit without a frame.
_AXIS_SCALES = np.geomspace(0.72, 1.5, 9)
_FRAME_SCALES = np.geomspace(0.6, 1.6, 10)
# Frequencies of a table whose pitching is coupled to the axis, over that of the fit without coupling: in 12
# of 13 runs of random axes that were compared it is 0.85 to 1.11, in one 1.27.
_COUPLED_PITCH_SCALES = np.geomspace(0.75, 1.1, 8)
_RATIO = 0.12  # moving mass over the frame's
_DAMPING = 0.05  # damping ratio of the frame
_ROTOR_PART = 0.6  # rotor's part of the total inertia, if the rotor-held frequency is not fitted too
_MOST_STEPS = 30  # of a fit from a start: 12 are too few for one of 60 runs with a coupled pitching mode

# Least reduction of the log residual by a possible frame; the pitching mode is fitted with and without it.
# Without a frame it is 0.026 at most on those 40 axes, 0.044 with loose accelerometers, and 0.09 with a
# pitching table that is not coupled to the axis, which the limit beside the ripple rejects. With a frame at
# 1.3 and 1.4 of the mode it is 0.068 at least on 14 of those 16 axes; at 1.6 it is below 0.05 on eight.
_LEAST_REDUCTION = 0.05
_SAME_PITCH = 0.02  # largest difference of ln(frequency) from that of the pitching mode
LEAST_REDUCTION_BESIDE_RIPPLE = 0.15
"""Least reduction of the log residual by the frame, with the ripple fitted.

The pitching mode is fitted with the frame; without it, only where it is near the axial mode.

With frames of 4 to 20 times the moving mass at 0.7 to 1.2 of the mode it is 0.31 at least in 68 runs of 16
random axes; with a coupled pitching mode 0.18 at least in 60 runs. Without a frame it is 0.11 at most in six
of seven runs that a possible frame explains best, 0.25 in one; with uncoupled pitching 0.12 at most in 90."""
_MOST_DAMPING = 0.15  # largest damping ratio of the frame; those of machines are 0.1 at most
# Largest mass of the frame over the moving mass. With a wrong data sheet, a fit on the independent bench
# finds a frame of 73 times the moving mass, with a reduction of 0.11 and a damping ratio of 0.06.
_MOST_MASS = 50.0
# Range of the frame's frequency over the axial one. A frame below it moves as a free body.
_LEAST_FREQUENCY = 0.45
_LARGEST_FREQUENCY = 2.2

# Frequency over the axial one from which on a frame is far above: the torsional mode above the band makes its
# mass up to 20 % too small.
_FAR_ABOVE = 1.5

_DISTINCT = 0.1  # margin of a FrameSearch above which the run shows which of the two modes is the axis
_SAME = 0.01  # largest difference of ln(frequency) of two fits in which the same mode is the axis


@dataclass(frozen=True, slots=True)
class FrameSearch:
    """A mode of the frame that was found.

    Parameters
    ----------
    modes : tuple of AxialMode
        With the frame, one per block.
    reduction : float
        Reduction of :func:`~ballscrew.modal.joint.fit.log_residual` by the frame; the pitching mode is fitted
        both with and without it.
    margin : float
        Log residual with axis and frame interchanged, less that of ``modes``. If no such fit has a possible
        frame, the log residual without a frame takes its place.
    pitching : bool
        Whether the mode is that in which the table pitches.
    """

    modes: Modes
    reduction: float
    margin: float
    pitching: bool = False

    @property
    def distinct(self) -> bool:
        """Whether the run shows which of the two modes is the axis."""
        return self.margin > _DISTINCT


def find_frame(plain: JointFit, profile: Profile, *, pitch_measured: bool) -> FrameSearch | None:
    """Search for a frame mode near the axial one.

    Where the accelerometers do not show the pitching mode, it is fitted to the response along the screw, and
    may have been fitted to the higher of two coupled modes: then the frame is also searched for with the
    pitching mode far above both.

    Parameters
    ----------
    plain : JointFit
        Fit without a frame, ripple and whitening.
    profile : Profile
        Parameters and priors of that fit.
    pitch_measured : bool
        Whether the difference of two accelerometers shows the pitching mode.

    Returns
    -------
    FrameSearch or None
        None if the run shows neither a frame nor a pitching table that acts on the axis.
    """
    found = None
    starts: list[Modes] = []
    if profile.pitch > 0:
        starts += _starts(plain, _COUPLED_PITCH_SCALES * plain.modes[0].pitch, pitching=True)
    by_score = bool(frame_scores(plain).max() >= _LEAST_SCORE)
    by_pitching = not by_score and not pitch_measured and _pitching_imitates_frame(plain, profile)
    least_reduction = _LEAST_REDUCTION
    if by_pitching:
        least_reduction = _LEAST_REDUCTION_BY_PITCHING
    if by_score or by_pitching:
        starts += _starts(plain, _FRAME_SCALES * plain.modes[0].middle_frequency)
    if starts:
        found = _frame_beside(plain, starts, profile, plain.log_residual, least_reduction)
    if found is not None or pitch_measured:
        return found
    return _find_beside_high_pitch(plain, profile)


def _find_beside_high_pitch(plain: JointFit, profile: Profile) -> FrameSearch | None:
    """Search for a frame mode with the pitching mode far above both."""
    high_pitch = _HIGH_PITCH * plain.modes[0].middle_frequency
    high = tuple(replace(mode, pitch=high_pitch) for mode in plain.modes)
    priors = profile.priors(INITIAL_INFLATION)
    without_pitch = fit_blocks(plain.blocks, high, profile.fields, priors, most_steps=0)
    score = float(frame_scores(without_pitch).max())
    # Part of the power of the residual that the pitching mode explains, a mean over the blocks.
    by_pitch = -math.expm1(2 * (plain.log_residual - without_pitch.log_residual) / len(plain.blocks))
    # Without a response of the nut the pitching mode explains nothing, and the search would repeat the first.
    if by_pitch <= 0 or score < max(_LEAST_SCORE, _LEAST_PART * by_pitch):
        return None
    with_pitch = _residual_with_pitch(plain, profile)
    return _frame_beside(
        without_pitch,
        _starts(without_pitch, _FRAME_SCALES * without_pitch.modes[0].middle_frequency),
        profile,
        min(plain.log_residual, with_pitch),
    )


def _pitching_imitates_frame(plain: JointFit, profile: Profile) -> bool:
    """True if a frame at the frequency of the pitching mode explains the run much better than this mode.

    A step along the derivative by the coupling, as in :func:`frame_scores`, does not show this: the pitching
    mode explains most of what a small coupling would.
    """
    pitch = plain.modes[0].pitch
    start = _with_frame(plain.blocks, plain.modes, pitch, _RATIO)
    motor_alone = all(b.name == "torque-motor" for b in plain.blocks)  # the motor does not pitch
    if motor_alone or not is_frame(start[0]):
        return False
    with_frame = replace(profile, pitch=pitch, frame=True)
    priors = with_frame.priors(INITIAL_INFLATION)
    modes, residual = fit_modes(plain.blocks, start, with_frame.fields, priors, most_steps=_MOST_STEPS)
    return is_frame(modes[0]) and plain.log_residual - residual >= _LEAST_REDUCTION_BY_PITCHING


def _frame_beside(
    plain: JointFit,
    starts: Sequence[Modes],
    profile: Profile,
    residual_without: float,
    least_reduction: float = _LEAST_REDUCTION,
) -> FrameSearch | None:
    """Search for a frame mode beside the modes of a fit without a frame, from several starts.

    ``residual_without`` is a log residual that some fit without a frame reaches. ``least_reduction`` is the
    reduction with which a frame counts as found.
    """
    with_frame = replace(profile, pitch=plain.modes[0].pitch, frame=True)
    priors = with_frame.priors(INITIAL_INFLATION)
    residual_without = min(residual_without, _residual_with_pitch(plain, profile))
    fits = [
        fit_modes(plain.blocks, start, with_frame.fields, priors, most_steps=_MOST_STEPS) for start in starts
    ]
    possible = [fit for fit in fits if is_frame(fit[0][0])]
    best, residual = min(possible, key=lambda fit: fit[1], default=(plain.modes, math.inf))
    reduction = residual_without - residual
    if reduction < least_reduction:
        return None
    pitching = profile.pitch > 0 and abs(math.log(best[0].frame / best[0].pitch)) < _SAME_PITCH
    interchanged = [
        other_residual
        for other, other_residual in possible
        if abs(math.log(other[0].middle_frequency / best[0].middle_frequency)) >= _SAME
    ]
    other_residual = min(interchanged, default=residual_without)
    return FrameSearch(best, reduction, other_residual - residual, pitching)


def _residual_with_pitch(plain: JointFit, profile: Profile) -> float:
    """Log residual of a fit of the parameters of a profile and of the pitching mode."""
    with_pitch = replace(profile, pitch=plain.modes[0].pitch)
    return fit_modes(plain.blocks, plain.modes, with_pitch.fields, with_pitch.priors(INITIAL_INFLATION))[1]


def is_frame(mode: AxialMode) -> bool:
    """True if the frame's mode is near the axial one, and has mass and damping ratio of a machine's frame.

    Parameters
    ----------
    mode : AxialMode
        Of a fit, with a frame.

    Returns
    -------
    bool
        False where the fit is more likely to have explained something else.
    """
    near = _LEAST_FREQUENCY < mode.frame / mode.middle_frequency < _LARGEST_FREQUENCY
    return near and mode.frame_damping < _MOST_DAMPING and mode.coupling * _MOST_MASS >= 1


def is_far_above(mode: AxialMode) -> bool:
    """True if the frame's mode is so far above the axial one that its mass, and with it both, are uncertain.

    Parameters
    ----------
    mode : AxialMode
        Of a fit, with a frame.

    Returns
    -------
    bool
        Whether its frequency exceeds the axial one by more than half.
    """
    return mode.frame > _FAR_ABOVE * mode.middle_frequency


def frame_scores(plain: JointFit) -> Array:
    """Part of each block's residual that a frame of large mass would explain, at frequencies near the mode.

    This is a score test: one step from a fit without a frame, along the derivative of the model by the
    frame's coupling, from which the part that the fitted parameters explain is removed.

    Parameters
    ----------
    plain : JointFit
        Fit without a frame.

    Returns
    -------
    ndarray, shape (blocks, frequencies)
        Explained power over the power of the residual; negative where the step leads to a negative coupling.
    """
    bases = [np.linalg.qr(jacobian[:, jacobian.any(axis=0)])[0] for jacobian in plain.jacobian]
    out = np.zeros((len(plain.blocks), len(_SCORED_SCALES)))
    for column, scale in enumerate(_SCORED_SCALES.tolist()):
        frequency = scale * plain.modes[0].middle_frequency
        modes = _with_frame(plain.blocks, plain.modes, frequency, _SCORED_COUPLING)
        by_coupling = fit_blocks(plain.blocks, modes, ("coupling",), most_steps=0)
        for row, basis in enumerate(bases):
            direction, residual = by_coupling.jacobian[row][:, 0], plain.residual[row]
            direction = direction - basis @ (basis.T @ direction)
            along = float(direction @ residual)
            powers = float(direction @ direction) * float(residual @ residual)
            out[row, column] = along * abs(along) / max(powers, 1e-300)
    return out


def _starts(plain: JointFit, frequencies: Array, *, pitching: bool = False) -> list[Modes]:
    """Best initial modes with the axial frequency below that of the frame, and best ones with it above.

    Parameters
    ----------
    plain : JointFit
        Fit without a frame.
    frequencies : ndarray, shape (n,)
        Frequencies of the frame, Hz.
    pitching : bool
        Whether the mode of the frame is that in which the table pitches.

    Returns
    -------
    list of tuple of AxialMode
        One or two, each with a mode per block.
    """
    best: dict[bool, tuple[float, Modes]] = {}
    for axis_scale in _AXIS_SCALES.tolist():
        scaled = tuple(
            replace(mode, compliance=mode.compliance / axis_scale**2, damping=INITIAL_DAMPING)
            for mode in plain.modes
        )
        for frequency in frequencies.tolist():
            if pitching:
                scaled = tuple(replace(mode, pitch=frequency) for mode in scaled)
            modes = _with_frame(plain.blocks, scaled, frequency, _RATIO)
            raw = raw_columns_of(plain.blocks, modes)
            projections = [project(b, m, raw=r) for b, m, r in zip(plain.blocks, modes, raw, strict=True)]
            residual = log_residual(projections)
            above = scaled[0].middle_frequency > frequency
            if residual < best.get(above, (math.inf, modes))[0]:
                best[above] = residual, modes
    return [modes for _, modes in best.values()]


def _with_frame(blocks: Sequence[Block], modes: Modes, frequency: float, ratio: float) -> Modes:
    """Modes with a frame of this frequency (Hz); ``ratio`` is the moving mass over the frame's."""
    out = []
    for b, mode in zip(blocks, modes, strict=True):
        part = _ROTOR_PART
        if b.mode_index == ROTOR_HELD:
            part = 1.0
        out.append(replace(mode, frame=frequency, frame_damping=_DAMPING, coupling=ratio, rotor_part=part))
    return with_rotor_parts(blocks, out)
