"""What ``monitor`` says: one line that is right, and what to do on Monday."""

from __future__ import annotations

import math

from ballscrew.monitoring.state import HealthState, RunState
from ballscrew.prognosis.monitor import Monitored

__all__ = ["advice", "headline"]

_LEARNT = 3
_SURE = 0.8  # probability from which on one cause is named alone
_GONE = 0.5
_AGAIN = "one run cannot tell an odd run from wear. Later than that the next planned test tells it."


def headline(told: Monitored) -> str:
    """The axis in one line.

    Parameters
    ----------
    told : Monitored
        Of the axis.

    Returns
    -------
    str
        State, since when, how much is left, how long it will last.
    """
    state = told.state
    name = state.axis or "axis"
    last = _newest(state)
    left = ""
    if last is not None and last.relative is not None:
        low, high = last.relative.interval
        left = (
            f": {100 * last.relative.value:.0f} % of the preload left ({100 * low:.0f} to {100 * high:.0f} %)"
        )
    since = f" since {state.alarm_at[:10]}" if state.state == "alarm" and state.alarm_at else ""
    return f"{name}: {state.state.upper()}{since}{left}{_life(told)}"


def advice(told: Monitored) -> tuple[str, ...]:
    """What to do.

    Parameters
    ----------
    told : Monitored
        Of the axis.

    Returns
    -------
    tuple of str
        Sentences.
    """
    state = told.state
    if state.repeat_asked:
        newest = state.runs[-1].reading.measured_at
        said = [f"Run the test again within half a day of the newest run, {newest}: {_AGAIN}"]
    else:
        said = list(_STATES[state.state](state)) if state.state in _STATES else []
    unread = _unread(state)
    if unread:
        said.append(unread)
    if state.stage is not None and state.stage.II > _GONE:
        said.append("The preload is probably gone: expect backlash, and replace or preload the nut anew.")
    return tuple(said)


def _learning(state: HealthState) -> tuple[str, ...]:
    good = sum(1 for one in state.runs if _of_newest(state, one) and one.reading.verdict == "good")
    drawn = state.charts[-1] if state.charts else None
    visits = good if drawn is None else len(drawn.visits.first)
    missing = max(_LEARNT - visits, 0)
    if missing:
        times = "once" if missing == 1 else f"{missing} times"
        days = "" if visits == good else ", on another day: a second run on a day repeats the first"
        return (f"Run the test {times} more in the same way{days}. Three good runs make a baseline.",)
    return ("The next good run will be judged.",)


def _normal(_: HealthState) -> tuple[str, ...]:
    return ("Nothing to do: run the test again as planned.",)


def _watch(state: HealthState) -> tuple[str, ...]:
    again = "Run the test again soon, in the same way: it is more than chance makes, and no alarm yet."
    return (again, *_other_cause(state))


def _other_cause(state: HealthState) -> tuple[str, ...]:
    """Where to look first, if not at the nut."""
    first = state.causes[0].cause if state.causes else "nut"
    if first == "nut":
        return ()
    return (f"The likeliest cause is not the nut but {first}: look there first.",)


def _alarm(state: HealthState) -> tuple[str, ...]:
    if state.stiffer:
        return ("Order nothing yet: the newest runs do not look worn.",)
    other = _other_cause(state)
    if other:
        return (*other, "If it is none of that, order a nut and plan the repair; test more often until then.")
    said = ["Order a nut and plan the repair; test more often until then."]
    bearing = next((one for one in state.causes if one.cause == "bearing"), None)
    if bearing is not None and bearing.probability > 1 - _SURE:
        said.append("Check the thrust bearing first: frequencies alone cannot tell it from the nut.")
    return tuple(said)


_STATES = {"learning": _learning, "normal": _normal, "watch": _watch, "alarm": _alarm}


def _unread(state: HealthState) -> str:
    """The newest runs, where none of them could be told: never shown as well."""
    last = [one for one in state.runs if _of_newest(state, one)]
    count = 0
    for one in reversed(last):
        if one.relative is not None:
            break
        count += 1
    if not count:
        return ""
    why = last[-1].reading.reasons[0] if last[-1].reading.reasons else "it tells no preload"
    many = "The newest run is" if count == 1 else f"The newest {count} runs are"
    return f"{many} not judged, the state is that of the run before: {why}."


def _newest(state: HealthState) -> RunState | None:
    told = [one for one in state.runs if _of_newest(state, one) and one.relative is not None]
    return told[-1] if told else None


def _of_newest(state: HealthState, one: RunState) -> bool:
    return one.reading.epoch == state.epochs[-1].number


def _life(told: Monitored) -> str:
    if told.prognosis is None or told.state.state in ("learning", "normal"):
        return ""
    low, middle, high = (told.prognosis.rul_days.get(p) for p in (0.05, 0.5, 0.95))
    if middle is None or low is None:
        return ""
    if middle == 0:
        return "; its end has been reached"
    upper = "open" if high is None or not math.isfinite(high) else f"{high:.0f}"
    return f"; about {middle:.0f} days to go ({low:.0f} to {upper})"
