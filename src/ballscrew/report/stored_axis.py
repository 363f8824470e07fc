"""An axis of a store as a report shows it: its state, and the blocks of its pages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from ballscrew.base.words import NONE, interval_words, life_words, percent, plural
from ballscrew.monitoring.epochs import moment
from ballscrew.prognosis.monitor import Monitored
from ballscrew.report.blocks import (
    TROUBLE,
    UNKNOWN,
    DrawnPicture,
    PageHeading,
    ReportBlock,
    ReportTable,
    SectionHeading,
    Sentences,
    StateWords,
    TableCell,
    TableColumn,
    listed,
    short_name,
)
from ballscrew.report.canvas import FigureBase
from ballscrew.report.stored_words import (
    RUN_WIDTH,
    changes,
    exclusions,
    stored_headline,
    utc_minute,
    with_minutes,
)
from ballscrew.report.what_to_do import WAIT

_NEWEST, _NEWEST_BRIEF = 26, 6  # runs in the table
_BECAUSE = {
    "overdue": "its run is overdue",
    "old": "last run is old",
    "no run": "it has no run",
    "future": "its newest run is in the future",
    "set aside": "its newest run does not count",
    "reset": "it was repaired after its newest run",
}
_OLD = ("overdue", "old")
_TROUBLES = {"silence": "overdue", "measurement": "bad measurement", "assessment": "cannot be assessed"}
_DAYS_FROM = 48  # hours
_ROWS = (2.0, 0.9, 1.3)  # heights of the rows of a picture that is less high than by itself
_DAY = len("2026-01-31")
_LEAST_SHOWN = 0.001  # probability of a cause
_TREND_CAPTION = "Axial stiffness of every run by the newest assessment, which is not of the present history"
_CAPTION = "Preload of every run, evidence of a loss, stage, causes and forecast"


@dataclass(frozen=True, eq=False)
class StoredAxis:
    """What a store has about an axis.

    Parameters
    ----------
    document : dict
        As ``store show --json`` prints it, with its lamp and when the next run is due.
    place : tuple of str
        Machine and site, as far as they are known.
    alarms : tuple of dict
        Its alarms and the troubles with its measurements, those that stand first.
    standing : int
        How many of these stand.
    epochs : tuple of dict
        By the newest assessment.
    made : dict
        How the newest assessment was made; empty without one.
    explained : dict
        What the newest assessment says beside its numbers; empty without one.
    monitored : Monitored or None
        The newest assessment; None where there is none of the present history by this version.
    why : str
        Sentence why it is None.
    """

    document: dict[str, Any]
    place: tuple[str, ...]
    alarms: tuple[dict[str, Any], ...]
    standing: int
    epochs: tuple[dict[str, Any], ...]
    made: dict[str, Any]
    explained: dict[str, Any]
    monitored: Monitored | None
    why: str

    @property
    def name(self) -> str:
        """Name of the axis."""
        return str(self.document["axis"])

    @property
    def preload_alarms(self) -> tuple[dict[str, Any], ...]:
        """Alarms of the axis that stand."""
        return tuple(each for each in self.alarms[: self.standing] if each["kind"] == "axis")

    @property
    def troubles(self) -> tuple[dict[str, Any], ...]:
        """Troubles with its measurements that stand."""
        return tuple(each for each in self.alarms[: self.standing] if each["kind"] != "axis")

    @property
    def counting(self) -> list[dict[str, Any]]:
        """Runs that count and have a time, the newest last."""
        return [run for run in self.document["runs"] if run["counts"] and run["measured_at"]]


def state_words(axis: StoredAxis) -> StateWords:
    """State of an axis by its lamp: never normal where nothing is known."""
    document = axis.document
    lamp, state = document["lamp"], document["last_state"] or document["state"]
    if lamp["because"] is not None and lamp["state"] == UNKNOWN:
        return StateWords(
            UNKNOWN, f"unknown, {_BECAUSE[lamp['because']]}; {state} before{_waiting(document)}"
        )
    if lamp["state"] == UNKNOWN:
        return StateWords(UNKNOWN, f"unknown, {state} before" if document["last_state"] else UNKNOWN)
    words = str(lamp["state"])
    if document["urgency"] == "now":
        words += ", urgent"
    if document["reasons"]:
        words += " (suspect)"
    return StateWords(lamp["state"], words + _waiting(document))


def _waiting(document: dict[str, Any]) -> str:
    """How many runs wait for their analysis or assessment."""
    return f", {plural(document['waiting'], 'run')} waiting" if document["waiting"] else ""


def measurement_words(axis: StoredAxis) -> str:
    """What is wrong with the measurements of an axis, else the verdict on its newest run."""
    found = []
    for each in axis.troubles:
        kind = _TROUBLES.get(each["kind"], each["kind"])
        found.append(f"{kind} since {utc_minute(each['began_at'])[:_DAY]}")
    if found:
        return "; ".join(found)
    if not axis.counting:
        return NONE
    because = axis.document["measurement"]["because"]
    if because in (*_OLD, "future"):
        return "no recent run"
    return because or axis.counting[-1]["quality"] or "no result"


def due_words(axis: StoredAxis) -> str:
    """When the next run of an axis is due."""
    due = axis.document["due_at"]
    because = axis.document["measurement"]["because"]
    if because == "future":
        return UNKNOWN
    if due is None:
        return "no schedule"
    words = _unbroken(utc_minute(due))
    if because == "overdue":
        return f"{words}, overdue"
    return words


def last_words(axis: StoredAxis, at: datetime) -> str:
    """Time of the newest run of an axis, and how long ago that is."""
    if not axis.counting:
        return "no run"
    newest = axis.counting[-1]["measured_at"]
    hours = (at - moment(newest, "a run")).total_seconds() / 3600
    if hours < 0:
        return f"{utc_minute(newest)}, in the future"
    ago = f"{hours:.0f} h ago"
    if hours >= _DAYS_FROM:
        ago = f"{hours / 24:.0f} d ago"
    return f"{_unbroken(utc_minute(newest))} {_unbroken(ago)}"


def _unbroken(text: str) -> str:
    """A text that stays on one line."""
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def axis_blocks(axis: StoredAxis, at: datetime, anchor: str, *, brief: bool = False) -> list[ReportBlock]:
    """Pages of an axis.

    Parameters
    ----------
    axis : StoredAxis
        The axis.
    at : datetime
        Time of the report.
    anchor : str
        Name of the page in the file.
    brief : bool
        Whether it contains only what the state rests on, which is one page or two.

    Returns
    -------
    list of ReportBlock
        First what to do and the picture, then alarms, events, runs and how the numbers were made.
    """
    place = [short_name(each) for each in axis.place]
    below = " · ".join([*place, f"as of {at:%Y-%m-%d %H:%M} UTC", "all times are UTC"])
    blocks: list[ReportBlock] = [PageHeading(short_name(axis.name), below, anchor)]
    blocks += [_conclusion(axis), SectionHeading("What to do"), *listed(_actions(axis))]
    blocks.append(_key_numbers(axis, at))
    blocks += _picture(axis)
    for title, tables in _sections(axis, brief):
        if tables:
            blocks += [SectionHeading(title), *tables]
    return blocks


def _sections(axis: StoredAxis, brief: bool) -> Iterator[tuple[str, list[ReportBlock]]]:
    """Headings of an axis with what is below them."""
    runs = axis.document["runs"]
    alarms, newest = axis.alarms, _NEWEST
    if brief:
        alarms, newest = axis.alarms[: axis.standing], _NEWEST_BRIEF
    yield "Alarms and actions", _alarms(alarms)
    yield "Forecast", listed(_forecast(axis))
    yield "Causes", _causes(axis)
    yield "Doubts", listed(_doubts(axis))
    if not brief:
        yield "Events, exclusions and corrections", _events(axis.document)
        yield "Epochs", _epochs(axis.epochs)
    yield _runs_title(runs, newest), _runs(runs[-newest:])
    if not brief:
        yield "How the numbers were made", _made(axis)


def _picture(axis: StoredAxis) -> list[ReportBlock]:
    """Picture of the newest assessment, or of the stored states of the runs."""

    def draw(figure: FigureBase) -> None:
        from ballscrew.report.monitor_figure import draw_panels

        if axis.monitored is not None:
            draw_panels(figure, axis.monitored, _ROWS)

    def draw_runs(figure: FigureBase) -> None:
        from ballscrew.report.trend_figure import draw_trend

        draw_trend(figure.subplots(), axis.document)

    if axis.monitored is not None:
        return [DrawnPicture(draw, _CAPTION, 150.0)]
    if any(run["stiffness"] for run in axis.counting):
        return [DrawnPicture(draw_runs, _TREND_CAPTION, 75.0)]
    return []


def _conclusion(axis: StoredAxis) -> StateWords:
    """State in one line; that of the newest assessment, unless nothing is known since."""
    state = state_words(axis)
    if not axis.explained:
        if axis.document["waiting"] is not None and state.lamp != UNKNOWN:
            return state
        return StateWords(state.lamp, stored_headline(axis.document).removeprefix(f"{axis.name}: "))
    words = axis.explained["headline"].removeprefix(f"{axis.name}: ")
    because = axis.document["lamp"]["because"]
    if because is not None:
        words = f"UNKNOWN, {_BECAUSE[because]}; before: {words}"
    return StateWords(state.lamp, with_minutes(words))


def _actions(axis: StoredAxis) -> list[str]:
    found = [str(each["text"]) for each in axis.document["to_do"]]
    if axis.why:
        found = [*(each for each in found if each != WAIT), axis.why]
    return list(map(with_minutes, found))


def _key_numbers(axis: StoredAxis, at: datetime) -> ReportTable:
    document = axis.document
    nut = None
    for run in axis.counting:
        if run["stiffness"] is not None:
            nut = run["nut"]
    columns = (
        TableColumn("preload by stiffness (95 %)", 1.7, right=True),
        TableColumn("preload of the nut (95 %)", 1.7, right=True),
        TableColumn("remaining life, days (90 %)", 1.5, right=True),
        TableColumn("last run", 1.7),
        TableColumn("next run due", 1.4),
        TableColumn("measurement", 1.6),
    )
    row = (
        interval_words(document["stiffness"]), interval_words(nut), life_words(document["rul_days"]),
        last_words(axis, at), due_words(axis), measurement_words(axis),
    )  # fmt: skip
    return ReportTable(columns, (row,))


def _alarms(alarms: Sequence[dict[str, Any]]) -> list[ReportBlock]:
    columns = (
        TableColumn("alarm", 1.3), TableColumn("state", 1.0), TableColumn("began", 1.2),
        TableColumn("raised", 1.2), TableColumn("ended", 1.2), TableColumn("text", 3.2),
        TableColumn("actions", 2.8),
    )  # fmt: skip
    rows: list[tuple[TableCell, ...]] = []
    for each in alarms:
        kind = StateWords(TROUBLE, _TROUBLES.get(each["kind"], each["kind"]))
        if each["kind"] == "axis":
            kind = StateWords("alarm", "preload")
        times = [utc_minute(each[name]) for name in ("began_at", "raised_at", "ended_at")]
        actions = "; ".join(map(_action, each["actions"])) or NONE
        rows.append((kind, each["state"], *times, with_minutes(each["text"]), actions))
    return _table(columns, rows)


def _action(action: dict[str, Any]) -> str:
    words = f"{action['action']} {utc_minute(action['at'])} by {action['by']}"
    if action["until"]:
        words += f" until {utc_minute(action['until'])}"
    return f"{words}: {action['text']}" if action["text"] else words


def _table(columns: tuple[TableColumn, ...], rows: Iterable[tuple[TableCell, ...]]) -> list[ReportBlock]:
    found = tuple(rows)
    return [ReportTable(columns, found)] if found else []


def _forecast(axis: StoredAxis) -> list[str]:
    prognosis = axis.explained.get("prognosis") or {}
    return list(prognosis.get("statement", ()))


def _causes(axis: StoredAxis) -> list[ReportBlock]:
    columns = (TableColumn("cause", 1.2), TableColumn("probability", 0.7, right=True), TableColumn("", 5.0))
    rows = []
    for each in axis.explained.get("state", {}).get("causes", ()):
        probability = f"below {percent(_LEAST_SHOWN)}"
        if each["probability"] >= _LEAST_SHOWN:
            probability = percent(each["probability"])
        rows.append((each["cause"], probability, each["evidence"]))
    return _table(columns, rows)


def _doubts(axis: StoredAxis) -> list[str]:
    found = [f"Measurement: {each['text']}" for each in axis.troubles]
    if not axis.explained:
        return [*map(with_minutes, found), *(f"Suspect: {reason}" for reason in axis.document["reasons"])]
    state = axis.explained["state"]
    found += [f"Suspect: {reason}" for reason in state["reasons"]]
    found += [f"Nut: {reason}" for reason in state["nut_reasons"]]
    if state["not_judged"]:
        found.append(f"Not judged: {state['not_judged']}")
    return list(map(with_minutes, [*found, *state["notes"]]))


def _events(document: dict[str, Any]) -> list[ReportBlock]:
    columns = (TableColumn("event", 1.0), TableColumn("what", 1.3), TableColumn("text", 6.0))
    rows = [(utc_minute(each["at"]), each["kind"], each["text"] or NONE) for each in document["events"]]
    return [*_table(columns, rows), *listed([*exclusions(document), *changes(document)])]


def _epochs(epochs: Sequence[dict[str, Any]]) -> list[ReportBlock]:
    columns = (
        TableColumn("epoch", 0.5, right=True), TableColumn("begins", 1.2), TableColumn("ends", 1.2),
        TableColumn("begun by", 2.4), TableColumn("reference run", 1.2), TableColumn("alarm began", 1.2),
    )  # fmt: skip
    rows = []
    for each in epochs:
        begins = "first run"
        if each["begins"]:
            begins = utc_minute(each["begins"])
        times = (begins, utc_minute(each["ends"]))
        reference = (each["reference"] or NONE)[:RUN_WIDTH]
        rows.append(
            (str(each["number"] + 1), *times, each["cause"] or NONE, reference, utc_minute(each["alarm_at"]))
        )
    return _table(columns, rows)


def _runs_title(runs: Sequence[dict[str, Any]], newest: int) -> str:
    if len(runs) > newest:
        return f"Newest {newest} of {plural(len(runs), 'run')}"
    return plural(len(runs), "run").capitalize()


def _runs(runs: Sequence[dict[str, Any]]) -> list[ReportBlock]:
    columns = (
        TableColumn("measured at", 1.3), TableColumn("state", 1.2), TableColumn("measurement", 0.9),
        TableColumn("preload by stiffness (95 %)", 1.75, right=True),
        TableColumn("preload of the nut (95 %)", 1.75, right=True), TableColumn("load, kg", 0.7, right=True),
        TableColumn("temperature, °C", 1.1, right=True), TableColumn("run", 1.2),
    )  # fmt: skip
    return _table(columns, (_run(run) for run in reversed(runs)))


def _run(run: dict[str, Any]) -> tuple[TableCell, ...]:
    state = StateWords(run["state"], run["state"])
    if not run["counts"]:
        state = StateWords(UNKNOWN, "does not count")
    return (
        utc_minute(run["measured_at"]), state, run["quality"] or "no result",
        interval_words(run["stiffness"]), interval_words(run["nut"]), _number(run["mass_kg"]),
        _number(run["temperature_C"]), run["run"][:RUN_WIDTH],
    )  # fmt: skip


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:g}"


def _made(axis: StoredAxis) -> list[ReportBlock]:
    columns = (TableColumn("", 1.0), TableColumn("", 6.0))
    rows = tuple(_made_rows(axis))
    hint = "'ballscrew store show RUN' prints the recordings, readers, documents and settings of a run."
    return [*_table(columns, rows), Sentences(hint, soft=True)]


def _made_rows(axis: StoredAxis) -> Iterator[tuple[str, str]]:
    method = axis.document["method"]
    if method is not None:
        yield "analysis", f"method {method['name']}, revision {method['revision']}"
    made = axis.made
    if made:
        yield (
            "assessment",
            f"ballscrew {made['version']}, {utc_minute(made['made_at'])}, of {made['runs']} runs",
        )
        yield "its inputs", f"digest {made['inputs']}"
        yield "model", f"digest {made['model_digest']}"
        settings = made["settings"]
        detection, failure = settings.get("settings", {}), settings.get("failure", {})
        words = [f"false alarms per year {_number(detection.get('false_alarms_per_year'))}"]
        words.append(f"end of life at P/P₀ {_number(failure.get('preload_ratio'))}")
        if settings.get("largest_load") is not None:
            words.append(f"largest load {_number(settings['largest_load'])} N")
        if settings.get("accept"):
            words.append(f"accepted doubts {', '.join(settings['accept'])}")
        yield "settings", "; ".join(words)
    if axis.counting:
        yield "newest run", axis.counting[-1]["run"]
