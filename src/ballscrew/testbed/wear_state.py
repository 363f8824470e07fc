"""A worn axis on one day: how far each flank is still pressed at every place, hence preload and backlash."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from ballscrew.axis.given import finite
from ballscrew.axis.hertz import hertz_constant
from ballscrew.base.arrays import Array
from ballscrew.testbed.machine import Machine


@dataclass(frozen=True, slots=True, eq=False)
class WearState:
    """What wear has left on one day.

    Parameters
    ----------
    day : float
        Since new.
    travel_m : float
        Since new, m.
    x : ndarray, shape (n,)
        Axis positions, ascending, m.
    wear : ndarray, shape (n,)
        w, the approach that each flank has lost there, m.
    pressed : ndarray, shape (n,)
        δ₀ − w and what warmth adds, m; negative where it is half a backlash.
    kappa : float
        κ of the nut, N^(2/3)/m.
    """

    day: float
    travel_m: float
    x: Array
    wear: Array
    pressed: Array
    kappa: float

    def preload(self, position: ArrayLike) -> Array:
        """P = K_h (δ₀ − w)₊^1.5 at axis positions, N; beyond the grid as at its end."""
        return np.asarray(hertz_constant(self.kappa) * np.maximum(self._at(position), 0.0) ** 1.5)

    def backlash(self, position: ArrayLike) -> Array:
        """B = 2 (w − δ₀)₊ at axis positions, m."""
        return np.asarray(2 * np.maximum(-self._at(position), 0.0))

    @property
    def least_preload(self) -> float:
        """At the most worn place, N."""
        return float(self.preload(self.x).min())

    @property
    def most_backlash(self) -> float:
        """At the most worn place, m."""
        return float(self.backlash(self.x).max())

    @property
    def stage(self) -> Literal["I", "II"]:
        """I while there is no backlash anywhere, II from then on."""
        return "II" if self.most_backlash > 0 else "I"

    def _at(self, position: ArrayLike) -> Array:
        return np.asarray(np.interp(finite("position", position, "m"), self.x, self.pressed))


def worn_machine(machine: Machine, state: WearState) -> Machine:
    """The same machine with the preload and backlash that wear has left along its axis.

    Parameters
    ----------
    machine : Machine
        When new; the same preload everywhere.
    state : WearState
        Of the day.

    Returns
    -------
    Machine
        With its former preload, and the approach that each place has lost.
    """
    lost = machine.pressed(state.x) - state.pressed
    return replace(machine, lost=tuple(zip(state.x.tolist(), lost.tolist(), strict=True)))
