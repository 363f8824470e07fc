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
    with_places,
)
from ballscrew.modal.joint.mode import FORM_PRIOR, AxialMode
from ballscrew.modal.joint.parameters import FRAME_FIELDS
from ballscrew.modal.joint.uncertainty import variance_inflation

# Priors where the frame has a mode: median of a damping ratio and standard deviation of its logarithm; and
# standard deviation of ln(frequency) of the pitching mode, whose median is the initial one.
_FRAME_PRIORS = {"frame_damping": (0.05, 0.9), "pitch_damping": (0.03, 0.7)}
_PITCH_DEVIATION = 0.05
_ROUNDS = 3  # largest number of fits, each with the inflation and local variation estimated from the previous
_LOCAL_ITERATIONS = 4  # largest number of iterations of a fit with local compliances
_CONVERGED = 0.25  # change of ln(standard deviation) below which the rounds end; of ln(variance), twice that
INITIAL_INFLATION = 1000.0
"""Result of :func:`~ballscrew.modal.joint.uncertainty.variance_inflation` assumed in the first fit.

Large, so that the data sheet's mass over preload dominates until the scatter of the cells is known."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Which parameters of the mode along the axis are fitted.

    Parameters
    ----------
    curved : bool
        Whether the compliance is a parabola along the axis, and not a line.
    mass_over_preload, load_deviation, least_mass_over_preload : float
        Results of :func:`~ballscrew.modal.joint.initial.expected_mass_over_preload`: value (kg/N), standard
        deviation of its logarithm, and lower limit (kg/N); 0 without a data sheet.
    pitch : float
        Of an axis with a mode of the frame: initial frequency of the pitching mode, Hz, which is then fitted
        too. 0 without such a mode.
    """

    curved: bool
    mass_over_preload: float = 0.0
    load_deviation: float = 0.0
    least_mass_over_preload: float = 0.0
    pitch: float = 0.0

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
        if self.pitch > 0:
            fields += FRAME_FIELDS
        return (*fields, "power")

    def priors(self, inflation: float) -> list[Prior]:
        """Priors of mass over preload, of the damping ratio's exponent, of the form, and of a frame's mode.

        The exponent is 0.5 ± 0.7, between hysteresis (0) and damping in the springs (1); it can be that of
        damping in the guide (-1). ``inflation`` is a result of
        :func:`~ballscrew.modal.joint.uncertainty.variance_inflation`.
        """
        out = [Prior((("power", 1.0),), 0.5, 0.7)]
        if not self.curved:
            out.append(Prior((("form", 1.0),), FORM_PRIOR[0], self.scaled(FORM_PRIOR[1], inflation)))
        if self.mass_over_preload > 0:
            deviation = self.scaled(self.load_deviation, inflation)
            load = Prior((("mass_over_preload", 1.0),), math.log(self.mass_over_preload), deviation)
            out.insert(0, load)
        if self.pitch > 0:
            for field, (value, deviation) in _FRAME_PRIORS.items():
                out.append(Prior(((field, 1.0),), math.log(value), deviation))
            out.append(Prior((("pitch", 1.0),), math.log(self.pitch), _PITCH_DEVIATION))
        return out

    @staticmethod
    def scaled(deviation: float, inflation: float) -> float:
        """Standard deviation of a prior, in proportion to the weight of the data.

        A fit takes its residuals for white noise, and so gives the data too much weight by the factor
        ``inflation``. The information of the prior is multiplied by the same factor: by
        SAMPLES_PER_INDEPENDENT in the fit, and by the rest here.
        """
        return deviation * math.sqrt(SAMPLES_PER_INDEPENDENT / inflation)

    def load_information(self, inflation: float) -> float:
        """Information of the prior of ln(mass over preload) in the fit: the inverse of its variance there."""
        if not self.mass_over_preload > 0:
            return 0.0
        return inflation / self.load_deviation**2


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
        Data.
    modes : tuple of AxialMode
        Initial modes, by the index ROTOR_FREE or ROTOR_HELD.
    profile : Profile
        Which parameters are fitted.
    variation : LocalVariation
        Local variation estimated so far.
    most_steps : int
        Upper limit of the iterations.

    Returns
    -------
    JointFit
        The last fit.
    LocalVariation
        The local variation assumed in its priors, with the inflation assumed in the others.
    """
    w = blocks[0].windows
    places = tuple(sorted({cell.position - w.middle for cell in w.cells}))
    # The parameter whose scatter shows the weight of the data: a run without a data sheet has a form.
    shown_by = "form"
    if profile.mass_over_preload > 0:
        shown_by = "mass_over_preload"
    inflation = INITIAL_INFLATION
    for _ in range(_ROUNDS):
        assumed, assumed_inflation = variation, inflation
        now = _fit_once(blocks, modes, profile, places, assumed, inflation, most_steps)
        modes = now.modes
        if shown_by in profile.fields:
            inflation = variance_inflation(now, now.parameters.index((shown_by, None)))
        variation = _variation(now, places, assumed, profile.curved)
        local_settled = variation.spread == 0 or _change(variation.spread, assumed.spread) < _CONVERGED
        if local_settled and _change(inflation, assumed_inflation) < 2 * _CONVERGED:
            break
    return now, replace(assumed, prior_inflation=assumed_inflation)


def _fit_once(
    blocks: Sequence[Block],
    modes: tuple[AxialMode, ...],
    profile: Profile,
    places: tuple[float, ...],
    variation: LocalVariation,
    inflation: float,
    most_steps: int,
) -> JointFit:
    """One fit, with local compliances if the spread of the variation is not zero."""
    if variation.spread == 0:
        smooth = tuple(replace(mode, places=(), local=()) for mode in modes)
        return fit_blocks(blocks, smooth, profile.fields, profile.priors(inflation), most_steps=most_steps)
    if not modes[0].local:
        modes = with_places(modes, places)
    fields = profile.fields + local_fields(places)
    priors = profile.priors(inflation) + local_priors(variation, places, profile.curved)
    return fit_blocks(blocks, modes, fields, priors, most_steps=_LOCAL_ITERATIONS)


def _variation(
    now: JointFit, places: tuple[float, ...], assumed: LocalVariation, curved: bool
) -> LocalVariation:
    """The local variation estimated from a fit for which ``assumed`` was assumed."""
    if assumed.spread == 0:
        now = with_local_parameters(now, with_places(now.modes, places), local_fields(places))
    return estimate_variation(now, curved)


def _change(value: float, before: float) -> float:
    """Absolute change of the logarithm of a positive value."""
    return abs(math.log(value / max(before, 1e-9)))
