"""HTML page of an axis: its state, history and picture in one file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ballscrew.base.errors import InputError
from ballscrew.base.quantity import quantity_numbers
from ballscrew.base.words import interval_words, without_repeats
from ballscrew.monitoring.state import RunState
from ballscrew.prognosis.monitor import Monitored
from ballscrew.report.canvas import check_drawing
from ballscrew.report.monitor_words import advice, headline, lamp
from ballscrew.report.page import html_page, image_of, state_words


def axis_page(monitored: Monitored, names: Mapping[str, str], failures: Sequence[str] = ()) -> str:
    """Page of an axis, with its picture inside.

    Parameters
    ----------
    monitored : Monitored
        Result for the axis.
    names : mapping of str to str
        Name of each run, by its id.
    failures : sequence of str
        Runs that could not be used, a sentence each.

    Returns
    -------
    str
        HTML, the same for the same result; without matplotlib it has no picture.
    """
    state = monitored.state
    doubts = [f"Suspect: {reason}" for reason in state.reasons]
    sentences = [*advice(monitored), *doubts, *state.notes]
    if monitored.prognosis is not None:
        sentences += monitored.prognosis.statement
    sentences += [f"Not used: {failure}" for failure in failures]
    rows = [_row(run, names.get(run.reading.run, run.reading.run[:12])) for run in reversed(state.runs)]
    return html_page(
        f"{state.axis or 'Axis'}: preload of the ball screw",
        list(without_repeats(sentences)),
        _pictures(monitored),
        ["measured at", "state", "preload by stiffness (95 %)", "preload of the nut (95 %)", "run"],
        rows,
        conclusion=headline(monitored),
        lamp=lamp(monitored),
    )


def _pictures(monitored: Monitored) -> list[tuple[str, str]]:
    try:
        check_drawing()
    except InputError:
        return []
    from ballscrew.report.monitor_figure import draw_monitor

    state = monitored.state
    first, last = (run.reading.measured_at[:10] for run in (state.runs[0], state.runs[-1]))
    title = f"{state.axis or 'axis'}, {first} to {last}"  # the page begins with the headline
    image = image_of(draw_monitor(monitored, title))
    return [(image, "Preload of every run, evidence of a loss, and forecast")]


def _row(run: RunState, name: str) -> list[str]:
    return [
        run.reading.measured_at[:16].replace("T", " "),
        state_words(run.state),
        interval_words(quantity_numbers(run.stiffness)),
        interval_words(quantity_numbers(run.relative)),
        name,
    ]
