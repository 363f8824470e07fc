"""The paper's title as a number: the day of the alarm, what was lost by then, and the lead over backlash."""

from __future__ import annotations

from dataclasses import dataclass

from ballscrew.prognosis.monitor import Monitored, monitor
from ballscrew.reproduction.preload import calibrated
from ballscrew.reproduction.results import Claim, Experiments, first_backlash, mean_preload

__all__ = ["Alarm", "alarm", "detected", "watched"]


@dataclass(frozen=True, slots=True)
class Alarm:
    """The first alarm of the life.

    Parameters
    ----------
    day : float
        Of the run.
    run : int
        Its place in the life, from 0.
    lost : float
        True part of the preload that is gone, mean of the stops.
    lead : float or None
        Days to the first run with backlash; None where there is none.
    """

    day: float
    run: int
    lost: float
    lead: float | None


def watched(found: Experiments, runs: int | None = None) -> Monitored:
    """The life as ``monitor`` sees it, with the model of the multi-level-mass experiment.

    Parameters
    ----------
    found : Experiments
        Both.
    runs : int, optional
        How many of the life's runs; by default all.

    Returns
    -------
    Monitored
        At the default rate of false alarms.
    """
    return monitor([one.run for one in found.life[:runs]], calibrated(found))


def alarm(found: Experiments) -> Alarm | None:
    """When the alarm came, beside the truth.

    Parameters
    ----------
    found : Experiments
        Both.

    Returns
    -------
    Alarm or None
        None where there was none.
    """
    states = {one.reading.run: one.state for one in watched(found).state.runs}
    for index, one in enumerate(found.life):
        if states.get(one.run.id) == "alarm":
            end = first_backlash(found.life)
            lost = 1 - mean_preload(one) / mean_preload(found.life[0])
            return Alarm(one.planned.day, index, lost, None if end is None else end - one.planned.day)
    return None


def detected(found: Experiments) -> Claim:
    """Early detection."""
    words = "Preload loss can be detected early (title, section 6)."
    first = alarm(found)
    if first is None:
        return Claim(words, "ballscrew monitor gave no alarm.", "no", "None.")
    told = watched(found, first.run + 1)
    life = None if told.prognosis is None else told.prognosis.rul_days
    middle = None if life is None else life[0.5]
    rest = ""
    if middle == 0:
        rest = " Half of it is then told to be gone already."
    elif life is not None and middle is not None:
        high = life[0.95]
        rest = (
            f" Half of the preload was then foretold for {middle:.0f} days later ({life[0.05] or 0:.0f} to "
            f"{'open' if high is None else f'{high:.0f}'}, 90 %)."
        )
    lead = "no run has backlash"
    if first.lead is not None:
        lead = f"{first.lead:g} days before the first with backlash"
    return Claim(
        words,
        f"The alarm of ballscrew monitor, at one false one in ten years, comes with run {first.run + 1}, on "
        f"day {first.day:g}, {lead}; {100 * first.lost:.0f} % of the preload was then lost, mean of the "
        f"stops.{rest}",
        "yes" if first.lead is None or first.lead > 0 else "no",
        "The axis wears from the first day on, so its baseline of three runs wears too: the evidence is a "
        "ramp that begins with the first run.",
    )
