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
from ballscrew.modal.joint.mode import AxialMode
from ballscrew.modal.joint.uncertainty import variance_inflation

_LOAD_DEVIATION = 0.35  # of the logarithm of the load over the preload, about the data sheet's
_LOAD_DEVIATION_WORN = 1.0  # the same with local wear: such a screw is not new
_ROUNDS = 3
_LOCAL_ITERATIONS = 4
_CONVERGED = 0.25  # change of the logarithm of the spread; twice that of the inflation
INITIAL_INFLATION = 1000.0
"""Variance of the cells' estimates of the load over that of white noise, before a run is fitted."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Free parameters of the mode along the axis.

    Parameters
    ----------
    curved : bool
        Whether the compliance may have a curvature.
    load : float
        Load on the nut over its preload by the data sheet, per m/s² of the table; 0 without a sheet.
    """

    curved: bool
    load: float

    @property
    def fields(self) -> tuple[str, ...]:
        """Fields of AxialMode that a complete fit frees."""
        fields = ["compliance", "damping", "slope"]
        if self.curved:
            fields.append("curve")
        if self.load > 0:
            fields.append("load")
        return (*fields, "power")

    def priors(self, inflation: float, *, worn: bool = False) -> list[Prior]:
        """Priors of nut load and damping power.

        Springs have a power of 1, hysteresis 0, the guide -1. The nut load is that of the data sheet; its
        weight is less the more the cells scatter.
        """
        power = Prior((("power", 1.0),), 0.5, 0.7)
        if not self.load > 0:
            return [power]
        return [Prior((("load", 1.0),), math.log(self.load), self.load_deviation(inflation, worn)), power]

    def load_deviation(self, inflation: float, worn: bool) -> float:
        """Standard deviation of the prior of the load's logarithm."""
        wide = math.sqrt(SAMPLES_PER_INDEPENDENT / inflation)
        if worn:
            wide = wide * (_LOAD_DEVIATION_WORN / _LOAD_DEVIATION)
        return _LOAD_DEVIATION * wide


def fit_profile(
    blocks: Sequence[Block],
    modes: tuple[AxialMode, ...],
    profile: Profile,
    variation: LocalVariation,
    most: int,
) -> tuple[JointFit, LocalVariation]:
    """Fit the smooth profile, and local compliances at the stops if the run shows local wear.

    Parameters
    ----------
    blocks : sequence of Block
        Data.
    modes : tuple of AxialMode
        Initial values.
    profile : Profile
        What is free.
    variation : LocalVariation
        As estimated so far.
    most : int
        Upper limit of the iterations.

    Returns
    -------
    JointFit
        The last.
    LocalVariation
        That of its priors.
    """
    w = blocks[0].windows
    places = tuple(sorted({cell.position - w.middle for cell in w.cells}))
    has_load = profile.load > 0
    inflation = INITIAL_INFLATION
    for _ in range(_ROUNDS):
        assumed, assumed_inflation = variation, inflation
        now = _fit_once(blocks, modes, profile, places, assumed, inflation, most)
        modes = now.modes
        if has_load:
            inflation = variance_inflation(now, now.parameters.index(("load", None)))
        variation = _variation(now, places, assumed, profile.curved)
        local_settled = variation.spread == 0 or _change(variation.spread, assumed.spread) < _CONVERGED
        if local_settled and _change(inflation, assumed_inflation) < 2 * _CONVERGED:
            break
    weight = 0.0
    if has_load:
        deviation = profile.load_deviation(assumed_inflation, assumed.spread > 0)
        weight = SAMPLES_PER_INDEPENDENT / deviation**2
    return now, replace(assumed, load_prior_weight=weight)


def _fit_once(
    blocks: Sequence[Block],
    modes: tuple[AxialMode, ...],
    profile: Profile,
    places: tuple[float, ...],
    variation: LocalVariation,
    inflation: float,
    most: int,
) -> JointFit:
    """One fit, with local compliances if the variation is not zero."""
    if variation.spread == 0:
        smooth = tuple(replace(mode, places=(), local=()) for mode in modes)
        return fit_blocks(blocks, smooth, profile.fields, profile.priors(inflation), most=most)
    if not modes[0].local:
        modes = with_places(modes, places)
    fields = profile.fields + local_fields(places)
    priors = profile.priors(inflation, worn=True) + local_priors(variation, places, profile.curved)
    return fit_blocks(blocks, modes, fields, priors, most=_LOCAL_ITERATIONS)


def _variation(
    now: JointFit, places: tuple[float, ...], assumed: LocalVariation, curved: bool
) -> LocalVariation:
    """The variation as the fit shows it."""
    if assumed.spread == 0:
        now = with_local_parameters(now, with_places(now.modes, places), local_fields(places))
    return estimate_variation(now, curved)


def _change(value: float, before: float) -> float:
    return abs(math.log(value / max(before, 1e-9)))
