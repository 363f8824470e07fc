"""What an assessment says beside its numbers: recommended actions, causes, and the forecast ahead."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from ballscrew.base.jsonfile import plain
from ballscrew.prognosis.monitor import Monitored
from ballscrew.report.monitor_words import NOTHING_TO_DO, advice, headline, lamp
from ballscrew.store.alarms import to_close
from ballscrew.store.tables import Axis, Explanation, unpack

_BY_RUN = ("runs", "epochs", "made", "schema")  # stored as rows
_MOST_DAYS = 120  # of the forecast that are stored


def explanation(monitored: Monitored) -> dict[str, Any]:
    """Explanation of an assessment.

    Parameters
    ----------
    monitored : Monitored
        Health state and remaining life.

    Returns
    -------
    dict
        ``headline``, ``lamp`` and ``actions``; ``state`` as :meth:`~ballscrew.HealthState.to_json` without
        its runs; ``prognosis`` as of :class:`~ballscrew.Prognosis`, or None; ``ahead``, the forecast of
        P/P₀ from ``begins`` on: days, probabilities, and a row of quantiles for each day.
    """
    state = {name: value for name, value in monitored.state.to_json().items() if name not in _BY_RUN}
    prognosis = ahead = None
    if monitored.prognosis is not None:
        prognosis = plain(monitored.prognosis.to_json())
        prognosis.pop("fan", None)
        fan = monitored.prognosis.fan
        step = max(1, -(-len(fan.days) // _MOST_DAYS))
        ahead = {
            "begins": None if monitored.forecast_at is None else monitored.forecast_at.isoformat(),
            "days": fan.days[::step],
            "probabilities": fan.probabilities,
            "ratio": fan.ratio[::step],
        }
    return {
        "headline": headline(monitored),
        "lamp": lamp(monitored),
        "actions": list(advice(monitored)),
        "state": state,
        "prognosis": prognosis,
        "ahead": plain(ahead),
    }


def find_explanation(session: Session, axis: Axis) -> dict[str, Any] | None:
    """Explanation of the newest assessment of an axis; None where its history has changed since.

    ``to_close``, which ``actions`` contain, is what to do with alarms that stand though the assessment asks
    for nothing.
    """
    row = session.scalar(select(Explanation).where(Explanation.axis_id == axis.id))
    if row is None or row.assessment_id != axis.assessment_id or axis.changed_at is not None:
        return None
    found: dict[str, Any] = unpack(row.document)
    found["to_close"] = to_close(session, axis, found["lamp"])
    if found["to_close"]:
        others = (each for each in found["actions"] if each != NOTHING_TO_DO)
        found["actions"] = [*found["to_close"], *others]
    return found
