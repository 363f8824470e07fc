"""Blocks of the report of a store: the fleet, the worst axis first, and the pages of its axes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from itertools import pairwise
from statistics import median

from ballscrew.base.words import NONE, interval_words, life_words
from ballscrew.monitoring.epochs import moment
from ballscrew.report.blocks import (
    UNKNOWN,
    AxisLink,
    PageHeading,
    ReportBlock,
    ReportTable,
    Sentences,
    StateStrip,
    StateWords,
    TableCell,
    TableColumn,
    short_name,
)
from ballscrew.report.stored_axis import (
    StoredAxis,
    axis_blocks,
    due_words,
    last_words,
    measurement_words,
    state_words,
)
from ballscrew.report.stored_words import utc_minute

_YEAR = timedelta(days=365)
_AFTER = timedelta(days=7)  # the newest run, where the year ends with it
_FOLLOWS = 1.5  # times the usual time between two runs: the longest that a state is drawn
_LEAST_PART = 1 / 250  # of a strip
_URGENCY = {
    "alarm": 1, "unloaded": 1, "watch": 3, "suspect": 4, UNKNOWN: 4, "not assessed": 5, "learning": 6,
    "normal": 7,
}  # fmt: skip
_LEGEND = "Strip: state of each run of the year, the higher the worse; a gap is a time without runs."
_SOUND = 6  # urgency from which on an axis needs nothing
_BRIEF = (
    "Axes that need nothing have no page here. 'ballscrew report AXIS' and the report as HTML also contain "
    "their pages, events, epochs, more runs, and how the numbers were made."
)


def urgency_of(axis: StoredAxis) -> tuple[int, str]:
    """Order of an axis among others, the worst first."""
    rank = _URGENCY.get(state_words(axis).lamp, 4)
    if rank > 2 and axis.preload_alarms:
        rank = 2
    elif rank > 5 and axis.troubles:
        rank = 5
    elif axis.document["urgency"] == "now":
        rank = 0
    return rank, axis.name


def report_blocks(
    axes: Sequence[StoredAxis], at: datetime, *, fleet: bool, brief: bool = False
) -> list[ReportBlock]:
    """Blocks of a report.

    Parameters
    ----------
    axes : sequence of StoredAxis
        The axes, the worst first.
    at : datetime
        Time of the report.
    fleet : bool
        Whether a page of all axes comes first.
    brief : bool
        Whether axes that need nothing have no page, and the others one or two.

    Returns
    -------
    list of ReportBlock
        In the order of reading.
    """
    anchors: dict[str, str] = {}
    for number, axis in enumerate(axes, 1):
        if not brief or urgency_of(axis)[0] < _SOUND:
            anchors[axis.name] = f"axis-{number}"
    blocks: list[ReportBlock] = []
    if fleet:
        blocks += _fleet(axes, anchors, at)
        if brief:
            blocks.append(Sentences(_BRIEF, soft=True))
    for axis in axes:
        if axis.name in anchors:
            blocks += axis_blocks(axis, at, anchors[axis.name], brief=brief)
    return blocks


def _fleet(axes: Sequence[StoredAxis], anchors: Mapping[str, str], at: datetime) -> list[ReportBlock]:
    heading = PageHeading("State of the axes", f"as of {at:%Y-%m-%d %H:%M} UTC · all times are UTC", "fleet")
    if not axes:
        return [heading, StateWords(UNKNOWN, "The store has no axis.")]
    begin, end = _period(axes, at)
    period = f"{begin:%Y-%m-%d} to {end:%Y-%m-%d}"
    columns = (
        TableColumn("state", 3.1), TableColumn("axis", 1.9), TableColumn("machine", 2.3),
        TableColumn("preload by stiffness (95 %)", 2.8, right=True),
        TableColumn("remaining life, days (90 %)", 1.9, right=True), TableColumn("last run", 2.65),
        TableColumn("next run due", 2.65), TableColumn("standing alarm", 2.3),
        TableColumn("measurement", 2.15), TableColumn(period, 2.3),
    )  # fmt: skip
    rows = []
    for axis in axes:
        name: TableCell = short_name(axis.name)
        if axis.name in anchors:
            name = AxisLink(short_name(axis.name), anchors[axis.name])
        rows.append(_row(axis, name, at, _strip(axis, begin, end)))
    states = Counter(state_words(axis).lamp for axis in axes)
    counts = [f"{states[state]} {state}" for state in _URGENCY if state in states]
    worst = state_words(axes[0]).lamp
    number = "1 axis" if len(axes) == 1 else f"{len(axes)} axes"
    conclusion = StateWords(worst, f"{number}: {', '.join(counts)}")
    return [heading, conclusion, ReportTable(columns, tuple(rows)), Sentences(_LEGEND, soft=True)]


def _row(axis: StoredAxis, name: TableCell, at: datetime, strip: StateStrip) -> tuple[TableCell, ...]:
    alarms = [f"since {utc_minute(each['began_at'])[:10]}, {each['state']}" for each in axis.preload_alarms]
    return (
        state_words(axis), name, short_name(", ".join(axis.place)) or NONE,
        interval_words(axis.document["stiffness"]), life_words(axis.document["rul_days"]),
        last_words(axis, at), due_words(axis), "; ".join(alarms) or NONE, measurement_words(axis), strip,
    )  # fmt: skip


def _period(axes: Sequence[StoredAxis], at: datetime) -> tuple[datetime, datetime]:
    """The last year; of a store without runs in it, the year until its newest run."""
    newest = []
    for axis in axes:
        newest += [moment(run["measured_at"], "a run") for run in axis.counting[-1:]]
    end = at
    if newest and max(newest) < at - _YEAR:
        end = max(newest) + _AFTER
    return end - _YEAR, end


def _strip(axis: StoredAxis, begin: datetime, end: datetime) -> StateStrip:
    """States of the runs of a period, each until the next run unless that is long after it."""
    runs = [(moment(run["measured_at"], "a run"), run["state"]) for run in axis.counting]
    if not runs:
        return StateStrip(())
    gaps = [(later - earlier) / _YEAR for (earlier, _), (later, _) in pairwise(runs)]
    longest = _LEAST_PART
    if gaps:
        longest = max(_FOLLOWS * median(gaps), _LEAST_PART)
    parts = []
    for (when, state), gap in zip(runs, [*gaps, longest], strict=True):
        first = (when - begin) / (end - begin)
        last = first + max(min(gap, longest), _LEAST_PART)
        if last > 0 and first < 1 and state != UNKNOWN:
            parts.append((max(first, 0.0), min(last, 1.0), state))
    return StateStrip(tuple(parts))
