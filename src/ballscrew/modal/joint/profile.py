"""Fit of the compliance along the axis: a smooth profile, with local wear at stops if it is significant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ballscrew.modal.joint.blocks import Block
from ballscrew.modal.joint.fit import (
    SAMPLES_PER_INDEPENDENT,
    JointFit,
    Prior,
    fit_blocks,
    with_local_parameters,
)
from ballscrew.modal.joint.local_wear import (
    LocalVariation,
    estimate_variation,
    local_fields,
    local_priors,
    with_stops,
)
from ballscrew.modal.joint.mode import (
    FORM_DEVIATION,
    FORM_MEAN,
    GUIDE_PART_DEVIATION,
    GUIDE_PART_MEAN,
    AxialMode,
)
from ballscrew.modal.joint.parameters import FRAME_FIELDS, PITCH_FIELDS
from ballscrew.modal.joint.uncertainty import variance_inflation

# Prior of the damping ratio's exponent along the axis: between hysteresis (0) and damping in the springs (1),
# and not excluding damping in the guide (-1).
EXPONENT_MEAN = 0.5
"""Mean of the prior of the damping ratio's exponent."""
EXPONENT_DEVIATION = 0.7
"""Its standard deviation."""

# Priors of damping ratios: median, and standard deviation of the logarithm.
_FRAME_DAMPING = (0.05, 0.9)
_PITCH_DAMPING = (0.03, 0.7)
_PITCH_DEVIATION = 0.05  # standard deviation of ln(pitching frequency), whose median is the initial one

_ROUNDS = 3  # largest number of fits, each with inflation and local variation estimated from the previous one
_LOCAL_ITERATIONS = 4  # largest number of iterations of a fit with local compliances
_CONVERGED = 0.25  # change of ln(standard deviation) below which the rounds end; of ln(variance), twice that
INITIAL_INFLATION = 1000.0
"""Result of :func:`~ballscrew.modal.joint.uncertainty.variance_inflation` assumed in the first fit.

Large, so that the priors, such as that of mass over preload, dominate until the scatter of the cells is
known."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Choice of the parameters of the mode along the axis that are fitted, and their priors.

    Parameters
    ----------
    curved : bool
        Whether the compliance is a parabola along the axis, and not nearly a line.
    mass_over_preload, load_deviation, least_mass_over_preload : float
        Results of :func:`~ballscrew.modal.joint.initial.expected_mass_over_preload`: value (kg/N), standard
        deviation of its logarithm, and lower limit (kg/N); 0 without a data sheet.
    pitch : float
        Initial frequency of the pitching mode, Hz, where it is fitted; else 0.
    frame : bool
        Whether a mode of the frame is fitted.
    guide_part : bool
        Whether the guide's part of the viscous friction is fitted.
    """

    curved: bool
    mass_over_preload: float = 0.0
    load_deviation: float = 0.0
    least_mass_over_preload: float = 0.0
    pitch: float = 0.0
    frame: bool = False
    guide_part: bool = False

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields of AxialMode that are fitted."""
        fields = ["compliance", "damping", "slope"]
        if self.curved:
            fields.append("curve")
        else:
            fields.append("form")
        if self.mass_over_preload > 0:
            fields.append("mass_over_preload")
        if self.guide_part:
            fields.append("guide_part")
        if self.frame:
            fields += FRAME_FIELDS
        if self.pitch > 0:
            fields += PITCH_FIELDS
        return (*fields, "damping_exponent")

    def priors(self, inflation: float) -> list[Prior]:
        """Priors of the parameters that have one.

        ``inflation`` is a result of :func:`~ballscrew.modal.joint.uncertainty.variance_inflation`; only those
        of mass over preload, of the guide's part and of the form are adapted to it, see :meth:`scaled`. That
        of the exponent, if adapted, moves the frequencies of ten random axes by 0.09 of their uncertainty at
        most. Those of a frame, if adapted, increase the rms error of 20 runs with a frame from 0.60 to 0.76
        Hz.
        """
        out = [Prior((("damping_exponent", 1.0),), EXPONENT_MEAN, EXPONENT_DEVIATION)]
        if not self.curved:
            out.append(Prior((("form", 1.0),), FORM_MEAN, self.scaled(FORM_DEVIATION, inflation)))
        if self.mass_over_preload > 0:
            deviation = self.scaled(self.load_deviation, inflation)
            load = Prior((("mass_over_preload", 1.0),), math.log(self.mass_over_preload), deviation)
            out.insert(0, load)
        if self.guide_part:
            deviation = self.scaled(GUIDE_PART_DEVIATION, inflation)
            out.append(Prior((("guide_part", 1.0),), GUIDE_PART_MEAN, deviation))
        if self.frame:
            out.append(_damping_prior("frame_damping", *_FRAME_DAMPING))
        if self.pitch > 0:
            out.append(_damping_prior("pitch_damping", *_PITCH_DAMPING))
            out.append(Prior((("pitch", 1.0),), math.log(self.pitch), _PITCH_DEVIATION))
        return out

    @staticmethod
    def scaled(deviation: float, inflation: float) -> float:
        """Standard deviation of a prior, adapted to the weight of the data.

        A fit takes its residuals for white noise, and so gives the data too much weight by the factor
        ``inflation``. The information of the prior is multiplied by the same factor: by
        SAMPLES_PER_INDEPENDENT in the fit, and by ``inflation`` / SAMPLES_PER_INDEPENDENT here.
        """
        return deviation * math.sqrt(SAMPLES_PER_INDEPENDENT / inflation)

    def load_information(self, inflation: float) -> float:
        """Information of the prior of ln(mass over preload) in the fit: the inverse of its variance there."""
        if not self.mass_over_preload > 0:
            return 0.0
        return inflation / self.load_deviation**2


def _damping_prior(field: str, median: float, deviation: float) -> Prior:
    """Prior of a damping ratio; ``deviation`` is that of its logarithm."""
    return Prior(((field, 1.0),), math.log(median), deviation)


def fit_profile(
    blocks: Sequence[Block],
    modes: tuple[AxialMode, ...],
    profile: Profile,
    variation: LocalVariation,
    most_steps: int,
) -> tuple[JointFit, LocalVariation]:
    """Fit the smooth profile, and local compliances at the stops if the run shows local wear.

    Parameters
    ----------
    blocks : sequence of Block
        Drives and responses.
    modes : tuple of AxialMode
        Initial modes. That of a block is the element ROTOR_FREE (0) or ROTOR_HELD (1).
    profile : Profile
        Which parameters are fitted.
    variation : LocalVariation
        Local variation estimated so far.
    most_steps : int
        Upper limit of the iterations of a fit of the smooth profile.

    Returns
    -------
    JointFit
        The last fit.
    LocalVariation
        The local variation assumed in its priors, with the inflation assumed in the others.
    """
    w = blocks[0].windows
    stops = tuple(sorted({cell.position - w.middle for cell in w.cells}))
    # Parameter by whose scatter the inflation is estimated; a run with a curve and no load has neither.
    reference = "form"
    if profile.mass_over_preload > 0:
        reference = "mass_over_preload"
    inflation = INITIAL_INFLATION
    for _ in range(_ROUNDS):
        assumed, assumed_inflation = variation, inflation
        fit = _fit_once(blocks, modes, profile, stops, assumed, inflation, most_steps)
        modes = fit.modes
        if reference in profile.fields:
            inflation = variance_inflation(fit, fit.parameters.index((reference, None)))
        variation = _variation(fit, stops, assumed, profile.curved)
        local_settled = variation.spread == 0 or _change(variation.spread, assumed.spread) < _CONVERGED
        if local_settled and _change(inflation, assumed_inflation) < 2 * _CONVERGED:
            break
    return fit, replace(assumed, prior_inflation=assumed_inflation)


def _fit_once(
    blocks: Sequence[Block],
    modes: tuple[AxialMode, ...],
    profile: Profile,
    stops: tuple[float, ...],
    variation: LocalVariation,
    inflation: float,
    most_steps: int,
) -> JointFit:
    """Fit the profile, with local compliances if the spread of the variation is not zero."""
    if variation.spread == 0:
        smooth = tuple(replace(mode, stops=(), local=()) for mode in modes)
        return fit_blocks(blocks, smooth, profile.fields, profile.priors(inflation), most_steps=most_steps)
    if not modes[0].local:
        modes = with_stops(modes, stops)
    fields = profile.fields + local_fields(stops)
    priors = profile.priors(inflation) + local_priors(variation, stops, profile.curved)
    return fit_blocks(blocks, modes, fields, priors, most_steps=_LOCAL_ITERATIONS)


def _variation(
    fit: JointFit, stops: tuple[float, ...], assumed: LocalVariation, curved: bool
) -> LocalVariation:
    """Local variation estimated from a fit for which ``assumed`` was assumed."""
    if assumed.spread == 0:
        fit = with_local_parameters(fit, with_stops(fit.modes, stops), local_fields(stops))
    return estimate_variation(fit, curved)


def _change(value: float, before: float) -> float:
    """Absolute change of the logarithm of a positive value."""
    return abs(math.log(value / max(before, 1e-9)))
