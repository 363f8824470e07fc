"""The picture and the words of ``monitor``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import at, history, unloading, worn

from ballscrew.monitoring.epochs import Event
from ballscrew.monitoring.history_causes import HistoryCause
from ballscrew.prognosis.monitor import monitor
from ballscrew.recording.quality.finding import Quality
from ballscrew.report.canvas import save_figure
from ballscrew.report.monitor_figure import draw_monitor
from ballscrew.report.monitor_words import AGAIN_SOON, _remaining, advice, headline, lamp

DAYS = tuple(float(day) for day in range(0, 60, 3))


@pytest.fixture(autouse=True)
def _matplotlib():
    pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def alarmed():
    runs = history(DAYS, lambda day: worn(9.0, 60.0)(day) if day < 30 else worn(42.0, 80.0)(day))
    events = [Event(at(29.0), "nut replaced", "$new$ nut"), Event(at(50.0), "note")]
    return monitor(runs, calibrated(), events=events)


def test_the_same_file_twice(alarmed, tmp_path):
    for name in ("one.png", "two.png"):
        save_figure(draw_monitor(alarmed), tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


def test_it_shows_runs_events_and_both_alarms(alarmed):
    figure = draw_monitor(alarmed)
    preload, evidence, stage, causes = figure.axes
    notes = [text.get_text() for text in preload.texts]
    assert "nut replaced" in notes
    assert "note" in notes
    assert sum(text.startswith("alarm ") for text in notes) == 2
    assert "alarm" in [text.get_text() for text in preload.get_legend().get_texts()]
    assert max(float(max(line.get_ydata())) for line in evidence.lines) <= 100
    assert stage.get_title(loc="left") == "Wear stage"
    assert next(t.get_text() for t in causes.get_yticklabels()) == "nut or bearing"


def test_a_young_axis_has_a_picture_too(tmp_path):
    for count in (1, 3):
        result = monitor(history(DAYS[:count]), calibrated())
        figure = draw_monitor(result)
        save_figure(figure, tmp_path / f"{count}.png")
        assert [t.get_text() for axes in figure.axes[-2:] for t in axes.texts] == ["not judged"] * 2
        learnt = {1: "1 of 3 good runs", 3: "the baseline is complete: the next good run will be assessed"}
        assert f"NOT JUDGED: learning, {learnt[count]}" in headline(result)
    assert any("2 times more" in line for line in advice(monitor(history(DAYS[:1]), calibrated())))


def test_the_line_states_state_day_and_remaining_life(alarmed):
    line = headline(alarmed)
    assert lamp(alarmed) == "alarm"
    assert line.startswith(f"bench: ALARM since {alarmed.state.alarm_at[:10]}: ")
    assert "axial stiffness as with" in line
    assert "% of the preload on 20" in line
    first, second = advice(alarmed)[:2]
    assert "Check the support bearing" in first
    assert "order a nut" in second


def test_a_sound_axis_asks_for_nothing():
    result = monitor(history(DAYS), calibrated())
    assert "NORMAL" in headline(result)
    assert "days" not in headline(result)
    assert advice(result) == ("Nothing to do: run the test again as planned.",)


def test_one_thing_is_to_be_done_first(alarmed):
    """The likeliest cause comes before any order, and stiffening, which wear cannot cause, before both."""
    state = alarmed.state
    causes = (HistoryCause("bearing", 0.9, "softening"), HistoryCause("nut", 0.1, "softening"))
    bearing = replace(state, causes=causes)
    first, second = advice(replace(alarmed, state=bearing))[:2]
    assert first == "Check the bearing first: it is the most likely cause, not the nut."
    assert second.startswith("If that is not it, order a nut")
    both = replace(state, causes=(HistoryCause("both", 0.9, ""), HistoryCause("nut", 0.1, "")))
    assert "Check the support bearing too" in advice(replace(alarmed, state=both))[1]
    newest = replace(state.charts[-1], stiffer=np.ones_like(state.charts[-1].stiffer))
    actions = advice(replace(alarmed, state=replace(bearing, charts=(*state.charts[:-1], newest))))
    assert actions[0].startswith("Order nothing yet")
    assert len(actions) == 1


def test_runs_that_were_set_aside_are_in_the_first_line_with_their_number_and_reason():
    bad = history((30.0, 33.0), seed=9, quality=Quality("bad", ("clipped",)))
    result = monitor([*history(DAYS[:8]), *bad], calibrated())
    assert result.state.runs[-1].state == "suspect"
    assert result.state.urgency == "unknown"
    assert lamp(result) == "suspect"
    line = headline(result)
    assert line.startswith(
        "bench: NOT JUDGED: the newest 2 runs do not count (clipped); NORMAL on 2026-01-22"
    )
    assert advice(result) == ("Correct what makes the newest run not count, then run the test again.",)


def test_a_run_without_an_estimate_is_marked_outside_the_scale_and_in_words():
    runs = [*history(DAYS[:6]), *history((18.0,), seed=9, quality=Quality("bad", ("clipped",)))]
    axes = draw_monitor(monitor(runs, calibrated()), "bench, January").axes[0]
    (crosses,) = [line for line in axes.lines if line.get_label() == "no estimate"]
    assert list(crosses.get_ydata()) == [pytest.approx(-0.0575)]
    assert crosses.get_transform() == axes.get_xaxis_transform()
    assert "no estimate" in [text.get_text() for text in axes.texts]
    assert axes.figure.get_suptitle() == "bench, January"


def test_a_worn_out_nut_is_urgent_with_the_date_of_its_run_and_its_stage():
    runs = history(DAYS[:10], worn(9.0, 60.0))
    result = monitor(
        [*unloading(1.0, runs), *unloading(4.0, history((30.0,), seed=9), refused=True)], calibrated()
    )
    state = result.state
    assert (state.state, state.urgency, state.set_aside) == ("alarm", "now", ())
    assert state.stage is not None
    line = headline(result)
    assert "URGENT: the nut's preload is below " in line
    assert "% on 2026-01-31" in line
    assert "days of life" not in line
    assert advice(result)[0].startswith("Replace or preload the nut now")
    legend = draw_monitor(result).axes[0].get_legend()
    assert "nut below" in [text.get_text() for text in legend.get_texts()]


def test_a_suspect_run_is_not_to_be_repeated_in_the_same_way():
    runs = [*history(DAYS[:1]), *history(DAYS[1:2], seed=9, quality=Quality("bad", ("clipped",)))]
    assert advice(monitor(runs, calibrated()))[0].startswith("Correct first")


def test_a_life_of_less_than_a_day_is_not_at_least_0_days() -> None:
    assert _remaining(0.4, 18.2, 60.0) == "; the end of life may have been reached (about 18 days remain)"
    assert _remaining(0.6, 18.2, 60.0) == "; at least 1 days of life remain (about 18, at most 60)"
    assert _remaining(0.4, None, None) == "; at least 0 days of life remain, the latest end is open"


def test_the_end_of_life_is_a_bar_from_the_earliest_to_the_latest_day(alarmed):
    prognosis = alarmed.prognosis
    assert prognosis is not None
    lengths = []
    for latest, words in ((None, "(10 to open)"), (12.0, "(10 to 12)"), (13.0, "(10 to 13)")):
        days = {**dict.fromkeys(prognosis.rul_days), 0.05: 10.0, 0.5: 11.0, 0.95: latest}
        axes = draw_monitor(replace(alarmed, prognosis=replace(prognosis, rul_days=days))).axes[0]
        assert f"end of life: 11 days {words}" in [text.get_text() for text in axes.texts]
        (bar,) = [line for line in axes.lines if line.get_linewidth() == 3 and len(line.get_xdata()) == 2]
        first, last = bar.get_xdata()
        lengths.append((last - first).total_seconds() / 86_400)
    assert lengths[0] > lengths[2]
    assert lengths[1:] == pytest.approx([2.0, 3.0])


def test_runs_of_a_long_history_are_thin(alarmed, monkeypatch):
    def sizes():
        bars = [bar for bar in draw_monitor(alarmed).axes[0].containers if bar.get_label() == "alarm"]
        return bars[0].lines[0].get_markersize(), bars[0].lines[2][0].get_linewidths()[0]

    thick = sizes()
    monkeypatch.setattr("ballscrew.report.monitor_figure._MANY", len(alarmed.state.runs) - 1)
    assert all(now < before for now, before in zip(sizes(), thick, strict=True))


def test_a_time_without_a_zone_is_utc():
    def naive(run):
        return replace(run, reading=replace(run.reading, measured_at=run.reading.measured_at[:19]))

    result = monitor(history(DAYS[:6]), calibrated())
    unzoned = replace(result, state=replace(result.state, runs=tuple(map(naive, result.state.runs))))
    times = []
    for each in (result, unzoned):
        (bars,) = [bar for bar in draw_monitor(each).axes[0].containers if bar.get_label() == "normal"]
        times.append(list(bars.lines[0].get_xdata()))
    assert times[0] == times[1]


def test_an_axis_without_any_assessed_run_has_a_line_without_an_estimate():
    result = monitor(history(DAYS[:2], quality=Quality("bad", ("clipped",))), calibrated())
    assert result.state.assessed is None
    line = headline(result)
    assert line.startswith("bench: NOT JUDGED: ")
    assert "%" not in line


def test_a_nut_that_is_probably_in_stage_two_is_to_be_replaced(alarmed):
    state = alarmed.state
    words = "The preload is probably gone: expect backlash, and replace or preload the nut."
    for probability, gone in ((0.51, True), (0.49, False)):
        stage = replace(state.stage, I=1 - probability, II=probability)
        assert (words in advice(replace(alarmed, state=replace(state, stage=stage)))) == gone


def test_two_runs_on_a_day_are_one_of_the_baseline():
    result = monitor(history((0.0, 0.1)), calibrated())
    (action,) = advice(result)
    assert action == (
        "Run the test 2 times more in the same way, on another day: a second run on a day repeats the "
        "first. A baseline takes three good runs."
    )


def test_a_watch_asks_for_another_run_soon(alarmed):
    watched = replace(alarmed, state=replace(alarmed.state, state="watch", causes=()))
    assert advice(watched) == (AGAIN_SOON,)
    bearing = replace(watched.state, causes=(HistoryCause("bearing", 0.9, "softening"),))
    first, second = advice(replace(watched, state=bearing))
    assert (first, "the bearing" in second) == (AGAIN_SOON, True)


def test_an_open_life_is_not_in_the_line(alarmed):
    prognosis = alarmed.prognosis
    assert prognosis is not None
    line = headline(alarmed)
    assert "of life" in line
    days = dict.fromkeys(prognosis.rul_days)
    without = headline(replace(alarmed, prognosis=replace(prognosis, rul_days=days)))
    assert "of life" not in without
    assert line.startswith(without)
