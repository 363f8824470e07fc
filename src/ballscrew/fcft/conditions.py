"""The four conditions in which the table reaches or leaves a stop, Table 1 of the paper."""

from __future__ import annotations

from enum import StrEnum

from ballscrew.base.errors import InputError


class Condition(StrEnum):
    """Approach direction and manner at a stop; in the order that the paper's Table 1 numbers them 1 to 4."""

    PD = "PD"
    PA = "PA"
    NA = "NA"
    ND = "ND"

    @property
    def number(self) -> int:
        """The condition's number in the paper's Table 1."""
        return list(Condition).index(self) + 1

    @property
    def direction(self) -> int:
        """+1 where the table moves in the positive direction, −1 where in the negative."""
        return 1 if self in (Condition.PD, Condition.PA) else -1

    @property
    def accelerating(self) -> bool:
        """True if the table leaves the stop; otherwise it arrives there."""
        return self in (Condition.PA, Condition.NA)

    @property
    def words(self) -> str:
        """Direction and manner, ``"positive/acceleration"``."""
        direction = "positive" if self.direction > 0 else "negative"
        return f"{direction}/{'acceleration' if self.accelerating else 'deceleration'}"


def conditions_at(index: int, count: int) -> tuple[Condition, ...]:
    """Conditions that exist at a stop, Table 1 of the paper.

    A stop between two others is reached and left in both directions. The table can only leave the first one
    upwards (PA) and reach it downwards (ND), and only reach the last one upwards (PD) and leave it downwards
    (NA). With the numbers in the order of the paper's text, that is what its table prints.

    Parameters
    ----------
    index : int
        Which stop, from 0, in the positive direction.
    count : int
        How many stops the plan has, 2 or more.

    Returns
    -------
    tuple of Condition
        In the order of the paper's numbers.

    Raises
    ------
    InputError
        If there is no such stop.
    """
    if count < 2 or not 0 <= index < count:
        raise InputError(f"there is no stop {index} of {count}; a plan has 2 stops or more, counted from 0")
    if index == 0:
        return (Condition.PA, Condition.ND)
    if index == count - 1:
        return (Condition.PD, Condition.NA)
    return tuple(Condition)
