"""The state of an axis in one line, and the recommended actions."""

from __future__ import annotations

import math

from ballscrew.estimation.causes import UNDECIDED
from ballscrew.monitoring.state import LEAST_GOOD, HealthState, RunState
from ballscrew.prognosis.monitor import Monitored

NOTHING_TO_DO = "Nothing to do: run the test again as planned."
"""Advice where the newest run is normal."""

_SURE = 0.8  # probability from which on one cause is named alone
_GONE = 0.5  # probability of stage II from which on the preload counts as gone
_UNDECIDED = (
    "Check the support bearing (its play, preload or friction torque) before you order a nut: the recordings "
    "cannot decide which of the two has lost stiffness. Test runs at two acceleration levels would."
)
_UNLOADED = (
    "Replace or preload the nut now: little preload is left. A gentler motion measures how much, if the "
    "baseline was measured with it too (ballscrew plan --gentle)."
)
_AGAIN = "one run cannot distinguish an outlier from wear. Later than that, the next planned test decides."


def headline(monitored: Monitored) -> str:
    """State of the axis in one line.

    Parameters
    ----------
    monitored : Monitored
        Result for the axis.

    Returns
    -------
    str
        State with the date of its run, date of the alarm, preload, runs set aside since, remaining life.
    """
    state = monitored.state
    axis, why, assessed = state.axis or "axis", state.why_unassessed, state.assessed
    asks_for_nothing = state.state in ("learning", "normal")
    line = f"{axis}: {state.state.upper()}"
    if why and asks_for_nothing:
        line = f"{axis}: NOT JUDGED: {why}"
    if state.verdict != "good":
        line += " (suspect)"
    if state.state == "alarm" and state.alarm_at:
        line += f" since {state.alarm_at[:10]}"
    if assessed is None:
        return line
    day = assessed.reading.measured_at[:10]
    if why and state.state == "normal":
        line += f"; NORMAL on {day}"
    line += _estimate(assessed, day, state.urgency)
    if assessed.preload_below is not None and state.stage is not None:
        line += f"; stage II with a probability of {state.stage.II:.2f}"
    if why and not asks_for_nothing:
        line += f"; NOT JUDGED since then: {why}"
    return line + _life(monitored)


def lamp(monitored: Monitored) -> str:
    """State whose sign and colour stand before the headline: suspect where the axis is not judged."""
    state = monitored.state
    if state.why_unassessed and state.state == "normal":
        return "suspect"
    return state.state


def _estimate(assessed: RunState, day: str, urgency: str) -> str:
    """Stiffness and preload of the run that the state is of."""
    words = ""
    if assessed.stiffness is not None:
        low, high = assessed.stiffness.interval
        words += f": axial stiffness as with {100 * assessed.stiffness.value:.0f} % of the preload on {day} "
        words += f"({100 * low:.0f} to {100 * high:.0f} %)"
    if assessed.preload_below is not None:
        urgent = ", URGENT" if urgency == "now" else ""
        words += f"{urgent}: the nut's preload is below {100 * assessed.preload_below:.0f} % on {day}, since "
        words += "the test's own load unloads it"
    return words


def advice(monitored: Monitored) -> tuple[str, ...]:
    """Recommended actions.

    Parameters
    ----------
    monitored : Monitored
        Result for the axis.

    Returns
    -------
    tuple of str
        Sentences, the first action first.
    """
    state = monitored.state
    actions = []
    if state.reasons:
        actions.append(
            "Check the reasons of the doubt; those of the calibration can be accepted by name (--accept)."
        )
    if state.repeat_asked:
        newest = state.runs[-1].reading.measured_at
        actions += [f"Run the test again within half a day of the newest run, {newest}: {_AGAIN}"]
    elif state.state in _ACTIONS:
        actions += _ACTIONS[state.state](state)
    if state.set_aside and state.state != "learning":
        actions.append("Correct what made the newest run be set aside, then run the test again.")
    if state.stage is not None and state.stage.II > _GONE and state.urgency != "now":
        actions.append("The preload is probably gone: expect backlash, and replace or preload the nut.")
    return tuple(actions)


def _learning(state: HealthState) -> tuple[str, ...]:
    good = sum(run.reading.verdict == "good" for run in state.epoch_runs)
    visits = good
    chart = (None, *state.charts)[-1]
    if chart is not None:
        visits = len(chart.visits.first)
    missing = LEAST_GOOD - visits
    if state.loss_while_learning is not None:
        return ("Check load, temperature and nut now: a baseline that contains a loss hides it.",)
    if missing <= 0:
        return ("The next good run will be assessed.",)
    times, days = f"{missing} times", ""
    if missing == 1:
        times = "once"
    if state.epoch_runs[-1].state == "suspect":
        first = "Correct first what makes the newest run suspect: a repeat would be suspect too."
        return (f"{first} Then run the test {times}: a baseline takes three good runs.",)
    if visits != good:
        days = ", on another day: a second run on a day repeats the first"
    return (f"Run the test {times} more in the same way{days}. A baseline takes three good runs.",)


def _normal(_: HealthState) -> tuple[str, ...]:
    return (NOTHING_TO_DO,)


def _watch(state: HealthState) -> tuple[str, ...]:
    again = (
        "Run the test again soon, in the same way: the change exceeds chance, but not yet the alarm limit."
    )
    return (again, *_other_cause(state))


def _other_cause(state: HealthState) -> tuple[str, ...]:
    """Cause to check first, unless it is or may be the nut."""
    if not state.causes or state.causes[0].cause in ("nut", "both", UNDECIDED):
        return ()
    return (f"The most likely cause is not the nut but {state.causes[0].cause}: check that first.",)


def _alarm(state: HealthState) -> tuple[str, ...]:
    if state.urgency == "now":
        return (_UNLOADED,)
    if state.stiffer:
        return ("Order nothing yet: the newest runs show no wear.",)
    other = _other_cause(state)
    if other:
        return (*other, "If that is not it, order a nut and plan the repair; until then, test more often.")
    actions = ["Order a nut and plan the repair; until then, test more often."]
    causes = {cause.cause: cause.probability for cause in state.causes}
    if UNDECIDED in causes:
        return (_UNDECIDED, "If it is not the bearing, order a nut; until then, test more often.")
    if causes.get("both", 0.0) + causes.get("bearing", 0.0) > 1 - _SURE:
        actions.append("Check the support bearing too: it may have lost preload as well.")
    return tuple(actions)


_ACTIONS = {"learning": _learning, "normal": _normal, "watch": _watch, "alarm": _alarm}


def _life(monitored: Monitored) -> str:
    state = monitored.state
    if monitored.prognosis is None or state.state in ("learning", "normal"):
        return ""
    days = monitored.prognosis.rul_days
    low, middle, high = days.get(0.05), days.get(0.5), days.get(0.95)
    if low is None:
        return ""
    if middle == 0:
        return "; the end of life has been reached"
    if state.assessed is None or state.assessed.stiffness is None:
        return ""
    if middle is None:
        return f"; at least {low:.0f} days of life remain, the latest end is open"
    latest = ""
    if high is not None and math.isfinite(high):
        latest = f", at most {high:.0f}"
    return f"; at least {low:.0f} days of life remain (about {middle:.0f}{latest})"
