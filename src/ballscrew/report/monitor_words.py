"""The state of an axis in one line, and the recommended actions."""

from __future__ import annotations

import math

from ballscrew.estimation.causes import UNDECIDED
from ballscrew.monitoring.state import HealthState, RunState
from ballscrew.prognosis.monitor import Monitored

_LEARNT = 3  # good runs that make a baseline
_SURE = 0.8  # probability from which on one cause is named alone
_GONE = 0.5  # probability of stage II from which on the preload counts as gone
_UNDECIDED = (
    "Check the support bearing (its play, preload or friction torque) before you order a nut: the recordings "
    "cannot decide which of the two has lost stiffness. Test runs at two acceleration levels would."
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
        State, date of the alarm, preload with the date of its run, remaining life.
    """
    state = monitored.state
    line = f"{state.axis or 'axis'}: {state.state.upper()}"
    if state.verdict != "good":
        line += " (suspect)"
    if state.state == "alarm" and state.alarm_at:
        line += f" since {state.alarm_at[:10]}"
    last = _newest_estimate(state)
    if last is not None and last.stiffness is not None:
        low, high = last.stiffness.interval
        day = str(last.reading.measured_at)[:10]
        line += f": axial stiffness as with {100 * last.stiffness.value:.0f} % of the preload on {day} "
        line += f"({100 * low:.0f} to {100 * high:.0f} %)"
    return line + _life(monitored)


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
    actions += _not_assessed(state)
    if state.stage is not None and state.stage.II > _GONE:
        actions.append("The preload is probably gone: expect backlash, and replace or preload the nut.")
    return tuple(actions)


def _learning(state: HealthState) -> tuple[str, ...]:
    good = sum(run.reading.verdict == "good" for run in _epoch_runs(state))
    visits = good
    chart = (None, *state.charts)[-1]
    if chart is not None:
        visits = len(chart.visits.first)
    missing = _LEARNT - visits
    if missing <= 0:
        return ("The next good run will be assessed.",)
    times, days = f"{missing} times", ""
    if missing == 1:
        times = "once"
    if _epoch_runs(state)[-1].state == "suspect":
        first = "Correct first what makes the newest run suspect: a repeat would be suspect too."
        return (f"{first} Then run the test {times}: a baseline takes three good runs.",)
    if visits != good:
        days = ", on another day: a second run on a day repeats the first"
    return (f"Run the test {times} more in the same way{days}. A baseline takes three good runs.",)


def _normal(_: HealthState) -> tuple[str, ...]:
    return ("Nothing to do: run the test again as planned.",)


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


def _not_assessed(state: HealthState) -> list[str]:
    """Note on the newest runs without an estimate, which the state does not include."""
    runs = _epoch_runs(state)
    count = 0
    while count < len(runs) and runs[-1 - count].stiffness is None:
        count += 1
    if not count:
        return []
    why = (*runs[-1].reading.reasons, "it gives no preload")[0]
    if not why.endswith("?"):
        why += "."
    if count == 1:
        return [f"The newest run was not assessed, and the state is that of the run before it: {why}"]
    return [f"The newest {count} runs were not assessed, and the state is that of the run before them: {why}"]


def _newest_estimate(state: HealthState) -> RunState | None:
    for run in reversed(_epoch_runs(state)):
        if run.stiffness is not None:
            return run
    return None


def _epoch_runs(state: HealthState) -> list[RunState]:
    """Runs of the newest epoch."""
    newest = state.epochs[-1].number
    return [run for run in state.runs if run.reading.epoch == newest]


def _life(monitored: Monitored) -> str:
    if monitored.prognosis is None or monitored.state.state in ("learning", "normal"):
        return ""
    days = monitored.prognosis.rul_days
    low, middle, high = days.get(0.05), days.get(0.5), days.get(0.95)
    if middle is None or low is None:
        return ""
    if middle == 0:
        return "; the end of life has been reached"
    if high is None or not math.isfinite(high):
        return f"; about {middle:.0f} days of life remain (at least {low:.0f})"
    return f"; about {middle:.0f} days of life remain ({low:.0f} to {high:.0f})"
