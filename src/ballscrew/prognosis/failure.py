"""When an axis has failed: preload below a stated part, a load that lifts a flank, or backlash of a size."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ballscrew.axis.hertz import RELEASE
from ballscrew.base.errors import InputError, shown

__all__ = ["HALF", "Failure"]

HALF = 0.5
"""The part of the new preload that is taken for the end where nothing else is said.

Makers choose the preload as about a third of the largest load, so that no flank lets go (2.83 P). At half of
the preload the nut lets go at half of that load, its rigidity is down by a fifth, and backlash is near: by
the law of contact pressure four fifths of the travel to it are then still to come, by that of a constant
load three fifths. It is early enough to order a nut, and late enough not to change a good one.
"""


@dataclass(frozen=True, slots=True)
class Failure:
    """What counts as the end; whichever comes first.

    Parameters
    ----------
    preload_ratio : float or None
        P/P₀ below which the axis has failed; above 0 and below 1. None where it does not count.
    largest_load : float or None
        F_max of the stated duty, N: the axis has failed when F_max > 2.83 P.
    preload : float or None
        P₀ at the epoch's begin, N; needed with ``largest_load``.
    backlash : float or None
        B, m, at which the axis has failed.

    Raises
    ------
    InputError
        If a number cannot be, or nothing is a failure.
    """

    preload_ratio: float | None = HALF
    largest_load: float | None = None
    preload: float | None = None
    backlash: float | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        for name in ("preload_ratio", "largest_load", "preload", "backlash"):
            value = getattr(self, name)
            if value is None:
                continue
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not math.isfinite(value) or not value > 0:
                raise InputError(f"a failure's {name} is {shown(value)}; it must be more than 0, and finite.")
        if self.preload_ratio is not None and self.preload_ratio >= 1:
            raise InputError(f"a failure's preload_ratio is {self.preload_ratio:g}; it must be below 1.")
        if self.largest_load is not None and self.preload is None:
            raise InputError("a failure by the largest load needs the preload in N too.")
        if self.preload_ratio is None and self.largest_load is None and self.backlash is None:
            raise InputError("nothing is a failure: give a preload ratio, a largest load or a backlash.")

    def left(self, pressed: float) -> float:
        """What is left of the flanks' approach at the end: 1 − w/δ₀, negative where there is backlash.

        Parameters
        ----------
        pressed : float
            δ₀, m.

        Returns
        -------
        float
            1 at most: of an axis that has failed from the first day on.
        """
        return min(1.0, max(left for _, left, _ in self._ends(pressed)))

    def mode(self, pressed: float) -> tuple[str, str]:
        """Which end comes first.

        Parameters
        ----------
        pressed : float
            δ₀, m.

        Returns
        -------
        mode, text : str
            ``"preload"``, ``"load"`` or ``"backlash"``, and the same in words.
        """
        name, _, text = max(self._ends(pressed), key=lambda end: end[1])
        return name, text

    def _ends(self, pressed: float) -> list[tuple[str, float, str]]:
        ends = []
        if self.preload_ratio is not None:
            text = f"the preload falls below {100 * self.preload_ratio:g} % of what it was"
            ends.append(("preload", self.preload_ratio ** (2 / 3), text))
        if self.largest_load is not None and self.preload is not None:
            ratio = self.largest_load / RELEASE / self.preload
            text = (
                f"the largest load of the duty, {self.largest_load:g} N, exceeds 2.83 times the preload "
                f"and lifts one flank ({100 * ratio:.0f} % of the preload left)"
            )
            ends.append(("load", ratio ** (2 / 3), text))
        if self.backlash is not None:
            text = f"backlash exceeds {1e6 * self.backlash:g} µm"
            ends.append(("backlash", -self.backlash / 2 / pressed, text))
        return ends
