"""The state of an axis in one line, and the recommended actions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ballscrew.base.words import fixed, interval_decimals
from ballscrew.estimation.causes import UNDECIDED
from ballscrew.monitoring.state import LEAST_GOOD, HealthState, RunState
from ballscrew.prognosis.monitor import Monitored

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
NOTHING = "Nothing to do: run the test again as planned."
AGAIN_SOON = (
    "Run the test again soon, in the same way: the change exceeds chance, but not yet the alarm limit."
)
"""Advice where there is no other."""
_AGAIN = "one run cannot distinguish an outlier from wear. Later than that, the next planned test decides."


_STATES = {
    "learning": "LEARNING", "normal": "NORMAL", "watch": "WATCH", "alarm": "ALARM", "unloaded": "UNLOADED",
    "suspect": "SUSPECT",
}  # fmt: skip
_UNLOADS = "since the test's own load unloads it"


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
    return f"{monitored.state.axis or 'axis'}: {''.join(headline_parts(monitored))}"


def headline_parts(monitored: Monitored) -> tuple[str, ...]:
    """The headline without the name of the axis, in parts that each have a code and parameters."""
    state = monitored.state
    why, assessed = state.why_unassessed, state.assessed
    asks_for_nothing = state.state in ("learning", "normal")
    parts = [_STATES[state.state]]
    if why and asks_for_nothing:
        parts = [f"NOT JUDGED: {why}"]
    if state.verdict != "good":
        parts.append(" (suspect)")
    if state.state == "alarm" and state.alarm_at:
        parts.append(f" since {state.alarm_at[:10]}")
    if assessed is None:
        return tuple(parts)
    day = assessed.reading.measured_at[:10]
    if why and state.state == "normal":
        parts.append(f"; NORMAL on {day}")
    parts += _estimate(assessed, day, state.urgency)
    if assessed.preload_below is not None and state.stage is not None:
        parts.append(f"; stage II with a probability of {state.stage.II:.2f}")
    if why and not asks_for_nothing:
        parts.append(f"; NOT JUDGED since then: {why}")
    return (*parts, *_life(monitored))


def lamp(monitored: Monitored) -> str:
    """State whose sign and colour stand before the headline: suspect where the axis is not judged."""
    state = monitored.state
    if state.why_unassessed and state.state == "normal":
        return "suspect"
    return state.state


def _estimate(assessed: RunState, day: str, urgency: str) -> Iterator[str]:
    """Stiffness and preload of the run that the state is of."""
    if assessed.stiffness is not None:
        shown = assessed.stiffness.value, *assessed.stiffness.interval
        value, low, high = (fixed(100 * each, interval_decimals(shown)) for each in shown)
        yield f": axial stiffness as with {value} % of the preload on {day} ({low} to {high} %)"
    if assessed.preload_below is not None:
        if urgency == "now":
            yield ", URGENT"
        yield f": the nut's preload is below {100 * assessed.preload_below:.0f} % on {day}, {_UNLOADS}"


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
        actions.append("Correct what makes the newest run not count, then run the test again.")
    if state.stage is not None and state.stage.II > _GONE and state.urgency != "now":
        actions.append("The preload is probably gone: expect backlash, and replace or preload the nut.")
    return _without_nothing(actions)


def _without_nothing(actions: Sequence[str]) -> tuple[str, ...]:
    """Actions, without *nothing to do* where it stands beside others."""
    if len(actions) > 1:
        actions = [action for action in actions if action != NOTHING]
    return tuple(actions)


def _learning(state: HealthState) -> tuple[str, ...]:
    good = sum(run.reading.verdict == "good" for run in state.epoch_runs)
    missing = LEAST_GOOD - state.visits
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
    if state.visits != good:
        days = ", on another day: a second run on a day repeats the first"
    return (f"Run the test {times} more in the same way{days}. A baseline takes three good runs.",)


def _normal(_: HealthState) -> tuple[str, ...]:
    return (NOTHING,)


def _watch(state: HealthState) -> tuple[str, ...]:
    return (AGAIN_SOON, *_other_cause(state))


def _other_cause(state: HealthState) -> tuple[str, ...]:
    """Cause to check first, unless it is or may be the nut."""
    if not state.causes or state.causes[0].cause in ("nut", "both", UNDECIDED):
        return ()
    return (f"Check the {state.causes[0].cause} first: it is the most likely cause, not the nut.",)


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


def _life(monitored: Monitored) -> Iterator[str]:
    state = monitored.state
    if monitored.prognosis is None or state.state in ("learning", "normal"):
        return
    days = monitored.prognosis.rul_days
    low, middle, high = days.get(0.05), days.get(0.5), days.get(0.95)
    if low is None:
        return
    if middle == 0:
        yield "; the end of life has been reached"
    elif state.assessed is not None and state.assessed.stiffness is not None:
        yield _remaining(low, middle, high)


def _remaining(low: float, middle: float | None, high: float | None) -> str:
    """Quantiles of the remaining life, in days; None where they are open."""
    if middle is None:
        return f"; at least {low:.0f} days of life remain, the latest end is open"
    if round(low) == 0:
        return f"; the end of life may have been reached (about {middle:.0f} days remain)"
    if high is None or not math.isfinite(high):
        return f"; at least {low:.0f} days of life remain (about {middle:.0f})"
    return f"; at least {low:.0f} days of life remain (about {middle:.0f}, at most {high:.0f})"
