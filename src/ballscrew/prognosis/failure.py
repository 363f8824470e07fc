"""End of life: preload below a stated part, a load that unloads a flank, or backlash of a stated size."""

from __future__ import annotations

from dataclasses import dataclass
from operator import itemgetter

from ballscrew.axis.hertz import RELEASE
from ballscrew.base.errors import InputError
from ballscrew.base.settings import check_setting

HALF = 0.5
"""Part of the new preload at which life ends by default.

Makers choose the preload as about a third of the largest load, so that no flank is unloaded (2.83 P). At half
of the preload the nut unloads at half of that load, its rigidity is down by a fifth, and backlash is near: by
the law of contact pressure four fifths of the travel to it are then still to come, by that of a constant
load three fifths. It is early enough to order a nut, and late enough not to change a good one.
"""


@dataclass(frozen=True, slots=True)
class Failure:
    """Criteria for the end of life; whichever is met first.

    Parameters
    ----------
    preload_ratio : float or None
        P/P₀ below which the axis has failed; above 0 and below 1. None where it does not count.
    largest_load : float or None
        F_max of the stated duty, N: the axis has failed when F_max > 2.83 P.
    preload : float or None
        P₀ at the start of the epoch, N; needed with ``largest_load``.
    backlash : float or None
        B, m, at which the axis has failed.

    Raises
    ------
    InputError
        If a number is out of range, or there is no criterion.
    """

    preload_ratio: float | None = HALF
    largest_load: float | None = None
    preload: float | None = None
    backlash: float | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("preload_ratio", "largest_load", "preload", "backlash"):
            value = getattr(self, name)
            if value is not None:
                check_setting(f"a failure's {name}", value, above=0.0)
        if self.preload_ratio is not None and self.preload_ratio >= 1:
            raise InputError(f"a failure's preload_ratio is {self.preload_ratio:g}; it must be below 1.")
        if self.largest_load is not None and self.preload is None:
            raise InputError("a failure by the largest load needs the preload in N too.")
        if self.preload_ratio is None and self.largest_load is None and self.backlash is None:
            raise InputError(
                "a failure has no criterion: give a preload ratio, a largest load or a backlash."
            )

    def remaining(self, approach: float) -> float:
        """Remaining part of the flanks' approach at the end of life: 1 − w/δ₀, negative with backlash.

        Parameters
        ----------
        approach : float
            δ₀, m.

        Returns
        -------
        float
            1 at most: of an axis that has failed from the first day on.
        """
        remaining, _, _ = self._first(approach)
        return min(1.0, remaining)

    def mode(self, approach: float) -> tuple[str, str]:
        """Failure mode that is reached first.

        Parameters
        ----------
        approach : float
            δ₀, m.

        Returns
        -------
        mode, text : str
            ``"preload"``, ``"load"`` or ``"backlash"``, and the same in words.
        """
        _, name, text = self._first(approach)
        return name, text

    def _first(self, approach: float) -> tuple[float, str, str]:
        """Remaining part of the approach, name and text of the criterion that is met first."""
        ends = []
        if self.preload_ratio is not None:
            text = f"the preload falls below {100 * self.preload_ratio:g} % of what it was"
            ends.append((self.preload_ratio ** (2 / 3), "preload", text))
        if self.largest_load is not None and self.preload is not None:
            ratio = self.largest_load / RELEASE / self.preload
            text = (
                f"the largest load of the duty, {self.largest_load:g} N, exceeds 2.83 times the preload "
                f"and unloads one flank ({100 * ratio:.0f} % of the preload remaining)"
            )
            ends.append((ratio ** (2 / 3), "load", text))
        if self.backlash is not None:
            text = f"backlash exceeds {1e6 * self.backlash:g} µm"
            ends.append((-self.backlash / 2 / approach, "backlash", text))
        return max(ends, key=itemgetter(0))
