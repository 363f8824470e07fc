"""What an assessment says beside its numbers: recommended actions, causes, and the forecast ahead."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from ballscrew.base.jsonfile import plain
from ballscrew.base.reasons import coded
from ballscrew.prognosis.monitor import Monitored
from ballscrew.report.monitor_words import advice, headline, headline_parts, lamp
from ballscrew.store.rows import unpack
from ballscrew.store.tables import Axis, Explanation

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
        ``headline``, and its ``headline_parts`` with their codes and parameters; ``lamp`` and ``actions``;
        ``state`` as :meth:`~ballscrew.HealthState.to_json` without
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
        "headline_parts": [coded(part) for part in headline_parts(monitored)],
        "lamp": lamp(monitored),
        "actions": list(advice(monitored)),
        "state": state,
        "prognosis": prognosis,
        "ahead": plain(ahead),
    }


def find_explanation(session: Session, axis: Axis) -> dict[str, Any] | None:
    """Explanation of the newest assessment of an axis; None where its history has changed since."""
    row = session.scalar(select(Explanation).where(Explanation.axis_id == axis.id))
    if row is None or row.assessment_id != axis.assessment_id or axis.changed_at is not None:
        return None
    found: dict[str, Any] = unpack(row.document)
    return found


def stored_advice(session: Session, axes: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Advice of the newest assessments, by the name of the axis, where its history has not changed since."""
    newest = and_(Explanation.axis_id == Axis.id, Explanation.assessment_id == Axis.assessment_id)
    rows = session.execute(
        select(Axis.name, Explanation.document)
        .join(Explanation, newest)
        .where(Axis.changed_at.is_(None), Axis.name.in_(axes))
    )
    return {name: _actions(document) for name, document in rows}


@lru_cache(maxsize=1024)
def _actions(document: bytes) -> tuple[str, ...]:
    """Advice in a stored explanation."""
    return tuple(unpack(document)["actions"])
