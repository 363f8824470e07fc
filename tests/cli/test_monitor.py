"""``ballscrew monitor``."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from inspect import signature
from pathlib import Path

import pandas as pd
import pytest
from tests.estimation.made_runs import calibrated
from tests.monitoring.histories import at, history, worn

from ballscrew.base.errors import ALARM, DONE, REFUSED, UNASSESSED, WATCH
from ballscrew.base.jsonfile import write_json
from ballscrew.calibration.calibrated_axis import Doubt
from ballscrew.calibration.modelfile import write_model
from ballscrew.cli import model_app
from ballscrew.cli.monitor import health_status, print_monitored
from ballscrew.modal.run import Run
from ballscrew.monitoring.detection.settings import MonitorSettings
from ballscrew.monitoring.epochs import Event
from ballscrew.prognosis.monitor import monitor
from ballscrew.recording.quality.finding import Quality

pytestmark = pytest.mark.usefixtures("few_members")

DAYS = tuple(float(day) for day in range(0, 42, 3))
EVENTS = '[[events]]\nat = 2026-01-20T08:00:00Z\nkind = "note"\ntext = "looked at"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, fourteen runs of an axis that wears from day 21 on, and a bad one."""
    path = tmp_path_factory.mktemp("monitor")
    write_model(calibrated(), path / "model.json")
    for index, run in enumerate(history(DAYS, worn(21.0, 80.0))):
        (path / f"run{index:02d}.json").write_text(write_json(run.to_json()), encoding="utf-8")
    bad = history([60.0], seed=9, quality=Quality("bad", ("clipped",)))[0]
    (path / "bad.json").write_text(write_json(bad.to_json()), encoding="utf-8")
    (path / "events.toml").write_text(EVENTS, encoding="utf-8")
    return path


def runs(folder: Path) -> list[Path]:
    return sorted(folder.glob("run*.json"))


def test_printed_state_and_remaining_life(ballscrew, folder: Path) -> None:
    outcome = ballscrew("monitor", *runs(folder), "--model", folder / "model.json", "--duty", "10 km")
    assert outcome.status == 0, outcome.err
    words = " ".join(outcome.out.split())
    assert "ALARM since 2026-0" in words
    assert "Check the support bearing" in words
    assert "axial stiffness as with" in words
    assert "Stage I" in words
    assert "Cause: nut or bearing" in words
    assert "In travel, at 10000 m a day" in words
    assert max(map(len, outcome.out.splitlines()[1:])) <= 100  # the first line is that of a mail or a log
    assert "…" not in outcome.out


def test_remaining_life_in_the_counters_of_a_file(ballscrew, folder: Path, tmp_path: Path) -> None:
    duty = tmp_path / "duty.csv"
    rows = [f"2026-01-{day:02d},{400_000 * day},{8 * day}" for day in (1, 15, 31)]
    duty.write_text("\n".join(["date,revolutions,hours", *rows, "2026-03-01,24000000,480"]), encoding="utf-8")
    outcome = ballscrew("monitor", *runs(folder), "--model", folder / "model.json", "--duty", duty)
    assert outcome.status == 0, outcome.err
    words = " ".join(outcome.out.split())
    assert "In revolutions of the screw: not before" in words
    assert "In hours of operation: not before" in words
    duty.write_text("date,hours\n2024-01-01,1\n2024-06-01,2\n", encoding="utf-8")
    outcome = ballscrew("monitor", *runs(folder), "--model", folder / "model.json", "--duty", duty)
    assert outcome.status == 2
    assert "must cover them to within 7 days" in outcome.err
    assert outcome.err.count("\n") == 1


def test_json_and_picture(ballscrew, folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    picture = tmp_path / "axis.png"
    outcome = ballscrew(
        "monitor", *runs(folder), "--model", folder / "model.json", "--events", folder / "events.toml",
        "--json", "--plot", picture,
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    document = outcome.document
    assert document["state"] == "alarm"
    assert document["alarm_at"] == next(r["measured_at"] for r in document["runs"] if r["state"] == "alarm")
    assert document["epochs"][0]["events"][0]["kind"] == "note"
    assert picture.stat().st_size > 20_000


def test_more_false_alarms_come_sooner(ballscrew, folder: Path) -> None:
    def first(rate: str) -> int:
        outcome = ballscrew(
            "monitor", *runs(folder), "--model", folder / "model.json", "--json", "--false-alarms", rate
        )
        return [row["state"] for row in outcome.document["runs"]].index("alarm")

    assert first("3") <= first("0.1") <= first("0.001")


def test_a_bad_newest_run_is_refused_and_the_others_are_reported(ballscrew, folder: Path) -> None:
    outcome = ballscrew("monitor", *runs(folder), folder / "bad.json", "--model", folder / "model.json")
    assert outcome.status == 1
    assert "clipped" in outcome.err
    assert "ALARM" in outcome.out


def asked_of(folder: Path) -> str:
    """The time of the newest run."""
    times = [Run.read(path).measured_at for path in folder.glob("run*.json")]
    return max(time for time in times if time is not None)


def test_a_run_that_stands_out_is_asked_for_once_more(ballscrew, folder: Path, tmp_path: Path) -> None:
    for index, run in enumerate(history(range(18), outliers={17: -6e-4})):
        (tmp_path / f"run{index:02d}.json").write_text(write_json(run.to_json()), encoding="utf-8")
    asked = ballscrew("monitor", *runs(tmp_path), "--model", folder / "model.json")
    outcome = " ".join(asked.out.split())
    newest = asked_of(tmp_path)
    assert f"→ Run the test again within half a day of the newest run, {newest}: one run cannot" in outcome
    assert "as planned" not in asked.out
    never = ballscrew("monitor", *runs(tmp_path), "--model", folder / "model.json", "--repeats", "0")
    assert "again within half a day" not in " ".join(never.out.split())


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--false-alarms", "0"), "false_alarms_per_year"),
        (("--repeats", "-1"), "repeats_per_year"),
        (("--end", "1.5"), "below 1"),
        (("--duty", "3 kg"), "--duty"),
        (("--duty", "0 m"), "more than 0"),
        (("--duty", "12"), "give its unit"),
        (("--duty", "none.csv"), "cannot be read"),
        (("--largest-load", "-1 kN"), "more than 0"),
        (("--baseline-runs", "2"), "baseline_runs"),
        (("--plot", "x.doc"), "must end in"),
    ],
)
def test_impossible_options_are_one_sentence(ballscrew, folder: Path, more, message: str) -> None:
    outcome = ballscrew("monitor", *runs(folder)[:4], "--model", folder / "model.json", *more)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.err.count("\n") == 1


def test_events_that_are_none(ballscrew, folder: Path, tmp_path: Path) -> None:
    for text in (
        '[[events]]\nat = "soon"\nkind = "note"\n',
        '[[events]]\nat = 2026-01-01\nkind = "x"\n',
        "[[",
    ):
        file = tmp_path / "events.toml"
        file.write_text(text, encoding="utf-8")
        outcome = ballscrew("monitor", runs(folder)[0], "--model", folder / "model.json", "--events", file)
        assert outcome.status == 2
        assert outcome.err.count("\n") == 1


def test_a_suspect_calibration_is_in_the_headline_until_it_is_accepted(
    ballscrew, folder: Path, tmp_path: Path
) -> None:
    model = tmp_path / "doubtful.json"
    write_model(replace(calibrated(), reasons=(Doubt("rigidity", "too stiff"),)), model)
    common = ("monitor", *runs(folder), "--model", model)
    words = " ".join(ballscrew(*common).out.split())
    assert "(suspect)" in words
    assert "suspect: the calibration is suspect (rigidity): too stiff" in words
    accepted = ballscrew(*common, "--accept", "rigidity")
    words = " ".join(accepted.out.split())
    assert "(suspect)" not in words
    assert "accepted (rigidity): too stiff" in words
    document = ballscrew(*common, "--accept", "rigidity", "--json").document
    assert (document["verdict"], document["made"]["settings"]["accept"]) == ("good", ["rigidity"])
    assert ballscrew(*common, "--accept", "misfit").status == 2


def test_the_exit_code_is_the_state_where_it_is_asked_for(ballscrew, folder: Path) -> None:
    common = ("--model", folder / "model.json", "--json", "--exit-code")
    assert ballscrew("monitor", *runs(folder), folder / "bad.json", *common).status == ALARM
    assert ballscrew("monitor", *runs(folder)[:2], *common).status == UNASSESSED


def test_errors_name_the_files(ballscrew, folder: Path, tmp_path: Path) -> None:
    known, *_ = runs(folder)
    document = json.loads(known.read_text(encoding="utf-8"))
    without_time, copy = tmp_path / "timeless.json", tmp_path / "copy.json"
    timeless = document | {"id": "another", "run": document["run"] | {"measured_at": None}}
    for path, content in ((without_time, timeless), (copy, document | {"id": "another"})):
        path.write_text(json.dumps(content), encoding="utf-8")
        outcome = ballscrew("monitor", known, path, "--model", folder / "model.json")
        assert outcome.status == 2
        assert str(path) in outcome.err
        assert document["id"][:12] not in outcome.err


def test_exit_statuses_of_the_states() -> None:
    state = monitor(history(range(8)), calibrated()).state
    assert [health_status(state, status) for status in (DONE, REFUSED)] == [DONE, REFUSED]
    for name, status in (("watch", WATCH), ("alarm", ALARM)):
        assert health_status(replace(state, state=name), REFUSED) == status
    assert health_status(replace(state, state="learning")) == UNASSESSED
    assert health_status(replace(state, reasons=("the calibration is suspect",))) == UNASSESSED
    suspect = replace(state, runs=(*state.runs[:-1], replace(state.runs[-1], state="suspect")))
    assert health_status(suspect) == UNASSESSED


@pytest.mark.parametrize("command", [model_app.monitor, model_app.watch])
def test_the_rate_of_false_alarms_of_a_command_is_that_of_the_settings(command: Callable[..., int]) -> None:
    stated = signature(command).parameters["false_alarms"].default
    assert stated == MonitorSettings().false_alarms_per_year


def test_the_table_of_the_runs_is_exported(ballscrew, folder: Path, tmp_path: Path) -> None:
    common = ("monitor", *runs(folder)[:4], "--model", folder / "model.json", "--export")
    assert ballscrew(*common, tmp_path / "runs.csv").status == 0
    table = pd.read_csv(tmp_path / "runs.csv")
    assert [time[:10] for time in table["measured_at"]] == [at(day)[:10] for day in DAYS[:4]]
    assert ballscrew(*common, tmp_path / "runs.xlsx").status == 2


def test_an_alarm_of_an_earlier_epoch_is_printed_with_what_ended_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    before, after = history(DAYS, worn(15.0, 80.0)), history((45.0, 48.0, 51.0), seed=3)
    events = (Event(at(43.0), "nut replaced", "a new nut"),)
    found = monitor([*before, *after], calibrated(), events=events)
    first, current = found.state.epochs
    assert first.alarm_at is not None
    assert current.alarm_at is None
    print_monitored(found)
    words = " ".join(capsys.readouterr().out.split())
    text = f"An earlier epoch had an alarm on {first.alarm_at[:10]}; it ended with: nut replaced."
    assert words.count("An earlier epoch had an alarm") == 1
    assert text in words
    assert "17 runs, a line between two epochs" in words


def test_why_there_is_no_forecast_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    print_monitored(monitor(history((0.0, 3.0)), calibrated()))
    words = " ".join(capsys.readouterr().out.split())
    assert words.endswith("Remaining life: no forecast, because there are fewer than three good runs.")
    stiffer = history(DAYS[:8], lambda day: 1.0 if day < 12 else 1.5)
    print_monitored(monitor(stiffer, calibrated()))
    words = " ".join(capsys.readouterr().out.split())
    reason = "the newest runs are stiffer than the baseline, which wear cannot explain."
    assert words.endswith(f"Remaining life: no forecast, because {reason}")


def test_the_table_has_the_newest_runs_of_a_long_history(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = monitor(history(DAYS[:7]), calibrated())
    print_monitored(found)
    assert "the newest" not in capsys.readouterr().out
    monkeypatch.setattr("ballscrew.cli.monitor._SHOWN_RUNS", 3)
    print_monitored(found)
    words = " ".join(capsys.readouterr().out.split())
    assert "the newest 3 of 7 runs" in words
    assert at(DAYS[4])[:16] in words
    assert at(DAYS[3])[:16] not in words
    assert "between two epochs" not in words
